"""Upper bounds of the ground: no place of a rectangle is higher, and small rectangles are bounded closely."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.scenario.environment.ground_bounds import highest_ground
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.sources.load import load_scenario


@pytest.mark.parametrize("name", ["simulation1", "simulation2", "gap", "ridge"])
def test_no_place_of_a_rectangle_is_higher(repo_root, name: str) -> None:  # type: ignore[no-untyped-def]
    scenario = load_scenario(repo_root / "missions" / name)
    random = np.random.default_rng(3)
    low, high = np.transpose([scenario.limits.north_m, scenario.limits.east_m])
    centre = random.uniform(low, high, (1000, 2))
    half = 10.0 ** random.uniform(-3.0, 2.0, centre.shape)
    bound_m = highest_ground(scenario.terrain)(centre - half, centre + half)
    for _ in range(20):
        places = centre + half * random.uniform(-1.0, 1.0, centre.shape)
        assert np.all(ground_height_m(scenario.terrain, *places.T) <= bound_m + 1e-9)
    small = half.max(axis=1) < 0.005
    assert np.all(bound_m[small] - ground_height_m(scenario.terrain, *centre[small].T) < 0.05)
    assert np.allclose(
        highest_ground(scenario.terrain)(centre, centre), ground_height_m(scenario.terrain, *centre.T), atol=1e-6
    )
