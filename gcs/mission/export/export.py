"""One folder with the files of a plan: missions for ground stations, setpoints, maps, and an index.

The rows of `gcs.mission.formats.registry` decide which files there are and what writes them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from gcs.autopilots.parameter_names import with_new_names
from gcs.autopilots.traits import Autopilot, FleetFirmware, one_each
from gcs.errors import UsageError
from gcs.mission.export.atomic_folder import refuse_foreign, replaced
from gcs.mission.export.bspline_smoothing import SmoothPath, smoothed
from gcs.mission.export.flight_volumes import ProvedVolumes, VolumeOrder, flight_volumes
from gcs.mission.export.index import ExportIndex, Smoothing, index_document
from gcs.mission.export.mission_files import MadeMissions, MissionOrder, make_missions
from gcs.mission.export.plan_curves import plan_curves
from gcs.mission.export.separations import Separation, separations
from gcs.mission.export.setpoint_stream import build_stream, of_vehicle
from gcs.mission.formats.maps.tracks import build_map
from gcs.mission.formats.param import ParameterFile
from gcs.mission.formats.registry import DEFAULT, FLEET, Content, Format, select_formats, vehicle_name
from gcs.mission.formats.tables.history_csv import build_histories
from gcs.mission.formats.tables.setpoint_table import StreamFile
from gcs.mission.formats.vehicle_curve import ShowFile
from gcs.mission.model import Altitude
from gcs.mission.returns.fence_rally import Safety, build_safety
from gcs.mission.waypoints.placement import Deviation
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Report, refusal, verify
from gcs.scenario.values.si import local_origin
from gcs.util.long_work import report as say_at

_BATCH = 20  # vehicles sampled at once: a thousand at full rate would need gigabytes of memory


@dataclass(frozen=True)
class ExportOptions:
    """What is asked for of an export; `export` says what each means."""

    formats: Iterable[str | Format] | None = None
    firmware: FleetFirmware | None = None
    altitude: Altitude = Altitude.RELATIVE
    setpoint_rate_hz: float | None = None
    smooth_m: float | None = None
    timed: bool = True
    gates: int = 0
    start_s: int | None = None
    volumes: VolumeOrder | None = None

    @property
    def wanted(self) -> tuple[Format, ...]:
        """The formats to write."""
        return DEFAULT if self.formats is None else select_formats(self.formats)

    def refuse_unordered(self) -> None:
        """Raise `UsageError` for volumes in space and time without what a plan does not say about them."""
        if self.volumes is None and any(row.content is Content.VOLUMES for row in self.wanted):
            text = "volumes need the instant of the take-off, and the height of mean sea level above the ellipsoid"
            hint = "give --takeoff 2026-11-28T10:30:00Z and --geoid METRES (volumes=VolumeOrder(...))"
            raise UsageError(text, hint=hint)

    def order(self, firmware: FleetFirmware) -> MissionOrder:
        """The missions that are asked for, for these autopilots. Raises what `MissionOrder.refuse_impossible` does."""
        order = MissionOrder(firmware, self.altitude, self.timed, self.gates, self.start_s)
        order.refuse_impossible()
        return order


def export(
    plan: Plan,
    folder: Path | str,
    *,
    formats: Iterable[str | Format] | None = None,
    firmware: FleetFirmware | None = None,
    altitude: Altitude = Altitude.RELATIVE,
    setpoint_rate_hz: float | None = None,
    smooth_m: float | None = None,
    timed: bool = True,
    gates: int = 0,
    start_s: int | None = None,
    volumes: VolumeOrder | None = None,
    report: Report | None = None,
) -> ExportIndex:
    """Write the files of these formats (names, or rows of your own; docs/formats.md) and index.json into `folder`.

    The folder holds the old export until the new one is complete. Autopilots (one for all vehicles or one each) and
    rate are the scenario's unless given. `smooth_m` smooths the setpoints to within this distance of the plan. `timed`
    missions have speeds corrected for the autopilot; others have the plan's own speeds. `start_s` is the time of day
    (UTC, s) at which all vehicles leave the hover; `gates` need it. The format f3548 needs `volumes`. The plan is
    verified first, unless you pass the `report` of `gcs.verify`, with which a failed plan is written too.

    Missions that are not fit to fly are left out, and the index says why; `NotWritten` is raised if nothing else was
    asked for. Raises `UsageError` if the folder holds a file that no export wrote, or if an autopilot has no gates.
    Raises `ScenarioError` for altitudes and gates that cannot be, and OSError as the file system does. Raises
    `VerificationError` if the plan, its landing or the smoothed path violate a limit.
    """
    refuse_foreign(Path(folder).resolve())
    options = ExportOptions(formats, firmware, altitude, setpoint_rate_hz, smooth_m, timed, gates, start_s, volumes)
    return prepared(plan, options, report).write(folder)


def prepared(plan: Plan, options: ExportOptions, report: Report | None = None) -> PreparedExport:
    """What `export` would write, with its separations, before anything is written. Raises what `export` does."""
    wanted = options.wanted
    options.refuse_unordered()
    if not isinstance(report, Report):  # the stored verdict of a file is none
        report = verify(plan)
        if not report.ok:
            raise refusal(report)
    rate_hz = options.setpoint_rate_hz or plan.scenario.mission.setpoint_rate_hz
    autopilots = one_each(plan.autopilots if options.firmware is None else options.firmware, len(plan.sysids))
    order = options.order(autopilots)
    proved = None if options.volumes is None else flight_volumes(plan, options.volumes)
    safety = build_safety(plan, autopilots)
    path = None if options.smooth_m is None else smoothed(plan, options.smooth_m)
    made = make_missions(plan, order, safety, wanted)
    if made.refusal is not None and all(row.content is Content.MISSION for row in wanted):
        raise made.refusal
    rows = separations(plan, report, autopilots, made, safety.returns)
    material = _Material(plan, autopilots, safety, rate_hz, path, proved)
    return PreparedExport(wanted, options.altitude, material, made, rows)


@dataclass(frozen=True)
class PreparedExport:
    """An export that is verified and not yet written."""

    wanted: tuple[Format, ...]
    altitude: Altitude
    material: _Material
    made: MadeMissions
    separations: tuple[Separation, ...]

    @cached_property
    def index(self) -> ExportIndex:
        """All that the index will say, before there are files."""
        material, made = self.material, self.made
        return ExportIndex(
            material.plan.scenario.name,
            material.plan.hash,
            material.autopilots,
            self.altitude,
            material.rate_hz,
            max((len(legs.t_s) for legs in made.legs.values()), default=0),
            max((len(m.items) for m in made.missions), default=0),
            Deviation(
                max((legs.error.path_m for legs in made.legs.values()), default=0.0),
                max((legs.error.time_m for legs in made.legs.values()), default=0.0),
            ),
            {},
            material.safety,
            None if made.refusal is not None else made.report,
            None if material.path is None else _smoothing(material.path),
            made.timing,
            "" if made.refusal is None else made.refusal.message,
            made.missions,
            self.separations,
            material.proved,
        )

    def write(self, folder: Path | str) -> ExportIndex:
        """Write the files and their index. Raises `UsageError` for a folder of other files, and OSError."""
        material, made = self.material, self.made
        say_at("making the files")
        with replaced(Path(folder)) as files:
            for name, text in made.files.items():
                files.write(name, text)
            for content, values in _VALUES.items():
                rows = [row for row in self.wanted if row.content is content]
                for stem, value in values(material) if rows else ():
                    firmware = material.by_stem.get(stem, material.autopilots[0])
                    for row in rows:
                        name = row.file_name(stem, firmware)
                        say_at(f"writing {name}")
                        files.write(name, row.write(value))
            index = replace(self.index, sha256=dict(sorted(files.sha256.items())))
            files.write_index(index_document(index, material.plan))
        return index


def _smoothing(path: SmoothPath) -> Smoothing:
    yaw_deg = math.degrees(path.yaw_deviation_rad)
    return Smoothing(path.knots_every_s, path.deviation_m, yaw_deg, path.clearance_min_m)


@dataclass(frozen=True)
class _Material:
    """The data from which files other than missions are made."""

    plan: Plan
    autopilots: tuple[Autopilot, ...]
    safety: Safety
    rate_hz: float
    path: SmoothPath | None
    proved: ProvedVolumes | None

    @property
    def by_stem(self) -> dict[str, Autopilot]:
        """The autopilot of each vehicle by the name of its files."""
        return dict(zip(map(vehicle_name, self.plan.sysids), self.autopilots, strict=True))


_Values = Iterator[tuple[str, object]]  # name of a file without suffix, and what it holds


def _parameters(material: _Material) -> _Values:
    rows = zip(material.plan.sysids, material.autopilots, material.safety.parameters, strict=True)
    for sysid, firmware, values in rows:
        yield vehicle_name(sysid), ParameterFile(firmware, sysid, with_new_names(firmware, values))


def _setpoints(material: _Material) -> _Values:
    plan = material.plan
    origin = local_origin(plan.scenario)
    for rows in _batches(len(plan.sysids)):
        stream = build_stream(plan, material.rate_hz, material.path, rows)
        for row, sysid in enumerate(plan.sysids[rows]):
            yield vehicle_name(sysid), StreamFile(of_vehicle(stream, row), plan.hash, origin)


def _histories(material: _Material) -> _Values:
    for rows in _batches(len(material.plan.sysids)):
        for history in build_histories(material.plan, material.rate_hz, rows):
            yield vehicle_name(history.sysid), history


def _show(material: _Material) -> _Values:
    plan = material.plan
    yield (
        FLEET,
        ShowFile(plan.scenario.title or plan.scenario.name, plan.hash, tuple(plan_curves(plan, quintics=False))),
    )


def _batches(vehicles: int) -> Iterator[slice]:
    return (slice(first, first + _BATCH) for first in range(0, vehicles, _BATCH))


# The values of each content. `mission_files` makes, verifies and writes missions.
_VALUES: dict[Content, Callable[[_Material], _Values]] = {
    Content.FENCE: lambda m: ((name, m.safety.fence.geofence) for name in m.by_stem),
    Content.RALLY: lambda m: ((name, list(each)) for name, each in zip(m.by_stem, m.safety.rally, strict=True) if each),
    Content.PARAMETERS: _parameters,
    Content.SETPOINTS: _setpoints,
    Content.HISTORY: _histories,
    Content.MAP: lambda m: iter([(FLEET, build_map(m.plan, m.safety.fence.geofence))]),
    Content.PIECES: lambda m: ((vehicle_name(each.sysid), each) for each in plan_curves(m.plan, quintics=True)),
    Content.SHOW: _show,
    Content.VOLUMES: lambda m: iter([] if m.proved is None else [(FLEET, m.proved.intent)]),
}
