"""The heights and times of geozones as those of no-fly zones; in doubt the zone is higher, lower and longer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property

from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.geozones import FT_M, ZoneLimit, ZonePeriod, ZoneVolume
from gcs.scenario.values.navigation_error import navigation_error

GEOID_M = (-110.0, 90.0)  # of mean sea level above the ellipsoid, anywhere (EGM2008: -107 m to 86 m)
_FARTHEST_M, _FARTHEST_S = 10_000.0, 20_000.0  # what a no-fly zone can have
_REFERENCES = ("AMSL", "WGS84", "AGL")
_WAIT_S = 600.0  # before and after the planned flight, for waits and slow landings

Range = tuple[float, float]


@dataclass(frozen=True)
class Reach:
    """Which heights and times a flight may have, and what the limits of a file may mean there."""

    scenario: Scenario
    flown: tuple[datetime, datetime] | None = None
    geoid_m: Range = GEOID_M  # least and most

    @property
    def top_m(self) -> float:
        """The greatest height of a vehicle, with its navigation error."""
        return self.scenario.limits.height_m[1] + navigation_error(self.scenario).vertical_m

    def is_beyond(self, height_m: Range | None, in_force_s: Range | None) -> str:
        """Why no vehicle of the planned flight meets a zone of these heights and times; empty where one may."""
        if height_m is not None and height_m[0] > self.top_m:
            return f"above all heights of the box ({self.top_m:g} m with the navigation error)"
        first_s, last_s = self._flight_s
        if in_force_s is not None and (in_force_s[1] < first_s - _WAIT_S or in_force_s[0] > last_s + _WAIT_S):
            return "not in force during the flight"
        return ""

    def heights_m(self, volume: ZoneVolume) -> tuple[Range | None, set[str]]:
        """The heights of a volume above height 0, None without limits, and the doubts about them."""
        ends = (("lower", volume.lower), ("upper", volume.upper))
        unknown = [which for which, end in ends if end is not None and end.reference not in _REFERENCES]
        why = {f"its {which} limit has no known reference, and does not count" for which in unknown}
        if volume.unit_m is None and not volume.lower is volume.upper is None:
            why.add("its limits have no known unit: the lower one is taken in feet, the upper one in metres")
        low_m = self._end_m(volume.lower, volume.unit_m, upper=False)
        high_m = self._end_m(volume.upper, volume.unit_m, upper=True)
        if high_m <= low_m:
            why.add("its upper limit is not above the lower one: neither counts")
            return None, why
        low_m, high_m = max(low_m, -_FARTHEST_M), min(high_m, _FARTHEST_M)
        if low_m >= _FARTHEST_M or high_m <= -_FARTHEST_M:
            why.add("its limits are at no height of a flight: they do not count")
            return None, why
        return None if (low_m, high_m) == (-_FARTHEST_M, _FARTHEST_M) else (low_m, high_m), why

    def in_force_s(self, periods: Sequence[ZonePeriod]) -> Range | None:
        """From when until when, in plan time, one of these periods may hold; None for all of the flight.

        The plan may begin at any instant at which it ends in `flown`.
        """
        if self.flown is None or not periods:
            return None
        begin, end = self.flown
        time = self.scenario.time
        least_s = (time.earliest_s or 0.0) if time.free else time.flight_s
        spare_s = max((end - begin).total_seconds() - least_s, 0.0)
        starts = [-_FARTHEST_S if p.start is None else (p.start - begin).total_seconds() - spare_s for p in periods]
        ends = [_FARTHEST_S if p.end is None else (p.end - begin).total_seconds() for p in periods]
        from_s, until_s = max(min(starts), -_FARTHEST_S), min(max(ends), _FARTHEST_S)
        first_s, last_s = self._flight_s
        whole = from_s <= first_s - _WAIT_S and until_s >= last_s + _WAIT_S
        return None if whole or until_s <= from_s else (from_s, until_s)

    @property
    def _flight_s(self) -> Range:
        ground, time = self.scenario.ground_phases, self.scenario.time
        before_s = ground.run_up_s + ground.takeoff_s + ground.hover_s
        flight_s = max(time.flight_s, time.latest_s or 0.0)
        return -before_s, flight_s + ground.hover_s + (ground.landing_s or 0.0)

    def _end_m(self, limit: ZoneLimit | None, unit_m: float | None, *, upper: bool) -> float:
        """One limit above height 0: the lower end at the lowest that it may mean, the upper end at the highest."""
        unknown_m = _FARTHEST_M if upper else -_FARTHEST_M
        if limit is None:
            return unknown_m
        if unit_m is None:
            unit_m = 1.0 if (limit.value > 0.0) == upper else FT_M
        value_m, altitude_m = limit.value * unit_m, self.scenario.origin.alt_amsl_m
        if limit.reference == "AMSL":
            return value_m - altitude_m
        if limit.reference == "WGS84":
            return value_m - altitude_m - self.geoid_m[0 if upper else 1]
        if limit.reference == "AGL":
            # Nobody flies below the ground.
            return value_m + self._ground_m[1] if upper else value_m + self._ground_m[0] if value_m > 0.0 else unknown_m
        return unknown_m

    @cached_property
    def _ground_m(self) -> Range:
        """Heights that no ground under the flight is below or above."""
        terrain = self.scenario.terrain
        if terrain.relief is not None:
            return float(terrain.relief.pixels_m.min()), float(terrain.relief.pixels_m.max())
        rows = [row[0] for row in terrain.mountains.rows]
        # Each is nowhere below its summit and 0, nor above them.
        low_m, high_m = sum(min(0.0, top_m) for top_m in rows), sum(max(0.0, top_m) for top_m in rows)
        if terrain.ripple is None:
            return low_m, high_m
        wave = terrain.ripple
        most_m = 1.0 + sum(abs(part) for part in (wave.b, wave.c, wave.e, wave.f))
        return 0.0, max(high_m, most_m)  # Eq. 52 is an absolute value


def heights_in_words(volumes: Sequence[ZoneVolume], found: Sequence[Range | None]) -> str:
    """The heights of a zone in its file, and those that are used, in words."""
    ranges = dict.fromkeys(f"{_limit_text(one.lower, one)} to {_limit_text(one.upper, one)}" for one in volumes)
    return f"taken as {', '.join(map(_range_text, dict.fromkeys(found)))} (file: {', '.join(ranges)})"


def _range_text(height_m: Range | None) -> str:
    if height_m is None:
        return "without limits in height"
    low, high = (
        "" if abs(end) >= _FARTHEST_M else f" {word} {end:.2f} m"
        for word, end in zip(("from", "to"), height_m, strict=True)
    )
    return f"heights{low}{high}"


def _limit_text(limit: ZoneLimit | None, volume: ZoneVolume) -> str:
    unit = {None: " without a unit", 1.0: " m", FT_M: " ft"}[volume.unit_m]
    return "no limit" if limit is None else f"{limit.value:g}{unit} {limit.reference or 'without a reference'}"
