"""The geozones of a file as no-fly zones of a scenario. What a file leaves in doubt is decided for the larger zone.

A geozone without effect on a flight is left out: one beside the box, one whose periods do not meet the flight, one that
restricts nothing, and one that the operator may enter. One above the box is kept for proofs of other flights alone.
All others have the heights of the file and the times at which they may hold. Every decision is a sentence.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np
import shapely

from gcs.errors import FileFormatError
from gcs.frames import place_up_m, unwrapped_deg
from gcs.scenario.schema.mistake import Mistake
from gcs.scenario.schema.places import CORNERS_MAX, NoFlyZone
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.schema.toml_lines import Table
from gcs.scenario.sources.geozone_limits import GEOID_M, Range, Reach, heights_in_words
from gcs.scenario.sources.geozones import (
    Corner,
    Geozone,
    ZonePeriod,
    ZoneVolume,
    read_geozones,
    utc_of,
)
from gcs.scenario.values.si import ground_needed, local_origin

_FREE = "NO_RESTRICTION"
_KNOWN = ("PROHIBITED", "REQ_AUTHORISATION", "REQ_AUTHORIZATION", "CONDITIONAL", "USPACE")
_BEYOND_BOX_M = 200.0  # around the box and the pads: a zone beyond has no effect
_KEPT_BESIDE_M = 1000.0  # around them: what of a zone is farther away is cut off
_STEPS_MAX = 500_000  # of all edges of a polygon
_BOW_M = 0.01  # by which two meanings of a straight edge may differ
_EARTH_M = 6_371_000.0
_SIMPLER_M = (0.5, 2.0, 5.0, 20.0)
_ZONES_MAX = 256
_KEY_OF_VALUE = 3


@dataclass(frozen=True)
class _Asked:
    """What is asked of the zones of one file."""

    scenario: Scenario
    flown: tuple[datetime, datetime] | None
    permitted: frozenset[str]
    reach: Reach
    needed: shapely.Polygon  # where the flight may be (north, east), m


def with_geozones(scenario: Scenario, folder: Path) -> tuple[Scenario, list[Mistake], list[int]]:
    """The scenario with zones in place of files, or mistakes; and the number of the entry behind each zone."""
    zones: list[NoFlyZone] = []
    beyond: list[NoFlyZone] = []
    rows: list[int] = []
    notes: list[str] = []
    mistakes: list[Mistake] = []
    reach = Reach(scenario)
    for row, entry in enumerate((*scenario.no_fly, *scenario.no_fly_beyond)):
        if entry.file is None:
            why, was_beyond = reach.is_beyond(entry.height_m, entry.in_force_s), row >= len(scenario.no_fly)
            found = [] if why else [entry]
            beyond += [entry] if why else []
            if why and not was_beyond:
                notes.append(f"no_fly, entry {row + 1}: {why}; only gcs prove counts it")
            elif was_beyond and not why:
                notes.append(f"no-fly zone {len(zones) + 1}: now met by the box and the flight")
        else:
            try:
                found, more, said = _zones_of(entry, scenario, folder, first=len(zones) + 1)
            except _WrongKey as error:
                mistakes.append(Mistake(("no_fly", row, error.key), str(error), getattr(entry, error.key)))
                continue
            except FileFormatError as error:
                mistakes.append(Mistake(("no_fly", row, "file"), error.reason.rstrip("."), entry.file, error.hint))
                continue
            notes += said
            beyond += more
        zones += found
        rows += [row] * len(found)
    if len(zones) > _ZONES_MAX and not mistakes:
        text = f"with these, the scenario has {len(zones)} no-fly zones near its box; {_ZONES_MAX} are possible"
        mistakes.append(Mistake(("no_fly",), text, remedy="make the box smaller, or give flown_utc"))
    if mistakes:
        return scenario, mistakes, rows
    notes = [*scenario.geozones, *notes]
    changed = {"no_fly": tuple(zones), "no_fly_beyond": tuple(beyond), "geozones": tuple(notes)}
    return scenario.model_copy(update=changed), [], rows


def as_entry(mistake: Mistake, data: Table, rows: Sequence[int]) -> Mistake:
    """The mistake of a zone with the key of the entry that the file of the scenario has for it."""
    if mistake.key[:1] != ("no_fly",) or len(mistake.key) < _KEY_OF_VALUE or not isinstance(mistake.key[1], int):
        return mistake
    number = mistake.key[1]
    row = rows[number] if number < len(rows) else number
    entry = data["no_fly"][row] if row < len(data["no_fly"]) else None
    if not isinstance(entry, dict) or entry.get("file") is None:
        return replace(mistake, key=("no_fly", row, *mistake.key[2:]))
    if mistake.key[2] in ("file", *NoFlyZone.file_keys):
        return mistake
    text = f"no-fly zone {number + 1}, which is of this file, {mistake.text}"
    return replace(mistake, key=("no_fly", row, "file"), text=text, value=entry["file"])


class _WrongKey(ValueError):
    def __init__(self, key: str, text: str) -> None:
        super().__init__(text)
        self.key = key


def _zones_of(
    entry: NoFlyZone, scenario: Scenario, folder: Path, first: int
) -> tuple[list[NoFlyZone], list[NoFlyZone], list[str]]:
    """The zones of one file, those that the planned flight does not meet, and sentences about all of its geozones."""
    assert entry.file is not None
    asked = _asked(entry, scenario)
    geozones = read_geozones(folder / entry.file)
    unknown = asked.permitted - {one.identifier for one in geozones}
    if unknown:
        raise _WrongKey("permitted", f"the file has no zone {', '.join(sorted(unknown))}")
    zones: list[NoFlyZone] = []
    beyond: list[NoFlyZone] = []
    notes: list[str] = []
    left: dict[str, int] = {}
    name = Path(entry.file).name
    for geozone in geozones:
        if reason := _without_effect(geozone, asked):
            left[reason] = left.get(reason, 0) + 1
            continue
        kept, why, beside = [], set[str](), 0
        heights: list[Range | None] = []
        in_force_s = _in_force_s(geozone, asked)
        for volume in geozone.volumes:
            shapes, of_shape = _shapes(geozone, volume, asked)
            why |= of_shape
            beside += not shapes
            if not shapes:
                continue
            height_m, of_heights = asked.reach.heights_m(volume)
            why |= of_heights
            limits = {"height_m": height_m, "in_force_s": in_force_s}
            shapes = [shape.model_copy(update=limits) for shape in shapes]
            if above := asked.reach.is_beyond(height_m, None):
                reason = f"lower limit {above}, which only gcs prove counts"
                left[reason] = left.get(reason, 0) + 1
                beyond += shapes
                continue
            heights.append(height_m)
            kept += shapes
        if geozone.without_area:
            left["points and lines, which have no area"] = left.get("points and lines, which have no area", 0) + 1
        if not kept:
            left["beside the box"] = left.get("beside the box", 0) + bool(beside)
            continue
        numbers = first + len(zones), first + len(zones) + len(kept) - 1
        which = f"zone {numbers[0]}" if len(kept) == 1 else f"zones {numbers[0]} to {numbers[1]}"
        when = _when(geozone.periods, asked, in_force_s)
        what = geozone.restriction or "without a restriction"
        doubt = "" if geozone.restriction in _KNOWN else ", which counts as prohibited"
        how = heights_in_words(geozone.volumes, heights)
        text = f"no-fly {which}: {geozone.label} of {name}, {what}{doubt}, {when}, {how}"
        notes.append("; ".join([text, *sorted(why)]))
        zones += kept
    notes += [f"{name}: left out, {reason}: {count}" for reason, count in left.items() if count]
    return zones, beyond, notes


def _asked(entry: NoFlyZone, scenario: Scenario) -> _Asked:
    flown = None
    if entry.flown_utc is not None:
        try:
            start, end = map(utc_of, entry.flown_utc)
        except ValueError as error:
            raise _WrongKey("flown_utc", str(error)) from None
        if end <= start:
            raise _WrongKey("flown_utc", "ends before it begins")
        flown = start, end
    region = ground_needed(scenario)
    needed = shapely.box(region.north_m[0], region.east_m[0], region.north_m[1], region.east_m[1])
    geoid_m = GEOID_M if entry.geoid_m is None else (entry.geoid_m, entry.geoid_m)
    reach = Reach(scenario, flown, geoid_m)
    return _Asked(scenario, flown, frozenset(entry.permitted or ()), reach, needed)


def _without_effect(geozone: Geozone, asked: _Asked) -> str:
    """Why no volume of a zone has an effect on the flight; empty where one may have."""
    if geozone.restriction == _FREE:
        return "no restriction"
    if geozone.identifier and geozone.identifier in asked.permitted:
        return "permitted"
    if asked.flown and geozone.periods and not any(_meets(period, asked.flown) for period in geozone.periods):
        return "not in force while the plan may be flown"
    return ""


def _meets(period: ZonePeriod, flown: tuple[datetime, datetime]) -> bool:
    return (period.start is None or period.start <= flown[1]) and (period.end is None or period.end >= flown[0])


def _in_force_s(geozone: Geozone, asked: _Asked) -> Range | None:
    if asked.flown is None:
        return None
    return asked.reach.in_force_s([period for period in geozone.periods if _meets(period, asked.flown)])


def _when(periods: Sequence[ZonePeriod], asked: _Asked, in_force_s: Range | None) -> str:
    if asked.flown is None:
        return "at all times" if not periods else "at all times, because flown_utc is not given"
    scheduled = any(period.schedule and _meets(period, asked.flown) for period in periods)
    during = "" if in_force_s is None else f" from t = {in_force_s[0]:g} s to {in_force_s[1]:g} s of the plan, at most"
    return f"in force{during}" + (" at all hours, whatever its schedule says" if scheduled else "")


def _shapes(geozone: Geozone, volume: ZoneVolume, asked: _Asked) -> tuple[list[NoFlyZone], set[str]]:
    """The zones of a volume near the box, and how they differ from it."""
    why = set[str]()
    if volume.radius_m is not None:
        return _disk(geozone, volume.corners[0], volume.radius_m, asked), why
    shape = _straight(geozone.label, volume.corners, asked)
    near = asked.needed.buffer(_BEYOND_BOX_M, join_style="mitre")
    if not shape.intersects(near):
        swapped = tuple((lon, lat) for lat, lon in volume.corners)
        if all(abs(lat) <= 90.0 for lat, _ in swapped) and _straight(geozone.label, swapped, asked).intersects(near):
            _refuse_swapped(geozone)
        return [], why
    if not shape.is_valid:
        shape = shape.convex_hull
        why.add("its edge crosses itself: its convex hull counts")
    kept = shape.intersection(asked.needed.buffer(_KEPT_BESIDE_M, join_style="mitre"))
    found = []
    for part in shapely.get_parts(kept):
        if part.geom_type == "Polygon" and part.area > 0.0:
            filled, larger_m = _few_corners(geozone, shapely.Polygon(part.exterior))
            why |= {f"larger by up to {larger_m:g} m, to have fewer corners"} if larger_m else set()
            corners = tuple((float(n), float(e)) for n, e in filled.exterior.coords[:-1])
            found.append(NoFlyZone(polygon_m=corners))
    return found, why


def _disk(geozone: Geozone, centre: Corner, radius_m: float, asked: _Asked) -> list[NoFlyZone]:
    """A circle on Earth as a disk of the plane, whose distances differ by up to 4e-5 there."""
    reach_m = radius_m * 1.0001 + 0.01
    north_m, east_m = _plane(np.array([centre]), asked)[0].tolist()
    away_m = shapely.Point(north_m, east_m).distance(asked.needed)
    if away_m <= reach_m + _BEYOND_BOX_M:
        if max(abs(north_m), abs(east_m), reach_m) <= 1e5:
            return [NoFlyZone(north_m=north_m, east_m=east_m, radius_m=reach_m)]
        circle = shapely.Point(north_m, east_m).buffer(reach_m * 1.01, quad_segs=512)
        kept = circle.intersection(asked.needed.buffer(_KEPT_BESIDE_M, join_style="mitre"))
        corners = tuple((float(n), float(e)) for n, e in kept.exterior.coords[:-1])
        return [NoFlyZone(polygon_m=corners)]
    if abs(centre[1]) <= 90.0:
        other = shapely.Point(_plane(np.array([[centre[1], centre[0]]]), asked)[0])
        if other.distance(asked.needed) <= reach_m + _BEYOND_BOX_M:
            _refuse_swapped(geozone)
    return []


def _refuse_swapped(geozone: Geozone) -> None:
    text = f"{geozone.label} is at the box only with latitude and longitude exchanged. Swapped?"
    raise FileFormatError(text, hint="write longitude first, as both formats have it", reason=text)


def _straight(label: str, corners: Sequence[Corner], asked: _Asked) -> shapely.Polygon:
    """A polygon in the plane (north, east), m, with what lies between two meanings of a straight edge.

    An edge may be straight on the Earth or in degrees: they differ by metres over ten kilometres.
    """
    degrees = np.array(corners)
    degrees[:, 1] = unwrapped_deg(degrees[:, 1])
    plain = shapely.Polygon(_plane(degrees, asked))
    closed = np.vstack([degrees, degrees[:1]])
    lengths_m = np.radians(np.linalg.norm(np.diff(closed, axis=0), axis=1)) * _EARTH_M
    steepest = math.tan(math.radians(min(89.0, float(np.abs(degrees[:, 0]).max()))))
    bows_m = lengths_m**2 * steepest / (8.0 * _EARTH_M)
    if float(bows_m.max()) <= _BOW_M:
        return plain
    steps = np.ceil(np.sqrt(bows_m / _BOW_M)).astype(int) + 1
    if int(steps.sum()) > _STEPS_MAX:
        text = f"{label} has edges of {lengths_m.sum() / 1000.0:,.0f} km together"
        raise FileFormatError(text, hint="leave the zone out of the file, and give it as polygon_deg", reason=text)
    bent = shapely.Polygon(_plane(np.vstack([*_fine_edges(closed, steps)]), asked))
    if not (plain.is_valid and bent.is_valid):
        return plain
    both = shapely.union_all([plain, bent])
    return both if both.geom_type == "Polygon" else both.convex_hull


def _fine_edges(closed: np.ndarray, steps: np.ndarray) -> Iterator[np.ndarray]:
    for (first, last), count in zip(itertools.pairwise(closed), steps.tolist(), strict=True):
        yield first + np.arange(count)[:, None] / count * (last - first)


def _plane(degrees: np.ndarray, asked: _Asked) -> np.ndarray:
    found: np.ndarray = place_up_m(degrees[:, 0], degrees[:, 1], 0.0, local_origin(asked.scenario))[:, :2]
    return found


def _few_corners(geozone: Geozone, shape: shapely.Polygon) -> tuple[shapely.Polygon, float]:
    """The polygon, or a larger one with as many corners as a zone may have, and by how many metres it is larger."""
    if len(shape.exterior.coords) - 1 <= CORNERS_MAX:
        return shape, 0.0
    for by_m in _SIMPLER_M:
        larger = shapely.Polygon(shape.buffer(1.01 * by_m).simplify(by_m).exterior)
        if larger.is_valid and larger.covers(shape) and len(larger.exterior.coords) - 1 <= CORNERS_MAX:
            return larger, 2.01 * by_m
    text = f"{geozone.label} has more than {CORNERS_MAX} corners near the box"
    raise FileFormatError(text, hint="draw it with fewer corners", reason=text)
