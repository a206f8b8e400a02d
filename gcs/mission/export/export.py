"""One folder with everything a plan turns into: missions for ground stations, setpoints, maps, and an index.

Knows: which files there are and what the index tells. Does not know: the formats' contents, planning, how a folder is
replaced (`folder`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.autopilots.traits import Autopilot
from gcs.mission.export.atomic_folder import Folder, replaced
from gcs.mission.export.index import ExportIndex, Smoothing, index_document
from gcs.mission.export.mission_files import MissionOrder, make_missions
from gcs.mission.failsafe.fence_rally import Safety, build_safety
from gcs.mission.formats.maps.tracks import build_map
from gcs.mission.formats.param import SUFFIX as PARAMETER_SUFFIX
from gcs.mission.formats.param import ParameterFile, write_parameters
from gcs.mission.formats.qgc_wpl import write_fence, write_rally
from gcs.mission.formats.registry import DEFAULT, FLEET, MAPS, Format, vehicle_name
from gcs.mission.formats.tables.history_csv import build_histories, write_history
from gcs.mission.formats.tables.setpoint_table import StreamFile
from gcs.mission.model import Altitude
from gcs.mission.setpoints.bspline_smoothing import SmoothPath, smoothed
from gcs.mission.setpoints.setpoint_stream import build_stream, of_vehicle
from gcs.scenario.si import local_origin

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

# Loaded when asked for: their libraries take a while.
_WRITERS = {
    Format.SETPOINTS: "gcs.mission.formats.tables.setpoints_csv:write_setpoints",
    Format.PARQUET: "gcs.mission.formats.tables.setpoints_parquet:write_setpoints_parquet",
    Format.KML: "gcs.mission.formats.maps.kml:write_kml",
    Format.KMZ: "gcs.mission.formats.maps.kml:write_kmz",
    Format.GEOJSON: "gcs.mission.formats.maps.geojson:write_geojson",
}
_TOGETHER = 20  # vehicles sampled at once: memory for a thousand at full rate would be gigabytes


def export(
    plan: Plan,
    folder: Path | str,
    *,
    formats: Iterable[Format] | None = None,
    firmware: Autopilot | None = None,
    altitude: Altitude = Altitude.RELATIVE,
    setpoint_rate_hz: float | None = None,
    smooth_m: float | None = None,
    timed: bool = True,
    gates: int = 0,
    start_s: int | None = None,
) -> ExportIndex:
    """Write the files of these formats (`formats.DEFAULT` unless given) and index.json into `folder`.

    All is written beside and swapped in at the end: the folder holds the old export or the new one. Autopilot and rate
    are the scenario's unless given; `smooth_m` smooths the setpoints within so many metres of the plan. Missions are
    `timed`, their speeds corrected for the autopilot, or ask for the plan's own speeds; `start_s` is the time of day
    (UTC) at which everybody leaves the hover, which `gates` need. Raises `UsageError` when the folder holds anything
    that no export made, or for gates that cannot be had, `ScenarioError` for missions that the autopilot cannot store,
    `VerificationError` when missions as written or the smoothed path would break a limit (missions that nobody asked
    for are then left out, which the index tells), and OSError as the file system does.
    """
    wanted = DEFAULT if formats is None else tuple(formats)
    rate_hz = setpoint_rate_hz or plan.scenario.mission.setpoint_rate_hz
    firmware = firmware or Autopilot.named(plan.scenario.mission.autopilot)
    order = MissionOrder(firmware, altitude, timed, gates, start_s)
    order.refuse_impossible()
    with replaced(Path(folder)) as files:
        safety = build_safety(plan, firmware)
        path = None if smooth_m is None else smoothed(plan, smooth_m)
        made = make_missions(plan, order, safety, wanted)
        if made.refusal is not None and formats is not None:
            raise made.refusal
        for name, text in made.files.items():
            files.write(name, text)
        _write_safety(files, plan, firmware, safety, wanted)
        _write_streams(files, plan, rate_hz, path, wanted)
        _write_maps(files, plan, safety, wanted)
        index = ExportIndex(
            plan.scenario.name,
            plan.hash,
            firmware,
            altitude,
            rate_hz,
            len(made.legs.t_s),
            max(len(m.items) for m in made.missions),
            made.legs.error,
            dict(sorted(files.sha256.items())),
            safety,
            made.report,
            None if path is None else _smoothing(path),
            made.timing,
            "" if made.refusal is None else made.refusal.message,
            made.missions,
        )
        files.write_index(index_document(index, plan))
    return index


def _smoothing(path: SmoothPath) -> Smoothing:
    yaw_deg = math.degrees(path.yaw_deviation_rad)
    return Smoothing(path.knots_every_s, path.deviation_m, yaw_deg, path.clearance_min_m)


def _write_safety(files: Folder, plan: Plan, firmware: Autopilot, safety: Safety, formats: tuple[Format, ...]) -> None:
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
    origin = local_origin(plan.scenario)
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
