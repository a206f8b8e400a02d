"""Offsets over time: a few functions times fixed tables, cut, stretched and joined without anyone noticing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.physics.wind import SteadyWind
from gcs.plan.formation.shape import Shape, joined, rigid, stretched
from gcs.plan.formation.transforms import rotation, shrinking, straight
from gcs.types import Array

RANDOM = np.random.default_rng(11)
PLACES = RANDOM.normal(size=(5, 3)) * 4.0
TARGETS = RANDOM.normal(size=(5, 3)) * 4.0
DOWN = np.array([0.0, 0.0, 1.0])


def two_functions() -> Shape:
    """Offsets a (1 + t^2) + b t^3 on [0, 1], then a (2 + 2 (t - 1)) + b (1 + 3 (t - 1)) on [1, 3]."""
    c = np.zeros((4, 2, 2))
    c[:, 0, 0], c[:, 0, 1] = [0.0, 1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0]
    c[:, 1, 0], c[:, 1, 1] = [0.0, 0.0, 2.0, 2.0], [0.0, 0.0, 3.0, 1.0]
    return Shape(PPoly(c, np.array([0.0, 1.0, 3.0])), np.stack([PLACES, TARGETS]))


def written_out(t: Array, order: int) -> Array:
    """The same, function by function."""
    first = [[1 + t**2, t**3], [2 * t, 3 * t**2], [2 + 0 * t, 6 * t], [0 * t, 6 + 0 * t], [0 * t, 0 * t]][order]
    after = [[2 * t, 3 * t - 2], [2 + 0 * t, 3 + 0 * t], *[[0 * t, 0 * t]] * 3][order]
    a, b = (np.where(t < 1.0, x, y) for x, y in zip(first, after, strict=True))
    return np.asarray(PLACES[:, None] * a[:, None] + TARGETS[:, None] * b[:, None])


@pytest.mark.parametrize("order", range(5))
def test_offsets_are_the_sum_of_tables_times_functions(order: int) -> None:
    t = np.array([0.0, 0.2, 0.999, 1.0, 1.5, 3.0])
    np.testing.assert_allclose(two_functions().offsets(t, order), written_out(t, order), atol=1e-12)
    np.testing.assert_allclose(two_functions().at(1.5, order), written_out(np.array([1.5]), order)[:, 0], atol=1e-12)


def test_rows_are_those_rows_and_no_others() -> None:
    shape, t = two_functions(), np.linspace(0.0, 3.0, 7)
    rows = np.array([4, 0, 0])
    np.testing.assert_array_equal(shape.offsets(t, 1, rows), shape.offsets(t, 1)[rows])
    assert shape.offsets(t, 0, np.array([], dtype=np.intp)).shape == (0, 7, 3)
    assert shape.offsets(np.array([]), 2).shape == (5, 0, 3)


def test_a_rigid_shape_never_moves() -> None:
    shape = rigid(PLACES, -3.0, 8.0)
    t = np.array([-3.0, 0.0, 8.0])
    np.testing.assert_array_equal(shape.offsets(t), np.repeat(PLACES[:, None], 3, axis=1))
    np.testing.assert_array_equal(shape.offsets(t, 1), 0.0)
    assert shape.moving_s == ()
    assert not shape.is_moving(t).any()


@pytest.mark.parametrize("span", [(0.0, 1.0), (5.0, 5.25), (-7.0, 93.0)])
def test_stretched_is_the_same_shape_at_the_same_share_of_its_time(span: tuple[float, float]) -> None:
    """The n-th derivative falls with the n-th power of the length."""
    shape, share = two_functions(), np.array([0.0, 0.1, 0.33, 0.5, 0.99])
    slow = stretched(shape, *span)
    assert (slow.start_s, slow.end_s) == span
    factor = (span[1] - span[0]) / 3.0
    for order in range(4):
        found = slow.offsets(span[0] + share * (span[1] - span[0]), order) * factor**order
        np.testing.assert_allclose(found, shape.offsets(3.0 * share, order), atol=1e-9)


def test_stretched_ends_where_it_is_told_to_the_last_bit() -> None:
    for end_s in np.random.default_rng(5).uniform(1.0, 300.0, 200):
        turned = stretched(rotation(PLACES, DOWN, 2.0), 0.1, float(end_s))
        assert turned.end_s == end_s
        assert (np.diff(turned.joints_s) > 0).all()


def test_joined_is_each_part_in_its_time() -> None:
    parts = [
        rigid(PLACES, 0.0, 2.0),
        stretched(shrinking(PLACES, 0.5), 2.0, 5.0),
        rigid(0.5 * PLACES, 5.0, 6.0),
        stretched(straight(0.5 * PLACES, TARGETS), 6.0, 11.0),
    ]
    whole = joined(parts)
    assert (whole.start_s, whole.end_s) == (0.0, 11.0)
    for part in parts:
        t = np.linspace(part.start_s, part.end_s, 9)[:-1]
        for order in range(5):
            np.testing.assert_allclose(whole.offsets(t, order), part.offsets(t, order), atol=1e-12)
    np.testing.assert_allclose(whole.at(11.0), TARGETS, atol=1e-12)
    assert whole.moving_s == ((2.0, 5.0), (6.0, 11.0))


def test_a_joint_belongs_to_what_begins_there_and_the_last_one_to_what_ends() -> None:
    move, still = stretched(straight(PLACES, TARGETS), 1.0, 2.0), rigid(PLACES, 0.0, 1.0)
    shape = joined([still, move, rigid(TARGETS, 2.0, 3.0)])
    t = np.array([0.0, np.nextafter(1.0, 0.0), 1.0, 1.5, np.nextafter(2.0, 0.0), 2.0, 3.0, 9.0])
    np.testing.assert_array_equal(shape.is_moving(t), [False, False, True, True, True, False, False, False])
    ends_moving = joined([still, move])
    np.testing.assert_array_equal(ends_moving.is_moving(np.array([-1.0, 2.0])), [False, True])


def test_moves_that_touch_are_one_stretch() -> None:
    legs = [
        stretched(straight(PLACES, TARGETS), 1.0, 2.0),
        stretched(straight(TARGETS, PLACES), 2.0, 4.0),
        stretched(rotation(PLACES, DOWN, 1.0), 4.0, 5.0),
    ]
    assert joined(legs).moving_s == ((1.0, 5.0),)


def test_a_gap_between_parts_is_refused() -> None:
    with pytest.raises(ValueError, match=r"one shape ends at 2\.0 s, the next starts at 2\.5 s"):
        joined([rigid(PLACES, 0.0, 2.0), rigid(PLACES, 2.5, 3.0)])


def test_tables_and_functions_that_do_not_match_are_refused() -> None:
    functions = PPoly(np.ones((1, 1, 2)), np.array([0.0, 1.0]))
    with pytest.raises(ValueError, match="1 tables need functions"):
        Shape(functions, PLACES[None])
    with pytest.raises(ValueError, match=r"basis needs \(K, V, 3\)"):
        Shape(functions, PLACES)


@pytest.mark.parametrize("height_m", [0.0, 2.0])
@pytest.mark.parametrize("exponent", [0.0, 0.4])
def test_vehicles_move_apart_where_the_shape_changes_or_heights_differ_in_shear(
    height_m: float, exponent: float
) -> None:
    """A flat, a stepped and a changing part: the last one always, the second only in a wind that grows with height."""
    flat = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    stepped = flat - [[0.0, 0.0, 0.0], [0.0, 0.0, height_m]]
    change = Shape(PPoly(np.array([[[0.0, 1.0]], [[1.0, 0.0]]]), [4.0, 6.0]), np.stack([stepped, flat]))
    shape = joined([rigid(flat, 0.0, 2.0), rigid(stepped, 2.0, 4.0), change])
    wind = SteadyWind(8.0, 0.0, 10.0, exponent)
    in_shear = exponent > 0.0 and height_m > 0.0
    expected = [False, in_shear, in_shear, True, True]
    assert shape.moves_apart(np.array([1.0, 2.0, 3.0, 4.0, 5.9]), wind).tolist() == expected
    assert shape.apart_s(wind) == (((2.0, 6.0),) if in_shear else ((4.0, 6.0),))
