"""One mistake in a scenario, its sentence, and keys and values as sentences show them."""

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from gcs.errors import ScenarioError
from gcs.scenario.schema.toml_lines import Key

_NO_WORD = re.compile(r"[-+]?\d[\d.]*(?:[,:]\d+|\s*[A-Za-z/²^°]{1,7}2?)")  # 5 m: perhaps without quotes in the file
_SHOWN_INT = 10**100
_SHOWN_DEPTH = 10
_SMALL = 0.1
_E7, _E7_LEAST = 10_000_000, 1_000_000  # degrees as MAVLink has them; smaller numbers may be metres
_DIGITS = 3
EXACT = 7  # digits of what is written into a file


@dataclass(frozen=True)
class KeyChange:
    """A key, and the value that it should have; as text, the words after "set"."""

    key: Key
    value: float | Sequence[float]

    def __str__(self) -> str:
        return f"{dotted(self.key)} to {plain(self.value, digits_of(self.key))}"


@dataclass(frozen=True)
class Mistake:
    """The mistake of one key; `text` follows "key = value: ". `remedy` says what to do, as a `next:` line has it."""

    key: Key
    text: str
    value: object = None
    remedy: str = ""  # with {} for each of the changes
    changes: tuple[KeyChange, ...] = ()
    line: int | None = None  # where the text of the file itself is wrong

    @property
    def place(self) -> str:
        """The key and its value."""
        if self.value is None:
            return dotted(self.key)
        return f"{dotted(self.key)} = {toml(self.value, digits_of(self.key))}"

    @property
    def step(self) -> str:
        """What to do; empty where nothing is known but the problem."""
        return self.remedy.format(*self.changes) if self.changes else self.remedy

    @property
    def whole(self) -> str:
        """What is wrong and what to do."""
        return sentence(self.text, self.step)

    def __str__(self) -> str:
        return f"{self.place}: {self.whole}"


class Mistaken(ScenarioError):
    """A file with these mistakes, which its message lists."""

    def __init__(self, message: str, *, hint: str = "", reason: str = "", mistakes: Sequence[Mistake] = ()) -> None:
        super().__init__(message, hint=hint, reason=reason)
        self.mistakes = tuple(mistakes)


def sentence(text: str, step: str) -> str:
    """What is wrong and what to do."""
    return f"{text}{'' if text.endswith('?') else '.'} {step[0].upper()}{step[1:]}" if step else text


def dotted(key: Key) -> str:
    """The key as text: `formation.vehicle[3].position_m[0]`."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in key)
    return "".join(parts).removeprefix(".")


def name_of(key: Key) -> str:
    """The last name in a key: that of a value, or of the list that holds it."""
    return next((part for part in reversed(key) if isinstance(part, str)), "")


def digits_of(key: Key) -> int:
    """The digits after the point that a number of this key needs."""
    return EXACT if name_of(key).endswith("_deg") else _DIGITS


def value_at(table: Any, key: Key) -> Any:
    """The value at a key inside a table; None without one."""
    for part in key:
        try:
            table = table[part]
        except (LookupError, TypeError):
            return None
    return table


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name that is the same but for its unit or its case, or else is similar; None without one."""
    same, names = name.lower().replace("-", "_"), list(known)
    with_unit = [one for one in names if one.startswith(f"{same}_")]
    return next(iter(with_unit or difflib.get_close_matches(same, names, n=1)), None)


def plain(value: float | Sequence[Any], digits: int = _DIGITS) -> str:
    """A number or a list in a sentence: few digits after the point, or three in all below 0.1, no zeros at the end."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(plain(one, digits) for one in value)}]"
    assert isinstance(value, int | float)
    if isinstance(value, int):
        return str(value) if abs(value) < _SHOWN_INT else hex(value)  # Python refuses thousands of decimal digits
    if digits == _DIGITS and 0.0 < abs(value) < _SMALL:
        return f"{value:.3g}"
    return f"{round(value, digits) + 0.0:.{digits}f}".rstrip("0").rstrip(".")


def from_e7(value: object) -> float | None:
    """The degrees in an integer as MAVLink has them; None for what may be metres."""
    return value / _E7 if isinstance(value, int) and _E7_LEAST < abs(value) <= 180 * _E7 else None


def degrees(value: float) -> str:
    """Degrees as they are written into a file: to 1e-7, which is a centimetre."""
    return plain(float(value), EXACT)


def toml(value: object, digits: int = _DIGITS, depth: int = 0) -> str:
    """The value in TOML, cut when it is long or nested deeply. What may stand without quotes has none."""
    if depth > _SHOWN_DEPTH:
        text = "..."
    elif isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, str):
        text = "".join(mark if mark.isprintable() else ascii(mark)[1:-1] for mark in value)
        text = text if _NO_WORD.fullmatch(text) or {'"', "'"} & {*text} else f'"{text}"'
    elif isinstance(value, list | tuple):
        text = f"[{', '.join(toml(item, digits, depth + 1) for item in value)}]"
    elif isinstance(value, dict):
        text = f"{{{', '.join(f'{name} = {toml(item, digits, depth + 1)}' for name, item in value.items())}}}"
    elif isinstance(value, float) and (digits != _DIGITS or not 0.0 < abs(value) < _SMALL):
        text = str(round(value, digits))
    else:
        text = plain(value) if isinstance(value, int | float) else str(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
