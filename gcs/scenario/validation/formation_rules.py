"""Rules about the formation: separation in every shape, times and gates of changes, speed limits of changes.

The separation during a change is for the planner and the verification.
"""

from dataclasses import dataclass, replace

import numpy as np

from gcs.scenario.schema.fields import Point
from gcs.scenario.schema.formation_table import START_SHAPE
from gcs.scenario.schema.mistake import Mistake, dotted, plain
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.schema.toml_lines import Key
from gcs.scenario.validation.rule_set import Mistakes, Rules
from gcs.scenario.validation.spacing import SLACK, Pair, close_pairs, nearest_pair
from gcs.scenario.values.si import offsets_ned_m, shape_offsets_ned_m, sysids

_LISTED = 10  # pairs of vehicles with a line each
_APART = "are {:.2f} m apart"

RULES = Rules()


@dataclass(frozen=True)
class _Size:
    """The two closest vehicles of a shape at a scale."""

    pair: Pair
    scale: float  # relative to the shape in the file

    @property
    def gap_m(self) -> float:
        return self.pair.distance_m * self.scale


@RULES.needs("formation", "limits")
def _vehicles_are_apart(scenario: Scenario) -> Mistakes:
    if scenario.formation.count is None:  # else the next rule checks the named shape
        pairs = close_pairs(offsets_ned_m(scenario), scenario.limits.separation_min_m)
        yield from pairs_in_start_shape(scenario, pairs, _APART)


@RULES.needs("formation", "limits")
def _shapes_keep_vehicles_apart(scenario: Scenario) -> Mistakes:
    least = scenario.limits.separation_min_m
    for index, shape in enumerate(scenario.formation.shape):
        pairs = close_pairs(shape_offsets_ned_m(scenario, shape.name), least)
        key: Key = ("formation", "shape", index)
        if shape.generator is not None:
            yield from _closest_pair(scenario, pairs, _APART, Mistake((*key, "spacing_m"), "", shape.spacing_m))
        else:
            table = (*key, "offsets_m")
            places = [Mistake((*table, row), "", offset) for row, offset in enumerate(shape.offsets_m)]
            yield from _each_pair(scenario, pairs, _APART, table, places)


@RULES.needs("formation", "limits")
def _shrinking_keeps_vehicles_apart(scenario: Scenario) -> Mistakes:
    least = scenario.limits.separation_min_m - SLACK
    size = _size(scenario, START_SHAPE)
    sizes = [size]
    for index, change in enumerate(scenario.formation.change):
        if change.to is not None:
            reached = _size(scenario, change.to)
        elif change.scale is not None and size is not None and not change.auto:
            reached = _Size(size.pair, size.scale * change.scale)
            if reached.gap_m < least <= size.gap_m:
                yield _too_small(scenario, index, size, "would bring")
        else:
            continue
        sizes.append(reached)
        if not change.auto:
            size = reached
    tight = [size for size in sizes if size is not None and size.gap_m >= least]
    for index, change in enumerate(scenario.formation.change):
        if change.auto and change.scale is not None and tight:
            size = min(tight, key=lambda size: size.gap_m)
            if size.gap_m * change.scale < least:
                yield _too_small(scenario, index, size, "may bring")


@RULES.needs("formation", "time")
def _changes_begin_in_flight(scenario: Scenario) -> Mistakes:
    flight = scenario.time.flight_s
    for index, change in enumerate(scenario.formation.change):
        key, time_s = change.timed
        if time_s is not None and (time_s >= flight if key == "at_s" else time_s > flight):
            text = f"is after the flight, which ends at time.flight_s = {flight:g}"
            step = f"set formation.change[{index}].{key} to less than {plain(flight)}"
            yield Mistake(("formation", "change", index, key), text, time_s, remedy=step)


@RULES.needs("formation", "limits")
def _gates_are_in_the_box(scenario: Scenario) -> Mistakes:
    box_m = scenario.limits.north_m, scenario.limits.east_m
    for index, change in enumerate(scenario.formation.change):
        if change.gate_m is not None and not _crosses(change.gate_m, box_m):
            (south, north), (west, east) = box_m
            sides = f"north {south:g} to {north:g} m and east {west:g} to {east:g} m"
            text = f"lies outside the box of [limits], {sides}"
            yield Mistake(("formation", "change", index, "gate_m"), text, change.gate_m, "move it")


@RULES.needs("formation", "limits")
def _changes_keep_the_speed_limits(scenario: Scenario) -> Mistakes:
    formation, limits = scenario.formation, scenario.limits
    if not formation.change:
        return
    fastest = float(np.linalg.norm(limits.speed_ned_mps))
    if formation.change_speed_mps > fastest:
        text = f"faster than any vehicle: limits.speed_ned_mps allows {fastest:.2f} m/s"
        yield Mistake(("formation", "change_speed_mps"), text, formation.change_speed_mps)
    if limits.accel_max_mps2 is not None and formation.change_accel_mps2 > limits.accel_max_mps2:
        text = f"more than any vehicle: limits.accel_max_mps2 allows {limits.accel_max_mps2:g} m/s²"
        yield Mistake(("formation", "change_accel_mps2"), text, formation.change_accel_mps2)


def pairs_in_start_shape(scenario: Scenario, pairs: list[Pair], what: str) -> Mistakes:
    """Mistakes for pairs that are too close at t = 0, at the key that places them; `what` takes the distance."""
    formation = scenario.formation
    if formation.count is not None:
        place = Mistake(("formation", "start_shape"), "", formation.start_shape)
        yield from _closest_pair(scenario, pairs, what, place)
    else:
        table: Key = ("formation", "vehicle")
        rows = enumerate(formation.vehicle)
        places = [Mistake((*table, row, "position_m"), "", vehicle.position_m) for row, vehicle in rows]
        yield from _each_pair(scenario, pairs, what, table, places)


def _closest_pair(scenario: Scenario, pairs: list[Pair], what: str, place: Mistake) -> Mistakes:
    """A mistake for the closest pair, where one value places all vehicles."""
    if pairs:
        more = len(pairs) - 1
        others = f"; {more} more {'pairs are' if more > 1 else 'pair is'} too close" if more else ""
        step = _wider(scenario, place, pairs[0])
        yield replace(place, text=f"{_too_near(scenario, pairs[0], what)}{others}", remedy=step)


def _each_pair(scenario: Scenario, pairs: list[Pair], what: str, table: Key, places: list[Mistake]) -> Mistakes:
    """Mistakes for the closest pairs, each at the later of its two vehicles."""
    for pair in pairs[:_LISTED]:
        lacks_m = np.ceil((scenario.limits.separation_min_m - pair.distance_m) * 100.0 - 1e-6) / 100.0
        step = f"move vehicle {sysids(scenario)[pair.second]} away by {plain(lacks_m)} m or more"
        yield replace(places[pair.second], text=_too_near(scenario, pair, what), remedy=step)
    if len(pairs) > _LISTED:
        more = len(pairs) - _LISTED
        are = "pairs of vehicles are" if more > 1 else "pair of vehicles is"
        text = f"{more} more {are} closer than limits.separation_min_m allows"
        yield Mistake(table, text)


def _wider(scenario: Scenario, place: Mistake, pair: Pair) -> str:
    """The spacing at which the closest pair of a generated shape is apart; empty where it has no spacing."""
    if place.key[-1] != "spacing_m" or not isinstance(place.value, float) or pair.distance_m <= 0.0:
        return ""
    enough = place.value * scenario.limits.separation_min_m / pair.distance_m
    return f"set {dotted(place.key)} to {plain(float(np.ceil(enough * 100.0 - 1e-6) / 100.0))} or more"


def _too_near(scenario: Scenario, pair: Pair, what: str) -> str:
    required = f"limits.separation_min_m requires {scenario.limits.separation_min_m:g} m"
    return f"{_names(scenario, pair)} {what.format(pair.distance_m)}; {required}"


def _names(scenario: Scenario, pair: Pair) -> str:
    ids = sysids(scenario)
    return f"vehicles {ids[pair.first]} and {ids[pair.second]}"


def _size(scenario: Scenario, name: str) -> _Size | None:
    """The closest pair of a shape as in the file; None for a single vehicle."""
    pair = nearest_pair(shape_offsets_ned_m(scenario, name))
    return None if pair is None else _Size(pair, 1.0)


def _too_small(scenario: Scenario, index: int, before: _Size, brings: str) -> Mistake:
    scale = scenario.formation.change[index].scale
    assert scale is not None
    least = scenario.limits.separation_min_m
    text = f"{brings} {_names(scenario, before.pair)} from {before.gap_m:.2f} m to {before.gap_m * scale:.2f} m"
    text += f"; limits.separation_min_m requires {least:g} m"
    allowed = np.ceil(least / before.gap_m * 1000.0 - 1e-6) / 1000.0
    step = f"give a scale of at least {allowed:g}" if allowed < 1 else "remove the change: the shape cannot shrink here"
    return Mistake(("formation", "change", index, "scale"), text, scale, step)


def _crosses(gate_m: tuple[Point, Point], box_m: tuple[Point, Point]) -> bool:
    """Whether a part of the line between two points lies in a box of [low, high] along each axis."""
    enters, leaves = 0.0, 1.0
    for begin, end, (low, high) in zip(*gate_m, box_m, strict=True):
        if begin == end:
            if not low <= begin <= high:
                return False
            continue
        shares = sorted(((low - begin) / (end - begin), (high - begin) / (end - begin)))
        enters, leaves = max(enters, shares[0]), min(leaves, shares[1])
    return enters <= leaves
