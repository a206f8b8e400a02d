"""One criterion of a flight: the measured value against its limit, and what the measurement leaves open."""

import math
from dataclasses import dataclass
from enum import StrEnum


class FlightOutcome(StrEnum):
    """What is known about a criterion, or about all of a flight."""

    OK = "ok"
    FAILED = "failed"
    UNKNOWN = "not known"


@dataclass(frozen=True)
class Criterion:
    """One criterion. Of reported states the true value is between `lowest` and `highest`; of true states it is `value`.

    A criterion is decided where both ends of that range are on one side of the limit.
    """

    name: str
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
