"""One criterion of a flight: the measured value against its limit, and what the measurement leaves open."""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

import numpy as np

from gcs.types import Array

GRID_S = 0.05


class FlightOutcome(StrEnum):
    """What is known about a criterion, or about all of a flight."""

    OK = "ok"
    FAILED = "failed"
    UNKNOWN = "not known"


class CriterionName(StrEnum):
    """What is judged, and its definition. Positions are true ones, times are plan times."""

    POSITION_RMS = (
        "position error (RMS)",
        "distance of the true position from the planned position of the same instant; root of the mean of its squares, "
        f"every {GRID_S:g} s from T0 to the planned arrival; the worst vehicle",
    )
    CLEARANCE = (
        "clearance above ground",
        f"distance to the exact ground in any direction, every {GRID_S:g} s from the hover after take-off to the order "
        "to land",
    )
    ZONES = (
        "outside no-fly zones",
        "horizontal distance to the nearest no-fly zone, negative inside; from the pads to the last stop",
    )
    KEEP_IN = (
        "inside keep-in areas",
        "horizontal distance to the edge of the nearest keep-in area, negative outside; from the pads to the last stop",
    )
    FENCE = (
        "inside the fence",
        "horizontal distance to the edge of the fence, negative outside; from the pads to the last stop",
    )
    HEIGHT = "height", f"height above the origin, every {GRID_S:g} s from the hover after take-off to the order to land"
    ROUTE_POINTS = (
        "route points",
        "least distance of a vehicle from its place at a route point, within 3 s, or `judge.arrival_time_s` where that "
        "is more, of the planned time; the worst vehicle and point",
    )
    ARRIVAL_POSITION = "arrival position", "distance from the vehicle's goal at the planned arrival"
    ARRIVAL_TIME = (
        "arrival time",
        "when the vehicle comes into the circle of `judge.arrival_position_m` around its goal to stay, against the "
        "plan's own entry; early or late. The circle is smaller where the plan waits at its edge",
    )
    SEPARATION = "separation", "distance of the centres of two vehicles, from T0 to the order to land"
    GROUND_SEPARATION = "separation near ground", "the same before T0 and after the order to land"

    definition: str

    def __new__(cls, words: str, definition: str) -> Self:
        """The member of these words."""
        one = str.__new__(cls, words)
        one._value_, one.definition = words, definition
        return one


@dataclass(frozen=True)
class Criterion:
    """One criterion. Of reported states the true value is between `lowest` and `highest`; of true states it is `value`.

    A criterion is decided where both ends of that range are on one side of the limit.
    """

    name: CriterionName
    unit: str
    value: float
    limit: float
    at_least: bool  # value >= limit, else value <= limit
    sysid: int | None = None
    t_s: float | None = None
    other: int | None = None  # of a pair: its second vehicle
    planned: float | None = None  # the scenario's limit for the plan, where the flight's is another
    lowest: float | None = None
    highest: float | None = None

    @property
    def vehicles(self) -> str:
        """The vehicles of the measured value in words; empty for a value of all."""
        if self.sysid is None:
            return ""
        return f"vehicle {self.sysid}" if self.other is None else f"vehicles {self.sysid}, {self.other}"

    @property
    def within(self) -> float:
        """How far the true value may be from the measured one."""
        low = self.value if self.lowest is None else self.lowest
        high = self.value if self.highest is None else self.highest
        return max(self.value - low, high - self.value)

    @property
    def outcome(self) -> FlightOutcome:
        """Whether the true value is within its limit, as far as the measurement tells."""
        low = self.value if self.lowest is None else self.lowest
        high = self.value if self.highest is None else self.highest
        if low >= self.limit if self.at_least else high <= self.limit:
            return FlightOutcome.OK
        failed = high < self.limit if self.at_least else low > self.limit
        return FlightOutcome.FAILED if failed else FlightOutcome.UNKNOWN

    @property
    def ok(self) -> bool:
        """Whether the value is known to be within its limit."""
        return self.outcome is FlightOutcome.OK

    @property
    def verdict(self) -> str:
        """The outcome in words: "ok", "FAILED", "not known within ±0.4 m"."""
        if self.outcome is FlightOutcome.UNKNOWN:
            return f"not known within ±{self.within:.2g} {self.unit}" if math.isfinite(self.within) else "not known"
        return "ok" if self.ok else "FAILED"


@dataclass(frozen=True)
class Figures:
    """Metres (V, N) of all vehicles at times (N,), each known to `within_m`; infinite for one that is not heard."""

    sysids: tuple[int, ...]
    t_s: Array
    metres: Array
    within_m: Array

    def at_least(self, name: CriterionName, limit: float, planned: float | None = None) -> Criterion:
        """The least of all, which must not be below the limit."""
        return self._criterion(name, limit, planned, at_least=True)

    def at_most(self, name: CriterionName, limit: float, planned: float | None = None) -> Criterion:
        """The greatest of all, which must not be above the limit."""
        return self._criterion(name, limit, planned, at_least=False)

    def _criterion(self, name: CriterionName, limit: float, planned: float | None, *, at_least: bool) -> Criterion:
        worst, none = (np.min, np.inf) if at_least else (np.max, -np.inf)
        heard = np.isfinite(np.broadcast_to(self.within_m, self.metres.shape))
        told = np.where(heard, self.metres, none) if heard.any() else self.metres
        row, instant = np.unravel_index(int((np.argmin if at_least else np.argmax)(told)), told.shape)
        return Criterion(
            name,
            "m",
            float(told[row, instant]),
            limit,
            at_least,
            self.sysids[row],
            float(self.t_s[instant]),
            planned=planned,
            lowest=float(worst(self.metres - self.within_m)),
            highest=float(worst(self.metres + self.within_m)),
        )
