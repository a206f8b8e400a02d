"""What counts in what a vehicle says: which messages are dialogue and which are telemetry, which fields matter.

Knows: the fields of messages and what an autopilot's version or its simulator put into them by chance. Does not
know: recordings, vehicles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from gcs.link.wire.message import Message

# Entry is compared one by one, in order; all else is telemetry and is compared by kind and rate.
DIALOGUE = frozenset(
    {
        "AUTOPILOT_VERSION",
        "AVAILABLE_MODES",
        "BAD_DATA",
        "COMMAND_ACK",
        "COMMAND_LONG",
        "GPS_GLOBAL_ORIGIN",
        "HOME_POSITION",
        "MESSAGE_INTERVAL",
        "MISSION_ACK",
        "MISSION_COUNT",
        "MISSION_ITEM",
        "MISSION_ITEM_INT",
        "MISSION_ITEM_REACHED",
        "MISSION_REQUEST",
        "MISSION_REQUEST_INT",
        "PARAM_VALUE",
        "STATUSTEXT",
        "TIMESYNC",
        "UNKNOWN_300",
        "UNKNOWN_410",
    }
)
# These come when they come: just before or just after an answer, on the originals too.
BY_THE_WAY = frozenset({"STATUSTEXT", "PARAM_VALUE", "UNKNOWN_410", "HEARTBEAT"})

# These are said again and again, whatever the ground station does meanwhile.
REPEATED = frozenset({"MISSION_ITEM_REACHED"})

# Of these streams only what is new is dialogue: they say how things stand.
STANDING: dict[str, tuple[str, ...]] = {
    "HEARTBEAT": ("type", "autopilot", "base_mode", "custom_mode", "system_status"),
    "MISSION_CURRENT": ("seq", "total", "mission_state", "mission_mode"),
    "EXTENDED_SYS_STATE": ("vtol_state", "landed_state"),
}

# Which of several messages of a kind it is.
_WHICH: dict[str, tuple[str, ...]] = {
    "COMMAND_ACK": ("command",),
    "COMMAND_LONG": ("command",),
    "MISSION_ACK": ("target_system", "mission_type"),
    "MISSION_COUNT": ("mission_type",),
    "MISSION_ITEM": ("seq", "mission_type"),
    "MISSION_ITEM_INT": ("seq", "mission_type"),
    "MISSION_ITEM_REACHED": ("seq",),
    "MISSION_REQUEST": ("seq", "mission_type"),
    "MISSION_REQUEST_INT": ("seq", "mission_type"),
    "PARAM_VALUE": ("param_id",),
    "STATUSTEXT": ("text",),
    "MESSAGE_INTERVAL": ("message_id",),
}
_MATTERS: dict[str, tuple[str, ...]] = {
    "AUTOPILOT_VERSION": ("capabilities", "flight_sw_version", "uid"),
    "COMMAND_ACK": ("result", "progress", "result_param2", "target_system", "target_component"),
    "GPS_GLOBAL_ORIGIN": ("latitude", "longitude", "altitude"),
    "HOME_POSITION": ("latitude", "longitude", "altitude", "q"),
    "MESSAGE_INTERVAL": ("interval_us",),
    "MISSION_ACK": ("type", "target_component"),
    "MISSION_COUNT": ("count", "target_system", "target_component"),
    "MISSION_REQUEST": ("target_system", "target_component"),
    "MISSION_REQUEST_INT": ("target_system", "target_component"),
    "PARAM_VALUE": ("param_value", "param_type", "param_count", "param_index"),
    "STATUSTEXT": ("severity", "chunk_seq"),
    "TIMESYNC": ("ts1",),
}
_ITEM = ("frame", "command", "current", "autocontinue", "param1", "param2", "param3", "param4", "x", "y", "z")
_MATTERS["MISSION_ITEM_INT"] = _MATTERS["MISSION_ITEM"] = _ITEM
_MATTERS |= STANDING

# Places are where the recorded vehicle stood, as its receiver saw it.
_CLOSE: dict[tuple[str, str], float] = {
    **{(name, f): 100.0 for name in ("GPS_GLOBAL_ORIGIN", "HOME_POSITION") for f in ("latitude", "longitude")},
    **{(name, "altitude"): 2000.0 for name in ("GPS_GLOBAL_ORIGIN", "HOME_POSITION")},
}
_HOME_ITEM_CLOSE = {"x": 3.0, "y": 3.0, "z": 0.02}  # 1e-7 degree, metres


@dataclass(frozen=True)
class Wording:
    """One thing a vehicle said. Two of them answer to each other when their `which` is the same."""

    t_s: float
    step: int
    name: str
    which: tuple[object, ...]
    fields: dict[str, Any]

    def __str__(self) -> str:
        told = " ".join(str(part) for part in self.which)
        return f"{self.name} {told}".strip()


def wording(t_s: float, step: int, name: str, message: Message | None) -> Wording:
    """A message as something to compare."""
    fields = message.fields if message is not None else {}
    which = tuple(fields[key] for key in _WHICH.get(name, ()) if key in fields)
    return Wording(t_s, step, name, which, fields)


def equal(recorded: Wording, here: Wording) -> bool:
    """Whether they say the same, apart from how many parameters there are."""
    return all(line.startswith(("param_count", "param_index")) for line in differences(recorded, here))


def differences(recorded: Wording, here: Wording) -> list[str]:
    """Fields that matter and differ, each as `field: recorded -> here`."""
    return [
        f"{field}: {_told(recorded.fields.get(field))} -> {_told(here.fields.get(field))}"
        for field in _MATTERS.get(recorded.name, ())
        if not _same(recorded, field, recorded.fields.get(field), here.fields.get(field))
    ]


def _same(recorded: Wording, field: str, a: Any, b: Any) -> bool:
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(_same(recorded, field, x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, float) and isinstance(b, float) and math.isnan(a) and math.isnan(b):
        return True
    if field == "uid":
        return bool(a) == bool(b)
    if field == "q":
        return isinstance(a, float) and isinstance(b, float) and math.isnan(a) == math.isnan(b)
    close = _CLOSE.get((recorded.name, field))
    if recorded.name == "MISSION_ITEM_INT" and recorded.which[0] == 0:
        close = _HOME_ITEM_CLOSE.get(field)
    if close is not None and isinstance(a, int | float) and isinstance(b, int | float):
        return abs(a - b) <= close
    return bool(a == b)


def _told(value: Any) -> str:
    return f"{value:.7g}" if isinstance(value, float) else str(value)
