"""Items that no vehicle reaches, and what happened to their numbers: exchanged, or without their sign."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from gcs.autopilots.mission_commands import known_position
from gcs.frames import from_degE7, to_degE7
from gcs.mission.check.findings import Finding, Level, Rule
from gcs.mission.check.item_checks import found
from gcs.mission.formats.mission_file import MissionFile

FAR_M = 100_000.0  # no quadrotor flies so far
_EARTH_M = 6_371_000.0
Degrees = tuple[int, int]  # latitude, longitude, degE7
# How two numbers, written as they are here, become latitude and longitude.
_QUESTIONS: tuple[tuple[str, Callable[[int, int], Degrees]], ...] = (
    ("swapped latitude and longitude?", lambda lat, lon: (lon, lat)),
    ("has the latitude lost its sign?", lambda lat, lon: (-lat, lon)),
    ("has the longitude lost its sign?", lambda lat, lon: (lat, -lon)),
    ("have both lost their signs?", lambda lat, lon: (-lat, -lon)),
    ("swapped latitude and longitude, without a sign?", lambda lat, lon: (lon, -lat)),
    ("swapped latitude and longitude, without a sign?", lambda lat, lon: (-lon, lat)),
)


def check_places(mission: MissionFile) -> tuple[MissionFile, list[Finding]]:
    """The mission without its far places, and an error for each.

    An item that is too far from the one before it to be meant so stays at the place of that one.
    """
    last: tuple[int, int] | None = None
    name = "the item before it"
    if mission.home is not None:
        last, name = (to_degE7(mission.home.lat_deg), to_degE7(mission.home.lon_deg)), "home"
    items, findings = [], []
    for index, item in enumerate(mission.items):
        place = (item.lat_degE7, item.lon_degE7)
        if not known_position(item.command) or not any(place):
            items.append(item)
        elif last is None or _apart_m(place, last) <= FAR_M:
            last, name = place, "the item before it"
            items.append(item)
        else:
            items.append(replace(item, lat_degE7=last[0], lon_degE7=last[1]))
            meant = next((text for text, turn in _QUESTIONS if _apart_m(turn(*place), last) <= FAR_M), "")
            it = f"{meant} It" if meant else "this place"
            message = f"{it} is {_apart_m(place, last) / 1000.0:,.0f} km from {name}; the check leaves it out"
            findings.append(found(mission, Rule.PLACE, Level.ERROR, message, index))
    return (replace(mission, items=tuple(items)) if findings else mission), findings


def _apart_m(first: Degrees, second: Degrees) -> float:
    """The distance of two places on a sphere."""
    (lat_a, lon_a), (lat_b, lon_b) = ((math.radians(from_degE7(value)) for value in place) for place in (first, second))
    half_lat, half_lon = 0.5 * (lat_b - lat_a), 0.5 * (lon_b - lon_a)
    share = math.sin(half_lat) ** 2 + math.cos(lat_a) * math.cos(lat_b) * math.sin(half_lon) ** 2
    return 2.0 * _EARTH_M * math.asin(min(math.sqrt(share), 1.0))
