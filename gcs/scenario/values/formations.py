"""Shapes for any number of vehicles: triangle, line, column, vee, grid, circle, sphere.

All places are in metres. North is ahead: a line is abreast (east and west of the leader), a column is behind it.
"""

from collections.abc import Callable

import numpy as np
from scipy.spatial import KDTree

from gcs.scenario.schema.formation_table import Generator
from gcs.types import Array

_Places = tuple[Array, ...]  # north, east, and up where places are not level; neighbours are one apart


def places_up_m(generator: Generator, count: int, spacing_m: float) -> Array:
    """Places (count, 3) north, east, up, `spacing_m` between nearest neighbours; the first is the leader's."""
    return np.column_stack([*_GENERATORS[generator](count), np.zeros(count)][:3]) * spacing_m


def turned(places_m: Array, heading_deg: float) -> Array:
    """Places (count, 3) north, east, up with their front at a heading, clockwise from north."""
    angle = np.radians(heading_deg)
    north, east, up = places_m.T
    return np.column_stack(
        [north * np.cos(angle) - east * np.sin(angle), north * np.sin(angle) + east * np.cos(angle), up]
    )


def _triangle(count: int) -> _Places:
    """Rows of 1, 2, 3, ... behind the leader, equilateral."""
    row = np.ceil((np.sqrt(8.0 * np.arange(1, count + 1) + 1.0) - 3.0) / 2.0 - 1e-9)
    place = np.arange(count) - row * (row + 1.0) / 2.0
    return -row * np.sqrt(0.75), place - row / 2.0


def _vee(count: int) -> _Places:
    """Two arms at 45 degrees, by turns to the right and left, as geese fly."""
    east = _by_turns(count) * np.sqrt(0.5)
    return -np.abs(east), east


def _grid(count: int) -> _Places:
    """A grid as square as possible, filled row by row from the front; the leader is in the middle of the first row."""
    columns = int(np.ceil(np.sqrt(count)))
    row, place = np.divmod(np.arange(count), columns)
    return -row.astype(float), _by_turns(columns)[place]


def _circle(count: int) -> _Places:
    """Evenly on a circle, the leader in front."""
    angle = 2.0 * np.pi * np.arange(count) / count
    radius = 0.5 / np.sin(np.pi / count)
    return radius * (np.cos(angle) - 1.0), radius * np.sin(angle)


def _sphere(count: int) -> _Places:
    """A Fibonacci sphere, scaled so that the nearest neighbours are one apart; the leader is its lowest."""
    if count == 1:
        return np.zeros(1), np.zeros(1)
    index = np.arange(count)
    up = -1.0 + (2.0 * index + 1.0) / count
    angle = index * np.pi * (3.0 - np.sqrt(5.0))
    around = np.sqrt(1.0 - up**2)
    places = np.column_stack([around * np.cos(angle), around * np.sin(angle), up])
    nearest = KDTree(places).query(places, k=2)[0][:, 1].min()
    return tuple(((places - places[0]) / nearest).T)


def _by_turns(count: int) -> Array:
    """0, 1, -1, 2, -2, ..."""
    index = np.arange(count)
    return np.asarray(np.where(index % 2 == 1, 1.0, -1.0) * ((index + 1) // 2))


_GENERATORS: dict[Generator, Callable[[int], _Places]] = {
    "triangle": _triangle,
    "line": lambda count: (np.zeros(count), _by_turns(count)),  # by turns to the right and left of the leader
    "column": lambda count: (-np.arange(count, dtype=float), np.zeros(count)),
    "vee": _vee,
    "grid": _grid,
    "circle": _circle,
    "sphere": _sphere,
}
