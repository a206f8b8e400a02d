"""Missions for tests, made from metres around one home."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from gcs.autopilots.traits import Autopilot
from gcs.frames import Origin, ned_to_geodetic, to_degE7
from gcs.mission.flight_limits import Surroundings
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.geofence import NO_FENCE, Geofence, GeoPoint, RallyPoint
from gcs.mission.model import Home, MissionItem

ORIGIN = Origin(47.4, 8.5, 500.0)
FLAT = Surroundings(ORIGIN, lambda north, east: 0.0 * north)  # type: ignore[operator]
UNKNOWN = Surroundings(ORIGIN)


def place(north_m: float, east_m: float) -> GeoPoint:
    lat, lon, _ = ned_to_geodetic(np.array([north_m, east_m, 0.0]), ORIGIN)
    return GeoPoint(to_degE7(float(lat)), to_degE7(float(lon)))


def at(command: int, north_m: float, east_m: float, up_m: float, *, p1: float = 0.0, frame: int = 3) -> MissionItem:
    """An item with a place, `up_m` in its frame."""
    where = place(north_m, east_m)
    return MissionItem(command, frame, (p1, 0.0, 0.0, 0.0), where.lat_degE7, where.lon_degE7, up_m)


def do(command: int, p1: float = 0.0, p2: float = 0.0, p3: float = 0.0, p4: float = 0.0) -> MissionItem:
    """An item without a place."""
    return MissionItem(command, 2, (p1, p2, p3, p4), 0, 0, 0.0)


def speed(mps: float) -> MissionItem:
    return do(178, 1.0, mps, -1.0)


def mission(
    items: Iterable[MissionItem],
    *,
    name: str = "a.plan",
    firmware: Autopilot = Autopilot.ARDUPILOT,
    home: tuple[float, float, float] = (0.0, 0.0, 0.0),
    geofence: Geofence = NO_FENCE,
    rally: tuple[RallyPoint, ...] = (),
    home_known: bool = True,
) -> MissionFile:
    """A mission whose home is (north, east, up)."""
    lat, lon, alt = ned_to_geodetic(np.array(home) * [1, 1, -1], ORIGIN)
    known = Home(float(lat), float(lon), float(alt)) if home_known else None
    return MissionFile(name, firmware, known, tuple(items), geofence, rally)


def out_and_land(north_m: float, east_m: float = 0.0, up_m: float = 10.0, mps: float = 5.0) -> tuple[MissionItem, ...]:
    """Up over home, straight to a place, and down there."""
    return (
        at(22, 0.0, 0.0, up_m),
        speed(mps),
        at(16, north_m, east_m, up_m),
        at(21, north_m, east_m, 0.0),
    )
