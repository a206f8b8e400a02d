"""How far ground reaches in a direction: never less than a dense sample of the patch, and tight where it is small."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.plan.verification.proof.ground_patches import GroundPatches, ReliefGround, SmoothGround, ground_patches
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.heightmap import Relief, packed
from gcs.scenario.schema.scenario import Terrain
from gcs.types import Array

RIPPLE = {"a": 10.0, "b": 0.2, "c": 0.1, "d": 0.6, "e": 1.0, "f": 0.1, "g": 0.1}
MOUNTAINS = {
    "north_m": [4.0, -6.0],
    "east_m": [3.0, 2.0],
    "height_m": [8.0, 3.0],
    "spread_north_m": [3.0, 6.0],
    "spread_east_m": [5.0, 2.0],
}


def hills(bend: float = 0.0, pixel_m: tuple[float, float] = (2.0, 2.0)) -> Relief:
    """40 x 40 pixels, 2 m to the north and 2 m to the east, around the origin; `bend` makes rows curved."""
    random = np.random.default_rng(11)
    row, column = np.zeros(10), np.zeros(10)
    row[[0, 1, 3, 5]], column[[0, 2, 4]] = (20.0, 40.0 / pixel_m[0], bend, bend), (20.0, 40.0 / pixel_m[1], bend)
    return Relief(
        rows=40,
        columns=40,
        heights=packed(random.uniform(0.0, 5.0, (40, 40))),
        centre_m=(0.0, 0.0),
        reach_m=40.0,
        row=tuple(row.tolist()),
        column=tuple(column.tolist()),
        spacing_m=2.0,
        north_m=(-30.0, 30.0),
        east_m=(-30.0, 30.0),
    )


GROUNDS: dict[str, Terrain] = {
    "level": Terrain(),
    "ripple": Terrain.model_validate({"ripple": RIPPLE}),
    "mountains": Terrain.model_validate({"mountains": MOUNTAINS}),
    "both": Terrain.model_validate({"ripple": RIPPLE, "mountains": MOUNTAINS}),
    "relief": Terrain.model_validate({"relief": hills().model_dump()}),
    "relief of long pixels": Terrain.model_validate({"relief": hills(pixel_m=(-1.0, 3.0)).model_dump()}),
    "relief of wide pixels": Terrain.model_validate({"relief": hills(pixel_m=(-3.0, 1.0)).model_dump()}),
    "curved relief": Terrain.model_validate({"relief": hills(0.05).model_dump()}),
}


def sampled(ground: GroundPatches, patch: Array, direction: Array, side: int = 41) -> float:
    """The largest of direction . point over a grid of a patch (4,)."""
    first, second = np.meshgrid(np.linspace(*patch[:2], side), np.linspace(*patch[2:], side), indexing="ij")
    return float((ground.points_ned_m(first.ravel(), second.ravel()) @ direction).max())


def random_patches(rng: np.random.Generator, ground: GroundPatches, count: int, size_m: float) -> tuple[Array, Array]:
    north, east = rng.uniform(-12.0, 12.0, (2, count))
    patches = ground.around(north, east, rng.uniform(0.01, size_m, count))
    direction = rng.normal(size=(count, 3))
    direction[:, 2] = -np.abs(direction[:, 2])
    direction[::5, 2] = 0.0  # level: beside a wall
    return patches, direction / np.linalg.norm(direction, axis=1, keepdims=True)


@pytest.mark.parametrize("size_m", [0.2, 2.0, 9.0])
@pytest.mark.parametrize("name", GROUNDS)
def test_the_support_is_never_below_a_sample_of_the_patch(name: str, size_m: float) -> None:
    ground = ground_patches(GROUNDS[name])
    assert isinstance(ground, ReliefGround if "relief" in name else SmoothGround)
    patches, directions = random_patches(np.random.default_rng(3), ground, 60, size_m)
    support = ground.support(patches, directions)
    for patch, direction, bound in zip(patches, directions, support, strict=True):
        assert sampled(ground, patch, direction) <= bound + 1e-9


def test_the_highest_pixel_is_found_in_a_table_that_is_longer_than_wide() -> None:
    heights = packed(np.random.default_rng(2).uniform(0.0, 9.0, (60, 20)))
    long = Relief.model_validate(hills().model_dump() | {"rows": 60, "columns": 20, "heights": heights})
    pixels = np.asarray(long.pixels_m)
    assert pixels.shape == (60, 20)
    for k, table in enumerate(ReliefGround(long)._peaks):
        expected = np.empty_like(pixels)
        for row, column in np.ndindex(pixels.shape):
            expected[row, column] = pixels[row : row + 2**k, column : column + 2**k].max()
        np.testing.assert_array_equal(table, expected)


@pytest.mark.parametrize("name", GROUNDS)
def test_halves_cover_the_patch_and_lead_to_a_tight_bound(name: str) -> None:
    ground = ground_patches(GROUNDS[name])
    patches, _ = random_patches(np.random.default_rng(4), ground, 3, 2.0)
    up = np.broadcast_to([0.0, 0.0, -1.0], (1, 3))
    for patch in patches:
        highest, parts = sampled(ground, patch, up[0], 201), patch[None]
        bounds = [float(ground.support(parts, up).max())]
        for _ in range(12):
            area = np.prod(parts[:, 1::2] - parts[:, ::2], axis=1).sum()
            parts = np.concatenate(ground.parts(parts))
            assert np.prod(parts[:, 1::2] - parts[:, ::2], axis=1).sum() == pytest.approx(area)
            bounds.append(float(ground.support(parts, np.repeat(up, len(parts), axis=0)).max()))
        assert highest - 1e-9 <= bounds[-1] <= highest + 0.06
        assert bounds[-1] <= bounds[0] + 1e-9


@pytest.mark.parametrize("name", GROUNDS)
def test_the_patch_around_a_place_reaches_as_far_and_the_height_is_that_of_the_scenario(name: str) -> None:
    ground, rng = ground_patches(GROUNDS[name]), np.random.default_rng(6)
    north, east, reach = rng.uniform(-10.0, 10.0, 50), rng.uniform(-10.0, 10.0, 50), rng.uniform(0.1, 5.0, 50)
    patches = ground.around(north, east, reach)
    angle = rng.uniform(0.0, 2.0 * np.pi, 50)
    there = north + reach * np.cos(angle), east + reach * np.sin(angle)
    everywhere = ground.around(np.zeros(50), np.zeros(50), np.full(50, 25.0))
    own = ground.nearest(patches, *there)
    np.testing.assert_allclose(own, ground.nearest(everywhere, *there), atol=1e-9)  # not clipped: inside
    point = ground.points_ned_m(*own)
    np.testing.assert_allclose(point[:, :2].T, there, atol=1e-8)
    np.testing.assert_allclose(-point[:, 2], ground_height_m(GROUNDS[name], point[:, 0], point[:, 1]), atol=1e-8)


def test_at_the_origin_of_the_ripple_a_patch_of_no_size_has_a_bound() -> None:
    """Its rings have a corner there: a vehicle stands on its pad at the origin."""
    ground = ground_patches(GROUNDS["ripple"])
    patch = ground.around(np.zeros(1), np.zeros(1), np.zeros(1))
    bound = ground.support(patch, np.array([[0.0, 0.0, -1.0]]))
    assert bound[0] == pytest.approx(float(ground_height_m(GROUNDS["ripple"], np.zeros(1), np.zeros(1))[0]))


# Grounds of one term of Eqs. 52 and 53 each, with a summit where their height is known: sin(a) + e = 0 and cos(a) = 0
# leave nothing of the terms across.
ALONE = {"a": np.pi / 2.0, "b": 0.0, "c": 0.0, "d": 0.0, "e": -1.0, "f": 0.0, "g": 0.0}
PEAK = {"north_m": [7.0], "east_m": [-3.0], "height_m": [5.0], "spread_north_m": [4.0], "spread_east_m": [4.0]}
SUMMITS: list[tuple[str, Terrain, tuple[float, float], float]] = [
    ("rings of d", Terrain.model_validate({"ripple": ALONE | {"c": 2.0, "d": 0.6}}), (0.0, 0.0), 2.0),
    ("waves of b", Terrain.model_validate({"ripple": ALONE | {"b": 2.0}}), (np.pi / 2.0, 5.0), 2.0),
    ("waves of a and e", Terrain.model_validate({"ripple": ALONE | {"a": 0.0, "e": 1.0}}), (5.0, np.pi / 4.0), 2**0.5),
    ("rings of g", Terrain.model_validate({"ripple": ALONE | {"f": 2.0, "g": 0.6}}), (np.pi / 1.2, 0.0), 2.0),
    ("a mountain", Terrain.model_validate({"mountains": PEAK}), (7.0, -3.0), 5.0),
]


@pytest.mark.parametrize("sides_m", [(0.2, 0.2), (0.2, 0.02), (0.02, 0.2), (1.6, 1.6)])
@pytest.mark.parametrize(("name", "terrain", "summit_m", "height_m"), SUMMITS, ids=[one[0] for one in SUMMITS])
def test_a_summit_inside_a_patch_is_not_above_its_bound_and_the_bound_is_near(
    name: str, terrain: Terrain, summit_m: tuple[float, float], height_m: float, sides_m: tuple[float, float]
) -> None:
    """All corners lie lower; the remainder makes up for it. It is of the second order in the sides."""
    ground = ground_patches(terrain)
    assert float(ground_height_m(terrain, *(np.array([one]) for one in summit_m))[0]) == pytest.approx(height_m)
    (n, e), (north_m, east_m) = summit_m, (0.5 * side for side in sides_m)
    patch = np.array([[n - north_m, n + north_m, e - east_m, e + east_m]])
    above_m = float(ground.support(patch, np.array([[0.0, 0.0, -1.0]]))[0]) - height_m
    assert -1e-12 <= above_m <= 0.4 * float(np.square(sides_m).sum())


@pytest.mark.parametrize("shift_m", [0.0, 0.05, -0.05])
def test_a_cone_at_the_origin_is_not_above_its_bound(shift_m: float) -> None:
    """c cos(d r) + f sin(g r) with f below 0 falls from the origin on with a slope, f g."""
    terrain = Terrain.model_validate({"ripple": ALONE | {"c": 2.0, "d": 0.01, "f": -1.0, "g": 0.5}})
    patch = np.array([[-0.1 + shift_m, 0.1 + shift_m, -0.1, 0.1]])
    bound = ground_patches(terrain).support(patch, np.array([[0.0, 0.0, -1.0]]))
    assert 2.0 <= bound[0] <= 2.0 + 0.5 * 0.3
