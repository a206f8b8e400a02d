"""Every error the operator can meet, and the exit code of its family.

A mistake of the operator and a fault of the vehicle are different classes, so that no caller has to parse the text.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Self

_LONG = re.compile(
    r"(?<![\w.])(-?\d+\.\d{4,})(?= (?:m|s|N|W|Wh|V|kg|m/s|m/s²|deg|degrees|rad/s|deg/s|degrees/s|N m)\b)"
)

_FEW = 12


class GcsError(Exception):
    """A failure in one sentence. `hint` is the next step for the operator, if there is one.

    `reason` is the part that a longer message takes: without the file's name, or the words "no plan".
    `folder` is that of the flight which failed, with its events and telemetry.
    """

    exit_code = 1
    folder: str | None = None

    def __init__(self, message: str, *, hint: str = "", reason: str = "") -> None:
        self.message, self.hint, self.reason = map(for_people, (message, hint, reason or message))
        super().__init__(self.message)

    def advise(self, hint: str) -> None:
        """Give another next step: whoever catches it knows more."""
        self.hint = for_people(hint)


def for_people(text: str) -> str:
    """The text with at most three digits after the point of a quantity, or three significant digits below 0.1."""
    return _LONG.sub(lambda number: _short(float(number[1])), text)


def error_text(message: str, hint: str) -> str:
    """What a program prints about an error."""
    return f"error: {message}\nnext: {hint}" if hint else f"error: {message}"


def read_error_text(text: str) -> tuple[str, str]:
    """The message and the hint of an `error_text`."""
    message, _, hint = text.strip().removeprefix("error: ").partition("\nnext: ")
    return message, hint


def counted(number: int, noun: str, plural: str = "") -> str:
    """A number of things: "1 vehicle", "2 vehicles"."""
    return f"{number} {noun if number == 1 else plural or f'{noun}s'}"


def listed(numbers: Sequence[int]) -> str:
    """Numbers in order: "1, 2, 4"; of more than a dozen, those that follow each other as "1 to 60, 62 to 100"."""
    if len(numbers) <= _FEW:
        return ", ".join(map(str, numbers))
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs)


def _short(value: float) -> str:
    if 0.0 < abs(value) < 0.1:
        return f"{value:.3g}"
    return f"{value:.3f}".rstrip("0").rstrip(".")


class UsageError(GcsError):
    """The command line requests something that is not possible."""

    exit_code = 2


class ScenarioError(GcsError):
    """The scenario file is missing, unreadable or invalid. The message lists every mistake."""

    exit_code = 3


class PlanningError(GcsError):
    """No plan: the solver failed, or the problem has no solution."""

    exit_code = 4
    legs: tuple[int, ...] = ()  # of a drawn route, by index: where it failed, if that is known

    @classmethod
    def because(cls, reason: str, *, hint: str, legs: Iterable[int] = ()) -> Self:
        """The failure "no plan: REASON"; `legs` are those of a drawn route in which it happened, by index."""
        failure = cls(f"no plan: {reason}", hint=hint, reason=reason)
        failure.legs = tuple(sorted({leg for leg in legs if leg >= 0}))
        return failure


class OutOfTime(PlanningError):
    """The work has no time left (`limit_s` of `make_plan`, `--limit`); the reason says what it was doing."""

    @classmethod
    def because(cls, reason: str, *, hint: str = "", legs: Iterable[int] = ()) -> Self:
        """The failure "no plan in the time given"."""
        more = "give more time (--limit), or plan less: fewer points or loops, one objective, a shorter flight"
        return super().because(f"the time limit has passed, while {reason}", hint=hint or more, legs=legs)


class Infeasible(PlanningError):
    """The problem has no solution. The message names the constraint that cannot be met."""


class VerificationError(GcsError):
    """A plan exists and failed verification."""

    exit_code = 5


class NotWritten(VerificationError):
    """The plan is verified, and missions of it that were asked for are not written: they are not fit to fly."""

    exit_code = 13


class FileFormatError(GcsError):
    """A plan, mission or log file is not in the format that it claims."""

    exit_code = 6

    def __init__(self, message: str, *, hint: str = "", reason: str = "") -> None:
        super().__init__(message, hint=hint or "correct the file there, or save it again", reason=reason)


class LinkError(GcsError):
    """The connection itself failed: a port in use, an unreachable host."""

    exit_code = 7


class PeerError(GcsError):
    """The vehicle is silent, refuses, or violates the protocol."""

    exit_code = 8


class PeerTimeout(PeerError):
    """The vehicle did not answer in time."""


class PeerRefusal(PeerError):
    """The vehicle refused."""


class ProtocolMisuse(GcsError):
    """This program used a protocol machine out of order: a bug in Skein, never a fault of the vehicle."""

    exit_code = 70


class FlightError(GcsError):
    """The flight was aborted: a vehicle was lost, a separation was violated, or the setpoint stream stalled."""

    exit_code = 9


class OrderError(FlightError):
    """The flight ended, and a vehicle refused or did not answer an order in a crisis."""

    exit_code = 12


class JudgementError(GcsError):
    """The flight ended, and violated a limit of the scenario."""

    exit_code = 10
