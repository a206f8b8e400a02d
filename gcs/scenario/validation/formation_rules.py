"""Whether shapes keep vehicles apart, and whether changes begin where and when the flight is.

Knows: rules that compare the formation's shapes and changes with limits and times, and the key to change.
Does not know: how a change flies, when a gate is crossed, whether vehicles meet on the way from shape to shape.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gcs.scenario.schema.fields import Point
from gcs.scenario.schema.formation_table import START_SHAPE
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.si import offsets_ned_m, shape_offsets_ned_m, sysids
from gcs.scenario.validation.mistakes import Mistake
from gcs.scenario.validation.rule_set import Mistakes, Rules
from gcs.scenario.validation.spacing import SLACK, Pair, close_pairs, nearest_pair
from gcs.scenario.validation.toml_lines import Key

_TOLD = 10  # pairs of vehicles told one by one
_APART = "are {:.2f} m apart"

RULES = Rules()


@dataclass(frozen=True)
class _Size:
    """The two vehicles nearest to each other while a shape has some size."""

    pair: Pair
    scale: float  # of the shape as it is written

    @property
    def gap_m(self) -> float:
        return self.pair.distance_m * self.scale


@RULES.needs("formation", "limits")
def _vehicles_are_apart(scenario: Scenario) -> Mistakes:
    if scenario.formation.count is None:  # else they stand in a named shape, and the next rule looks at it
        pairs = close_pairs(offsets_ned_m(scenario), scenario.limits.separation_min_m)
        yield from tell_in_start_shape(scenario, pairs, _APART)


@RULES.needs("formation", "limits")
def _shapes_keep_vehicles_apart(scenario: Scenario) -> Mistakes:
    least = scenario.limits.separation_min_m
    for index, shape in enumerate(scenario.formation.shape):
        pairs = close_pairs(shape_offsets_ned_m(scenario, shape.name), least)
        key: Key = ("formation", "shape", index)
        if shape.generator is not None:
            yield from _tell_once(scenario, pairs, _APART, Mistake((*key, "spacing_m"), "", shape.spacing_m))
        else:
            table = (*key, "offsets_m")
            places = [Mistake((*table, row), "", offset) for row, offset in enumerate(shape.offsets_m)]
            yield from _tell_each(scenario, pairs, _APART, table, places)


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
        if change.at_s is not None and change.at_s >= flight:
            text = f"is not in the flight, which ends at time.flight_s = {flight:g}"
            yield Mistake(("formation", "change", index, "at_s"), text, change.at_s)


@RULES.needs("formation", "limits")
def _gates_are_in_the_box(scenario: Scenario) -> Mistakes:
    limits = scenario.limits
    for index, change in enumerate(scenario.formation.change):
        if change.gate_m is not None and not _crosses(change.gate_m, (limits.north_m, limits.east_m)):
            text = (
                f"lies where nobody flies: outside limits.north_m, {limits.north_m[0]:g} to {limits.north_m[1]:g}, "
                f"and limits.east_m, {limits.east_m[0]:g} to {limits.east_m[1]:g}"
            )
            yield Mistake(("formation", "change", index, "gate_m"), text, change.gate_m)


@RULES.needs("formation", "limits")
def _changes_ask_no_more_than_vehicles_may(scenario: Scenario) -> Mistakes:
    formation, limits = scenario.formation, scenario.limits
    if not formation.change:
        return
    fastest = float(np.linalg.norm(limits.speed_ned_mps))
    if formation.change_speed_mps > fastest:
        text = f"faster than a vehicle may fly at all: limits.speed_ned_mps allows {fastest:.2f} m/s"
        yield Mistake(("formation", "change_speed_mps"), text, formation.change_speed_mps)
    if limits.accel_max_mps2 is not None and formation.change_accel_mps2 > limits.accel_max_mps2:
        text = f"more than a vehicle may accelerate at all: limits.accel_max_mps2 allows {limits.accel_max_mps2:g} m/s²"
        yield Mistake(("formation", "change_accel_mps2"), text, formation.change_accel_mps2)


def tell_in_start_shape(scenario: Scenario, pairs: list[Pair], what: str) -> Mistakes:
    """Pairs that are too near each other at t = 0, at the key that puts them there; `what` takes the distance."""
    formation = scenario.formation
    if formation.count is not None:
        place = Mistake(("formation", "start_shape"), "", formation.start_shape)
        yield from _tell_once(scenario, pairs, what, place)
    else:
        table: Key = ("formation", "vehicle")
        rows = enumerate(formation.vehicle)
        places = [Mistake((*table, row, "position_m"), "", vehicle.position_m) for row, vehicle in rows]
        yield from _tell_each(scenario, pairs, what, table, places)


def _tell_once(scenario: Scenario, pairs: list[Pair], what: str, place: Mistake) -> Mistakes:
    """The nearest pair, where one value places all vehicles."""
    if pairs:
        others = f", which {len(pairs) - 1} more pairs miss as well" if len(pairs) > 1 else ""
        yield replace(place, text=f"{_too_near(scenario, pairs[0], what)}{others}")


def _tell_each(scenario: Scenario, pairs: list[Pair], what: str, table: Key, places: list[Mistake]) -> Mistakes:
    """The nearest pairs, each at the later of its two vehicles."""
    for pair in pairs[:_TOLD]:
        yield replace(places[pair.second], text=_too_near(scenario, pair, what))
    if len(pairs) > _TOLD:
        text = f"{len(pairs) - _TOLD} more pairs of vehicles are nearer than limits.separation_min_m allows"
        yield Mistake(table, text)


def _too_near(scenario: Scenario, pair: Pair, what: str) -> str:
    asks = f"limits.separation_min_m asks {scenario.limits.separation_min_m:g} m"
    return f"{_names(scenario, pair)} {what.format(pair.distance_m)}; {asks}"


def _names(scenario: Scenario, pair: Pair) -> str:
    ids = sysids(scenario)
    return f"vehicles {ids[pair.first]} and {ids[pair.second]}"


def _size(scenario: Scenario, name: str) -> _Size | None:
    """A shape as it is written; None for a single vehicle."""
    pair = nearest_pair(shape_offsets_ned_m(scenario, name))
    return None if pair is None else _Size(pair, 1.0)


def _too_small(scenario: Scenario, index: int, before: _Size, brings: str) -> Mistake:
    scale = scenario.formation.change[index].scale
    assert scale is not None
    least = scenario.limits.separation_min_m
    text = (
        f"{brings} {_names(scenario, before.pair)} from {before.gap_m:.2f} m to {before.gap_m * scale:.2f} m; "
        f"limits.separation_min_m asks {least:g} m"
    )
    allowed = np.ceil(least / before.gap_m * 1000.0 - 1e-6) / 1000.0
    text += f": the least scale here is {allowed:g}" if allowed < 1 else ": there is nothing to shrink here"
    return Mistake(("formation", "change", index, "scale"), text, scale)


def _crosses(gate_m: tuple[Point, Point], box_m: tuple[Point, Point]) -> bool:
    """Whether any of the line between two points lies in a box of [low, high] along each axis."""
    enters, leaves = 0.0, 1.0
    for begin, end, (low, high) in zip(*gate_m, box_m, strict=True):
        if begin == end:
            if not low <= begin <= high:
                return False
            continue
        shares = sorted(((low - begin) / (end - begin), (high - begin) / (end - begin)))
        enters, leaves = max(enters, shares[0]), min(leaves, shares[1])
    return enters <= leaves
