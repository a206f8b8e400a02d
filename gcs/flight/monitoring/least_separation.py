"""The least separation so far, from telemetry: at instants between reports of both vehicles, never ahead of either.

A report that is extrapolated by 2 s may be metres off for a vehicle that turns or brakes meanwhile. Between two reports
positions and velocities are known at both ends, and the cubic through them is off by centimetres.
"""

from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np
from scipy.spatial.distance import pdist

from gcs.flight.monitoring.progress import FlightPart, NearestPair
from gcs.types import Array

_HEARD_S = 2.0  # reports farther apart do not tell what was between them
_KEPT_S = 2.0 * _HEARD_S
_STEP_S = 0.1


class _Report(NamedTuple):
    unix_s: float
    position_ned_m: Array
    velocity_ned_mps: Array


class LeastSeparation:
    """Reports in, the nearest two vehicles of each part of the flight out."""

    def __init__(self) -> None:
        self.nearest: dict[FlightPart, NearestPair] = {}
        self._reports: dict[int, deque[_Report]] = {}
        self._until_s = -np.inf

    def receive(self, sysid: int, unix_s: float, position_ned_m: Array, velocity_ned_mps: Array) -> None:
        """Take in a report of a vehicle, in the common frame."""
        reports = self._reports.setdefault(sysid, deque())
        if reports and unix_s <= reports[-1].unix_s:  # its clock was corrected, or began anew
            reports.clear()
        reports.append(_Report(unix_s, position_ned_m, velocity_ned_mps))
        while unix_s - reports[0].unix_s > _KEPT_S:
            reports.popleft()

    def look(
        self, aloft: Collection[int], part_at: Callable[[float], FlightPart], standing_ned_m: Mapping[int, Array]
    ) -> None:
        """Note the nearest two of the vehicles `aloft` since the last call.

        `part_at` tells the part of the flight at a time. In the take-off the errors `standing_ned_m` (3,) that vehicles
        report on their pads are subtracted.
        """
        known = {sysid: self._reports[sysid] for sysid in aloft if self._reports.get(sysid)}
        newest_s = max((reports[-1].unix_s for reports in known.values()), default=-np.inf)
        heard = {sysid: reports for sysid, reports in known.items() if newest_s - reports[-1].unix_s < _HEARD_S}
        if len(heard) < 2:
            return
        until_s = min(reports[-1].unix_s for reports in heard.values())
        since_s = (
            until_s if self._until_s > until_s or np.isinf(self._until_s) else max(self._until_s, until_s - _KEPT_S)
        )
        self._until_s = until_s
        for unix_s in until_s - _STEP_S * np.arange(int((until_s - since_s) / _STEP_S), -1, -1):
            part = part_at(unix_s)
            at = {sysid: place for sysid, reports in heard.items() if (place := _place(reports, unix_s)) is not None}
            if part is FlightPart.TAKEOFF:
                at = {sysid: place - standing_ned_m.get(sysid, 0.0) for sysid, place in at.items()}
            if len(at) > 1:
                self._note(part, float(unix_s), at)

    def _note(self, part: FlightPart, unix_s: float, at: Mapping[int, Array]) -> None:
        between_m, ids = pdist(np.array(list(at.values()))), tuple(at)
        least = int(np.argmin(between_m))
        if part not in self.nearest or between_m[least] < self.nearest[part].distance_m:
            first, second = (int(rows[least]) for rows in np.triu_indices(len(ids), 1))
            self.nearest[part] = NearestPair(part, (ids[first], ids[second]), float(between_m[least]), unix_s)


def _place(reports: Sequence[_Report], unix_s: float) -> Array | None:
    """The position (3,) of a vehicle at a time between two of its reports; None if they are too far apart."""
    if reports[-1].unix_s == unix_s:
        return reports[-1].position_ned_m
    for before, after in zip(islice(reversed(reports), 1, None), reversed(reports), strict=False):
        apart_s = after.unix_s - before.unix_s
        if before.unix_s <= unix_s <= after.unix_s:
            if apart_s >= _HEARD_S:
                return None
            x = (unix_s - before.unix_s) / apart_s
            left, right = (1.0 - x) ** 2, x**2
            moved = left * x * before.velocity_ned_mps - right * (1.0 - x) * after.velocity_ned_mps
            shares = left * (1.0 + 2.0 * x) * before.position_ned_m + right * (3.0 - 2.0 * x) * after.position_ned_m
            return np.asarray(shares + apart_s * moved)
    return None
