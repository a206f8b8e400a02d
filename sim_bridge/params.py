"""The parameter protocol of one vehicle: read by name or index, set, list.

Knows: ArduPilot's manners (names match in any case and come back as they were asked for; unknown ones get silence).
Does not know: what the parameters do.
"""

from __future__ import annotations

import math

from gcs.link.message import Message
from sim_bridge.personality import Personality, Setting

_BY_NAME = 0xFFFF  # param_index of an answer to a question by name


class Params:
    """Name, value and type of every parameter, in order."""

    def __init__(self, personality: Personality, sysid: int) -> None:
        self._table = {param.name: param for param in personality.params}
        self._values = {param.name: param.value for param in personality.params}
        self._setters = {param.sets: param for param in personality.params if param.sets is not None}
        self._values[personality.params[0].name] = float(sysid)

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __setitem__(self, name: str, value: float) -> None:
        self._values[name] = value

    def setting(self, setting: Setting) -> float:
        """What the vehicle goes by: the value of the parameter that decides, within its bounds, in SI units."""
        param = self._setters[setting]
        return min(max(self._values[param.name], param.low), param.high) * param.unit

    def receive(self, message: Message) -> list[Message]:
        """Answer PARAM_REQUEST_LIST, PARAM_REQUEST_READ and PARAM_SET."""
        fields = message.fields
        if message.name == "PARAM_REQUEST_LIST":
            return [self._value(name, index) for index, name in enumerate(self._values)]
        if message.name == "PARAM_SET":
            asked, value = fields["param_id"], fields["param_value"]
            if asked.upper() not in self._values or not math.isfinite(value):
                return []
            self._values[asked.upper()] = float(value)
            return [self._value(asked, _BY_NAME)]
        if message.name == "PARAM_REQUEST_READ":
            index = fields["param_index"]
            if 0 <= index < len(self._values):
                return [self._value(list(self._values)[index], index)]
            asked = fields["param_id"]
            return [self._value(asked, _BY_NAME)] if asked.upper() in self._values else []
        return []

    def _value(self, asked: str, index: int) -> Message:
        name = asked.upper()
        return Message(
            "PARAM_VALUE",
            {
                "param_id": asked,
                "param_value": self._values[name],
                "param_type": self._table[name].kind,
                "param_count": len(self._values),
                "param_index": index,
            },
        )
