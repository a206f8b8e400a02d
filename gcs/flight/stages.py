"""Where a flight stands, and when what happened: plain values that everybody about a flight shares.

Knows: names and instants. Does not know: how anything comes about.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


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
