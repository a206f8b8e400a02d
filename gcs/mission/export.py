"""One folder with everything a plan turns into: missions for ground stations, setpoints, maps, and an index.

Knows: which files there are and what the index tells. Does not know: the formats' contents, planning, how a folder is
replaced (`folder`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.frames import Origin
from gcs.mission.build import build_missions, timed_legs
from gcs.mission.export_index import ExportIndex, Smoothing, index_document
from gcs.mission.fencefile import write_fence, write_rally
from gcs.mission.firmware import Firmware
from gcs.mission.folder import Folder, replaced
from gcs.mission.formats import DEFAULT, FLEET, MAPS, Format, vehicle_name
from gcs.mission.history import build_histories, write_history
from gcs.mission.model import Altitude, Command, VehicleMission
from gcs.mission.parameters import SUFFIX as PARAMETER_SUFFIX
from gcs.mission.parameters import ParameterFile, write_parameters
from gcs.mission.planfile import PlanFile, write_plan_file
from gcs.mission.safety import Safety, build_safety
from gcs.mission.setpoint_table import StreamFile
from gcs.mission.setpoints import build_stream, of_vehicle
from gcs.mission.smooth import SmoothPath, smoothed
from gcs.mission.tracks import build_map
from gcs.mission.verify_export import verify_box, verify_written
from gcs.mission.waypoints import WaypointFile, write_waypoints

if TYPE_CHECKING:
    from gcs.plan.trajectory import Plan

# Loaded when asked for: their libraries take a while.
_WRITERS = {
    Format.SETPOINTS: "gcs.mission.setpoints_csv:write_setpoints",
    Format.PARQUET: "gcs.mission.setpoints_parquet:write_setpoints_parquet",
    Format.KML: "gcs.mission.kml:write_kml",
    Format.KMZ: "gcs.mission.kml:write_kmz",
    Format.GEOJSON: "gcs.mission.geojson:write_geojson",
}
_TOGETHER = 20  # vehicles sampled at once: memory for a thousand at full rate would be gigabytes


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
    cannot store, `VerificationError` when missions as written or the smoothed path would break a limit, and OSError as
    the file system does.
    """
    formats = tuple(formats)
    rate_hz = setpoint_rate_hz or plan.scenario.mission.setpoint_rate_hz
    firmware = firmware or Firmware.named(plan.scenario.mission.autopilot)
    with replaced(Path(folder)) as files:
        legs = timed_legs(plan)
        missions = build_missions(plan, legs, firmware=firmware, altitude=altitude)
        safety = build_safety(plan, firmware)
        path = None if smooth_m is None else smoothed(plan, smooth_m)
        written = _write_missions(files, missions, firmware, safety, formats)
        report = None
        if written:
            fence = safety.fence.geofence, safety.rally
            report = verify_written(plan, firmware, written, fence)
            verify_box(plan, missions, altitude)
        _write_safety(files, plan, firmware, safety, formats)
        _write_streams(files, plan, rate_hz, path, formats)
        _write_maps(files, plan, safety, formats)
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
            safety,
            report,
            None if path is None else _smoothing(path),
        )
        files.write_index(index_document(index, plan))
    return index


def _smoothing(path: SmoothPath) -> Smoothing:
    yaw_deg = math.degrees(path.yaw_deviation_rad)
    return Smoothing(path.knots_every_s, path.deviation_m, yaw_deg, path.clearance_min_m)


def _write_missions(
    files: Folder,
    missions: Sequence[VehicleMission],
    firmware: Firmware,
    safety: Safety,
    formats: tuple[Format, ...],
) -> dict[str, str]:
    """Missions in every format asked for; returns their text by file name."""
    written: dict[str, str] = {}
    for row, mission in enumerate(missions):
        name = vehicle_name(mission.sysid)
        if Format.PLAN in formats:
            speeds = [i.params[1] for i in mission.items if i.command == Command.DO_CHANGE_SPEED]
            speed_mps = round(sum(speeds) / len(speeds), 1)
            rally = (safety.rally[row],)
            file = PlanFile(firmware, mission.home, mission.items, speed_mps, speed_mps, safety.fence.geofence, rally)
            written[f"{name}.plan"] = write_plan_file(file)
        if Format.WAYPOINTS in formats:
            home = mission.home if firmware.home_is_item_0 else None
            written[f"{name}.waypoints"] = write_waypoints(WaypointFile(home, mission.items))
    for name, text in written.items():
        files.write(name, text)
    return written


def _write_safety(files: Folder, plan: Plan, firmware: Firmware, safety: Safety, formats: tuple[Format, ...]) -> None:
    for row, sysid in enumerate(plan.sysids):
        name = vehicle_name(sysid)
        if Format.FENCE in formats:
            files.write(f"{name}.fence", write_fence(safety.fence.geofence))
        if Format.RALLY in formats:
            files.write(f"{name}.rally", write_rally([safety.rally[row]]))
        if Format.PARAM in formats:
            file = ParameterFile(firmware, sysid, safety.parameters[row])
            files.write(f"{name}{PARAMETER_SUFFIX[firmware]}", write_parameters(file))


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


def _write_maps(files: Folder, plan: Plan, safety: Safety, formats: tuple[Format, ...]) -> None:
    if not MAPS & set(formats):
        return
    drawn = build_map(plan, safety.fence.geofence)
    for form in formats:
        if form in MAPS:
            files.write(f"{FLEET}.{form}", _writer(form)(drawn))
