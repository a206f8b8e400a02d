"""Which flights of a campaign are with the workers, which are next, and whether enough have ended."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping

import numpy as np

from gcs.campaign.campaign_flight import HELD
from gcs.campaign.records import INDEX, INFRASTRUCTURE, OUTCOME, Row
from gcs.campaign.statistics import flights_needed

ATTEMPTS = 3  # of a flight that the machine fails; another one is for the next start of the campaign


class FlightWindow:
    """A window that rolls over the design: in order, as many flights are submitted as the workers have room for."""

    def __init__(self, left: Iterable[Row], results: Iterable[Row] = (), until: float | None = None) -> None:
        """`left` are the rows of the design to fly, `results` those known.

        The campaign ends when the interval of the pass rate is no wider than `until`.
        """
        self._queue = deque(left)
        self._attempts: dict[int, int] = {}
        self._out: dict[int, Row] = {}
        self._until = until
        self._outcomes = {row[INDEX]: row[OUTCOME] for row in results}
        self._needed = self._enough()

    @property
    def is_over(self) -> bool:
        """Whether nothing is left to wait for: all have ended, or enough."""
        return self._needed is not None or not (self._out or self._queue)

    def next(self, room: int) -> list[Row]:
        """Return the flights to submit now, so that `room` are with the workers."""
        found: list[Row] = []
        while self._needed is None and self._queue and len(self._out) < room:
            row = self._queue.popleft()
            self._out[row[INDEX]] = row
            found.append(row)
        return found

    def ended(self, result: Row) -> int | None:
        """Count a result; return how many attempts it took, or None if the flight is to be flown once more."""
        index = result[INDEX]
        row = self._out.pop(index)
        attempts = self._attempts[index] = self._attempts.get(index, 0) + 1
        if result[OUTCOME] == INFRASTRUCTURE and attempts < ATTEMPTS:
            self._queue.appendleft(row)
            return None
        self._outcomes[index] = result[OUTCOME]
        self._needed = self._enough()
        return attempts

    def _enough(self) -> int | None:
        return None if self._until is None else flights_counted(self._outcomes, self._until)


def flights_counted(outcomes: Mapping[int, str], until: float) -> int | None:
    """Return the index behind the last flight that counts: there the interval of the pass rate is `until` wide.

    Only flights in the order of the design count, up to the first one that has not ended; None if they do not suffice.
    """
    held: list[int] = []
    places: list[int] = []
    for index in range(len(outcomes)):
        if index not in outcomes:
            break
        if outcomes[index] != INFRASTRUCTURE:
            held.append(int(outcomes[index] == HELD))
            places.append(index)
    needed = flights_needed(np.array(held, dtype=np.float64), until) if held else None
    return None if needed is None else places[needed - 1] + 1
