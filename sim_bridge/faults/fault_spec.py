"""Faults on demand: what there is, what each needs to be told, and how people write it.

Knows: the kinds of fault as one table, and their grammar:

    SYSID:[up.|down.]KIND[=VALUE,...][@WHEN]        all:down.loss=0.2    3:delay=0.2,0.1@10..30    4:die@30

SYSID may be `all`. `up` is from the ground to the vehicle, `down` back; a fault of the link without either is both.
WHEN is `A..B` or `A`, in simulated seconds from take-off on; `start:A..B` counts from the start of the simulation,
and `upload:N` begins when item N of a mission comes in. Without WHEN it is always.
Does not know: how faults come about.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from gcs.errors import UsageError


class LinkDirection(StrEnum):
    """Which way frames go that suffer."""

    BOTH = ""
    UP = "up"  # to the vehicle
    DOWN = "down"


class Since(StrEnum):
    """From what moment on seconds are counted."""

    START = "start"
    TAKEOFF = "takeoff"
    UPLOAD = "upload"


@dataclass(frozen=True)
class When:
    """Simulated seconds since a moment; `item` names the moment of an upload."""

    from_s: float = 0.0
    until_s: float = math.inf
    since: Since = Since.START
    item: int = 0


ALWAYS = When()


@dataclass(frozen=True)
class Value:
    """One number that a kind of fault needs; a `default` of None has to be given. `words` stand for 0, 1, ..."""

    name: str
    low: float
    high: float
    default: float | None = None
    words: tuple[str, ...] = ()


@dataclass(frozen=True)
class FaultKind:
    """One kind of fault. `number` is its name in live commands; `at_once` means that it never ends."""

    name: str
    number: int
    what: str
    values: tuple[Value, ...] = ()
    directed: bool = False
    at_once: bool = False


@dataclass(frozen=True)
class Fault:
    """A fault of one vehicle."""

    kind: FaultKind
    values: tuple[float, ...] = ()
    direction: LinkDirection = LinkDirection.BOTH
    when: When = ALWAYS


_CHANCE = (Value("chance", 0.0, 1.0),)
_FAR_M = 1e5
_LONG_S = 3600.0
SENSORS = ("gyro", "accelerometer", "compass", "barometer", "gnss")

LOSS = FaultKind("loss", 1, "frames are lost", _CHANCE, directed=True)
DUPLICATE = FaultKind("duplicate", 2, "frames come twice", _CHANCE, directed=True)
REORDER = FaultKind("reorder", 3, "frames are overtaken by those of the next 0.1 s", _CHANCE, directed=True)
CORRUPT = FaultKind("corrupt", 4, "one to eight bits of a frame are turned over", _CHANCE, directed=True)
DELAY = FaultKind(
    "delay",
    5,
    "frames come late by the mean, give or take the jitter",
    (Value("mean_s", 0.0, _LONG_S), Value("jitter_s", 0.0, _LONG_S, 0.0)),
    directed=True,
)
SILENT = FaultKind("silent", 6, "no frame passes", directed=True)
DIE = FaultKind("die", 7, "motors stop for good, and nothing is heard any more", at_once=True)
REJECT_MISSION = FaultKind("reject-mission", 8, "every upload is refused at its first item")
REBOOT = FaultKind("reboot", 9, "the autopilot restarts: it keeps what real ones keep", at_once=True)
GNSS_OUTAGE = FaultKind("gnss-outage", 10, "there is no fix")
GNSS_JUMP = FaultKind(
    "gnss-jump",
    11,
    "fixes lie off",
    (Value("north_m", -_FAR_M, _FAR_M), Value("east_m", -_FAR_M, _FAR_M, 0.0), Value("down_m", -_FAR_M, _FAR_M, 0.0)),
)
MOTOR = FaultKind(
    "motor",
    12,
    "a motor (1 to 4) gives a share of its thrust less",
    (Value("motor", 1.0, 4.0), Value("share", 0.0, 1.0, 1.0)),
)
BATTERY = FaultKind("battery", 13, "no more than this share of the charge is left", (Value("share", 0.0, 1.0, 0.15),))
STUCK = FaultKind(
    "stuck", 14, "a sensor repeats its last sample", (Value("sensor", 0.0, len(SENSORS) - 1.0, words=SENSORS),)
)
SLOW = FaultKind("slow", 15, "it flies no faster than this", (Value("speed_mps", 0.01, 1000.0),))
_STRONGEST_MPS, _HARDEST_MPS2 = 30.0, 30.0
WIND = FaultKind(
    "wind",
    16,
    "the air around it moves by so much more",
    (
        Value("north_mps", -_STRONGEST_MPS, _STRONGEST_MPS),
        Value("east_mps", -_STRONGEST_MPS, _STRONGEST_MPS, 0.0),
        Value("down_mps", -_STRONGEST_MPS, _STRONGEST_MPS, 0.0),
    ),
)
PUSH = FaultKind(
    "push",
    17,
    "something pushes it",
    (
        Value("north_mps2", -_HARDEST_MPS2, _HARDEST_MPS2),
        Value("east_mps2", -_HARDEST_MPS2, _HARDEST_MPS2, 0.0),
        Value("down_mps2", -_HARDEST_MPS2, _HARDEST_MPS2, 0.0),
    ),
)

KINDS = (
    *(LOSS, DUPLICATE, REORDER, CORRUPT, DELAY, SILENT, DIE, REJECT_MISSION, REBOOT),
    *(GNSS_OUTAGE, GNSS_JUMP, MOTOR, BATTERY, STUCK, SLOW, WIND, PUSH),
)
_BY_NAME = {kind.name: kind for kind in KINDS}
_WHOLE = frozenset({"motor", "sensor"})
_HINT = "write for example --fault 3:loss=0.2@10..30, --fault all:down.delay=0.2,0.1 or --fault 3:die@30"
_TEXT = re.compile(
    r"(?P<who>\w+):(?:(?P<direction>up|down)\.)?(?P<kind>[a-z-]+)(?:=(?P<values>[^@]*))?(?:@(?P<when>.+))?"
)


def make_fault(
    kind: FaultKind, values: Sequence[float] = (), direction: LinkDirection = LinkDirection.BOTH, when: When = ALWAYS
) -> Fault:
    """A fault with its numbers checked; those left out take their defaults. Raises `UsageError`."""
    if len(values) > len(kind.values):
        raise UsageError(f"{kind.name} takes {len(kind.values)} values, not {len(values)}.", hint=_HINT)
    full = []
    for i, wanted in enumerate(kind.values):
        value = values[i] if i < len(values) else wanted.default
        if value is None:
            raise UsageError(f"{kind.name} needs a value: {wanted.name}.", hint=_HINT)
        if not wanted.low <= value <= wanted.high or (wanted.name in _WHOLE and value != round(value)):
            raise UsageError(f"{kind.name}: {wanted.name} lies between {wanted.low:g} and {wanted.high:g}.", hint=_HINT)
        full.append(float(value))
    if direction is not LinkDirection.BOTH and not kind.directed:
        raise UsageError(f"{kind.name} is no fault of the link and goes neither up nor down.", hint=_HINT)
    if not 0.0 <= when.from_s < when.until_s:
        raise UsageError(f"{kind.name} would end before it begins.", hint=_HINT)
    return Fault(kind, tuple(full), direction, when)


def kind_of(number: int) -> FaultKind | None:
    """The kind that live commands call by this number."""
    return next((kind for kind in KINDS if kind.number == number), None)


def parse_faults(texts: Iterable[str], sysids: Iterable[int]) -> dict[int, tuple[Fault, ...]]:
    """Faults by system id. Raises `UsageError` that quotes the wrong text."""
    known = tuple(sysids)
    faults: dict[int, tuple[Fault, ...]] = {}
    for text in texts:
        who, fault = parse_fault(text)
        named = known if who is None else (who,)
        if who is not None and who not in known:
            ids = ", ".join(map(str, known))
            raise UsageError(f"fault {text!r} names no vehicle of this mission ({ids}).", hint=_HINT)
        for sysid in named:
            faults[sysid] = (*faults.get(sysid, ()), fault)
    return faults


def parse_fault(text: str) -> tuple[int | None, Fault]:
    """One fault and whose it is, None for everybody's. Raises `UsageError` that quotes the text."""
    found = _TEXT.fullmatch(text.strip())
    if found is None or not (found["who"] == "all" or found["who"].isdecimal()):
        raise UsageError(f"{text!r} is no fault.", hint=_HINT)
    kind = _BY_NAME.get(found["kind"])
    if kind is None:
        raise UsageError(f"there is no fault {found['kind']!r} as in {text!r}; there are {_names()}.", hint=_HINT)
    try:
        values = [_number(part, kind.values[i : i + 1]) for i, part in enumerate(_parts(found["values"]))]
        fault = make_fault(kind, values, LinkDirection(found["direction"] or ""), _when(found["when"]))
    except ValueError:
        raise UsageError(f"fault {text!r} has something else where a number should be.", hint=_HINT) from None
    except UsageError as error:
        raise UsageError(f"fault {text!r} cannot be: {error.message}", hint=error.hint) from None
    return (None if found["who"] == "all" else int(found["who"])), fault


def _parts(text: str | None) -> list[str]:
    return text.split(",") if text else []


def _number(text: str, wanted: Sequence[Value]) -> float:
    words = wanted[0].words if wanted else ()
    return float(words.index(text)) if text in words else float(text)


def _when(text: str | None) -> When:
    if text is None:
        return ALWAYS
    since, colon, rest = text.rpartition(":")
    if since == Since.UPLOAD:
        return When(since=Since.UPLOAD, item=int(rest))
    moment = Since(since) if colon else Since.TAKEOFF
    first, dots, last = rest.partition("..")
    return When(float(first or 0.0), float(last) if dots and last else math.inf, moment)


def _names() -> str:
    return ", ".join(kind.name for kind in KINDS)
