"""Stalls of this program itself: it was stopped, swapped out, or its machine slept. Time is an argument.

What arrives is read late after a stall, and much of it is lost. So the silence of others counts in running time, which
stands still while the program does.
"""

from __future__ import annotations

STALL_S = 0.5  # between two notes; a longer gap is a stall
NOTE_EVERY_S = 0.1  # how often the owner has to call `note`


class OwnStalls:
    """Finds the gaps between the notes of an event loop, which come `NOTE_EVERY_S` apart or sooner."""

    def __init__(self, now_s: float) -> None:
        self._not_running_s = 0.0  # of all stalls that have ended
        self._noted_s = now_s

    def note(self, now_s: float) -> float:
        """Record that the program runs. Return the length of the stall that ended with this note, else 0."""
        gap_s = now_s - self._noted_s
        self._not_running_s += max(gap_s - STALL_S, 0.0)
        self._noted_s = max(self._noted_s, now_s)
        return gap_s if gap_s > STALL_S else 0.0

    def running_s(self, now_s: float) -> float:
        """Return `now_s` without the stalls until then: the clock that the silence of others is measured with.

        It never runs back: the first `STALL_S` of a stall count.
        """
        return now_s - self._not_running_s - max(now_s - self._noted_s - STALL_S, 0.0)
