"""How sentences call the things of a drawn file, and the lines that these are on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

_SHOWN_MAX = 60  # characters of a name


@dataclass(frozen=True)
class Label:
    """A thing in a drawn file: what it is, its number among those, and more about it: 'line 2 ("Ridge")'.

    `whole` is the thing that it is a part of: "segment 2 of track 1". `line` is where it is in the file, a line or a
    column; None: where its whole is.
    """

    what: str
    number: int | None = None
    more: str = ""
    whole: Label | None = None
    line: int | None = None

    @classmethod
    def named(cls, what: str, number: int, name: str, line: int, whole: Label | None = None) -> Label:
        """The label of a thing with a name of its own; a long name is shortened."""
        short = name if len(name) <= _SHOWN_MAX else f"{name[: _SHOWN_MAX - 3]}..."
        return cls(what, number, f'("{short}")' if short else "", whole, line)

    def part(self, what: str, number: int, count: int | None = None, line: int | None = None) -> Label:
        """The label of one of its parts; a thing with a `count` of one part is that part."""
        return self if count == 1 else Label(what, number, whole=self, line=line)

    @property
    def rest(self) -> str:
        """What follows its number."""
        return (f" {self.more}" if self.more else "") + ("" if self.whole is None else f" of {self.whole}")

    @property
    def at_line(self) -> int | None:
        """Where it is in the file; None where that is not known."""
        return self.line if self.line is not None or self.whole is None else self.whole.at_line

    def __str__(self) -> str:
        return f"{self.what}{'' if self.number is None else f' {self.number}'}{self.rest}"


@dataclass(frozen=True)
class LeftOut:
    """What is not carried over, or is changed: the thing in the file, and the rest of a sentence about it."""

    label: Label
    text: str

    def __str__(self) -> str:
        return f"{self.label}: {self.text}"


def sentences(left_out: Iterable[LeftOut], unit: str = "") -> list[str]:
    """The sentences with their lines, equal ones joined: "items 3, 4 and 7 (DO_SET_ROI), lines 6, 7 and 10: ...".

    `unit` is "line" or "column"; empty: without them.
    """
    alike: dict[tuple[str, bool, str, str], list[Label]] = {}
    for one in left_out:
        label = one.label
        alike.setdefault((label.what, label.number is None, label.rest, one.text), []).append(label)
    found = []
    for (what, _, rest, text), labels in alike.items():
        numbers = [*dict.fromkeys(label.number for label in labels if label.number is not None)]
        lines = sorted({label.at_line for label in labels if unit and label.at_line is not None})
        on = f", {_listed(unit, lines)}" if lines else ""
        found.append(f"{_listed(what, numbers)}{rest}{on}: {text}")
    return found


def _listed(noun: str, numbers: Sequence[int]) -> str:
    """A noun with numbers, in runs of three and more: "items 2, 4 to 9 and 12"."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    parts = [part for run in runs for part in ([f"{run[0]} to {run[-1]}"] if len(run) > 2 else map(str, run))]
    shown = f"{', '.join(parts[:-1])} and {parts[-1]}" if len(parts) > 1 else "".join(parts)
    return f"{noun}{'s' * (len(numbers) > 1)}{' ' * bool(shown)}{shown}"
