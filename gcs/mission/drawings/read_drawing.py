"""Drawn files of any format: the format is found from the beginning of the file, whatever its suffix."""

from __future__ import annotations

import json
from pathlib import Path

from gcs.errors import FileFormatError
from gcs.mission.drawings.drawing import Drawing
from gcs.mission.drawings.geojson_drawing import draw_geojson
from gcs.mission.drawings.mission_drawing import draw_mission, draw_plan
from gcs.mission.drawings.xml_drawing import draw_gpx, draw_kml, draw_kmz
from gcs.mission.formats.foreign.oddities import first_line
from gcs.mission.formats.foreign.point_lists import begins_fence, begins_rally
from gcs.mission.formats.foreign.table_rows import HEADER
from gcs.mission.formats.qgc_plan import is_mission_json
from gcs.reading.bounded_file import DRAWING_FILE, read_file
from gcs.reading.bounded_json import read_json

SUFFIXES = (".plan", ".waypoints", ".mission", ".kml", ".kmz", ".gpx", ".geojson")
_HINT = f"give a drawing: {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}"
_ARCHIVE, _MARK = b"PK", b"\xef\xbb\xbf"
_MAPS = (
    *("FeatureCollection", "Feature", "GeometryCollection", "LineString", "MultiLineString", "Point", "MultiPoint"),
    *("Polygon", "MultiPolygon"),
)
_BEGINNING = 4096  # bytes in which the root of an XML document begins


def read_drawing(path: Path) -> Drawing:
    """The drawing in a file. Raises `FileFormatError` with file and reason for one that is no drawing."""
    data = read_file(path, DRAWING_FILE, hint=_HINT)
    return drawing_in(data, str(path))


def drawing_in(data: bytes, source: str) -> Drawing:
    """The drawing in a file's bytes; `source` names it in errors. Raises `FileFormatError`."""
    start = data.removeprefix(_MARK).lstrip()
    if start.startswith(_ARCHIVE):
        return draw_kmz(data, source)
    if start.startswith(b"<") or start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return _draw_xml(data, source)
    if start.startswith((b"{", b"[")):
        return _draw_json(data, source)
    line = first_line(data)
    if line.startswith(HEADER.split()[0]) or begins_fence(line) or begins_rally(line):
        return draw_mission(data, source)
    raise FileFormatError(f"{source}: is {'no drawing' if start else 'empty'}.", hint=_HINT)


def _draw_xml(data: bytes, source: str) -> Drawing:
    is_gpx = b"<gpx" in data[:_BEGINNING].replace(b"\0", b"")
    return draw_gpx(data, source) if is_gpx else draw_kml(data, source)


def _draw_json(data: bytes, source: str) -> Drawing:
    if is_mission_json(data):
        return draw_mission(data, source)
    try:
        document = read_json(data.decode("utf-8-sig"))
    except json.JSONDecodeError as error:
        raise FileFormatError(f"{source}, line {error.lineno}: not JSON: {error.msg}.") from error
    except ValueError as error:
        raise FileFormatError(f"{source}: {error}.") from error
    if isinstance(document, dict) and document.get("type") in _MAPS:
        return draw_geojson(data, source)
    if isinstance(document, dict) and document.get("fileType") == "Plan":
        return draw_plan(data, source)
    raise FileFormatError(f"{source}: is neither a .plan nor GeoJSON.", hint=_HINT)
