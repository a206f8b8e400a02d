"""`.plan` files: QGroundControl's JSON, mission version 2.

Knows: the document's keys, simple items, the altitude keys QGroundControl shows. Does not know: links, survey
patterns and other complex items (refused by name), fences and rally points (written empty, not read).
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gcs.errors import FileFormatError
from gcs.mission.firmware import Firmware
from gcs.mission.model import Frame, Home, MissionItem
from gcs.mission.waypoints import file_position, wire_position

_MULTIROTOR = 2  # MAV_TYPE_QUADROTOR
# QGroundControl's own altitude modes, by frame: relative 1, AMSL 2, terrain frame 4.
_ALTITUDE_MODE = {Frame.GLOBAL: 2, Frame.GLOBAL_RELATIVE_ALT: 1, Frame.GLOBAL_TERRAIN_ALT: 4}

Finite = Annotated[float, Field(allow_inf_nan=False)]


@dataclass(frozen=True)
class PlanFile:
    """Contents of one file. The two speeds only serve QGroundControl's own time estimate."""

    firmware: Firmware
    home: Home
    items: tuple[MissionItem, ...]
    cruise_speed_mps: float = 15.0
    hover_speed_mps: float = 5.0


class _Part(BaseModel):
    model_config = ConfigDict(strict=True)


class _Item(_Part):
    type: Literal["SimpleItem"]
    autoContinue: bool
    command: Annotated[int, Field(ge=0, le=0xFFFF)]
    doJumpId: int
    frame: Annotated[int, Field(ge=0, le=0xFF)]
    params: Annotated[list[Finite | None], Field(min_length=7, max_length=7)]


class _Mission(_Part):
    version: Literal[2]
    firmwareType: int
    vehicleType: int
    cruiseSpeed: Finite
    hoverSpeed: Finite
    plannedHomePosition: tuple[Annotated[float, Field(ge=-90, le=90)], Annotated[float, Field(ge=-180, le=180)], Finite]
    items: list[_Item]


class _Document(_Part):
    fileType: Literal["Plan"]
    version: Literal[1]
    mission: _Mission


def write_plan_file(file: PlanFile) -> str:
    """The text of a file; `read_plan_file` gives back the same values (NaN parameters are null there)."""
    document = {
        "fileType": "Plan",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "groundStation": "Skein",
        "mission": {
            "cruiseSpeed": file.cruise_speed_mps,
            "firmwareType": int(file.firmware),
            "globalPlanAltitudeMode": 1,
            "hoverSpeed": file.hover_speed_mps,
            "items": [_written(item, number) for number, item in enumerate(file.items, start=1)],
            "plannedHomePosition": [file.home.lat_deg, file.home.lon_deg, file.home.alt_amsl_m],
            "vehicleType": _MULTIROTOR,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def read_plan_file(text: str | bytes, source: str) -> PlanFile:
    """Contents of a file; `source` names it in errors.

    Raises `FileFormatError` with file, key and reason for anything this program could not fly as it stands there.
    """
    try:
        mission = _Document.model_validate_json(text).mission
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        key = ".".join(map(str, first["loc"])) or "the file"
        raise FileFormatError(f"{source}: {key}: {first['msg']}.") from error
    if mission.firmwareType not in tuple(Firmware):
        raise FileFormatError(
            f"{source}: mission.firmwareType: {mission.firmwareType} is neither PX4 (12) nor ArduPilot (3)."
        )
    items = []
    for index, item in enumerate(mission.items):
        try:
            items.append(_read(item, index + 1))
        except ValueError as error:
            raise FileFormatError(f"{source}: mission.items.{index}: {error}.") from error
    return PlanFile(
        Firmware(mission.firmwareType),
        Home(*mission.plannedHomePosition),
        tuple(items),
        mission.cruiseSpeed,
        mission.hoverSpeed,
    )


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


def _read(item: _Item, number: int) -> MissionItem:
    if item.doJumpId != number:
        raise ValueError(f"doJumpId is {item.doJumpId}, but this is item {number}")
    x, y, z = item.params[4:]
    if item.frame == Frame.MISSION:
        x, y, z = x or 0.0, y or 0.0, z or 0.0
    if x is None or y is None or z is None:
        raise ValueError("the position has a null")
    p1, p2, p3, p4 = (math.nan if p is None else p for p in item.params[:4])
    lat, lon = wire_position(item.frame, x, y)
    return MissionItem(item.command, item.frame, (p1, p2, p3, p4), lat, lon, z, item.autoContinue)
