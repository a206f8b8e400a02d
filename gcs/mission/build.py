"""From a plan to one waypoint mission per vehicle.

Knows: which items make a vehicle take off, keep the plan's times leg by leg, and land. Does not know: files, links.
Timed legs: neither ArduPilot nor PX4 has waypoints with an arrival time, so before every leg DO_CHANGE_SPEED asks
for leg length / leg time. All vehicles share the times of their waypoints.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.errors import ScenarioError
from gcs.frames import Origin, ned_to_geodetic, to_degE7
from gcs.mission.model import Command, Frame, Home, MissionItem, VehicleMission
from gcs.mission.simplify import Deviation, Flown, deviation, waypoint_indices
from gcs.quadrotor import POSITION, Array

if TYPE_CHECKING:
    from gcs.plan.trajectory import Plan

# degE7 rounds a waypoint by up to 0.5e-7 deg, 5.6 mm, northwards and eastwards.
ROUNDING_M = 0.008
# Speeds ArduCopter 4.5 ignores (WPNAV_WP_SPEED_MIN): slower legs are flown at this one and waited out.
SPEED_MIN_MPS = 0.2
# ArduCopter's store, home included.
ITEMS_MAX = 650
# How far a constant-speed leg may be from the plan at the same time, in units of the path tolerance.
TIME_SHARE = 1.5

_SAMPLE_S = 0.1
_STILL_M = 0.01
_ALTITUDE_DECIMALS = 3
_SPEED_DECIMALS = 4
_YAW_DECIMALS = 2


@dataclass(frozen=True)
class TimedLegs:
    """Instants (W,) all vehicles pass their waypoints at, from the start of the run-up to the arrival."""

    t_s: Array
    error: Deviation


def timed_legs(plan: Plan) -> TimedLegs:
    """Choose the waypoints' instants for all vehicles of a plan at once.

    The start of the run-up, T0 and the arrival are always among them. Raises `ScenarioError` for a tolerance that
    rounding to degE7 alone would break.
    """
    tolerance_m = plan.scenario.mission.tolerance_m
    path_m = tolerance_m - ROUNDING_M
    if path_m <= 0:
        raise ScenarioError(
            f"mission.tolerance_m is {tolerance_m} m, but waypoints are rounded by up to {ROUNDING_M} m.",
            hint="ask for 0.02 m or more",
        )
    kept: list[Array] = []
    errors: list[Deviation] = []
    for phase in plan.phases:
        if phase.name not in ("run-up", "mission"):
            continue
        t_s = np.linspace(phase.start_s, phase.end_s, 1 + int(np.ceil((phase.end_s - phase.start_s) / _SAMPLE_S)))
        flown = Flown(t_s, plan.states(t_s)[..., POSITION], SPEED_MIN_MPS)
        indices = waypoint_indices(flown, Deviation(path_m, TIME_SHARE * tolerance_m))
        errors.append(deviation(flown, indices))
        kept.append(t_s[indices])
    return TimedLegs(
        np.unique(np.concatenate(kept)),
        Deviation(max(e.path_m for e in errors), max(e.time_m for e in errors)),
    )


def build_missions(plan: Plan, legs: TimedLegs | None = None) -> tuple[VehicleMission, ...]:
    """One mission per vehicle, in the plan's order: takeoff, delay, timed legs, hold, land.

    Altitudes are relative to the vehicle's own home, the ground under its pad. Raises `ScenarioError` when a mission
    has more items than ArduCopter stores.
    """
    t_s = (legs or timed_legs(plan)).t_s
    origin = Origin(**plan.scenario.origin.model_dump())
    states = plan.states(t_s)
    missions = tuple(
        _vehicle_mission(plan, origin, row, t_s, states[row, :, POSITION], states[row, :, 8])
        for row in range(len(plan.sysids))
    )
    longest = 1 + max(len(m.items) for m in missions)
    if longest > ITEMS_MAX:
        raise ScenarioError(
            f"A mission of {longest} items does not fit the {ITEMS_MAX} that ArduCopter stores.",
            hint=f"raise mission.tolerance_m, now {plan.scenario.mission.tolerance_m} m",
        )
    return missions


def _vehicle_mission(
    plan: Plan, origin: Origin, row: int, t_s: Array, position_ned_m: Array, yaw_ned_rad: Array
) -> VehicleMission:
    ends_ned_m = np.stack([plan.pads_ned_m[row], plan.landing_points_ned_m[row]])
    lat_deg, lon_deg, alt_m = ned_to_geodetic(np.concatenate([position_ned_m, ends_ned_m]), origin)
    home = Home(float(lat_deg[-2]), float(lon_deg[-2]), float(alt_m[-2]))
    above_home_m = alt_m - home.alt_amsl_m
    takeoff, landing = plan.phase("takeoff"), plan.phase("landing")
    items: list[MissionItem] = []
    arrival_s: list[float | None] = []

    def fly_to(command: Command, point: int, yaw_rad: float, at_s: float, hold_s: float = 0.0) -> None:
        items.append(
            MissionItem(
                command,
                Frame.GLOBAL_RELATIVE_ALT,
                (hold_s, 0.0, 0.0, _compass_deg(yaw_rad)),
                to_degE7(lat_deg[point]),
                to_degE7(lon_deg[point]),
                round(float(above_home_m[point]), _ALTITUDE_DECIMALS),
            )
        )
        arrival_s.append(at_s)

    def do(command: Command, *params: float) -> None:
        p1, p2, p3, p4 = params
        items.append(MissionItem(command, Frame.MISSION, (p1, p2, p3, p4), 0, 0, 0.0))
        arrival_s.append(None)

    def wait(duration_s: float) -> None:
        # -1: a time from now, not a time of day.
        if round(duration_s, 3) > 0:
            do(Command.NAV_DELAY, round(duration_s, 3), -1.0, -1.0, -1.0)

    length_m = np.linalg.norm(np.diff(position_ned_m, axis=0), axis=-1)
    fly_to(Command.NAV_TAKEOFF, 0, float(yaw_ned_rad[0]), takeoff.end_s)
    wait(float(t_s[0]) - takeoff.end_s)
    for leg, length in enumerate(length_m.tolist()):
        start_s, end_s = float(t_s[leg]), float(t_s[leg + 1])
        speed_mps = max(length / (end_s - start_s), SPEED_MIN_MPS)
        moving_s = length / speed_mps if length > _STILL_M else 0.0
        last = leg == len(length_m) - 1
        if moving_s or last:
            do(Command.DO_CHANGE_SPEED, 1.0, round(speed_mps, _SPEED_DECIMALS), -1.0, 0.0)
            hold_s = round(landing.start_s - end_s, 3) if last else 0.0
            fly_to(Command.NAV_WAYPOINT, leg + 1, float(yaw_ned_rad[leg + 1]), start_s + moving_s, hold_s)
        wait(end_s - start_s - moving_s)
    fly_to(Command.NAV_LAND, -1, float(yaw_ned_rad[-1]), landing.end_s)
    return VehicleMission(plan.sysids[row], home, tuple(items), tuple(arrival_s))


def _compass_deg(yaw_ned_rad: float) -> float:
    return round(float(np.degrees(yaw_ned_rad)), _YAW_DECIMALS) % 360.0
