"""The export formats: one row for each, from which export, read-back, `gcs check`, help and docs/formats.md derive.

A new format is a module with a writer and a row here. A program may also pass a row of its own to `gcs.export`.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from importlib import import_module
from typing import Any

from gcs.autopilots.traits import Autopilot
from gcs.errors import UsageError

ALL = "all"
FLEET = "formation"  # name, without suffix, of files that hold all vehicles
Function = str | Callable[..., Any]  # "module:function" is imported when it is first called


class Content(StrEnum):
    """What a file holds: the type of the value that its writer is given and its reader returns (rally: several)."""

    MISSION = "gcs.mission.formats.mission_file.MissionFile"
    FENCE = "gcs.mission.geofence.Geofence"
    RALLY = "gcs.mission.geofence.RallyPoint"
    PARAMETERS = "gcs.mission.formats.param.ParameterFile"
    SETPOINTS = "gcs.mission.formats.tables.setpoint_table.StreamFile"
    HISTORY = "gcs.mission.formats.tables.history_csv.History"
    MAP = "gcs.mission.formats.maps.tracks.MapFile"
    PIECES = "gcs.mission.formats.vehicle_curve.VehicleCurve"
    SHOW = "gcs.mission.formats.vehicle_curve.ShowFile"
    VOLUMES = "gcs.mission.formats.flight_volume.OperationalIntent"

    @property
    def per_vehicle(self) -> bool:
        """Whether each vehicle has a file; else one file holds the formation."""
        return self not in (Content.MAP, Content.SHOW, Content.VOLUMES)

    @property
    def per_autopilot(self) -> bool:
        """Whether readers need the autopilot, as a third argument after bytes and source."""
        return self in (Content.MISSION, Content.PARAMETERS)


@dataclass(frozen=True, eq=False)
class Format:
    """One export format. `write(value)` returns text or bytes; `read` returns the value again."""

    name: str
    suffix: str | Mapping[Autopilot, str]
    content: Content
    purpose: str
    writer: Function
    reader: Function | None = None  # required for missions: every exported mission is read back and flown
    default: bool = False  # written where no format is requested
    fenced: bool = False  # mission files hold the geofence and the rally points too
    asked: bool = False  # only where it is named: it needs what "all" cannot know
    begins: bytes = b""  # first bytes of a mission file; none: any file that no other format begins

    def file_name(self, stem: str, firmware: Autopilot) -> str:
        """The name of a file with this stem."""
        return stem + (self.suffix if isinstance(self.suffix, str) else self.suffix[firmware])

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Every suffix that files of this format may have."""
        return (self.suffix,) if isinstance(self.suffix, str) else tuple(dict.fromkeys(self.suffix.values()))

    def write(self, value: Any) -> str | bytes:
        """The contents of a file that holds `value`."""
        written: str | bytes = _function(self.writer)(value)
        return written

    def read(self, data: bytes, source: str, firmware: Autopilot | None = None) -> Any:
        """The value in a file's bytes; `source` names the file in errors. Raises `FileFormatError`."""
        if self.reader is None:
            raise UsageError(f"format '{self.name}' has no reader")
        return _function(self.reader)(data, source, *([firmware] if self.content.per_autopilot else []))


def _row(
    name: str, functions: str, content: Content, purpose: str, suffix: str | Mapping[Autopilot, str] = "", **more: Any
) -> Format:
    """A row of the table; `functions` is "module:value": `write_value`, and `read_value` of what flies."""
    module, value = functions.split(":")
    writer, reader = (f"gcs.mission.formats.{module}:{does}_{value}" for does in ("write", "read"))
    read_back = content not in (Content.HISTORY, Content.MAP, Content.PIECES, Content.SHOW)
    return Format(name, suffix or f".{name}", content, purpose, writer, reader if read_back else None, **more)


_PLAN = "Waypoint mission, geofence and rally point for QGroundControl"
_WAYPOINTS = "Waypoint mission for Mission Planner and MAVProxy (QGC WPL 110)"
_SETPOINTS = "Timed setpoints in the formation's common NED frame, as CSV"
_PARQUET = "The same setpoints as Parquet, with checksums"
_HISTORY = "State and control of Eq. 1 over the whole plan, as CSV, for plots and comparisons"
_PARAM = "Return (RTL) and fence parameters: `.param` for Mission Planner and MAVProxy, `.params` for QGroundControl"
_GEOJSON = "Tracks, plan times, route points and the geofence, for GIS programs (QGIS) and web maps"
_KML = "Tracks in time, route points and the geofence, for Google Earth"
_PIECES = "Polynomials from take-off to landing, as uav_trajectories and Crazyswarm have them, within 1 mm of the plan"
_SKYC = "Show for Skybrush, without lights, within 1 mm of the plan"
_F3548 = "Volumes in space and time (ASTM F3548) that hold all vehicles, proved; needs `--takeoff` and `--geoid`"
_PARAMETER_FILES = {known: str(known.traits.parameter_file) for known in Autopilot}
FORMATS = (
    _row("plan", "qgc_plan:mission", Content.MISSION, _PLAN, default=True, fenced=True),
    _row("waypoints", "qgc_wpl:mission", Content.MISSION, _WAYPOINTS, default=True, begins=b"QGC"),
    _row("fence", "qgc_wpl:fence", Content.FENCE, "Geofence for MAVProxy (QGC WPL 110)"),
    _row("rally", "qgc_wpl:rally", Content.RALLY, "Rally point for MAVProxy (QGC WPL 110)"),
    _row("setpoints", "tables.setpoint_table:setpoints", Content.SETPOINTS, _SETPOINTS, default=True),
    _row("parquet", "tables.setpoints_parquet:setpoints_parquet", Content.SETPOINTS, _PARQUET),
    _row("history", "tables.history_csv:history", Content.HISTORY, _HISTORY, ".history.csv"),
    _row("param", "param:parameters", Content.PARAMETERS, _PARAM, _PARAMETER_FILES),
    _row("kml", "maps.kml:kml", Content.MAP, _KML),
    _row("kmz", "maps.kml:kmz", Content.MAP, "The same map, compressed"),
    _row("geojson", "maps.geojson:geojson", Content.MAP, _GEOJSON),
    _row("pieces", "pieces_csv:pieces", Content.PIECES, _PIECES, ".pieces.csv"),
    _row("skyc", "skyc:show", Content.SHOW, _SKYC),
    _row("f3548", "f3548:operational_intent", Content.VOLUMES, _F3548, ".f3548.json", asked=True),
)
DEFAULT = tuple(row for row in FORMATS if row.default)


def vehicle_name(sysid: int) -> str:
    """Name, without suffix, of one vehicle's files."""
    return f"uav{sysid}"


def select_formats(wanted: Iterable[str | Format]) -> tuple[Format, ...]:
    """The rows of these formats: those of the table in its order, then the caller's own; "all" means the table,
    without rows that must be named.

    Raises `UsageError` for an unknown name, for a mission format without a reader, and for two formats that would
    write the same file.
    """
    own: list[Format] = []
    names: set[str] = set()
    table = {row.name: row for row in FORMATS}
    for one in wanted:
        if isinstance(one, Format):
            own += [one] if one not in (*FORMATS, *own) else []
            names |= {one.name} if one in FORMATS else set()
        elif one == ALL:
            names |= {row.name for row in FORMATS if not row.asked}
        elif one in table:
            names.add(one)
        else:
            raise UsageError(f"there is no format '{one}'", hint=f"choose from {', '.join(table)}, and {ALL}")
    rows = (*(row for row in FORMATS if row.name in names), *own)
    files: dict[tuple[bool, str], str] = {}
    for row in rows:
        if row.content is Content.MISSION and row.reader is None:
            text = f"format '{row.name}' holds missions and has no reader"
            raise UsageError(text, hint="give it one: every exported mission is read back and flown")
        for suffix in row.suffixes:
            other = files.setdefault((row.content.per_vehicle, suffix), row.name)
            if other != row.name:
                raise UsageError(f"formats '{other}' and '{row.name}' both write files that end in {suffix}")
    return rows


def suffixes_of(content: Content) -> str:
    """The suffixes of files that hold this, for help texts."""
    return ", ".join(suffix for row in FORMATS if row.content is content for suffix in row.suffixes)


def _function(function: Function) -> Callable[..., Any]:
    if not isinstance(function, str):
        return function
    module, name = function.split(":")
    loaded: Callable[..., Any] = getattr(import_module(module), name)
    return loaded
