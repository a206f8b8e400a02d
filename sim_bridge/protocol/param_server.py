"""The parameter protocol of one vehicle: read by name or index, set, list, and report changes.

`setting` gives the effective value: within its bounds, in SI units.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterable

from gcs.link.protocols.parameter_transfer import RANGES
from gcs.link.wire.message import Message
from gcs.mavlink import ParameterType
from sim_bridge.personality import Personality, Setting

BY_NAME = 0xFFFF  # param_index of an answer to a request by name

_UINT32, _REAL32 = int(ParameterType.UINT32), int(ParameterType.REAL32)
_SIGNED = struct.Struct("<i")
_UNSIGNED = struct.Struct("<I")
_FLOAT = struct.Struct("<f")


class ParamServer:
    """Name, value and type of every parameter, in order."""

    def __init__(self, personality: Personality, sysid: int, capacity_mAh: float | None = None) -> None:
        """`capacity_mAh` of the vehicle's own battery; None: as recorded."""
        self._traits = personality.param_traits
        self._table = {param.name: param for param in personality.params}
        self._index = {name: index for index, name in enumerate(self._table)}
        self._values = {param.name: stored(param.value, param.kind) for param in personality.params}
        self._setters = {param.sets: param for param in personality.params if param.sets is not None}
        self._values[self._traits.sysid] = float(sysid)
        if capacity_mAh is not None:
            name = self._traits.capacity
            self._values[name] = stored(capacity_mAh, self._table[name].kind)
        self._changes: list[Message] = []

    def remember(self, earlier: ParamServer) -> None:
        """Take over the values from before a restart."""
        self._values |= earlier._values

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def change(self, name: str, value: float) -> None:
        """Change a parameter on the vehicle's own initiative; `changes` reports it."""
        value = stored(value, self._table[name].kind)
        if value != self._values[name]:
            self._values[name] = value
            self._changes.append(self._reported(name, name))

    def setting(self, setting: Setting) -> float:
        """Return the value of the parameter behind a setting, within its bounds, in SI units.

        Raises KeyError if this autopilot has no such parameter.
        """
        param = self._setters[setting]
        value = self._values[param.name]
        if math.isnan(value):
            value = param.value
        return min(max(value, param.low), param.high) * param.unit

    def settings(self) -> dict[Setting, float]:
        """Return every setting for which this autopilot has a parameter."""
        return {setting: self.setting(setting) for setting in self._setters}

    def changes(self) -> list[Message]:
        """Return the PARAM_VALUE messages of values that the vehicle changed since the last call."""
        if not self._changes:
            return []
        changes, self._changes = self._changes, []
        return changes

    def receive(self, message: Message) -> list[Message]:
        """Answer PARAM_REQUEST_LIST, PARAM_REQUEST_READ and PARAM_SET. Unknown parameters get no answer."""
        if message.name == "PARAM_REQUEST_LIST":
            values = [self._value(name, name, index) for name, index in self._index.items()]
            return [self._hash(), *values] if self._traits.hash_name else values
        if message.name == "PARAM_REQUEST_READ":
            return self._read(message.fields["param_id"], message.fields["param_index"])
        if message.name == "PARAM_SET":
            fields = message.fields
            return self._set(fields["param_id"], fields["param_value"], fields["param_type"])
        return []

    def _read(self, requested: str, index: int) -> list[Message]:
        if index >= 0:
            return [self._value(name, name, i) for name, i in self._index.items() if i == index]
        if requested == self._traits.hash_name:
            return [self._hash()]
        name = self._found(requested)
        return [self._reported(name, requested)] if name is not None else []

    def _set(self, requested: str, sent: float, kind: int) -> list[Message]:
        name = self._found(requested)
        if name is None or not (math.isfinite(sent) or self._takes(sent, kind)):
            return []
        own = self._table[name].kind
        if kind == own or self._traits.converts:
            self._values[name] = self._decoded(sent, own)
        return [self._reported(name, requested)]

    def _takes(self, sent: float, kind: int) -> bool:
        """Whether a value that is not finite may be set."""
        return self._traits.takes_nan or (self._traits.bytes_in_float and kind != _REAL32)

    def _found(self, requested: str) -> str | None:
        name = requested.upper() if self._traits.any_case else requested
        return name if name in self._values else None

    def _reported(self, name: str, requested: str) -> Message:
        return self._value(name, requested, self._index[name] if self._traits.sends_index else BY_NAME)

    def _value(self, name: str, requested: str, index: int) -> Message:
        kind = self._table[name].kind
        return self._message(requested, self._encoded(self._values[name], kind), kind, index)

    def _message(self, name: str, value: float, kind: int, index: int) -> Message:
        fields = {"param_id": name, "param_value": value, "param_type": kind, "param_index": index}
        return Message("PARAM_VALUE", {**fields, "param_count": len(self._values)})

    def _hash(self) -> Message:
        parts: Iterable[bytes] = (name.encode() + _FLOAT.pack(value) for name, value in self._values.items())
        number = zlib.crc32(b"".join(parts))
        return self._message(self._traits.hash_name, _FLOAT.unpack(_UNSIGNED.pack(number))[0], _UINT32, BY_NAME)

    def _encoded(self, value: float, kind: int) -> float:
        if kind == _REAL32 or not self._traits.bytes_in_float:
            return value
        return float(_FLOAT.unpack(_SIGNED.pack(round(value)))[0])

    def _decoded(self, sent: float, kind: int) -> float:
        if kind == _REAL32 or not self._traits.bytes_in_float:
            return stored(sent, kind)
        return stored(_SIGNED.unpack(_FLOAT.pack(sent))[0], kind)


def stored(value: float, kind: int) -> float:
    """Return a value as a parameter of this type stores it: single precision, or a whole number within its range."""
    if kind == _REAL32:
        try:
            return float(_FLOAT.unpack(_FLOAT.pack(value))[0])
        except OverflowError:
            return math.copysign(math.inf, value)
    low, high = RANGES[kind]
    return float(min(max(math.floor(value + 0.5), low), high))
