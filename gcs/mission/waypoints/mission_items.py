"""From a plan to one waypoint mission per vehicle: the items for take-off, timed legs and landing.

Neither ArduPilot nor PX4 has waypoints with an arrival time. Before every leg DO_CHANGE_SPEED therefore sets leg length
/ leg time, or a speed that is corrected for the autopilot (`arrival_times`). All vehicles share the times of their
waypoints.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gcs.autopilots.mission_commands import kept_alt_m, written_alt_m
from gcs.autopilots.traits import Autopilot, FleetFirmware, one_each
from gcs.errors import ScenarioError
from gcs.frames import from_degE7, geodetic_to_ned, ned_to_geodetic, to_degE7
from gcs.mission.machine_independent import SAMPLE_GRID, on_grid
from gcs.mission.model import Altitude, Command, Frame, Home, MissionItem, VehicleMission
from gcs.mission.waypoints.placement import Deviation, SampledFlight, clear_legs, deviation, waypoint_indices
from gcs.mission.waypoints.timed_legs import TimedLegs, rows_with_own_legs, with_drawn_points
from gcs.physics.states import POSITION
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.values.si import local_origin
from gcs.types import Array

# degE7 rounds a waypoint by up to 0.5e-7 deg, 5.6 mm, north and east; ArduPilot's centimetres by 5 mm in height.
ROUNDING_M = 0.0095
# ArduCopter 4.5 ignores lower speeds (WPNAV_WP_SPEED_MIN): slower legs are flown at this speed, then a delay follows.
SPEED_MIN_MPS = 0.2
# Limit on the distance of a constant-speed leg from the plan at the same time, in units of the path tolerance.
TIME_SHARE = 1.5

_SAMPLE_S = 0.1
_STILL_M = 0.01
_SPEED_DECIMALS = 4
_TIME_DECIMALS = 3
_YAW_DECIMALS = 2
_HOME_DECIMALS = (9, 9, 3)
_SURE_DECIMALS = 6  # m: heights in metres and millimetres stay on the same side when they are rounded
_DAY_S = 86400


class ImpossibleMission(ScenarioError):
    """A mission that an autopilot cannot store, or whose rounded waypoints are too far from the plan."""


def timed_legs(plan: Plan) -> TimedLegs:
    """The times of the waypoints of all vehicles, for an autopilot that keeps the commanded speeds exactly.

    The start of the run-up, T0, the route points and the arrival are always among them. Every leg keeps the clearance
    of `limits_of(scenario)` over the ground. Raises `ImpossibleMission` for a tolerance that rounding alone would
    violate.
    """
    tolerance_m = plan.scenario.mission.tolerance_m
    path_m = tolerance_m - ROUNDING_M
    if path_m <= 0:
        text = f"mission.tolerance_m is {tolerance_m} m, and waypoints are rounded by up to {ROUNDING_M} m."
        raise ImpossibleMission(text, hint="set mission.tolerance_m to 0.02 or more")
    rows = rows_with_own_legs(plan)
    kept: list[Array] = []
    errors: list[Deviation] = []
    for phase in plan.phases:
        if phase.name not in (PhaseKind.RUN_UP, PhaseKind.MISSION):
            continue
        t_s = np.linspace(phase.start_s, phase.end_s, 1 + int(np.ceil((phase.end_s - phase.start_s) / _SAMPLE_S)))
        t_s, drawn = with_drawn_points(t_s, plan)
        everyone = on_grid(plan.motion(t_s, slice(None))[0][..., POSITION], SAMPLE_GRID)  # (V, N, 3)
        flown = SampledFlight(t_s, everyone[rows], SPEED_MIN_MPS, clear_legs(plan.scenario, t_s, everyone), drawn)
        indices = waypoint_indices(flown, Deviation(path_m, TIME_SHARE * tolerance_m))
        errors.append(deviation(flown, indices))
        kept.append(t_s[indices])
    return TimedLegs(
        np.unique(np.concatenate(kept)), Deviation(max(e.path_m for e in errors), max(e.time_m for e in errors))
    )


def build_missions(
    plan: Plan,
    legs: TimedLegs | Mapping[Autopilot, TimedLegs] | None = None,
    *,
    firmware: FleetFirmware | None = None,
    altitude: Altitude = Altitude.RELATIVE,
) -> tuple[VehicleMission, ...]:
    """One mission per vehicle, in the plan's order: takeoff, delay, timed legs, hold, land.

    Missions are for `firmware`, or else for the scenario's autopilots. `legs` may differ between autopilots. Relative
    altitudes count from the vehicle's own home, the ground under its pad. Raises `ImpossibleMission` for more items
    than an autopilot stores, and `ScenarioError` for altitudes that it refuses.
    """
    autopilots = one_each(plan.autopilots if firmware is None else firmware, len(plan.sysids))
    for known in set(autopilots):
        if altitude.frame not in known.traits.missions.frames:
            text = f"{known.title} refuses altitudes above the ground in missions."
            raise ScenarioError(text, hint="give --altitude relative or --altitude amsl")
    if not isinstance(legs, Mapping):
        legs = dict.fromkeys(autopilots, legs or timed_legs(plan))
    missions = tuple(_vehicle_mission(plan, row, legs[known], known, altitude) for row, known in enumerate(autopilots))
    for known, mission in zip(autopilots, missions, strict=True):
        refuse_too_many(len(mission.items), known, plan.scenario.mission.tolerance_m)
    return missions


def empty_missions(plan: Plan) -> tuple[VehicleMission, ...]:
    """A mission without items for each vehicle, in the plan's order: what is on board is cleared."""
    places = np.stack(ned_to_geodetic(plan.pads_ned_m, local_origin(plan.scenario)), axis=-1)
    return tuple(VehicleMission(sysid, _home(pad), (), ()) for sysid, pad in zip(plan.sysids, places, strict=True))


def _home(pad: Array) -> Home:
    """A pad's latitude, longitude and altitude (3,), with the decimals of which all machines are certain."""
    return Home(*[round(part, decimals) for part, decimals in zip(pad.tolist(), _HOME_DECIMALS, strict=True)])


def refuse_too_many(count: int, firmware: Autopilot, tolerance_m: float) -> None:
    """Raise `ImpossibleMission` for a mission with more items than the autopilot stores; `count` is without home."""
    count, most = firmware.home_is_item_0 + count, firmware.traits.missions.items_max
    if count > most:
        text = f"A mission has {count} items; {firmware.title} stores at most {most}."
        raise ImpossibleMission(text, hint=f"raise mission.tolerance_m, now {tolerance_m} m")


def _vehicle_mission(plan: Plan, row: int, legs: TimedLegs, firmware: Autopilot, altitude: Altitude) -> VehicleMission:
    """The mission of the vehicle in this row."""
    landing, up_s = plan.phase(PhaseKind.LANDING), plan.airborne_s
    t_s = legs.t_s
    origin = local_origin(plan.scenario)
    states = plan.motion(t_s, slice(row, row + 1))[0][0]
    yaw_ned_rad = states[:, 8]
    if legs.raised_m is not None:
        states[:, 2] -= legs.raised_m
    ends_ned_m = np.stack([plan.landing_points_ned_m[row], plan.pads_ned_m[row]])
    points_ned_m = np.concatenate([states[:, POSITION], ends_ned_m])
    places = np.stack(ned_to_geodetic(points_ned_m, origin), axis=-1)
    home = _home(places[-1])
    below_m = np.full(len(places), places[-1, 2] if altitude is Altitude.RELATIVE else 0.0)
    if altitude is Altitude.TERRAIN:
        ground_m = ground_height_m(plan.scenario.terrain, points_ned_m[:, 0], points_ned_m[:, 1])
        below_m = places[:, 2] + points_ned_m[:, 2] + ground_m
    places[:, 2] = [
        written_alt_m(alt_m, firmware) for alt_m in np.round(places[:, 2] - below_m, _SURE_DECIMALS).tolist()
    ]
    # Lengths as stored, not as planned: the time of a slow leg depends on its last centimetre.
    kept = _as_kept(places, firmware)[:-2]
    length_m = np.linalg.norm(
        np.diff(geodetic_to_ned(kept[:, 0], kept[:, 1], kept[:, 2] + below_m[:-2], origin), axis=0), axis=-1
    )

    draft = _Draft(altitude.frame, [], [])
    first = Command.NAV_TAKEOFF if plan.begin_state is None else Command.NAV_WAYPOINT
    draft.fly_to(first, places[0], yaw_ned_rad[0], up_s)
    draft.wait(legs.left_s - up_s)
    rest_s = landing.start_s - t_s[-1]
    if legs.speeds_mps is None:
        _fly_planned(draft, t_s, length_m, (places, yaw_ned_rad), rest_s)
        gates: tuple[tuple[int, float], ...] = ()
    else:
        gates = _fly_corrected(draft, legs, row, (places, yaw_ned_rad), rest_s)
    draft.fly_to(Command.NAV_LAND, places[-2], yaw_ned_rad[-1], landing.end_s)
    return VehicleMission(plan.sysids[row], home, tuple(draft.items), tuple(draft.arrival_s), legs.left_s, gates)


def _fly_planned(draft: _Draft, t_s: Array, length_m: Array, ends: tuple[Array, Array], rest_s: float) -> None:
    """Add every leg at its length over its time, with a delay after legs slower than autopilots fly."""
    places, yaw_ned_rad = ends
    last = len(length_m) - 1
    for leg, length in enumerate(length_m):
        duration_s = t_s[leg + 1] - t_s[leg]
        speed_mps = max(length / duration_s, SPEED_MIN_MPS)
        moving_s = length / speed_mps if length > _STILL_M else 0.0
        if moving_s or leg == last:
            draft.set_speed(speed_mps)
            hold_s = rest_s if leg == last else 0.0
            draft.fly_to(Command.NAV_WAYPOINT, places[leg + 1], yaw_ned_rad[leg + 1], t_s[leg] + moving_s, hold_s)
        draft.wait(duration_s - moving_s)


def _fly_corrected(
    draft: _Draft, legs: TimedLegs, row: int, ends: tuple[Array, Array], rest_s: float
) -> tuple[tuple[int, float], ...]:
    """Add every leg at its corrected speed, and delays. Return those at gates: index of the item, and plan time."""
    assert legs.speeds_mps is not None
    places, yaw_ned_rad = ends
    own = min(row, len(legs.speeds_mps) - 1)
    speeds_mps = legs.speeds_mps[own]
    waits_s = np.where(np.isnan(speeds_mps), np.diff(legs.t_s), 0.0) if legs.waits_s is None else legs.waits_s[own]
    gates = {gate.waypoint: gate for gate in legs.gates}
    delays = []
    last = len(speeds_mps) - 1
    for leg, speed in enumerate(speeds_mps.tolist()):
        if not math.isnan(speed):
            draft.set_speed(speed)
            hold_s = rest_s if leg == last else 0.0
            at_s = float(legs.t_s[leg + 1])
            draft.fly_to(Command.NAV_WAYPOINT, places[leg + 1], yaw_ned_rad[leg + 1], at_s, hold_s)
        draft.wait(waits_s[leg])
        if gate := gates.get(leg + 1):
            draft.wait(gate.slack_s)
            delays.append((len(draft.items) - 1, gate.leaves_s))
    return tuple(delays)


@dataclass(frozen=True)
class _Draft:
    """A mission to which items are added one by one."""

    frame: Frame
    items: list[MissionItem]
    arrival_s: list[float | None]

    def fly_to(self, command: Command, place: Array, yaw_ned_rad: float, at_s: float, hold_s: float = 0.0) -> None:
        """Add an item at (lat_deg, lon_deg, altitude in the mission's frame)."""
        lat_deg, lon_deg, alt_m = place.tolist()
        yaw_deg = round(float(np.degrees(yaw_ned_rad)), _YAW_DECIMALS) % 360.0
        params = (round(float(hold_s), _TIME_DECIMALS), 0.0, 0.0, yaw_deg)
        self.items.append(MissionItem(command, self.frame, params, to_degE7(lat_deg), to_degE7(lon_deg), alt_m))
        self.arrival_s.append(float(at_s))

    def do(self, command: Command, p1: float, p2: float, p3: float, p4: float) -> None:
        """Add an item without a position."""
        self.items.append(MissionItem(command, Frame.MISSION, (p1, p2, p3, p4), 0, 0, 0.0))
        self.arrival_s.append(None)

    def set_speed(self, speed_mps: float) -> None:
        """Add a change of the ground speed."""
        self.do(Command.DO_CHANGE_SPEED, 1.0, round(float(speed_mps), _SPEED_DECIMALS), -1.0, 0.0)

    def wait(self, duration_s: float) -> None:
        """Add a delay (-1: not a time of day), unless it rounds to 0."""
        delay_s = round(float(duration_s), _TIME_DECIMALS)
        if delay_s > 0:
            self.do(Command.NAV_DELAY, delay_s, -1.0, -1.0, -1.0)


def _as_kept(places: Array, firmware: Autopilot) -> Array:
    """Positions (N, 3) of lat_deg, lon_deg, alt_m as the vehicle stores them."""
    return np.array(
        [
            (from_degE7(to_degE7(lat_deg)), from_degE7(to_degE7(lon_deg)), kept_alt_m(alt_m, firmware))
            for lat_deg, lon_deg, alt_m in places.tolist()
        ]
    )


def starting_at(mission: VehicleMission, unix_s: int) -> VehicleMission:
    """The mission whose delay after the take-off ends at `unix_s` (whole seconds of GNSS unix time).

    ArduPilot reads NAV_DELAY without seconds as "until hour, minute, second UTC": one instant within a day. Gates open
    the planned number of whole seconds after that.
    """
    first = mission.items[0]
    if first.command != Command.NAV_TAKEOFF:
        raise ValueError(f"a mission with a common start must begin with a take-off, not with command {first.command}")
    begins = 1 if mission.items[1].command == Command.NAV_DELAY else 0  # index of a delay to replace
    items, arrivals = list(mission.items), mission.arrival_s
    for index, leaves_s in mission.gates:
        items[index] = _until(unix_s + round(leaves_s - mission.leaves_s))
    shift = 1 - begins
    return replace(
        mission,
        items=(first, _until(unix_s), *items[1 + begins :]),
        arrival_s=(arrivals[0], None, *arrivals[1 + begins :]),
        gates=tuple((index + shift, leaves_s) for index, leaves_s in mission.gates),
    )


def timed_waits(mission: VehicleMission) -> tuple[int, ...]:
    """Return the indices of the items of a mission with a common start that wait until a time of day."""
    return (1, *(index for index, _ in mission.gates))


def _until(unix_s: int) -> MissionItem:
    minutes, second = divmod(unix_s % _DAY_S, 60)
    hour, minute = divmod(minutes, 60)
    return MissionItem(Command.NAV_DELAY, Frame.MISSION, (-1.0, float(hour), float(minute), float(second)), 0, 0, 0.0)
