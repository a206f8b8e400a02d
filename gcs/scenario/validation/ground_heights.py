"""Heights above the ground of start, end and points of a route, as heights above height 0.

A file may leave the height out of a position and give `height_above_ground_m` beside it, or once for all in [legs].
All later layers know both: where a place is, and that it was drawn above the ground.
"""

import dataclasses
from collections.abc import Iterator
from typing import TypeVar

import numpy as np

from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.degree_keys import ABOVE_GROUND, numbers
from gcs.scenario.schema.mistake import KeyChange, Mistake, plain
from gcs.scenario.schema.places import RoutePoint
from gcs.scenario.schema.scenario import Boundary, Scenario, Terrain
from gcs.scenario.schema.toml_lines import Key, Table

Kind = TypeVar("Kind", Boundary, RoutePoint)
_SAME_M = 0.01
_DIGITS = 6


def with_room_for_heights(data: Table) -> Table:
    """The tables of a file with three numbers in every position, the last one 0 where it counts from the ground."""
    legs = data.get("legs")
    usual = legs.get(ABOVE_GROUND) if isinstance(legs, dict) else None

    def completed(table: object) -> object:
        if not isinstance(table, dict):
            return table
        flat = numbers(table.get("position_m"), 2)
        above = table.get(ABOVE_GROUND)
        if above is None and (flat or ("position_deg" in table and not {"height_m", "alt_amsl_m"} & table.keys())):
            above = usual
        if above is None:
            return table
        return table | {ABOVE_GROUND: above} | ({"position_m": [*flat, 0.0]} if flat else {})

    ends = {name: completed(data[name]) for name in ("start", "end") if name in data}
    route = data.get("route")
    return data | ends | ({"route": [completed(point) for point in route]} if isinstance(route, list | tuple) else {})


def without_ground_heights(data: Table) -> Table:
    """The tables of a scenario, whose heights above the ground may change: such positions lose their own height."""

    def flat(table: Table) -> Table:
        return table if table.get(ABOVE_GROUND) is None else table | {"position_m": (*table["position_m"][:2], 0.0)}

    ends = {name: flat(data[name]) for name in ("start", "end")}
    return data | ends | ({"route": [*map(flat, data["route"])]} if "route" in data else {})


def above_ground(scenario: Scenario) -> tuple[Scenario, list[Mistake]]:
    """The scenario with heights above height 0, and the positions that give another height too."""
    mistakes = list(_other_heights(scenario))
    if mistakes:
        return scenario, mistakes
    ends = {"start": _lifted(scenario.terrain, scenario.start), "end": _lifted(scenario.terrain, scenario.end)}
    route = tuple(_lifted(scenario.terrain, point) for point in scenario.route)
    return scenario.model_copy(update=ends | {"route": route}), []


def sound_above_ground(sound: Table) -> Table:
    """The valid tables of a scenario with mistakes, with heights above height 0; without those of unknown height."""
    places = [sound[name] for name in ("start", "end") if name in sound] + [*sound.get("route", ())]
    if all(place.height_above_ground_m is None for place in places):
        return sound
    terrain = sound.get("terrain")
    if terrain is None or (terrain.dem is not None and terrain.relief is None):
        return {name: table for name, table in sound.items() if name not in ("start", "end", "route")}
    ends = {name: _lifted(terrain, sound[name]) for name in ("start", "end") if name in sound}
    route = {"route": tuple(_lifted(terrain, point) for point in sound["route"])} if "route" in sound else {}
    return sound | ends | route


def in_ground_keys(mistake: Mistake, scenario: Scenario) -> Mistake:
    """The mistake of a height with the key above the ground where the file has that one."""
    for key, place in _places(scenario):
        if place.height_above_ground_m is None or mistake.key != (*key, "position_m", 2):
            continue
        more_m = place.height_above_ground_m - place.position_m[2]
        own = (*key, ABOVE_GROUND)
        changes = tuple(
            KeyChange(own, one.value + more_m) if one.key == mistake.key and isinstance(one.value, int | float) else one
            for one in mistake.changes
        )
        return dataclasses.replace(mistake, key=own, value=place.height_above_ground_m, changes=changes)
    return mistake


def _places(scenario: Scenario) -> Iterator[tuple[Key, Boundary | RoutePoint]]:
    yield ("start",), scenario.start
    for row, point in enumerate(scenario.route):
        yield ("route", row), point
    yield ("end",), scenario.end


def _other_heights(scenario: Scenario) -> Iterator[Mistake]:
    for key, place in _places(scenario):
        given_m = place.position_m[2]
        if place.height_above_ground_m is None or given_m == 0.0:
            continue
        height_m = _height_m(scenario.terrain, place)
        if abs(height_m - given_m) > _SAME_M:
            text = f"stands beside a height of {plain(given_m)} m in position_m, and means {plain(height_m)} m there"
            value = place.height_above_ground_m
            yield Mistake((*key, ABOVE_GROUND), text, value, "give position_m north and east alone, or remove this key")


def _lifted(terrain: Terrain, place: Kind) -> Kind:
    if place.height_above_ground_m is None:
        return place
    return place.model_copy(update={"position_m": (*place.position_m[:2], _height_m(terrain, place))})


def _height_m(terrain: Terrain, place: Boundary | RoutePoint) -> float:
    """The height above height 0 of a place above the ground."""
    north_m, east_m, _ = place.position_m
    ground_m = float(ground_height_m(terrain, np.array(north_m), np.array(east_m)))
    return round(ground_m + (place.height_above_ground_m or 0.0), _DIGITS)
