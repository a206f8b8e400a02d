"""The items of QGroundControl's JSON files, in each form that it reads: seven `params`, or less and a `coordinate`."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError
from gcs.mission.formats.item_place import place_on_wire
from gcs.mission.formats.mission_file import Key, line_of, refused
from gcs.mission.formats.vendor_quirks import QuirkKind, QuirkList, decoded, without_mark
from gcs.mission.model import Command, Frame, MissionItem
from gcs.util.bounded_file import refuse_crowded_json

_Model = TypeVar("_Model", bound=BaseModel)
_ALTITUDE_CALCULATED = 3
_SAME_ALT_M = 0.01
_ITEM = ("SimpleItem", "missionItem")  # the second in `.mission` files of version 1.0


def _whole(value: object) -> object:
    """JSON has one kind of number: 16.0 is 16."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


Whole = Annotated[int, BeforeValidator(_whole)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=180)]
Point = tuple[Latitude, Longitude]
PointAndAltitude = tuple[Latitude, Longitude, Finite]


class PlanPart(BaseModel):
    """A part of a document. Keys that are not known are ignored; texts are no numbers."""

    model_config = ConfigDict(strict=True)


class PlanItem(PlanPart):
    """A simple item. `doJumpId`, in version 1.0 `id`, is the number by which jumps name it."""

    type: Literal["SimpleItem", "missionItem"]
    autoContinue: bool = True
    command: Annotated[Whole, Field(ge=0, le=0xFFFF)]
    doJumpId: Whole | None = None
    id: object = None
    frame: Annotated[Whole, Field(ge=0, le=0xFF)]
    params: Annotated[list[Finite | None], Field(min_length=7, max_length=7)]
    coordinate: object = None
    Altitude: object = None  # m, in the frame of the item, but above the terrain with the mode "calculated"
    AltitudeMode: object = None

    @model_validator(mode="before")
    @classmethod
    def _seven_params(cls, data: object) -> object:
        if not isinstance(data, dict) or not isinstance(data.get("coordinate"), list):
            return data
        first = data.get("params", [data.get(f"param{n}", "missing") for n in (1, 2, 3, 4)])
        return data | {"params": [*first, *data["coordinate"]]} if isinstance(first, list) else data

    def number(self, index: int) -> int:
        """The number by which jumps name the item with this index."""
        given = self.doJumpId if self.type == _ITEM[0] else self.id
        return given if isinstance(given, int) else index + 1


class ComplexItem(PlanPart):
    """A pattern of QGroundControl, which it turns into simple items itself."""

    type: Literal["ComplexItem"]
    complexItemType: str = "unnamed"
    TransectStyleComplexItem: object = None  # the simple items of surveys and corridors are in it
    polygon: object = None  # the area of a survey or structure
    polyline: object = None  # the middle of a corridor
    CorridorWidth: object = None  # m


ITEMS_MAX = 20_000  # an autopilot stores less than a tenth of it
AnyItem = Annotated[PlanItem | ComplexItem, Field(discriminator="type")]


class PlanText:
    """The text of a JSON file while it is read: its quirks, and refusals with line and key."""

    def __init__(self, data: str | bytes, source: str) -> None:
        self.source, self.quirks = source, QuirkList(source)
        self.text = without_mark(decoded(data, source), self.quirks)
        try:
            refuse_crowded_json(self.text)
        except ValueError as error:
            raise FileFormatError(f"{source}: {error}.") from error

    def parsed(self, model: type[_Model]) -> _Model:
        """The document. Raises `FileFormatError`."""
        try:
            return model.model_validate_json(self.text)
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            # pydantic names the kind of an item as if it were a key.
            path = tuple(key for key in first["loc"] if key not in (*_ITEM, "ComplexItem"))
            raise self.refused(path, first["msg"]) from error

    def refused(self, path: Sequence[Key], reason: str, *, hint: str = "") -> FileFormatError:
        """The error for the value at `path`."""
        return refused(self.text, self.source, path, reason, hint=hint)

    def note(self, kind: QuirkKind, path: Sequence[Key], text: str) -> None:
        """Count a quirk of the value at `path`."""
        self.quirks.add(kind, f"{'.'.join(map(str, path))}: {text}", lambda: line_of(self.text, path))

    def autopilot(self, number: int, path: Sequence[Key], firmware: Autopilot | None) -> Autopilot:
        """The autopilot that a file names, or `firmware`. Raises `FileFormatError` if there is neither."""
        if number in tuple(Autopilot):
            return Autopilot(number)
        known = ", ".join(f"{a.value} ({a.title})" for a in Autopilot)
        reason = f"{number} is not an autopilot that missions are written for: {known}"
        if firmware is None:
            raise self.refused(path, reason, hint="give --autopilot")
        self.note(QuirkKind.FIRMWARE, path, f"{reason}; read for {firmware.title}")
        return firmware

    def mission_items(self, items: Sequence[PlanItem | ComplexItem], path: tuple[Key, ...]) -> tuple[MissionItem, ...]:
        """The items at `path`. Raises `FileFormatError` for complex items and for jumps to no item or several."""
        simple: list[PlanItem] = []
        for index, item in enumerate(items):
            if isinstance(item, ComplexItem):
                reason = f"a complex item ({item.complexItemType}); replace it by simple items"
                raise self.refused((*path, index), reason)
            simple.append(item)
        read = [self.item(item, (*path, index)) for index, item in enumerate(simple)]
        numbers = [item.number(index) for index, item in enumerate(simple)]
        wrong = [index for index, number in enumerate(numbers) if number != index + 1]
        for index in wrong:
            text = f"item number {numbers[index]}, but this is item {index + 1}: the order of the items counts"
            self.note(QuirkKind.SEQ, (*path, index), text)
        if wrong:
            read = [self._jump(item, numbers, (*path, index)) for index, item in enumerate(read)]
        return tuple(read)

    def item(self, item: PlanItem, path: tuple[Key, ...]) -> MissionItem:
        """The item at `path`. Raises `FileFormatError` for a place that is missing or not on Earth."""

        def note(kind: QuirkKind, text: str) -> None:
            if kind is not QuirkKind.NO_PLACE or item.frame != Frame.MISSION:  # QGroundControl writes nulls there
                self.note(kind, path, text)

        p1, p2, p3, p4 = (math.nan if p is None else p for p in item.params[:4])
        try:
            lat, lon, alt_m = place_on_wire(item.command, item.frame, item.params[4:], note)
        except ValueError as error:
            raise self.refused(path, str(error)) from error
        also_m = item.Altitude
        is_same_kind = item.AltitudeMode not in (None, _ALTITUDE_CALCULATED)
        if is_same_kind and isinstance(also_m, int | float) and abs(also_m - alt_m) > _SAME_ALT_M:
            note(QuirkKind.ALTITUDE, f"Altitude is {also_m:g} m and parameter 7 is {alt_m:g} m, which counts")
        return MissionItem(item.command, item.frame, (p1, p2, p3, p4), lat, lon, alt_m, item.autoContinue)

    def _jump(self, item: MissionItem, numbers: Sequence[int], path: tuple[Key, ...]) -> MissionItem:
        target = item.params[0]
        if item.command != Command.DO_JUMP or not target.is_integer():
            return item
        named = [index for index, number in enumerate(numbers) if number == target]
        if len(named) != 1:
            raise self.refused(path, f"jumps to item {target:.0f}, and {len(named) or 'no'} items have this number")
        if named[0] + 1 != target:
            self.note(QuirkKind.JUMP, path, f"jumps to item number {target:.0f}, which is item {named[0] + 1}")
        return replace(item, params=(named[0] + 1.0, *item.params[1:]))
