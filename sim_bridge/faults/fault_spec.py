"""The table of fault kinds with their values, and the grammar of fault texts.

    SYSID:[up.|down.]KIND[=VALUE,...][@WHEN]        all:down.loss=0.2    3:delay=0.2,0.1@10..30    4:die@30

SYSID may be `all`. `up` is from the ground to the vehicle, `down` is back; a link fault without either acts both ways.
WHEN is `A..B` or `A`, in simulated seconds after take-off. `start:A..B` counts from the start of the simulation.
`upload:N` begins when item N of an upload arrives. Without WHEN the fault is always active.
"""

import math
import re
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from gcs.errors import UsageError
from gcs.util.bounded_file import FAULT_FILE, read_file

_FILE_HINT = 'write [faults], and under it e.g. 3 = ["loss=0.2@10..30"] or all = ["down.delay=0.2"]'


class LinkDirection(StrEnum):
    """The direction of the frames that a link fault affects."""

    BOTH = ""
    UP = "up"  # to the vehicle
    DOWN = "down"


class Since(StrEnum):
    """The event from which fault times count."""

    START = "start"
    TAKEOFF = "takeoff"
    UPLOAD = "upload"


@dataclass(frozen=True)
class When:
    """The active interval, in simulated seconds since an event; `item` is the item of an upload."""

    from_s: float = 0.0
    until_s: float = math.inf
    since: Since = Since.START
    item: int = 0


ALWAYS = When()


@dataclass(frozen=True)
class Value:
    """One number of a fault; a `default` of None makes it mandatory. `words` stand for 0, 1, ..."""

    name: str
    low: float
    high: float
    default: float | None = None
    words: tuple[str, ...] = ()


@dataclass(frozen=True)
class FaultKind:
    """One kind of fault. `number` identifies it in MAVLink commands; `at_once`: it acts once and has no end."""

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
_LONG_S = 3600.0


def _ned(unit: str, most: float) -> tuple[Value, ...]:
    """Values north, east and down of magnitude `most`; east and down are 0 unless they are given."""
    north, *others = (f"{axis}_{unit}" for axis in ("north", "east", "down"))
    return Value(north, -most, most), *(Value(name, -most, most, 0.0) for name in others)


SENSORS = ("gyro", "accelerometer", "compass", "barometer", "gnss")

LOSS = FaultKind("loss", 1, "frames are lost", _CHANCE, directed=True)
DUPLICATE = FaultKind("duplicate", 2, "frames arrive twice", _CHANCE, directed=True)
REORDER = FaultKind("reorder", 3, "frames arrive 0.1 s late, behind later ones", _CHANCE, directed=True)
CORRUPT = FaultKind("corrupt", 4, "one to eight bits of a frame are flipped", _CHANCE, directed=True)
DELAY = FaultKind(
    "delay",
    5,
    "frames arrive late by the mean, plus or minus the jitter",
    (Value("mean_s", 0.0, _LONG_S), Value("jitter_s", 0.0, _LONG_S, 0.0)),
    directed=True,
)
SILENT = FaultKind("silent", 6, "no frame arrives", directed=True)
DIE = FaultKind("die", 7, "motors stop for good, and the vehicle sends nothing more", at_once=True)
REJECT_MISSION = FaultKind("reject-mission", 8, "every upload is refused at its first item")
REBOOT = FaultKind("reboot", 9, "the autopilot restarts and keeps its stored data, as real ones do", at_once=True)
GNSS_OUTAGE = FaultKind("gnss-outage", 10, "there is no fix")
GNSS_JUMP = FaultKind("gnss-jump", 11, "fixes are offset", _ned("m", 1e5))
MOTOR = FaultKind(
    "motor",
    12,
    "a motor (1 to 4) loses a share of its thrust",
    (Value("motor", 1.0, 4.0), Value("share", 0.0, 1.0, 1.0)),
)
BATTERY = FaultKind("battery", 13, "at most this share of the charge remains", (Value("share", 0.0, 1.0, 0.15),))
STUCK = FaultKind(
    "stuck", 14, "a sensor repeats its last sample", (Value("sensor", 0.0, len(SENSORS) - 1.0, words=SENSORS),)
)
SLOW = FaultKind("slow", 15, "the ground speed is limited to this", (Value("speed_mps", 0.01, 1000.0),))
WIND = FaultKind("wind", 16, "this wind is added around the vehicle", _ned("mps", 30.0))
PUSH = FaultKind("push", 17, "this acceleration acts on the vehicle, evenly over its mass", _ned("mps2", 30.0))
WRONG_CRC = FaultKind("wrong-crc", 18, "CalcFileCRC32 of MAVLink FTP answers another checksum")
REFUSE = FaultKind("refuse-commands", 19, "every command is refused")
IGNORE = FaultKind("ignore-commands", 20, "no command is carried out or acknowledged")
CLOCK_JUMP = FaultKind("clock-jump", 21, "GNSS time is ahead by this, fixes are not", (Value("ahead_s", -1e6, 1e6),))
REFUSE_ARMING = FaultKind("refuse-arming", 22, "arming is refused, with a text that gives the reason")
FAIL_CHECKS = FaultKind("fail-checks", 23, "arming checks fail: the PREARM bit is off, and a text gives the reason")
SLOW_DOWN = FaultKind(
    "slow-down",
    25,
    "a slower leg is obeyed at once or late where the autopilot may do both; by the seed otherwise",
    (Value("when", 0.0, 1.0, words=("at-once", "late")),),
)
SAG = FaultKind("sag", 24, "the battery's voltage is lower by this", (Value("volt", 0.0, 100.0),))

KINDS = (
    *(LOSS, DUPLICATE, REORDER, CORRUPT, DELAY, SILENT, DIE, REJECT_MISSION, REBOOT),
    *(GNSS_OUTAGE, GNSS_JUMP, MOTOR, BATTERY, STUCK, SLOW, WIND, PUSH, WRONG_CRC, REFUSE, IGNORE, CLOCK_JUMP),
    *(REFUSE_ARMING, FAIL_CHECKS, SAG, SLOW_DOWN),
)
_BY_NAME = {kind.name: kind for kind in KINDS}
_WHOLE = frozenset({"motor", "sensor", "when"})
_HINT = "write e.g. --fault 3:loss=0.2@10..30, --fault all:down.delay=0.2,0.1 or --fault 3:die@30"
_TEXT = re.compile(
    r"(?P<vehicle>\w+):(?:(?P<direction>up|down)\.)?(?P<kind>[a-z-]+)(?:=(?P<values>[^@]*))?(?:@(?P<when>.+))?"
)


def make_fault(
    kind: FaultKind, values: Sequence[float] = (), direction: LinkDirection = LinkDirection.BOTH, when: When = ALWAYS
) -> Fault:
    """Return a fault with its values checked; missing values take their defaults. Raises `UsageError`."""
    if len(values) > len(kind.values):
        raise UsageError(
            f"{kind.name} takes at most {len(kind.values)} values, but {len(values)} are given.", hint=_HINT
        )
    full = []
    for i, wanted in enumerate(kind.values):
        value = values[i] if i < len(values) else wanted.default
        if value is None:
            raise UsageError(f"{kind.name} needs a value: {wanted.name}.", hint=_HINT)
        if not wanted.low <= value <= wanted.high or (wanted.name in _WHOLE and value != round(value)):
            raise UsageError(
                f"{kind.name}: {wanted.name} must be between {wanted.low:g} and {wanted.high:g}.", hint=_HINT
            )
        full.append(float(value))
    if direction is not LinkDirection.BOTH and not kind.directed:
        raise UsageError(f"{kind.name} is not a link fault, so it has no direction.", hint=_HINT)
    if not 0.0 <= when.from_s < when.until_s:
        raise UsageError(f"{kind.name} must begin at 0 s or later, and end after it begins.", hint=_HINT)
    return Fault(kind, tuple(full), direction, when)


def kind_of(number: int) -> FaultKind | None:
    """Return the kind with this number in MAVLink commands, or None."""
    return next((kind for kind in KINDS if kind.number == number), None)


def parse_faults(texts: Iterable[str], sysids: Iterable[int]) -> dict[int, tuple[Fault, ...]]:
    """Return the faults by system id. Raises `UsageError` that quotes the wrong text."""
    known = tuple(sysids)
    faults: dict[int, tuple[Fault, ...]] = {}
    for text in texts:
        vehicle, fault = parse_fault(text)
        named = known if vehicle is None else (vehicle,)
        if vehicle is not None and vehicle not in known:
            ids = ", ".join(map(str, known))
            raise UsageError(f"fault {text!r}: vehicle {vehicle} is not in this mission, which has {ids}.", hint=_HINT)
        for sysid in named:
            faults[sysid] = (*faults.get(sysid, ()), fault)
    return faults


def parse_fault(text: str) -> tuple[int | None, Fault]:
    """Return the system id (None for all vehicles) and the fault. Raises `UsageError` that quotes the text."""
    found = _TEXT.fullmatch(text.strip())
    if found is None or not (found["vehicle"] == "all" or found["vehicle"].isdecimal()):
        raise UsageError(f"{text!r} is not a fault.", hint=_HINT)
    kind = _BY_NAME.get(found["kind"])
    if kind is None:
        raise UsageError(
            f"fault {text!r}: the kind {found['kind']!r} is unknown. Known kinds are {', '.join(_BY_NAME)}.", hint=_HINT
        )
    try:
        values = [_number(part, kind.values[i : i + 1]) for i, part in enumerate(_parts(found["values"]))]
        fault = make_fault(kind, values, LinkDirection(found["direction"] or ""), _when(found["when"]))
    except ValueError:
        raise UsageError(f"fault {text!r}: a value or time is not a number.", hint=_HINT) from None
    except UsageError as error:
        raise UsageError(f"fault {text!r}: {error.message}", hint=error.hint) from None
    return (None if found["vehicle"] == "all" else int(found["vehicle"])), fault


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


def read_fault_file(path: Path) -> list[str]:
    """Return the faults of a TOML file as command-line texts, in the order of the file. Raises `UsageError`.

    [faults]
    all = ["down.loss=0.05"]
    3 = ["loss=0.2@10..30", "gnss-outage@20..40"]
    """
    try:
        data = tomllib.loads(read_file(path, FAULT_FILE, error=UsageError, hint=_FILE_HINT).decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise UsageError(f"the fault file {path} is not TOML: {error}.", hint=_FILE_HINT) from error
    table = data.get("faults")
    if not isinstance(table, dict) or len(data) != 1:
        raise UsageError(f"the fault file {path} must contain the table [faults] and nothing else.", hint=_FILE_HINT)
    texts = []
    for vehicle, faults in table.items():
        if not isinstance(faults, list) or not all(isinstance(fault, str) for fault in faults):
            raise UsageError(f"in the fault file {path}, {vehicle} must be a list of strings.", hint=_FILE_HINT)
        texts += [f"{vehicle}:{fault}" for fault in faults]
    return texts
