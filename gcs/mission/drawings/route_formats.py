"""The route formats, one row each: drawn files are recognised and read by it, docs/formats.md is printed from it.

A new format is a reader and a row here. A program may also give a row of its own to `read_drawing`.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from gcs.errors import FileFormatError
from gcs.mission.drawings.drawing import Drawing
from gcs.mission.drawings.geojson_drawing import GEOJSON_TYPES, draw_geojson
from gcs.mission.drawings.mission_drawing import draw_mission, draw_plan, draw_point_list
from gcs.mission.drawings.xml_drawing import draw_gpx, draw_kml, draw_kmz
from gcs.mission.formats.point_lists import begins_fence, begins_rally
from gcs.mission.formats.qgc_plan import is_mission_json
from gcs.mission.formats.table_rows import HEADER
from gcs.mission.formats.vendor_quirks import MARK, decoded, first_line
from gcs.util.bounded_file import DRAWING_FILE, SHEETS, as_utf8, read_file, read_json
from gcs.util.bounded_xml import root_of


@dataclass(frozen=True)
class DrawnFile:
    """The bytes of a drawn file, and what its format is recognised by."""

    data: bytes
    source: str

    @cached_property
    def start(self) -> bytes:
        """The bytes from the first character on: no byte order mark of UTF-8, no blanks."""
        return self.data.removeprefix(b"\xef\xbb\xbf").lstrip()

    @cached_property
    def is_xml(self) -> bool:
        """Whether it begins as XML does."""
        return self.start.startswith(b"<")

    @cached_property
    def is_gpx(self) -> bool:
        """Whether it is XML whose root is that of GPX."""
        return self.is_xml and root_of(self.data) == "gpx"

    @cached_property
    def is_json(self) -> bool:
        """Whether it begins as JSON does."""
        return self.start.startswith((b"{", b"["))

    @cached_property
    def members(self) -> dict[str, object]:
        """The members of a JSON object; none for every other file. Raises `FileFormatError` for broken JSON."""
        try:
            text = decoded(self.data, self.source).removeprefix(MARK) if self.is_json else ""
            document = read_json(text, not_finite=True) if text else None
        except json.JSONDecodeError as error:
            hint = "save the drawing as one document: GeoJSON or .plan"
            raise FileFormatError(f"{self.source}, line {error.lineno}: not JSON: {error.msg}.", hint=hint) from error
        except ValueError as error:
            raise FileFormatError(f"{self.source}: {error}.") from error
        return document if isinstance(document, dict) else {}


@dataclass(frozen=True)
class RouteFormat:
    """One route format. `holds` recognises its files, `reader` returns the drawing in their bytes."""

    suffixes: tuple[str, ...]  # as people know them: files are recognised by their content
    route: str  # what is the route of a file
    holds: Callable[[DrawnFile], bool]
    reader: Callable[[bytes, str], Drawing]  # of bytes and the file's name for errors; raises `FileFormatError`


def _is_mission(file: DrawnFile) -> bool:
    """Also rally points, whose reader says that they are no route."""
    line = first_line(file.data)
    begins = line.startswith(HEADER.split()[0]) or begins_rally(line)
    return is_mission_json(file.data) if file.is_json else begins


def _is_point_list(file: DrawnFile) -> bool:
    return not file.is_json and begins_fence(first_line(file.data))


_PLAN = "The items; those of surveys and corridors as QGroundControl stored them"
_GEOJSON = "The first line, else the points in order"
_KML = "The first line, else the first track, else the points in order"
_GPX = "The first route, else the first track, else the waypoints in order"
# The first row that recognises a file reads it.
ROUTE_FORMATS = (
    RouteFormat((".plan",), _PLAN, lambda file: file.members.get("fileType") == "Plan", draw_plan),
    RouteFormat((".kmz",), "As of the KML in it", lambda file: file.start.startswith(b"PK"), draw_kmz),
    RouteFormat((".gpx",), _GPX, lambda file: file.is_gpx, draw_gpx),
    RouteFormat((".kml",), _KML, lambda file: file.is_xml, draw_kml),
    RouteFormat((".geojson",), _GEOJSON, lambda file: file.members.get("type") in GEOJSON_TYPES, draw_geojson),
    RouteFormat((".waypoints", ".mission"), "The items, also of older versions", _is_mission, draw_mission),
    RouteFormat((".poly", ".fen"), "None: the area of a survey", _is_point_list, draw_point_list),
)


def read_drawing(path: Path, formats: Sequence[RouteFormat] = ROUTE_FORMATS) -> Drawing:
    """The drawing in a file. Raises `FileFormatError` with file and reason for one that is no drawing."""
    return drawing_in(read_file(path, DRAWING_FILE, hint=_hint(formats)), str(path), formats)


def drawing_in(data: bytes, source: str, formats: Sequence[RouteFormat] = ROUTE_FORMATS) -> Drawing:
    """The drawing in a file's bytes; `source` names it in errors. Raises `FileFormatError`."""
    try:
        data = as_utf8(data)
    except ValueError as error:
        raise FileFormatError(f"{source}: {error}.") from error
    file = DrawnFile(data, source)
    for row in formats:
        if row.holds(file):
            return row.reader(data, source)
    if Path(source).suffix.lower() in SHEETS and file.start:
        hint = "save its points as a line: KML, GPX or GeoJSON; --positions takes the places of vehicles on the ground"
        raise FileFormatError(f"{source}: is a sheet, and no drawing.", hint=hint)
    what = "neither a .plan nor GeoJSON" if file.is_json else "no drawing" if file.start else "empty"
    raise FileFormatError(f"{source}: is {what}.", hint=_hint(formats))


def _hint(formats: Sequence[RouteFormat]) -> str:
    return f"give a drawing: {', '.join(suffix for row in formats for suffix in row.suffixes)}"
