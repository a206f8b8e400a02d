"""Every error a person can meet, and the exit code of its family.

Knows: what went wrong, where, and what to do next. Does not know: how it is shown (that is `gcs.cli`).
Your own mistake and the peer's are different classes, so that no caller has to read the text to tell them
apart.
"""

from __future__ import annotations


class GcsError(Exception):
    """A failure that can be said in one sentence, with a next step where there is one."""

    exit_code = 1

    def __init__(self, message: str, *, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


class UsageError(GcsError):
    """The command line asks for something that cannot be done."""

    exit_code = 2


class ScenarioError(GcsError):
    """The scenario file is missing, unreadable or wrong; the message lists every mistake."""

    exit_code = 3


class PlanningError(GcsError):
    """No plan: the solver failed, or the problem has no solution."""

    exit_code = 4


class Infeasible(PlanningError):
    """The problem has no solution; the message names the constraint that forbids it."""


class VerificationError(GcsError):
    """A plan exists and does not hold what it promises."""

    exit_code = 5


class FileFormatError(GcsError):
    """A plan, mission or log file cannot be read as what it claims to be."""

    exit_code = 6


class LinkError(GcsError):
    """The connection itself: a port in use, a host that cannot be reached."""

    exit_code = 7


class PeerError(GcsError):
    """The vehicle at the other end: silent, refusing, or breaking the protocol."""

    exit_code = 8


class PeerTimeout(PeerError):
    """The vehicle did not answer in time."""


class PeerRefusal(PeerError):
    """The vehicle answered no."""


class ProtocolMisuse(GcsError):
    """This program used a protocol machine out of turn: a bug of ours, never the peer's."""

    exit_code = 70


class FlightError(GcsError):
    """The flight was aborted: a vehicle lost, a separation broken, the stream stalled."""

    exit_code = 9


class JudgementError(GcsError):
    """The flight ended, and did not hold what the scenario asks of it."""

    exit_code = 10
