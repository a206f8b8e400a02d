"""The missions of an export: built for each vehicle's autopilot, written, read back, flown by a model, verified."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from gcs.autopilots.traits import Autopilot, FleetFirmware, one_each, titles
from gcs.errors import NotWritten, UsageError, VerificationError
from gcs.mission.check.fleet_check import FleetReport
from gcs.mission.check.landing_separation import refuse_close_landing
from gcs.mission.export.verify_export import check_written, refuse_broken, refuse_untimely, verify_box
from gcs.mission.failsafe.fence_rally import Safety
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.registry import Content, Format, vehicle_name
from gcs.mission.model import Altitude, Command, VehicleMission
from gcs.mission.predicted.timing import Timing, predicted
from gcs.mission.waypoints.arrival_times import corrected_legs
from gcs.mission.waypoints.mission_items import build_missions, starting_at, timed_legs
from gcs.mission.waypoints.timed_legs import TimedLegs

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

_DAY_S = 86400
_IN_THE_AIR = NotWritten(
    "the plan begins in the air, and a mission cannot start in time there: missions are left out",
    hint="fly its setpoint stream: --format setpoints",
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
            raise UsageError(
                "gates open at a time of day, and the time of the common start is missing",
                hint="give --start HH:MM:SS (UTC), or fly with `gcs fly --mode mission --gates`",
            )
        if self.start_s is not None and not 0 <= self.start_s < _DAY_S:
            raise UsageError(f"start_s is {self.start_s}", hint=f"give a time of day from 0 to {_DAY_S - 1} s")

    @property
    def corrected(self) -> bool:
        """Whether speeds are corrected: the models of autopilots do not follow the ground."""
        return self.timed and self.altitude is not Altitude.TERRAIN


@dataclass(frozen=True)
class MadeMissions:
    """Missions, their legs by autopilot, their files by name, and the result of their check."""

    legs: dict[Autopilot, TimedLegs]
    missions: tuple[VehicleMission, ...]
    files: dict[str, str | bytes]
    report: FleetReport | None
    timing: Timing | None
    refusal: NotWritten | None = None  # why they must not fly; there are then no files


def make_missions(plan: Plan, order: MissionOrder, safety: Safety, formats: Sequence[Format]) -> MadeMissions:
    """The verified missions of a plan, in those formats that hold missions.

    Raises `ScenarioError` if the autopilot cannot store them, and `NotWritten` if missions at the plan's own speeds
    fail verification. Missions at corrected speeds return a `refusal` instead. Landings at the autopilots' own speeds
    are verified for streams too: they raise `VerificationError`.
    """
    altitude = order.altitude
    autopilots = one_each(order.firmware, len(plan.sysids))
    refuse_close_landing(plan, autopilots, [dict(values) for values in safety.parameters])
    formats = [row for row in formats if row.content is Content.MISSION]
    corrected = order.corrected and bool(formats) and plan.begin_state is None
    if corrected:
        legs = {known: corrected_legs(plan, known, order.gates) for known in dict.fromkeys(autopilots)}
    else:
        legs = dict.fromkeys(autopilots, timed_legs(plan))
    missions = build_missions(plan, legs, firmware=autopilots, altitude=altitude)
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
    timing = predicted(plan, autopilots, legs, missions, report.flights) if corrected else None
    try:
        refuse_broken(report)
        verify_box(plan, missions, altitude)
        if timing is not None:
            refuse_untimely(plan, autopilots, timing)
    except VerificationError as reason:
        refusal = NotWritten(reason.message, hint=reason.hint)
        if timing is None:
            raise refusal from reason
        return MadeMissions(legs, missions, {}, None, timing, refusal)
    return MadeMissions(legs, missions, files, report, timing)


def _held(missions: Sequence[VehicleMission], autopilots: Sequence[Autopilot], safety: Safety) -> list[MissionFile]:
    """The contents of each vehicle's mission files, the same for every format."""
    held = []
    rows = zip(missions, autopilots, safety.rally, safety.parameters, strict=True)
    for mission, firmware, rally, parameters in rows:
        speeds = [i.params[1] for i in mission.items if i.command == Command.DO_CHANGE_SPEED]
        speed_mps = round(sum(speeds) / len(speeds), 1)
        name = vehicle_name(mission.sysid)
        fence = safety.fence.geofence
        file = MissionFile(name, firmware, mission.home, mission.items, fence, rally, speed_mps)
        held.append(replace(file, parameters=dict(parameters)))
    return held


def _read_back(row: Format, name: str, data: str | bytes, wanted: MissionFile) -> MissionFile:
    """The mission in a file as written; a format that holds no fence is checked with the fleet's.

    The vehicle has the parameters that the export gives it.
    """
    read: MissionFile = row.read(data.encode() if isinstance(data, str) else data, name, wanted.firmware)
    read = replace(read, parameters=wanted.parameters)
    return read if row.fenced else replace(read, geofence=wanted.geofence, rally=wanted.rally)
