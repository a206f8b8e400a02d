"""One criterion of a flight: the measured value against its limit."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Criterion:
    """One criterion: the measured value against its limit."""

    name: str
    unit: str
    value: float
    limit: float
    at_least: bool  # value >= limit, else value <= limit
    sysid: int | None = None
    t_s: float | None = None
    other: int | None = None  # of a pair: its second vehicle
    planned: float | None = None  # the scenario's limit for the plan, where the flight's is another

    @property
    def vehicles(self) -> str:
        """The vehicles of the measured value in words; empty for a value of all."""
        if self.sysid is None:
            return ""
        return f"vehicle {self.sysid}" if self.other is None else f"vehicles {self.sysid}, {self.other}"

    @property
    def ok(self) -> bool:
        """Whether the value is within its limit."""
        return bool(self.value >= self.limit if self.at_least else self.value <= self.limit)
