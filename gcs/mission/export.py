"""One folder with everything a plan turns into: missions for ground stations, setpoints, maps, and an index.

Knows: which files there are and what the index tells. Does not know: the formats' contents, planning, how a folder is
replaced (`folder`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.frames import Origin
from gcs.mission.build import build_missions, timed_legs
from gcs.mission.firmware import Firmware
from gcs.mission.folder import Folder, replaced
from gcs.mission.formats import DEFAULT, FLEET, MAPS, Format, vehicle_name
from gcs.mission.history import build_histories, write_history
from gcs.mission.model import Altitude, Command, VehicleMission
from gcs.mission.planfile import PlanFile, write_plan_file
from gcs.mission.setpoint_table import StreamFile
from gcs.mission.setpoints import build_stream, of_vehicle
from gcs.mission.simplify import Deviation
from gcs.mission.smooth import SmoothPath, smoothed
from gcs.mission.tracks import build_map
from gcs.mission.waypoints import WaypointFile, write_waypoints

if TYPE_CHECKING:
    from gcs.plan.trajectory import Plan

_VERSION = 2
# Loaded when asked for: their libraries take a while.
_WRITERS = {
    Format.SETPOINTS: "gcs.mission.setpoints_csv:write_setpoints",
    Format.PARQUET: "gcs.mission.setpoints_parquet:write_setpoints_parquet",
    Format.KML: "gcs.mission.kml:write_kml",
    Format.KMZ: "gcs.mission.kml:write_kmz",
    Format.GEOJSON: "gcs.mission.geojson:write_geojson",
}
_TOGETHER = 20  # vehicles sampled at once: memory for a thousand at full rate would be gigabytes


@dataclass(frozen=True)
class Smoothing:
    """How the setpoints differ from the plan, where they were smoothed."""

    knots_every_s: float
    deviation_m: float
    yaw_deviation_deg: float
    clearance_min_m: float


@dataclass(frozen=True)
class ExportIndex:
    """What an export holds, and how faithfully."""

    scenario: str
    plan_hash: str
    firmware: Firmware
    altitude: Altitude
    setpoint_rate_hz: float
    waypoints: int  # positions with a planned time, per vehicle
    items: int  # mission items of the longest mission, home not counted
    deviation: Deviation
    sha256: dict[str, str]  # by file name
    smoothing: Smoothing | None = None  # of the setpoints; waypoints are always the plan's


def export(
    plan: Plan,
    folder: Path | str,
    *,
    formats: Iterable[Format] = DEFAULT,
    firmware: Firmware | None = None,
    altitude: Altitude = Altitude.RELATIVE,
    setpoint_rate_hz: float | None = None,
    smooth_m: float | None = None,
) -> ExportIndex:
    """Write the files of these formats and index.json into `folder`.

    All is written beside and swapped in at the end: the folder holds the old export or the new one. Autopilot and rate
    are the scenario's unless given; `smooth_m` smooths the setpoints within so many metres of the plan. Raises
    `UsageError` when the folder holds anything that no export made, `ScenarioError` for missions that the autopilot
    cannot store, `VerificationError` when the smoothed path would break a limit, and OSError as the file system does.
    """
    formats = tuple(formats)
    rate_hz = setpoint_rate_hz or plan.scenario.mission.setpoint_rate_hz
    firmware = firmware or Firmware.named(plan.scenario.mission.autopilot)
    with replaced(Path(folder)) as files:
        legs = timed_legs(plan)
        missions = build_missions(plan, legs, firmware=firmware, altitude=altitude)
        path = None if smooth_m is None else smoothed(plan, smooth_m)
        for mission in missions:
            _write_mission(files, mission, firmware, formats)
        _write_streams(files, plan, rate_hz, path, formats)
        _write_maps(files, plan, formats)
        index = ExportIndex(
            plan.scenario.name,
            plan.hash,
            firmware,
            altitude,
            rate_hz,
            len(legs.t_s),
            max(len(m.items) for m in missions),
            legs.error,
            dict(sorted(files.sha256.items())),
            None if path is None else _smoothing(path),
        )
        document = {"version": _VERSION} | asdict(index) | {"firmware": firmware.name.lower()}
        if index.smoothing is None:
            del document["smoothing"]
        files.write_index(document)
    return index


def _smoothing(path: SmoothPath) -> Smoothing:
    yaw_deg = math.degrees(path.yaw_deviation_rad)
    return Smoothing(path.knots_every_s, path.deviation_m, yaw_deg, path.clearance_min_m)


def _write_mission(files: Folder, mission: VehicleMission, firmware: Firmware, formats: tuple[Format, ...]) -> None:
    name = vehicle_name(mission.sysid)
    if Format.WAYPOINTS in formats:
        home = mission.home if firmware.home_is_item_0 else None
        files.write(f"{name}.waypoints", write_waypoints(WaypointFile(home, mission.items)))
    if Format.PLAN in formats:
        speeds = [i.params[1] for i in mission.items if i.command == Command.DO_CHANGE_SPEED]
        speed_mps = round(sum(speeds) / len(speeds), 1)
        files.write(
            f"{name}.plan",
            write_plan_file(PlanFile(firmware, mission.home, mission.items, speed_mps, speed_mps)),
        )


def _write_streams(
    files: Folder, plan: Plan, rate_hz: float, path: SmoothPath | None, formats: tuple[Format, ...]
) -> None:
    origin = Origin(**plan.scenario.origin.model_dump())
    writers = {f: _writer(f) for f in (Format.SETPOINTS, Format.PARQUET) if f in formats}
    for rows in _batches(len(plan.sysids)):
        stream = build_stream(plan, rate_hz, path, rows) if writers else None
        for row, sysid in enumerate(plan.sysids[rows]):
            if stream is None:
                break
            file = StreamFile(of_vehicle(stream, row), plan.hash, origin)
            for form, write in writers.items():
                files.write(f"{vehicle_name(sysid)}.{form}", write(file))
        if Format.HISTORY in formats:
            for history in build_histories(plan, rate_hz, rows):
                files.write(f"{vehicle_name(history.sysid)}.history.csv", write_history(history))


def _writer(form: Format) -> Callable[[Any], bytes | str]:
    module, name = _WRITERS[form].split(":")
    write: Callable[[Any], bytes | str] = getattr(import_module(module), name)
    return write


def _batches(vehicles: int) -> Iterator[slice]:
    return (slice(first, first + _TOGETHER) for first in range(0, vehicles, _TOGETHER))


def _write_maps(files: Folder, plan: Plan, formats: tuple[Format, ...]) -> None:
    if not MAPS & set(formats):
        return
    drawn = build_map(plan)
    for form in formats:
        if form in MAPS:
            files.write(f"{FLEET}.{form}", _writer(form)(drawn))
