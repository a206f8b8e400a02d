"""`.plan` files: QGroundControl's JSON, mission version 2, with its geofence and rally points (both version 2).

Only simple items are read. Survey patterns and other complex items are refused by name.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError
from gcs.frames import from_degE7, to_degE7
from gcs.mission.formats.json_lines import line_of
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.qgc_wpl import file_position, wire_position
from gcs.mission.geofence import LEAST_VERTICES, NO_FENCE, FenceCircle, FencePolygon, Geofence, GeoPoint, RallyPoint
from gcs.mission.model import Command, Frame, Home, MissionItem

_MULTIROTOR = 2  # MAV_TYPE_QUADROTOR
# QGroundControl's own altitude modes, by frame: relative 1, AMSL 2, terrain frame 4; 0 if items differ.
_ALTITUDE_MODE = {Frame.GLOBAL: 2, Frame.GLOBAL_RELATIVE_ALT: 1, Frame.GLOBAL_TERRAIN_ALT: 4}
_MIXED = 0

Finite = Annotated[float, Field(allow_inf_nan=False)]
Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=180)]
Point = tuple[Latitude, Longitude]
PointAndAltitude = tuple[Latitude, Longitude, Finite]


@dataclass(frozen=True)
class PlanFile:
    """Contents of one file. QGroundControl uses the two speeds for its time estimate only."""

    firmware: Autopilot
    home: Home
    items: tuple[MissionItem, ...]
    cruise_speed_mps: float = 15.0
    hover_speed_mps: float = 5.0
    geofence: Geofence = NO_FENCE
    rally: tuple[RallyPoint, ...] = ()


class _Part(BaseModel):
    model_config = ConfigDict(strict=True)


class _Simple(_Part):
    type: Literal["SimpleItem"]
    autoContinue: bool = True
    command: Annotated[int, Field(ge=0, le=0xFFFF)]
    doJumpId: int | None = None
    frame: Annotated[int, Field(ge=0, le=0xFF)]
    params: Annotated[list[Finite | None], Field(min_length=7, max_length=7)]


class _Complex(_Part):
    type: Literal["ComplexItem"]
    complexItemType: str = "unnamed"


class _Mission(_Part):
    version: Literal[2]
    firmwareType: int
    cruiseSpeed: Finite = 15.0
    hoverSpeed: Finite = 5.0
    plannedHomePosition: PointAndAltitude
    items: list[Annotated[_Simple | _Complex, Field(discriminator="type")]]


class _Polygon(_Part):
    inclusion: bool = True
    polygon: Annotated[list[Point], Field(min_length=LEAST_VERTICES)]


class _Disk(_Part):
    center: Point
    radius: Annotated[Finite, Field(gt=0)]


class _Circle(_Part):
    inclusion: bool = True
    circle: _Disk


class _Fence(_Part):
    version: Literal[2]
    polygons: list[_Polygon] = []
    circles: list[_Circle] = []
    breachReturn: PointAndAltitude | None = None


class _Rally(_Part):
    version: Literal[2]
    points: list[PointAndAltitude] = []


class _Document(_Part):
    fileType: Literal["Plan"]
    version: Literal[1]
    mission: _Mission
    geoFence: _Fence = _Fence(version=2)
    rallyPoints: _Rally = _Rally(version=2)


def write_plan_file(file: PlanFile) -> str:
    """The text of a file; `read_plan_file` gives back the same values (NaN parameters are null there)."""
    modes = {_ALTITUDE_MODE[Frame(i.frame)] for i in file.items if i.frame in _ALTITUDE_MODE}
    document = {
        "fileType": "Plan",
        "geoFence": _written_fence(file.geofence),
        "groundStation": "Skein",
        "mission": {
            "cruiseSpeed": file.cruise_speed_mps,
            "firmwareType": int(file.firmware),
            "globalPlanAltitudeMode": modes.pop() if len(modes) == 1 else _MIXED,
            "hoverSpeed": file.hover_speed_mps,
            "items": [_written(item, number) for number, item in enumerate(file.items, start=1)],
            "plannedHomePosition": [file.home.lat_deg, file.home.lon_deg, file.home.alt_amsl_m],
            "vehicleType": _MULTIROTOR,
            "version": 2,
        },
        "rallyPoints": {"points": [_written_point(p) for p in file.rally], "version": 2},
        "version": 1,
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def read_plan_file(text: str | bytes, source: str) -> PlanFile:
    """Contents of a file; `source` names it in errors.

    Raises `FileFormatError` with file, line, key and reason for anything that cannot be flown as written.
    """
    try:
        document = _Document.model_validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        raise _refusal(text, source, first["loc"], first["msg"]) from error
    mission = document.mission
    if mission.firmwareType not in tuple(Autopilot):
        known = ", ".join(f"{a.value} ({a.title})" for a in Autopilot)
        reason = f"{mission.firmwareType} is not an autopilot that missions are written for: {known}"
        raise _refusal(text, source, ("mission", "firmwareType"), reason)
    jumps = any(item.type == "SimpleItem" and item.command == Command.DO_JUMP for item in mission.items)
    items = []
    for index, item in enumerate(mission.items):
        try:
            items.append(_read(item, index + 1, jumps))
        except ValueError as error:
            raise _refusal(text, source, ("mission", "items", index), str(error)) from error
    return PlanFile(
        Autopilot(mission.firmwareType),
        Home(*mission.plannedHomePosition),
        tuple(items),
        mission.cruiseSpeed,
        mission.hoverSpeed,
        _read_fence(document.geoFence),
        tuple(map(_read_point, document.rallyPoints.points)),
    )


def write_mission(file: MissionFile) -> str:
    """The text of a file that holds this mission, its fence and its rally points."""
    if file.home is None:
        raise ValueError(f"{file.source}: a .plan holds a home position, and this mission has none")
    speeds = () if file.speed_mps is None else (file.speed_mps, file.speed_mps)
    cruise_mps, hover_mps = speeds or (PlanFile.cruise_speed_mps, PlanFile.hover_speed_mps)
    return write_plan_file(
        PlanFile(file.firmware, file.home, file.items, cruise_mps, hover_mps, file.geofence, file.rally)
    )


def read_mission(data: bytes, source: str, firmware: Autopilot | None = None) -> MissionFile:
    """The mission in a file, for `firmware` or the autopilot that the file names. Raises `FileFormatError`."""
    file = read_plan_file(data, source)
    speed_mps = file.hover_speed_mps if file.hover_speed_mps > 0 else None
    text = data.decode("utf-8", errors="replace")
    return MissionFile(
        source,
        file.firmware if firmware is None else firmware,
        file.home,
        file.items,
        file.geofence,
        file.rally,
        speed_mps,
        text=text,
    )


def _refusal(text: str | bytes, source: str, path: tuple[str | int, ...], reason: str) -> FileFormatError:
    """The error for one value, with its line. If the text is not JSON, the reason contains the line."""
    decoded = text if isinstance(text, str) else text.decode("utf-8", errors="replace")
    syntax = re.fullmatch(r"Invalid JSON: (.*) at line (\d+) column \d+", reason)
    if syntax:
        return FileFormatError(f"{source}, line {syntax[2]}: not JSON: {syntax[1]}.")
    # pydantic names the kind of an item as if it were a key.
    path = tuple(key for key in path if key not in ("SimpleItem", "ComplexItem"))
    key = ".".join(map(str, path))
    return FileFormatError(f"{source}, line {line_of(decoded, path)}: {f'{key}: ' if key else ''}{reason}.")


def _written(item: MissionItem, number: int) -> dict[str, Any]:
    params = [None if math.isnan(p) else p for p in item.params]
    written: dict[str, Any] = {
        "autoContinue": item.autocontinue,
        "command": int(item.command),
        "doJumpId": number,
        "frame": int(item.frame),
        "params": [*params, *file_position(item), item.alt_m],
        "type": "SimpleItem",
    }
    if item.frame in _ALTITUDE_MODE:
        mode = _ALTITUDE_MODE[Frame(item.frame)]
        written |= {"AMSLAltAboveTerrain": None, "Altitude": item.alt_m, "AltitudeMode": mode}
    return dict(sorted(written.items()))


def _read(item: _Simple | _Complex, number: int, jumps: bool) -> MissionItem:
    if isinstance(item, _Complex):
        raise ValueError(f"a complex item ({item.complexItemType}); replace it by simple items")
    if jumps and item.doJumpId not in (None, number):
        raise ValueError(f"doJumpId is {item.doJumpId}, but this is item {number}, and the mission has jumps")
    x, y, z = item.params[4:]
    if item.frame == Frame.MISSION:
        x, y, z = x or 0.0, y or 0.0, z or 0.0
    if x is None or y is None or z is None:
        raise ValueError("the position has a null")
    p1, p2, p3, p4 = (math.nan if p is None else p for p in item.params[:4])
    lat, lon = wire_position(item.frame, x, y)
    return MissionItem(item.command, item.frame, (p1, p2, p3, p4), lat, lon, z, item.autoContinue)


def _written_fence(fence: Geofence) -> dict[str, Any]:
    written: dict[str, Any] = {
        "circles": [
            {
                "circle": {"center": _degrees(c.center), "radius": c.radius_m},
                "inclusion": c.inclusion,
                "version": 1,
            }
            for c in fence.circles
        ],
        "polygons": [
            {"inclusion": p.inclusion, "polygon": [_degrees(place) for place in p.points], "version": 1}
            for p in fence.polygons
        ],
        "version": 2,
    }
    if fence.return_point is not None:
        written["breachReturn"] = _written_point(fence.return_point)
    return written


def _read_fence(fence: _Fence) -> Geofence:
    return Geofence(
        tuple(FencePolygon(tuple(_place(*point) for point in p.polygon), p.inclusion) for p in fence.polygons),
        tuple(FenceCircle(_place(*c.circle.center), c.circle.radius, c.inclusion) for c in fence.circles),
        None if fence.breachReturn is None else _read_point(fence.breachReturn),
    )


def _written_point(point: RallyPoint) -> list[float]:
    return [*_degrees(point.place), point.alt_m]


def _read_point(point: tuple[float, float, float]) -> RallyPoint:
    return RallyPoint(_place(*point[:2]), point[2])


def _degrees(place: GeoPoint) -> list[float]:
    return [from_degE7(place.lat_degE7), from_degE7(place.lon_degE7)]


def _place(lat_deg: float, lon_deg: float) -> GeoPoint:
    return GeoPoint(to_degE7(lat_deg), to_degE7(lon_deg))
