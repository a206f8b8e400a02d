"""Volumes in space and time for authorities and service suppliers, whatever the format of their file."""

from dataclasses import dataclass
from datetime import datetime


@dataclass(frozen=True)
class FlightVolume:
    """A polygon between two heights above the WGS-84 ellipsoid, from one instant (UTC) to another."""

    corners_deg: tuple[tuple[float, float], ...]  # latitude, longitude, in order, the first one once
    lower_w84_m: float
    upper_w84_m: float
    start: datetime
    end: datetime


@dataclass(frozen=True)
class OperationalIntent:
    """The volumes of a flight, in order of time."""

    volumes: tuple[FlightVolume, ...]
