"""Parameters on the wire: names, MAV_PARAM_TYPE, and integers inside the float of PARAM_VALUE and PARAM_SET.

PX4 copies the bytes of an integer into the bytes of the float; ArduPilot sends the integer's value as a float.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from gcs.errors import UsageError
from gcs.link.wire.message import Message, Station
from gcs.mavlink import ParameterType

REAL32 = int(ParameterType.REAL32)
RANGES: dict[int, tuple[int, int]] = {
    ParameterType.UINT8: (0, 255),
    ParameterType.INT8: (-128, 127),
    ParameterType.UINT16: (0, 65_535),
    ParameterType.INT16: (-32_768, 32_767),
    ParameterType.UINT32: (0, 2**32 - 1),
    ParameterType.INT32: (-(2**31), 2**31 - 1),
}
_BYTES: dict[int, str] = {
    ParameterType.UINT8: "<Bxxx",
    ParameterType.INT8: "<bxxx",
    ParameterType.UINT16: "<Hxx",
    ParameterType.INT16: "<hxx",
    ParameterType.UINT32: "<I",
    ParameterType.INT32: "<i",
}
_FLOAT = struct.Struct("<f")


@dataclass(frozen=True)
class Parameter:
    """One parameter of a vehicle. `kind` is its MAV_PARAM_TYPE; `value` is a float for REAL32, else an int."""

    name: str
    value: int | float
    kind: int

    def __str__(self) -> str:
        return f"{self.name} = {self.value:g}" if self.kind == REAL32 else f"{self.name} = {self.value}"

    def same_value(self, other: Parameter) -> bool:
        """Whether both have the same value, to the precision of the wire."""
        return as_kind(self.name, self.value, other.kind) == other.value


def as_kind(name: str, value: int | float, kind: int) -> int | float:
    """Return the value as a parameter of this type stores it.

    Raises `UsageError` for NaN and infinity (PX4 would store them), a fraction for an integer type, or a value out of
    range.
    """
    if not math.isfinite(value):
        raise UsageError(f"{name} cannot be {value}: it must be a finite number.")
    if kind == REAL32:
        try:
            return float(_FLOAT.unpack(_FLOAT.pack(value))[0])
        except OverflowError:
            raise UsageError(f"{name} cannot be {value:g}: it exceeds the range of a 32 bit float.") from None
    low, high = RANGES.get(kind, (0, -1))
    if value != round(value) or not low <= value <= high:
        raise UsageError(f"{name} cannot be {value}: on this vehicle it must be a whole number from {low} to {high}.")
    return round(value)


def encode(parameter: Parameter, *, in_bytes: bool) -> float:
    """Return the float of PARAM_SET that carries the value."""
    if parameter.kind == REAL32 or not in_bytes:
        return float(parameter.value)
    return float(_FLOAT.unpack(struct.pack(_BYTES[parameter.kind], parameter.value))[0])


def decode(message: Message, *, in_bytes: bool) -> Parameter | None:
    """Return the parameter in a PARAM_VALUE; None for the unused 64 bit types."""
    name, value, kind = (message.fields[key] for key in ("param_id", "param_value", "param_type"))
    if kind == REAL32:
        return Parameter(name, float(value), kind)
    if kind not in _BYTES:
        return None
    if in_bytes:
        return Parameter(name, int(struct.unpack(_BYTES[kind], _FLOAT.pack(value))[0]), kind)
    return Parameter(name, round(value), kind) if math.isfinite(value) else None


def read_request(name: str, peer: Station) -> Message:
    """Return PARAM_REQUEST_READ by name."""
    return Message("PARAM_REQUEST_READ", {**peer.target, "param_id": name, "param_index": -1})


def set_request(parameter: Parameter, peer: Station, *, in_bytes: bool) -> Message:
    """Return PARAM_SET in the parameter's own type: PX4 ignores any other type without an error."""
    value = encode(parameter, in_bytes=in_bytes)
    return Message(
        "PARAM_SET", {**peer.target, "param_id": parameter.name, "param_value": value, "param_type": parameter.kind}
    )
