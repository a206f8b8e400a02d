"""Where a flight stands, and when what happened: plain values that everybody about a flight shares.

Knows: names and instants. Does not know: how anything comes about.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Protocol


class Step(StrEnum):
    """Where a flight stands."""

    UPLOAD = "upload and read back"
    READY = "waiting for readiness"
    TAKEOFF = "take-off"
    FLY = "flying"
    LAND = "landing"
    DONE = "landed"


@dataclass(frozen=True)
class FlightTimes:
    """When things happened, in the vehicles' common GNSS time."""

    airborne_unix_s: float  # all hover over their pads
    t0_unix_s: float  # plan time 0
    landing_unix_s: float  # told to land


@dataclass(frozen=True)
class Snapshot:
    """The flight at one moment, for people."""

    phase: str
    progress: float  # of the whole flight, 0..1
    plan_time_s: float | None
    errors_m: dict[int, float]
    link_age_s: dict[int, float]
    armed: dict[int, bool]
    separation_m: float
    formation_error_m: float  # Definition 1: how far the shape is off, wherever it flies


@dataclass(frozen=True)
class Event:
    """One line: at an instant something happened to a vehicle, or it was told something, by a rule."""

    unix_s: float  # GNSS time
    t_s: float  # plan time
    sysid: int
    what: str
    rule: str = ""

    def __str__(self) -> str:
        return f"t = {self.t_s:.1f} s: vehicle {self.sysid} {self.what}. {self.rule}".rstrip(". ")


if TYPE_CHECKING:
    from gcs.flight.setup.preflight import PreflightCheck


class InFlight(Protocol):
    """A flight, as far as people watch it."""

    def snapshot(self) -> Snapshot:
        """How it stands now."""
        ...


class Watcher:
    """Hears everything and says nothing."""

    @property
    def laps_s(self) -> dict[str, float]:
        """Where the time went, for the report."""
        return {}

    def say(self, text: str) -> None:
        """One line for people."""

    def warn(self, text: str) -> None:
        """One warning."""
        self.say(f"WARNING: {text}")

    def lap(self, name: str) -> None:
        """This part of the work is done."""

    def checks(self, checks: tuple[PreflightCheck, ...]) -> None:
        """What the pre-flight found, good or not."""

    async def confirm(self) -> None:
        """All vehicles on a link are fit to fly: may they be armed? Raises `UsageError` for a no."""

    async def follow(self, flight: InFlight) -> None:
        """Runs beside the flight until it is cancelled: `flight.snapshot()` tells how it goes."""
