"""QGroundControl's `.mission` files, which came before `.plan`: version 1.0, a flat list of items, and version 2."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

from gcs.autopilots.traits import Autopilot
from gcs.mission.formats.foreign.oddities import MARK, Odd
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.plan_items import ITEMS_MAX, PlanItem, PlanPart, PlanText, PointAndAltitude, Whole
from gcs.mission.formats.qgc_plan import PlannedMission
from gcs.mission.model import Home
from gcs.reading.bounded_json import refuse_crowded_json


class _Kind(BaseModel):
    fileType: Any = None
    version: Any = None
    mission: Any = None


class _HomeItem(PlanPart):
    coordinate: PointAndAltitude


class _Version1(PlanPart):
    MAV_AUTOPILOT: Whole
    version: Literal["1.0", 1]
    plannedHomePosition: _HomeItem
    items: Annotated[list[PlanItem], Field(max_length=ITEMS_MAX)]
    complexItems: list[Any] = Field(default_factory=list)


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
    file.told(Odd.VERSION, ("version",), f"{version}: a .mission file, as QGroundControl wrote it before .plan")
    speed_mps = None
    if version == 2:
        mission = file.parsed(PlannedMission)
        named = file.autopilot(mission.firmwareType, ("firmwareType",), firmware)
        home, items = Home(*mission.plannedHomePosition), file.mission_items(mission.items, ("items",))
        speed_mps = mission.hoverSpeed if mission.hoverSpeed > 0 else None
    else:
        older = file.parsed(_Version1)
        if older.complexItems:
            raise file.refused(("complexItems", 0), "a complex item; replace it by simple items")
        named = file.autopilot(older.MAV_AUTOPILOT, ("MAV_AUTOPILOT",), firmware)
        home, items = Home(*older.plannedHomePosition.coordinate), file.mission_items(older.items, ("items",))
    return MissionFile(
        source,
        named if firmware is None else firmware,
        home,
        items,
        speed_mps=speed_mps,
        text=file.text,
        items_path=("items",),
        oddities=file.oddities.found(),
    )
