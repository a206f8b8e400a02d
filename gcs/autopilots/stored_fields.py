"""How an autopilot stores each field of a mission item: the types of these tables.

A table has one row per command, and in a row one rule per field. A rule says how the field reads back when the item
is stored as intended, and the source of that.
"""

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, StrEnum
from functools import partial

_SINGLE = struct.Struct("<f")
HEADING_TOLERANCE_DEG = 1e-3
CENTIMETRES_TOLERANCE_M = 0.0101  # one centimetre, and the rounding of an altitude of some km


class StoredAs(Enum):
    """How a field reads back, if not as it was sent. All values are in single precision."""

    EXACT = "as sent"
    CENTIMETRES = "cut to whole centimetres"
    WHOLE = "cut to a whole number"
    HEADING = "rounded by way of radians: the same direction within 0.001 deg"
    SIGN = "1, or -1 for a negative number"
    FLAG = "1 for a positive number, else 0"
    ZERO = "not stored: 0"

    def survives(self, sent: float, read_back: float) -> bool:
        """Return whether `read_back` is what a vehicle reports that stores `sent` in this way, or is equal to it.

        NaN is equal to NaN.
        """
        if _single(sent) == _single(read_back) or (math.isnan(sent) and math.isnan(read_back)):
            return True
        if self is StoredAs.ZERO:
            return read_back == 0.0
        if self is StoredAs.SIGN:
            return read_back == (-1.0 if sent < 0.0 else 1.0)
        if self is StoredAs.FLAG:
            return read_back == float(sent > 0.0)
        if not (math.isfinite(sent) and math.isfinite(read_back)):
            return False
        if self is StoredAs.CENTIMETRES:
            return abs(sent - read_back) <= CENTIMETRES_TOLERANCE_M
        if self is StoredAs.WHOLE:
            return read_back == math.trunc(_single(sent))
        if self is StoredAs.HEADING:
            return abs(math.remainder(sent - read_back, 360.0)) <= HEADING_TOLERANCE_DEG
        return False


class StorageSource(StrEnum):
    """The source of a field's rule."""

    RECORDED = "recorded with values that show it"
    PUBLISHED = "the autopilot's published source code"
    ASSUMED = "not known: it must come back as it was sent"


@dataclass(frozen=True)
class FieldRule:
    """The rule of one field."""

    stored: StoredAs
    source: StorageSource

    def survives(self, sent: float, read_back: float) -> bool:
        """Return whether the field is stored as intended."""
        return self.stored.survives(sent, read_back)


recorded = partial(FieldRule, source=StorageSource.RECORDED)  # a recording shows it
published = partial(FieldRule, source=StorageSource.PUBLISHED)  # the autopilot's source code shows it
ASSUMED = FieldRule(StoredAs.EXACT, StorageSource.ASSUMED)


@dataclass(frozen=True)
class StoredItem:
    """One row: the rules of all fields of an item. `frame` is compared as files have it: 0 for 5, 3 for 6."""

    param1: FieldRule = ASSUMED
    param2: FieldRule = ASSUMED
    param3: FieldRule = ASSUMED
    param4: FieldRule = ASSUMED
    x: FieldRule = ASSUMED  # 1e-7 deg
    y: FieldRule = ASSUMED
    z: FieldRule = ASSUMED
    frame: FieldRule = ASSUMED  # of an item that names a position; of others it has no meaning
    autocontinue: FieldRule = ASSUMED

    @property
    def params(self) -> tuple[FieldRule, FieldRule, FieldRule, FieldRule]:
        """The rules of parameters 1 to 4."""
        return self.param1, self.param2, self.param3, self.param4


@dataclass(frozen=True)
class ItemStorage:
    """The table of one autopilot. A command without a row has to come back as it was sent."""

    items: Mapping[int, StoredItem] = field(default_factory=dict)  # by MAV_CMD

    def of(self, command: int) -> StoredItem:
        """Return the row of a command."""
        return self.items.get(command, _AS_SENT)


_AS_SENT = StoredItem()
UNKNOWN_STORAGE = ItemStorage()  # every field of every command has to come back as it was sent


def _single(value: float) -> float:
    try:
        return float(_SINGLE.unpack(_SINGLE.pack(value))[0])
    except OverflowError:
        return math.copysign(math.inf, value)
