"""Drawn files of any format, which is found from the beginning of the file, whatever its suffix.

Those with missions are QGroundControl's `.plan` with its patterns, and the tables and JSON of any program.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from pydantic import Field, ValidationError

from gcs.autopilots.traits import traits_of
from gcs.errors import FileFormatError
from gcs.frames import from_degE7
from gcs.mavlink import FenceCommand
from gcs.mission.drawings.drawing import Drawing, DrawnArea, DrawnDisk, Sketch, tidy
from gcs.mission.drawings.geojson_drawing import draw_geojson
from gcs.mission.drawings.item_course import ItemCourse, NumberedItem
from gcs.mission.drawings.xml_drawing import draw_gpx, draw_kml, draw_kmz
from gcs.mission.formats.any_mission import read_mission
from gcs.mission.formats.mission_file import Key
from gcs.mission.formats.plan_items import ITEMS_MAX, ComplexItem, PlanItem, PlanPart, PlanText
from gcs.mission.formats.point_lists import begins_fence, begins_rally
from gcs.mission.formats.qgc_plan import PlanDocument, fence_in_plan, is_mission_json, rally_in_plan
from gcs.mission.formats.table_rows import HEADER
from gcs.mission.formats.vendor_quirks import first_line
from gcs.mission.geofence import Geofence, GeoPoint, RallyPoint
from gcs.mission.model import Home
from gcs.util.bounded_file import DRAWING_FILE, read_file, read_json

SUFFIXES = (".plan", ".waypoints", ".mission", ".kml", ".kmz", ".gpx", ".geojson")
_HINT = f"give a drawing: {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}"
_ARCHIVE, _MARK = b"PK", b"\xef\xbb\xbf"
_MAPS = (
    *("FeatureCollection", "Feature", "GeometryCollection", "LineString", "MultiLineString", "Point", "MultiPoint"),
    *("Polygon", "MultiPolygon"),
)
_BEGINNING = 4096  # bytes in which the root of an XML document begins
_NOWHERE_DEG = 1e-6  # a home at 0 N 0 E is one that was not set
_PATTERNS = {"survey": "survey", "CorridorScan": "corridor", "StructureScan": "structure"}
_LANDINGS = ("fwLandingPattern", "vtolLandingPattern")


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


class _Stored(PlanPart):
    """The simple items of a survey or corridor, as QGroundControl computed them."""

    items: list[PlanItem] = Field(alias="Items", max_length=ITEMS_MAX)


def draw_plan(data: bytes, source: str) -> Drawing:
    """The drawing in a `.plan` file, its patterns as QGroundControl stored them. Raises `FileFormatError`."""
    plan = PlanText(data, source)
    document = plan.parsed(PlanDocument)
    sketch = Sketch(source)
    home = _home(Home(*document.mission.plannedHomePosition))
    row = traits_of(document.mission.firmwareType)
    course = ItemCourse(sketch, home, row is not None and row.missions.height_0_is_height_before)
    course.follow(_items(document.mission.items, plan, sketch))
    _fence(fence_in_plan(document.geoFence, plan), sketch)
    _rally(rally_in_plan(document.rallyPoints, plan), sketch)
    speed_mps = document.mission.hoverSpeed
    return sketch.drawing(home=course.home, speed_mps=speed_mps if speed_mps > 0.0 else None, returns=course.returns)


def draw_mission(data: bytes, source: str) -> Drawing:
    """The drawing in a mission file of another format. Raises `FileFormatError`, also for a fence or rally points."""
    start = first_line(data)
    if begins_fence(start) or begins_rally(start):
        what = "a fence" if begins_fence(start) else "rally points"
        raise FileFormatError(f"{source}: holds {what}, and no route.", hint="give the file with the route")
    file = read_mission(data, source)
    if file.items and {item.command for item in file.items} <= set(FenceCommand):
        raise FileFormatError(f"{source}: holds a fence or rally points, and no route.", hint="give the mission")
    sketch = Sketch(source)
    home = None if file.home is None else _home(file.home)
    course = ItemCourse(sketch, home, file.firmware.traits.missions.height_0_is_height_before)
    first = 1 if file.text else file.jumps_from
    course.follow(NumberedItem(number, item) for number, item in enumerate(file.items, start=first))
    _fence(file.geofence, sketch)
    _rally(file.rally, sketch)
    return sketch.drawing(home=course.home, speed_mps=file.speed_mps, returns=course.returns)


def _items(items: Sequence[PlanItem | ComplexItem], plan: PlanText, sketch: Sketch) -> Iterator[NumberedItem]:
    """The items of a plan, with those in its patterns, numbered as QGroundControl numbers them."""
    number = 1
    for index, item in enumerate(items):
        path: tuple[Key, ...] = ("mission", "items", index)
        if isinstance(item, PlanItem):
            number = item.number(index) if item.doJumpId is not None else number
            yield NumberedItem(number, plan.item(item, path))
            number += 1
            continue
        name = _PATTERNS.get(item.complexItemType, tidy(item.complexItemType)[:40])
        label = f"item {number} ({name})"
        if item.complexItemType in _LANDINGS:
            sketch.leave_out(label, "landing patterns are not carried over; the formation lands below its last point")
            number += 1
            continue
        if item.TransectStyleComplexItem is None:
            sketch.leave_out(label, "the file does not store its points; replace it by waypoints")
            number += 1
            continue
        inner = (*path, "TransectStyleComplexItem")
        try:
            stored = _Stored.model_validate(item.TransectStyleComplexItem).items
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            raise plan.refused((*inner, *first["loc"]), first["msg"]) from error
        if not stored:
            sketch.leave_out(label, "the file stores no points of it; open and save it in QGroundControl")
        for row, one in enumerate(stored):
            yield NumberedItem(number, plan.item(one, (*inner, "Items", row)), name)
        number += max(1, len(stored))


def _home(home: Home) -> Home | None:
    return home if max(abs(home.lat_deg), abs(home.lon_deg)) > _NOWHERE_DEG else None


def _fence(fence: Geofence, sketch: Sketch) -> None:
    for number, polygon in enumerate(fence.polygons, start=1):
        corners = tuple(map(_degrees, polygon.points))
        sketch.areas.append(DrawnArea(corners, f"fence polygon {number}", polygon.inclusion))
    for number, circle in enumerate(fence.circles, start=1):
        label = f"fence circle {number}"
        sketch.disks.append(DrawnDisk(_degrees(circle.center), circle.radius_m, label, circle.inclusion))
    if fence.return_point is not None:
        sketch.leave_out("the fence's return point", "not carried over; failsafes choose where vehicles return to")


def _rally(points: Sequence[RallyPoint], sketch: Sketch) -> None:
    for number, _ in enumerate(points, start=1):
        sketch.leave_out(f"rally point {number}", "not carried over; `gcs export` writes one for each vehicle")


def _degrees(place: GeoPoint) -> tuple[float, float]:
    return from_degE7(place.lat_degE7), from_degE7(place.lon_degE7)
