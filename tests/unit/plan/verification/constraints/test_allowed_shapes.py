"""What automatic changes may make of a shape: an allowed shape is its own nearest, and the nearest of all is found."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from gcs.plan.verification.constraints.allowed_shapes import AllowedShapes
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import offsets_ned_m
from gcs.types import Array
from tests.unit.plan.formations import COURSE, SHRINK, TO_FILE, TURN, at, auto, fleet

RICH: tuple[dict[str, Any], ...] = (auto(SHRINK), auto({**TURN, "angle_deg": 60.0}), auto(TO_FILE))


def allowed_of(scenario: Scenario) -> AllowedShapes:
    found = AllowedShapes.of(scenario)
    assert found is not None
    return found


def bent(values: Array, base: Array, target: Array) -> Array:
    """Shapes (V, N, 3) of scales, rotations and blends (3, N)."""
    scale, turn, blend = values
    mixed = (1.0 - blend)[:, None] * base[:, None] + blend[:, None] * target[:, None]
    flat = (mixed[..., 0] + 1j * mixed[..., 1]) * scale * np.exp(1j * turn)
    return np.stack([flat.real, flat.imag, scale * mixed[..., 2]], axis=-1)


@pytest.mark.parametrize("changes", [RICH, RICH[:1], RICH[1:2], RICH[2:], RICH[:2], RICH[1:], (RICH[0], RICH[2])])
def test_every_allowed_shape_is_its_own_nearest(simulation1: Scenario, changes: tuple[dict[str, Any], ...]) -> None:
    shapes: tuple[dict[str, Any], ...] = (
        {"name": "wedge", "generator": "vee", "spacing_m": 3.0},
        {"name": "file", "generator": "sphere", "spacing_m": 5.0},
    )
    for begin in ("row", "wedge"):
        chosen = shapes if begin == "wedge" else fleet(simulation1).model_dump()["formation"]["shape"]
        scenario = fleet(simulation1, 5, begin, changes, chosen)
        allowed, base = allowed_of(scenario), offsets_ned_m(scenario)
        random, count = np.random.default_rng(1), 200
        scale = random.uniform(*allowed.scale, count)
        turn = random.uniform(-allowed.turn_rad, allowed.turn_rad, count)
        blend = random.uniform(*allowed.blend, count)
        seen = bent(np.stack([scale, turn, blend]), base, allowed.target_ned_m)
        nearest = np.stack(allowed.nearest(seen, base[:, None]))
        np.testing.assert_allclose(bent(nearest, base, allowed.target_ned_m), seen, atol=1e-4)


def test_the_nearest_of_all_allowed_shapes_is_found(simulation1: Scenario) -> None:
    """Against a search by a library, for places that belong to no shape."""
    scenario = fleet(simulation1, 5, "wedge", RICH)
    allowed, base = allowed_of(scenario), offsets_ned_m(scenario)
    random = np.random.default_rng(3)

    def shape(values: Array) -> Array:
        scale, turn, blend = values
        mixed = (1.0 - blend) * base + blend * allowed.target_ned_m
        return np.asarray(scale * Rotation.from_euler("z", turn).apply(mixed))

    for _ in range(12):
        seen = shape(random.uniform([0.3, -2.0, -0.5], [1.3, 2.0, 1.5])) + random.normal(size=base.shape)
        found = shape(np.stack(allowed.nearest(seen[:, None], base[:, None]))[:, 0])
        limits = [allowed.scale, (-allowed.turn_rad, allowed.turn_rad), allowed.blend]
        best = min(
            minimize(lambda v, s=seen: np.sum((shape(v) - s) ** 2), start, bounds=limits).fun
            for start in ([0.7, 0.0, 0.2], [0.7, 0.8, 0.8], [0.7, -0.8, 0.5])
        )
        assert np.sum((found - seen) ** 2) <= best * (1.0 + 1e-6)


def test_the_ranges_are_those_of_the_scenario(simulation1: Scenario) -> None:
    """A twentieth of its range and 0.1 % beyond; scheduled changes have no range."""
    scale, turn_rad, blend = allowed_of(fleet(simulation1, 5, "wedge", RICH)).ranges
    assert scale == pytest.approx((0.499, 1.026))
    np.testing.assert_allclose(np.degrees(turn_rad), [-60.06, 60.06])
    assert blend == pytest.approx((-0.051, 1.001))
    course = allowed_of(fleet(simulation1, 5, formation=COURSE))
    assert course.ranges == ((1.0, 1.0), (-np.inf, np.inf), (0.0, 0.0))
    assert AllowedShapes.of(fleet(simulation1, 5, "wedge", (at(TURN, 2.0),))) is None
