"""Which rows `[[on]]` of a scenario are due: a machine without clocks; times are arguments.

A row is due once. A low battery or a strong wind must be reported for `HOLDS_S`: one report alone may err. A time that
had passed when the watch began is not due: a flight that is taken up again has answered it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from gcs.scenario.schema.scenario import EventTable

HOLDS_S = 2.0
AGAIN_S = 5.0  # after a refusal a row is due again
ATTEMPTS = 3
_FIRST_LOOK_S = 1.0  # after T0 at the latest


@dataclass(frozen=True)
class Observed:
    """What one vehicle reports; NaN for what it does not."""

    sysid: int
    battery_pct: float
    wind_mps: float
    silent_s: float


@dataclass(frozen=True)
class DueEvent:
    """A row whose event has happened; `why` says it in words."""

    row: int  # the first is 0
    why: str


class EventWatch:
    """The rows of one flight, between T0 and the landing."""

    def __init__(self, rows: Sequence[EventTable]) -> None:
        self._rows = rows
        self._since_s = [math.inf] * len(rows)  # when each condition was first seen true
        self._left = [ATTEMPTS] * len(rows)
        self._not_before_s = [-math.inf] * len(rows)
        self._began_s = math.nan  # plan time

    def due(self, now_s: float, plan_s: float, vehicles: Collection[Observed]) -> list[DueEvent]:
        """Return the rows that are due at `now_s` (any steady time), plan time `plan_s`. Each is due once."""
        found = []
        if math.isnan(self._began_s) and math.isfinite(plan_s):
            self._began_s = plan_s
        for number, row in enumerate(self._rows):
            if row.at_s is not None and row.at_s < self._began_s - _FIRST_LOOK_S:
                continue
            why, holds_s = _happened(row, plan_s, vehicles)
            self._since_s[number] = min(self._since_s[number], now_s) if why else math.inf
            if not why or not self._left[number] or now_s < self._not_before_s[number]:
                continue
            if now_s - self._since_s[number] >= holds_s:
                self._left[number] -= 1
                self._not_before_s[number] = math.inf
                found.append(DueEvent(number, why))
        return found

    def refused(self, row: int, now_s: float) -> bool:
        """Take in that the order of a row was refused; return whether it will be due again, while its event lasts."""
        self._not_before_s[row] = now_s + AGAIN_S
        return self._left[row] > 0


def _happened(row: EventTable, plan_s: float, vehicles: Collection[Observed]) -> tuple[str, float]:
    """The event of a row in words, empty where it did not happen, and for how long it must last."""
    for one in vehicles:
        if row.battery_below_percent is not None and one.battery_pct < row.battery_below_percent:
            return f"vehicle {one.sysid} has {one.battery_pct:.0f} % battery", HOLDS_S
        if row.wind_above_mps is not None and one.wind_mps > row.wind_above_mps:
            return f"vehicle {one.sysid} reports {one.wind_mps:.1f} m/s of wind", HOLDS_S
        if row.silent_for_s is not None and one.silent_s > row.silent_for_s:
            return f"vehicle {one.sysid} was not heard for {one.silent_s:.1f} s", 0.0
    if row.at_s is not None and plan_s >= row.at_s:
        return f"it is t = {row.at_s:g} s", 0.0
    return "", 0.0
