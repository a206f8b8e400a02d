"""Which vehicles of a large fleet the live view shows: the worst of each column, as many as the screen has lines."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from gcs.flight.progress import VehicleNow

_KEPT = 12  # redraws for which a choice stands, so that it can be read
# The least is the worst; what is not known comes last.
_COLUMNS: tuple[Callable[[VehicleNow], float], ...] = (
    lambda v: -v.link_age_s,
    lambda v: v.zone_m,
    lambda v: v.above_ground_m,
    lambda v: -v.error_m,
    lambda v: v.battery_pct,
    lambda v: v.fence_m,
    lambda v: v.ceiling_m,
)


class ShownVehicles:
    """Chooses the rows, and keeps the choice for a few redraws."""

    def __init__(self) -> None:
        self._chosen: frozenset[int] = frozenset()
        self._left = 0

    def choose(self, vehicles: Sequence[VehicleNow], most: int) -> tuple[VehicleNow, ...]:
        """Return all vehicles if at most `most`, else the worst of each column in turn; in the order given."""
        if len(vehicles) <= most:
            return tuple(vehicles)
        self._left -= 1
        if self._left <= 0 or len(self._chosen) != most:
            self._chosen, self._left = worst_of_each_column(vehicles, most), _KEPT
        return tuple(v for v in vehicles if v.sysid in self._chosen)


def worst_of_each_column(vehicles: Sequence[VehicleNow], most: int) -> frozenset[int]:
    """Return the system ids of `most` vehicles: the worst of each column, then the second of each, and so on."""
    orders = [_worst_first(vehicles, figure) for figure in _COLUMNS]
    chosen: dict[int, None] = {}
    for rank in zip(*orders, strict=True):
        for vehicle in rank:
            if len(chosen) < most:
                chosen[vehicle.sysid] = None
    return frozenset(chosen)


def _worst_first(vehicles: Sequence[VehicleNow], figure: Callable[[VehicleNow], float]) -> list[VehicleNow]:
    def key(vehicle: VehicleNow) -> float:
        value = figure(vehicle)
        return math.inf if math.isnan(value) else value

    return sorted(vehicles, key=key)
