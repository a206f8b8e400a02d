"""The distance to the ground in any direction, against formulas and against the ground on ever finer grids."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.scenario.environment.ground_distance import ground_distance_m
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.heightmap import Relief, packed
from gcs.scenario.schema.scenario import Mountains, Ripple, Scenario, Terrain
from gcs.types import Array

CELL_M = 4.0
WAVES = Ripple(a=10.0, b=0.2, c=0.1, d=0.6, e=1.0, f=0.1, g=0.1)
LEVEL = Mountains()


def relief(heights_m: Array, turned_deg: float = 0.0) -> Terrain:
    """A table of heights in pixels of 4 m around the origin, its rows turned from north."""
    rows, columns = heights_m.shape
    c, s = np.cos(np.radians(turned_deg)) / CELL_M, np.sin(np.radians(turned_deg)) / CELL_M
    none = (0.0,) * 7
    return Terrain(
        relief=Relief(
            rows=rows,
            columns=columns,
            heights=packed(heights_m),
            centre_m=(0.0, 0.0),
            reach_m=1.0,
            row=(0.5 * (rows - 1), c, s, *none),
            column=(0.5 * (columns - 1), -s, c, *none),
            spacing_m=CELL_M,
            north_m=(-0.5 * CELL_M * rows, 0.5 * CELL_M * rows),
            east_m=(-0.5 * CELL_M * columns, 0.5 * CELL_M * columns),
        )
    )


def brute_m(terrain: Terrain, place: Array, reach_m: float) -> float:
    """The least distance on a grid of the ground around a place, made ever finer around its three nearest points."""
    north, east, up = place
    axis = np.linspace(-reach_m, reach_m, 241)
    a, b = np.meshgrid(north + axis, east + axis)
    away = np.sqrt((a - north) ** 2 + (b - east) ** 2 + (up - ground_height_m(terrain, a, b)) ** 2)
    best = min(reach_m, float(away.min()))
    order = np.argsort(away, axis=None)
    centres = [(a.flat[k], b.flat[k]) for k in order[[0, 20, 200]]]
    for centre in centres:
        at, half = centre, 8.0 * (axis[1] - axis[0])
        for _ in range(9):
            fine = np.linspace(-half, half, 41)
            a, b = np.meshgrid(at[0] + fine, at[1] + fine)
            away = np.sqrt((a - north) ** 2 + (b - east) ** 2 + (up - ground_height_m(terrain, a, b)) ** 2)
            at = (a.flat[away.argmin()], b.flat[away.argmin()])
            best, half = min(best, float(away.min())), 0.25 * half
    return best


def at(terrain: Terrain, north: float, east: float, up: float, reach_m: float = 10.0) -> float:
    return float(ground_distance_m(terrain, np.array(north), np.array(east), np.array(up), reach_m))


def test_over_level_ground_it_is_the_height() -> None:
    terrain = Terrain(mountains=LEVEL)
    assert at(terrain, 3.0, 4.0, 2.5) == 2.5
    assert at(terrain, 3.0, 4.0, 25.0) == 10.0  # no more than the reach
    assert at(terrain, 3.0, 4.0, -1.5) == -1.5  # below the ground


@pytest.mark.parametrize("turned_deg", [0.0, 31.0])
def test_over_a_slope_it_is_the_height_times_the_cosine(turned_deg: float) -> None:
    rise = 3.0 * np.arange(21.0)  # 3 m in 4 m
    terrain = relief(np.repeat(rise[:, None], 21, axis=1), turned_deg)
    ground = float(ground_height_m(terrain, np.array(1.3), np.array(-2.1)))
    assert at(terrain, 1.3, -2.1, ground + 5.0) == pytest.approx(4.0, abs=1e-4)


@pytest.mark.parametrize("beside_m", [0.1, 1.0, 2.7])
def test_beside_a_cliff_it_is_the_way_to_the_rock(beside_m: float) -> None:
    """Ground that falls by 40 m in one pixel of 4 m: 5 m above its foot, the slope of ten to one is the nearest."""
    heights = np.where(np.arange(20)[:, None] < 10, 40.0, 0.0) * np.ones(20)
    terrain = relief(heights)
    foot_north = (10.0 - 9.5) * CELL_M
    place = foot_north + beside_m, 0.7, 5.0
    # The slope goes through (foot, 0) and (foot - 4, 40).
    sideways = (beside_m + 0.5) * 10.0 / np.sqrt(101.0)
    assert at(terrain, *place) == pytest.approx(min(sideways, 5.0), abs=1e-4)


def test_over_an_edge_it_is_the_way_to_the_edge() -> None:
    """A roof: the nearest point of both slopes is their common edge."""
    roof = 20.0 - 2.0 * np.abs(np.arange(21.0) - 10.0)
    terrain = relief(np.repeat(roof[:, None], 21, axis=1))
    assert at(terrain, 0.0, 1.0, 23.0) == pytest.approx(3.0, abs=1e-9)
    assert at(terrain, 0.2, 1.0, 23.0) == pytest.approx(np.hypot(0.2, 3.0), abs=1e-4)


@given(
    st.integers(0, 10_000),
    st.sampled_from(["waves", "waves and mountains", "mountains", "relief", "cliffs"]),
    st.floats(0.2, 3.0),
)
@settings(max_examples=40, deadline=None)
def test_it_is_the_least_distance_to_any_point_of_the_ground(seed: int, kind: str, above_m: float) -> None:
    random = np.random.default_rng(seed)
    needles = Mountains(
        north_m=tuple(random.uniform(-15.0, 15.0, 4)),
        east_m=tuple(random.uniform(-15.0, 15.0, 4)),
        height_m=tuple(random.uniform(-2.0, 12.0, 4)),
        spread_north_m=tuple(random.uniform(2.0, 12.0, 4)),
        spread_east_m=tuple(random.uniform(2.0, 12.0, 4)),
    )
    terrains = {
        "waves": Terrain(ripple=WAVES, mountains=LEVEL),
        "waves and mountains": Terrain(ripple=WAVES, mountains=needles),
        "mountains": Terrain(mountains=needles),
        "relief": relief(random.uniform(0.0, 3.0, (12, 12)), float(random.uniform(0.0, 90.0))),
        "cliffs": relief(np.where(random.uniform(size=(12, 12)) < 0.3, 25.0, 0.0)),
    }
    terrain = terrains[kind]
    north, east = random.uniform(-14.0, 14.0, 2)
    up = float(ground_height_m(terrain, np.array(north), np.array(east))) + above_m
    found, brute = at(terrain, north, east, up, 4.0), brute_m(terrain, np.array([north, east, up]), 4.0)
    assert found <= brute + 1e-4
    # It is the distance to a point of the ground, so it is no less than the least one.
    assert found >= brute - 2e-3


def test_many_places_at_once_have_the_shape_that_is_given(simulation1: Scenario) -> None:
    north, east = np.linspace(0.0, 1500.0, 40)[:, None], np.linspace(0.0, 1500.0, 30)
    up = ground_height_m(simulation1.terrain, north + 0.0 * east, east + 0.0 * north) + 1.0
    found = ground_distance_m(simulation1.terrain, north, east, up, 2.0)
    assert found.shape == (40, 30)
    assert found[7, 9] == at(simulation1.terrain, float(north[7, 0]), float(east[9]), float(up[7, 9]), 2.0)
    assert np.all(found <= 1.0 + 1e-12)
