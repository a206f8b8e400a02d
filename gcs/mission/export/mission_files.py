"""The missions of an export: built for each vehicle's autopilot, written, read back, flown by a model, verified."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs.autopilots.traits import Autopilot, FleetFirmware, one_each, titles
from gcs.errors import NotWritten, UsageError, VerificationError
from gcs.frames import geodetic_to_ned
from gcs.mission.check.fleet_check import FleetReport, check_fleet
from gcs.mission.check.landing_separation import refuse_close_landing
from gcs.mission.flight_limits import OVERSPEED, limits_of, surroundings_of
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.registry import Content, Format, vehicle_name
from gcs.mission.model import Altitude, Command, VehicleMission
from gcs.mission.predicted.autopilot_flight import AutopilotFlight
from gcs.mission.predicted.timing import MARGIN_S, Timing, predicted
from gcs.mission.returns.fence_rally import Safety
from gcs.mission.waypoints.arrival_times import climb_s, corrected_legs
from gcs.mission.waypoints.mission_items import ImpossibleMission, build_missions, starting_at, timed_legs
from gcs.mission.waypoints.timed_legs import TimedLegs
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.navigation_error import judged_separation_m
from gcs.scenario.values.si import ability_of, local_origin

_DAY_S = 86400
_IN_THE_AIR = NotWritten(
    "the plan begins in the air, and a mission cannot start in time there: missions are left out",
    hint="fly its setpoint stream: --format setpoints",
)
_LISTED_MAX = 3
STREAM_INSTEAD = "fly the setpoint stream instead (--format setpoints): it keeps path and time"


def check_written(
    plan: Plan,
    autopilots: Sequence[Autopilot],
    fleets: Sequence[Sequence[MissionFile]],
    *,
    timed: bool = False,
    leaves_s: float | None = None,
) -> FleetReport:
    """The report on missions as read back from their files: for each format, one file for every vehicle.

    They are flown at their planned speeds or, if `timed`, by the model of their autopilot. Missions that wait until a
    time of day leave at plan time `leaves_s`. Raises `VerificationError` if two files of a vehicle differ.
    """
    first, *others = fleets
    scenario = plan.scenario
    limits = limits_of(scenario)
    if leaves_s is not None:
        limits = replace(limits, leaves_s=leaves_s)
    if timed:
        limits = replace(limits, overspeed=OVERSPEED)
        climbs_s = {known: climb_s(plan, known) for known in set(autopilots)}
        modelled = AutopilotFlight(ability_of(plan.quadrotor, scenario.limits), climbs_s)
        report = check_fleet(first, surroundings_of(scenario), limits, modelled, modelled.others)
    else:
        report = check_fleet(first, surroundings_of(scenario), limits)
    for fleet in others:
        for ours, theirs in zip(first, fleet, strict=True):
            same = ours.items == theirs.items and (ours.geofence, ours.rally) == (theirs.geofence, theirs.rally)
            if not same or theirs.home not in (ours.home, None):
                raise VerificationError(f"{ours.source} and {theirs.source} hold different missions")
    return report


def verify_box(plan: Plan, missions: Sequence[VehicleMission], altitude: Altitude) -> None:
    """Verify that waypoints between T0 and the arrival are inside the box (Eq. 51), to the mission's tolerance.

    Raises `VerificationError` for the waypoint of a vehicle that is farthest outside.
    """
    limits, tolerance_m = plan.scenario.limits, plan.scenario.mission.tolerance_m
    origin = local_origin(plan.scenario)
    for mission in missions:
        timed = [
            (index, item)
            for index, (item, t_s) in enumerate(zip(mission.items, mission.arrival_s, strict=True))
            if t_s is not None and item.frame == altitude.frame and 0.0 <= t_s <= plan.flight_s
        ]
        lat, lon = np.array([item.place_deg for _, item in timed]).T
        places = geodetic_to_ned(lat, lon, origin.alt_amsl_m, origin)
        for axis, (name, (low, high)) in enumerate((("north", limits.north_m), ("east", limits.east_m))):
            out_m = np.maximum(low - places[:, axis], places[:, axis] - high)
            worst = int(np.argmax(out_m))
            if out_m[worst] > tolerance_m:
                what = f"waypoint {timed[worst][0]} of vehicle {mission.sysid}"
                raise VerificationError(f"{what} is {out_m[worst]:.2f} m outside the {name} limits")


def refuse_broken(report: FleetReport) -> None:
    """Raise `VerificationError` if the report has an error."""
    if not report.errors:
        return
    errors = "; ".join(str(e) for e in report.errors[:_LISTED_MAX])
    more = f"; and {len(report.errors) - _LISTED_MAX} more" if len(report.errors) > _LISTED_MAX else ""
    raise VerificationError(f"the missions as written failed verification: {errors}{more}", hint=STREAM_INSTEAD)


def refuse_untimely(plan: Plan, autopilots: Sequence[Autopilot], timing: Timing) -> None:
    """Raise `VerificationError` if vehicles may violate the separation, or miss a gate, because of their timing."""
    near, required_m = timing.nearest, judged_separation_m(plan.scenario)
    if near is not None and near.distance_m < required_m:
        first, second = near.sysids
        pair = titles(autopilots[plan.sysids.index(sysid)] for sysid in near.sysids)
        raise VerificationError(
            f"not fit for mission mode: vehicles {first} and {second} may come within {near.distance_m:.2f} m at "
            f"{near.t_s:.1f} s ({required_m:g} m required). Two vehicles under {pair} may be "
            f"{near.apart_s:.3g} s apart in time.",
            hint=f"{STREAM_INSTEAD}; --untimed writes missions with the plan's own speeds, without this check",
        )
    for number, early_s in enumerate(timing.gates_early_s, start=1):
        if early_s < MARGIN_S:
            raise VerificationError(
                f"not fit for mission mode: the last vehicle reaches gate {number} {early_s:.1f} s before it opens "
                f"({MARGIN_S:g} s required).",
                hint="give fewer --gates",
            )


@dataclass(frozen=True)
class MissionOrder:
    """The autopilot that missions are for, one for all or one each, and how they keep the plan's times."""

    firmware: FleetFirmware
    altitude: Altitude = Altitude.RELATIVE
    timed: bool = True  # speeds corrected for the autopilot
    gates: int = 0
    start_s: int | None = None  # time of day, UTC, at which all vehicles leave the hover

    def refuse_impossible(self) -> None:
        """Raise `UsageError` for gates or starts that one of the autopilots does not have."""
        every = (self.firmware,) if isinstance(self.firmware, Autopilot) else tuple(self.firmware)
        unable = [known for known in every if not known.traits.flight.waits_for_time_of_day]
        if (self.gates or self.start_s is not None) and unable:
            raise UsageError(
                f"{titles(unable)} cannot wait until a time of day, so gates and a common start are not available "
                "on it.",
                hint="fly the setpoint stream, which keeps all vehicles on time",
            )
        if self.gates and not self.corrected:
            raise UsageError("gates need corrected speeds", hint="do not give --untimed or --altitude terrain")
        if self.gates and self.start_s is None:
            text = "gates open at a time of day, and the time of the common start is missing"
            raise UsageError(text, hint="give --start HH:MM:SS (UTC), or fly with `gcs fly --mode mission --gates`")
        if self.start_s is not None and not 0 <= self.start_s < _DAY_S:
            raise UsageError(f"start_s is {self.start_s}", hint=f"give a time of day from 0 to {_DAY_S - 1} s")

    @property
    def corrected(self) -> bool:
        """Whether speeds are corrected: the models of autopilots do not follow the ground."""
        return self.timed and self.altitude is not Altitude.TERRAIN


@dataclass(frozen=True)
class MadeMissions:
    """Missions, their legs by autopilot, their files by name, and the result of their check.

    Missions with a `refusal` are not written; their report and their timing say what was found.
    """

    legs: dict[Autopilot, TimedLegs]
    missions: tuple[VehicleMission, ...]
    files: dict[str, str | bytes]
    report: FleetReport | None
    timing: Timing | None
    refusal: NotWritten | None = None  # why they must not fly; there are then no files


def make_missions(plan: Plan, order: MissionOrder, safety: Safety, formats: Sequence[Format]) -> MadeMissions:
    """The verified missions of a plan, in those formats that hold missions.

    Missions that no autopilot model can time, that an autopilot cannot store or that fail verification have a `refusal`
    and no files. Landings at the autopilots' own speeds are verified for streams too: they raise `VerificationError`.
    Raises `ScenarioError` for gates that do not fit, and for altitudes that an autopilot refuses.
    """
    altitude = order.altitude
    autopilots = one_each(order.firmware, len(plan.sysids))
    parameters = [dict(values) for values in safety.parameters]
    refuse_close_landing(plan, autopilots, parameters)
    formats = [row for row in formats if row.content is Content.MISSION]
    corrected = order.corrected and bool(formats) and plan.begin_state is None
    legs: dict[Autopilot, TimedLegs] = {}
    try:
        if corrected:
            legs = {known: corrected_legs(plan, known, order.gates) for known in dict.fromkeys(autopilots)}
        else:
            legs = dict.fromkeys(autopilots, timed_legs(plan))
        missions = build_missions(plan, legs, firmware=autopilots, altitude=altitude)
    except (VerificationError, ImpossibleMission) as reason:
        # What cannot be a mission may still be flown as a stream.
        refusal = NotWritten(reason.message, hint=reason.hint) if formats else None
        return MadeMissions({}, (), {}, None, None, refusal)
    if plan.begin_state is not None:
        return MadeMissions(legs, missions, {}, None, None, _IN_THE_AIR if formats else None)
    if order.start_s is not None:
        missions = tuple(starting_at(mission, order.start_s) for mission in missions)
    if not formats:
        return MadeMissions(legs, missions, {}, None, None)
    held = _held(missions, autopilots, safety)
    files: dict[str, str | bytes] = {}
    read: list[list[MissionFile]] = []
    for row in formats:
        written = {row.file_name(file.source, file.firmware): row.write(file) for file in held}
        pairs = zip(written.items(), held, strict=True)
        read.append([_read_back(row, name, data, file) for (name, data), file in pairs])
        files |= written
    leaves_s = None if order.start_s is None else legs[autopilots[0]].left_s
    report = check_written(plan, autopilots, read, timed=corrected, leaves_s=leaves_s)
    timing = predicted(plan, autopilots, legs, missions, report.flights, report.spreads) if corrected else None
    try:
        refuse_broken(report)
        verify_box(plan, missions, altitude)
        if timing is not None:
            refuse_untimely(plan, autopilots, timing)
            refuse_close_landing(plan, autopilots, parameters, timing.may_differ_s)
    except VerificationError as reason:
        refusal = NotWritten(reason.message, hint=reason.hint)
        return MadeMissions(legs, missions, {}, report, timing, refusal)
    return MadeMissions(legs, missions, files, report, timing)


def _held(missions: Sequence[VehicleMission], autopilots: Sequence[Autopilot], safety: Safety) -> list[MissionFile]:
    """The contents of each vehicle's mission files, the same for every format."""
    held = []
    rows = zip(missions, autopilots, safety.rally, safety.parameters, strict=True)
    for mission, firmware, rally, parameters in rows:
        speeds = [i.params[1] for i in mission.items if i.command == Command.DO_CHANGE_SPEED]
        more = safety.fence.geofence, rally, round(sum(speeds) / len(speeds), 1)
        file = MissionFile(vehicle_name(mission.sysid), firmware, mission.home, mission.items, *more)
        held.append(replace(file, parameters=dict(parameters)))
    return held


def _read_back(row: Format, name: str, data: str | bytes, wanted: MissionFile) -> MissionFile:
    """The mission in a file as written; a format that holds no fence is checked with the fleet's.

    The vehicle has the parameters that the export gives it.
    """
    read: MissionFile = row.read(data.encode() if isinstance(data, str) else data, name, wanted.firmware)
    read = replace(read, parameters=wanted.parameters)
    return read if row.fenced else replace(read, geofence=wanted.geofence, rally=wanted.rally)
