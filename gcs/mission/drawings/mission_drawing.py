"""Routes in mission files: QGroundControl's `.plan` with its patterns, and the tables and JSON of any program."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import shapely
from pydantic import Field, TypeAdapter, ValidationError

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError
from gcs.frames import Origin, ned_to_geodetic, place_up_m
from gcs.mavlink import FenceCommand
from gcs.mission.drawings.drawing import Drawing, DrawnArea, Place, on_line, refusal, tidy
from gcs.mission.drawings.item_course import ItemCourse, NumberedItem
from gcs.mission.drawings.labels import Label
from gcs.mission.drawings.sketch import Sketch
from gcs.mission.formats.any_mission import read_mission
from gcs.mission.formats.mission_file import Key, lines_of
from gcs.mission.formats.plan_items import ITEMS_MAX, ComplexItem, PlanItem, PlanPart, PlanText, Point
from gcs.mission.formats.point_lists import begins_rally, numbered_points, read_fence_list
from gcs.mission.formats.qgc_plan import PlanDocument, fence_in_plan, rally_in_plan
from gcs.mission.formats.vendor_quirks import Quirk, QuirkKind, first_line
from gcs.mission.geofence import Geofence, RallyPoint
from gcs.mission.model import Home

_NOWHERE_DEG = 1e-6  # a home at 0 N 0 E is one that was not set
_STRUCTURE = "StructureScan"
_PATTERNS = {"survey": "survey", "CorridorScan": "corridor", _STRUCTURE: "structure"}
_CHANGING = frozenset(  # quirks with which something else is flown than some other program would fly
    (
        *(QuirkKind.ALTITUDE, QuirkKind.EMPTY, QuirkKind.SEQ, QuirkKind.YAW, QuirkKind.HOME),
        *(QuirkKind.FENCE_1, QuirkKind.FENCE_EMPTY, QuirkKind.RALLY_1),
    )
)
_LANDINGS = ("fwLandingPattern", "vtolLandingPattern")


class _Stored(PlanPart):
    """The simple items of a survey or corridor, as QGroundControl computed them."""

    items: list[PlanItem] = Field(alias="Items", max_length=ITEMS_MAX)


_POLYGON = TypeAdapter(list[Point])
_WIDTH_M = TypeAdapter(Annotated[float, Field(gt=0.0, allow_inf_nan=False)])


def draw_plan(data: bytes, source: str) -> Drawing:
    """The drawing in a `.plan` file, its patterns as QGroundControl stored them. Raises `FileFormatError`."""
    plan = PlanText(data, source)
    document = plan.parsed(PlanDocument)
    sketch = Sketch(source)
    home = _home(Home(*document.mission.plannedHomePosition))
    named = document.mission.firmwareType
    course = ItemCourse(sketch, home, Autopilot(named) if named in tuple(Autopilot) else None)
    lines = _plan_lines(plan.text, document)
    course.follow(_items(document.mission.items, plan, sketch, lines))
    rows = [row for row, one in enumerate(document.geoFence.polygons) if one.polygon]
    _fence(fence_in_plan(document.geoFence, plan), rows, sketch, lines)
    _rally(rally_in_plan(document.rallyPoints, plan), sketch, lines)
    _quirks(plan.quirks.found(), sketch)
    speed_mps = document.mission.hoverSpeed
    return sketch.drawing(home=course.home, speed_mps=speed_mps if speed_mps > 0.0 else None, returns=course.returns)


def draw_mission(data: bytes, source: str) -> Drawing:
    """The drawing in a mission file of another format. Raises `FileFormatError`, also for a fence or rally points."""
    if begins_rally(first_line(data)):
        raise FileFormatError(f"{source}: holds rally points, and no route.", hint="give the file with the route")
    file = read_mission(data, source)
    lines = file.item_lines
    if file.items and {item.command for item in file.items} <= set(FenceCommand):
        raise FileFormatError(f"{source}: holds a fence or rally points, and no route.", hint="give the mission")
    sketch = Sketch(source)
    home = None if file.home is None else _home(file.home)
    course = ItemCourse(sketch, home, file.firmware)
    first = 1 if file.text else file.jumps_from
    rows = enumerate(zip(file.items, lines, strict=True), start=first)
    course.follow([NumberedItem(number, item, line=line) for number, (item, line) in rows])
    _quirks(file.quirks, sketch)
    return sketch.drawing(home=course.home, speed_mps=file.speed_mps, returns=course.returns)


def draw_point_list(data: bytes, source: str) -> Drawing:
    """The polygon in a list of points: of Mission Planner, or a fence, whose first point is where vehicles return to.

    Raises `FileFormatError`.
    """
    sketch = Sketch(source)
    if Path(source).suffix.lower() == ".fen":
        read_fence_list(data, source)  # refuses a fence that other programs would read otherwise
    rows = numbered_points(data, source)
    if len(rows) > 2 and rows[-1][1] == rows[1][1] != rows[0][1]:
        line, _ = rows.pop(0)
        sketch.leave_out(Label("line", line), "the return point of a fence; not carried over")
    line = rows[0][0] if rows else 1
    try:
        with on_line(line):
            sketch.add_area(Label("the polygon", line=line), [point.place_deg for _, point in rows])
    except ValueError as error:
        raise refusal(source, error, "a polygon") from error
    return sketch.drawing()


def _plan_lines(text: str, document: PlanDocument) -> dict[tuple[Key, ...], int]:
    """The lines of what sentences name in a plan."""
    counts: dict[tuple[Key, ...], int] = {
        ("mission", "items"): len(document.mission.items),
        ("geoFence", "polygons"): len(document.geoFence.polygons),
        ("geoFence", "circles"): len(document.geoFence.circles),
        ("rallyPoints", "points"): len(document.rallyPoints.points),
    }
    rows: list[tuple[Key, ...]] = [(*path, row) for path, count in counts.items() for row in range(count)]
    return lines_of(text, [*rows, ("geoFence", "breachReturn")])


def _quirks(quirks: Iterable[Quirk], sketch: Sketch) -> None:
    """Leave out what was read otherwise than it was written."""
    for quirk in quirks:
        if quirk.kind in _CHANGING:
            sketch.leave_out(Label("line", quirk.line), str(quirk))


def _items(
    items: Sequence[PlanItem | ComplexItem], plan: PlanText, sketch: Sketch, lines: Mapping[tuple[Key, ...], int]
) -> Iterator[NumberedItem]:
    """The items of a plan, with those in its patterns, numbered as QGroundControl numbers them."""
    number = 1
    for index, item in enumerate(items):
        path: tuple[Key, ...] = ("mission", "items", index)
        if isinstance(item, PlanItem):
            number = item.number(index) if item.doJumpId is not None else number
            yield NumberedItem(number, plan.item(item, path), line=lines[path])
            number += 1
            continue
        name = _PATTERNS.get(item.complexItemType, tidy(item.complexItemType)[:40])
        label = Label("item", number, f"({name})", line=lines[path])
        _area_of_pattern(item, label, sketch)
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
            yield NumberedItem(number, plan.item(one, (*inner, "Items", row)), name, lines[path])
        number += max(1, len(stored))


def _area_of_pattern(item: ComplexItem, label: Label, sketch: Sketch) -> None:
    """Add the area that a pattern is to survey; one that cannot be read is left out with a sentence."""
    try:
        if item.complexItemType == _STRUCTURE and item.polygon is not None:
            sketch.leave_out(label, "its outline is that of a building, and no area to survey")
            return
        if item.polygon is not None:
            edge: Sequence[Place] = _POLYGON.validate_python(item.polygon)
        elif item.polyline is not None:
            edge = _corridor(_POLYGON.validate_python(item.polyline), _WIDTH_M.validate_python(item.CorridorWidth))
        else:
            return
        if not edge:
            sketch.lost_surveys.append(label)
        sketch.add_area(label, edge, survey=True)
    except ValueError as error:  # also of pydantic, whose sentences have many lines
        sketch.lost_surveys.append(label)
        reason = "it is no list of places" if isinstance(error, ValidationError) else str(error)
        sketch.leave_out(label, f"its area is not read: {reason}")


def _corridor(line: Sequence[Place], width_m: float) -> Sequence[Place]:
    """The outline of a corridor."""
    if len(line) < 2:
        return ()
    origin = Origin(*line[0], 0.0)
    lat, lon = np.array(line).T
    middle = shapely.LineString(place_up_m(lat, lon, 0.0, origin)[:, :2])
    outline = middle.buffer(width_m / 2.0, cap_style="flat", join_style="mitre")
    corners_m = shapely.get_coordinates(outline.exterior)
    lat, lon, _ = ned_to_geodetic(np.column_stack([corners_m, np.zeros(len(corners_m))]), origin)
    return [(float(a), float(b)) for a, b in zip(lat, lon, strict=True)]


def _home(home: Home) -> Home | None:
    return home if max(abs(home.lat_deg), abs(home.lon_deg)) > _NOWHERE_DEG else None


def _fence(fence: Geofence, rows: Sequence[int], sketch: Sketch, lines: Mapping[tuple[Key, ...], int]) -> None:
    """Add the areas of a fence, whose polygons are those at `rows` of the file."""
    for row, polygon in zip(rows, fence.polygons, strict=True):
        corners = tuple(place.place_deg for place in polygon.points)
        label = Label("fence polygon", row + 1, line=lines["geoFence", "polygons", row])
        sketch.areas.append(DrawnArea(corners, label, polygon.inclusion))
    for row, circle in enumerate(fence.circles):
        label = Label("fence circle", row + 1, line=lines["geoFence", "circles", row])
        sketch.areas.append(DrawnArea((circle.center.place_deg,), label, circle.inclusion, radius_m=circle.radius_m))
    if fence.return_point is not None:
        label = Label("the fence's return point", line=lines["geoFence", "breachReturn"])
        sketch.leave_out(label, "not carried over; failsafes choose where vehicles return to")


def _rally(points: Sequence[RallyPoint], sketch: Sketch, lines: Mapping[tuple[Key, ...], int]) -> None:
    for row, _ in enumerate(points):
        label = Label("rally point", row + 1, line=lines["rallyPoints", "points", row])
        sketch.leave_out(label, "not carried over; `gcs export` writes one for each vehicle")
