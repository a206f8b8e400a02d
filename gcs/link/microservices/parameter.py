"""Parameters on the wire: names, types, and numbers inside a float.

Knows: MAV_PARAM_TYPE, and that PX4 puts the bytes of an integer into the float's bytes where ArduPilot puts its value.
Does not know: what parameters mean, who asks when.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from gcs.autopilots.traits import Autopilot
from gcs.errors import UsageError
from gcs.link.wire.message import Message, Station

REAL32 = 9
_RANGES = {
    1: (0, 255),
    2: (-128, 127),
    3: (0, 65_535),
    4: (-32_768, 32_767),
    5: (0, 2**32 - 1),
    6: (-(2**31), 2**31 - 1),
}
_BYTES = {1: "<Bxxx", 2: "<bxxx", 3: "<Hxx", 4: "<hxx", 5: "<I", 6: "<i"}
_FLOAT = struct.Struct("<f")


@dataclass(frozen=True)
class Parameter:
    """One parameter as a vehicle has it: `kind` is its MAV_PARAM_TYPE, `value` an int unless that is REAL32."""

    name: str
    value: int | float
    kind: int

    def __str__(self) -> str:
        return f"{self.name} = {self.value:g}" if self.kind == REAL32 else f"{self.name} = {self.value}"

    def same_value(self, other: Parameter) -> bool:
        """Whether both hold the same, to the precision of the wire."""
        return as_kind(self.name, self.value, other.kind) == other.value


def bytewise(autopilot: int) -> bool:
    """Whether this autopilot puts integers into floats byte by byte."""
    return autopilot == Autopilot.PX4


def as_kind(name: str, value: int | float, kind: int) -> int | float:
    """A value as a parameter of this type holds it.

    Raises `UsageError` for what it cannot hold: a number that is none (PX4 would store it), a fraction, one too large.
    """
    if not math.isfinite(value):
        raise UsageError(f"{name} cannot be {value}: it is not a number.")
    if kind == REAL32:
        try:
            return float(_FLOAT.unpack(_FLOAT.pack(value))[0])
        except OverflowError:
            raise UsageError(f"{name} cannot be {value:g}: that does not fit a float.") from None
    low, high = _RANGES.get(kind, (0, -1))
    if value != round(value) or not low <= value <= high:
        raise UsageError(f"{name} cannot be {value}: on this vehicle it is a whole number from {low} to {high}.")
    return round(value)


def encode(parameter: Parameter, *, in_bytes: bool) -> float:
    """The float that carries it."""
    if parameter.kind == REAL32 or not in_bytes:
        return float(parameter.value)
    return float(_FLOAT.unpack(struct.pack(_BYTES[parameter.kind], parameter.value))[0])


def decode(message: Message, *, in_bytes: bool) -> Parameter | None:
    """The parameter in a PARAM_VALUE; None for a type that nobody uses (64 bits)."""
    name, value, kind = (message.fields[key] for key in ("param_id", "param_value", "param_type"))
    if kind == REAL32:
        return Parameter(name, float(value), kind)
    if kind not in _BYTES:
        return None
    if in_bytes:
        return Parameter(name, int(struct.unpack(_BYTES[kind], _FLOAT.pack(value))[0]), kind)
    return Parameter(name, round(value), kind) if math.isfinite(value) else None


def read_request(name: str, peer: Station) -> Message:
    """PARAM_REQUEST_READ by name."""
    target = {"target_system": peer.sysid, "target_component": peer.compid}
    return Message("PARAM_REQUEST_READ", {**target, "param_id": name, "param_index": -1})


def set_request(parameter: Parameter, peer: Station, *, in_bytes: bool) -> Message:
    """PARAM_SET, in the parameter's own type: PX4 takes no other, and says nothing about it."""
    target = {"target_system": peer.sysid, "target_component": peer.compid}
    value = encode(parameter, in_bytes=in_bytes)
    return Message(
        "PARAM_SET", {**target, "param_id": parameter.name, "param_value": value, "param_type": parameter.kind}
    )
