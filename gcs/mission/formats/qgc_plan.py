"""`.plan` files: QGroundControl's JSON, mission version 2, with its geofence and rally points (both version 2).

Only simple items are read. Survey patterns and other complex items are refused by name. `.mission` files
came before: version 1.0, a flat list of items, and version 2. They are only read.
"""

import json
import math
from dataclasses import replace
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, Field

from gcs.autopilots.traits import Autopilot
from gcs.mission.formats.item_place import place_in_file
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.plan_items import (
    ITEMS_MAX,
    AnyItem,
    Finite,
    PlanItem,
    PlanPart,
    PlanText,
    Point,
    PointAndAltitude,
    Whole,
)
from gcs.mission.formats.vendor_quirks import MARK, QuirkKind
from gcs.mission.geofence import LEAST_VERTICES, FenceCircle, FencePolygon, Geofence, GeoPoint, RallyPoint
from gcs.mission.model import Frame, Home, MissionItem
from gcs.util.bounded_file import refuse_crowded_json

_MULTIROTOR = 2  # MAV_TYPE_QUADROTOR
# QGroundControl's own altitude modes, by frame: relative 1, AMSL 2, terrain frame 4; 0 if items differ.
_ALTITUDE_MODE = {Frame.GLOBAL: 2, Frame.GLOBAL_RELATIVE_ALT: 1, Frame.GLOBAL_TERRAIN_ALT: 4}
_MIXED = 0
_CRUISE_MPS, _HOVER_MPS = 15.0, 5.0  # for its time estimate only


class PlannedMission(PlanPart):
    """The key `mission`, and all of a `.mission` file of version 2."""

    version: Literal[2]
    firmwareType: Whole
    cruiseSpeed: Finite = _CRUISE_MPS
    hoverSpeed: Finite = _HOVER_MPS
    plannedHomePosition: PointAndAltitude
    items: Annotated[list[AnyItem], Field(max_length=ITEMS_MAX)]


def _enough(corners: list[Point]) -> list[Point]:
    if 0 < len(corners) < LEAST_VERTICES:
        raise ValueError(f"a polygon has {LEAST_VERTICES} corners or more, got {len(corners)}")
    return corners


class _Polygon(PlanPart):
    inclusion: bool = True
    polygon: Annotated[list[Point], AfterValidator(_enough)]


class _Disk(PlanPart):
    center: Point
    radius: Annotated[Finite, Field(gt=0)]


class _Circle(PlanPart):
    inclusion: bool = True
    circle: _Disk


class _Fence(PlanPart):
    version: Literal[1, 2] | None = None
    polygon: object = None  # of version 1
    polygons: list[_Polygon] = Field(default_factory=list)
    circles: list[_Circle] = Field(default_factory=list)
    breachReturn: PointAndAltitude | None = None


class _Rally(PlanPart):
    version: Literal[1, 2]
    points: list[PointAndAltitude] = Field(default_factory=list)


class PlanDocument(PlanPart):
    """All of a `.plan` file."""

    fileType: Literal["Plan"]
    version: Literal[1]
    mission: PlannedMission
    geoFence: _Fence = _Fence(version=2)
    rallyPoints: _Rally = _Rally(version=2)


def write_mission(file: MissionFile) -> str:
    """The text of a file that holds this mission, its fence and its rally points. NaN is null, as in QGroundControl."""
    if file.home is None:
        raise ValueError(f"{file.source}: a .plan holds a home position, and this mission has none")
    speed_mps = file.speed_mps
    modes = {_ALTITUDE_MODE[Frame(i.frame)] for i in file.items if i.frame in _ALTITUDE_MODE}
    document = {
        "fileType": "Plan",
        "geoFence": _written_fence(file.geofence),
        "groundStation": "Skein",
        "mission": {
            "cruiseSpeed": _CRUISE_MPS if speed_mps is None else speed_mps,
            "firmwareType": int(file.firmware),
            "globalPlanAltitudeMode": modes.pop() if len(modes) == 1 else _MIXED,
            "hoverSpeed": _HOVER_MPS if speed_mps is None else speed_mps,
            "items": [_written(item, number) for number, item in enumerate(file.items, start=1)],
            "plannedHomePosition": [file.home.lat_deg, file.home.lon_deg, file.home.alt_amsl_m],
            "vehicleType": _MULTIROTOR,
            "version": 2,
        },
        "rallyPoints": {"points": [_written_point(p) for p in file.rally], "version": 2},
        "version": 1,
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def read_mission(data: str | bytes, source: str, firmware: Autopilot | None = None) -> MissionFile:
    """The mission in a file, for `firmware` or the autopilot that the file names; `source` names the file in errors.

    What other programs write otherwise is in `quirks`. Raises `FileFormatError` with file, line, key and reason for
    anything that cannot be flown as written.
    """
    plan = PlanText(data, source)
    document = plan.parsed(PlanDocument)
    found = _planned(document.mission, ("mission",), plan, firmware)
    fence, rally = fence_in_plan(document.geoFence, plan), rally_in_plan(document.rallyPoints, plan)
    return replace(found, geofence=fence, rally=rally, quirks=plan.quirks.found())


def _planned(
    mission: PlannedMission,
    at: tuple[str, ...],
    plan: PlanText,
    firmware: Autopilot | None,
    named: str = "firmwareType",
) -> MissionFile:
    """The mission `at` a key of a file. `named` is the key of its autopilot."""
    autopilot = plan.autopilot(mission.firmwareType, (*at, named), firmware)
    return MissionFile(
        plan.source,
        autopilot if firmware is None else firmware,
        Home(*mission.plannedHomePosition),
        plan.mission_items(mission.items, (*at, "items")),
        speed_mps=mission.hoverSpeed if mission.hoverSpeed > 0 else None,
        text=plan.text,
        items_path=(*at, "items"),
        quirks=plan.quirks.found(),
    )


def _written(item: MissionItem, number: int) -> dict[str, object]:
    numbers = (*item.params, *place_in_file(item), item.alt_m)
    params = [None if math.isnan(number) else number for number in numbers]
    written: dict[str, object] = {
        "autoContinue": item.autocontinue,
        "command": int(item.command),
        "doJumpId": number,
        "frame": int(item.frame),
        "params": params,
        "type": "SimpleItem",
    }
    if item.frame in _ALTITUDE_MODE:
        mode = _ALTITUDE_MODE[Frame(item.frame)]
        written |= {"AMSLAltAboveTerrain": None, "Altitude": params[-1], "AltitudeMode": mode}
    return dict(sorted(written.items()))


def _written_fence(fence: Geofence) -> dict[str, object]:
    circles = [
        {"circle": {"center": c.center.place_deg, "radius": c.radius_m}, "inclusion": c.inclusion, "version": 1}
        for c in fence.circles
    ]
    polygons = [
        {"inclusion": p.inclusion, "polygon": [place.place_deg for place in p.points], "version": 1}
        for p in fence.polygons
    ]
    written: dict[str, object] = {"circles": circles, "polygons": polygons, "version": 2}
    if fence.return_point is not None:
        written["breachReturn"] = _written_point(fence.return_point)
    return written


def fence_in_plan(fence: _Fence, plan: PlanText) -> Geofence:
    """The fence of a document. Raises `FileFormatError` for one of version 1 that is not empty."""
    if fence.version != 2:
        path = ("geoFence", "version")
        if fence.polygon or fence.polygons or fence.circles or fence.breachReturn:
            raise plan.refused(path, f"Input should be 2, got {fence.version}; QGroundControl drops older fences")
        plan.note(QuirkKind.FENCE_1, path, f"{fence.version} instead of 2; the fence is empty")
    for row, one in enumerate(fence.polygons):
        if not one.polygon:
            plan.note(QuirkKind.FENCE_EMPTY, ("geoFence", "polygons", row), "has no corner; skipped")
    drawn = [one for one in fence.polygons if one.polygon]
    return Geofence(
        tuple(FencePolygon(tuple(GeoPoint.at(*point) for point in p.polygon), p.inclusion) for p in drawn),
        tuple(FenceCircle(GeoPoint.at(*c.circle.center), c.circle.radius, c.inclusion) for c in fence.circles),
        None if fence.breachReturn is None else _read_point(fence.breachReturn),
    )


def rally_in_plan(rally: _Rally, plan: PlanText) -> tuple[RallyPoint, ...]:
    """The rally points of a document."""
    if rally.version != 2:
        text = f"{rally.version} instead of 2, with {len(rally.points)} points; QGroundControl drops them"
        plan.note(QuirkKind.RALLY_1, ("rallyPoints", "version"), text)
    return tuple(map(_read_point, rally.points))


def _written_point(point: RallyPoint) -> list[float]:
    return [*point.place.place_deg, point.alt_m]


def _read_point(point: tuple[float, float, float]) -> RallyPoint:
    return RallyPoint(GeoPoint.at(*point[:2]), point[2])


class _Kind(BaseModel):
    fileType: object = None
    version: object = None
    mission: object = None


class _HomeItem(PlanPart):
    coordinate: PointAndAltitude


class _Version1(PlanPart):
    MAV_AUTOPILOT: Whole
    version: Literal["1.0", 1]
    plannedHomePosition: _HomeItem
    items: Annotated[list[PlanItem], Field(max_length=ITEMS_MAX)]
    complexItems: list[object] = Field(default_factory=list)


def is_mission_json(data: bytes) -> bool:
    """Whether a file is a `.mission`; any file that is no JSON is none."""
    try:
        refuse_crowded_json(data)
        kind = _Kind.model_validate_json(data.decode("utf-8").removeprefix(MARK))
    except ValueError:  # also of pydantic, and of the decoder
        return False
    return kind.fileType == "Mission" or (kind.fileType is kind.mission is None and kind.version is not None)


def read_mission_json(data: bytes, source: str, firmware: Autopilot | None = None) -> MissionFile:
    """The mission in a file, for `firmware` or the autopilot that the file names. Raises `FileFormatError`."""
    file = PlanText(data, source)
    version = file.parsed(_Kind).version
    file.note(QuirkKind.VERSION, ("version",), f"{version}: a .mission file, as QGroundControl wrote it before .plan")
    if version == 2:
        return _planned(file.parsed(PlannedMission), (), file, firmware)
    older = file.parsed(_Version1)
    if older.complexItems:
        raise file.refused(("complexItems", 0), "a complex item; replace it by simple items")
    home = older.plannedHomePosition.coordinate
    mission = PlannedMission.model_construct(
        firmwareType=older.MAV_AUTOPILOT, plannedHomePosition=home, items=older.items, hoverSpeed=0.0
    )
    return _planned(mission, (), file, firmware, "MAV_AUTOPILOT")
