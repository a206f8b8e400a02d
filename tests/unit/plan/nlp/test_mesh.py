"""Meshes of several legs: what stretching and splitting change, and what they leave."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.plan.nlp.mesh import HOLD, Mesh, counted, end_refined

# Two legs of 3 s and 8 s, between them a hold of 4 s.
HELD = Mesh(np.array([1.0, 2.0, 4.0, 8.0, 10.0, 16.0]), (3, 2, 0, 4, 5), np.array([3.0, 6.0, 13.0]), (0, 0, HOLD, 1, 1))
LENGTHS = st.lists(st.floats(0.1, 50.0), min_size=1, max_size=5)


def test_legs_are_told_from_the_hold_between_them() -> None:
    assert HELD.leg_count == 2
    assert HELD.leg_of_interval.tolist() == [0, 0, HOLD, 1, 1]
    assert HELD.leg_of_node.tolist() == [0] * 5 + [1] * 9
    assert HELD.leg_lengths_s.tolist() == [3.0, 8.0]
    assert HELD.arrivals.tolist() == [2]  # where the hold begins


def test_a_mesh_without_legs_is_one_leg() -> None:
    whole = Mesh(np.array([0.0, 1.0, 4.0]), (2, 3))
    assert (whole.leg_count, whole.leg_lengths_s.tolist(), whole.arrivals.size) == (1, [4.0], 0)
    assert whole.leg_of_node.tolist() == [0] * 5


def test_a_stretched_leg_moves_what_comes_after_it_and_no_hold_grows() -> None:
    longer = HELD.stretched(np.array([2.0, 0.5]))
    np.testing.assert_allclose(longer.joints_s, [1.0, 3.0, 7.0, 11.0, 12.0, 15.0])
    np.testing.assert_allclose(longer.extra_s, [5.0, 9.0, 13.5])
    assert (longer.degrees, longer.legs) == (HELD.degrees, HELD.legs)


def test_the_end_of_stretched_legs_is_exactly_the_one_that_is_known() -> None:
    longer = HELD.stretched(np.array([1.1, 1.3]), 18.7)
    assert longer.joints_s[-1] == 18.7
    np.testing.assert_allclose(longer.leg_lengths_s, [3.3, 10.4])


def test_one_leg_is_stretched_with_its_extra_instants() -> None:
    whole = Mesh(np.array([2.0, 3.0, 6.0]), (2, 3), np.array([4.0])).stretched(np.array([1.5]))
    np.testing.assert_allclose(whole.joints_s, [2.0, 3.5, 8.0])
    np.testing.assert_allclose(whole.extra_s, [5.0])


@settings(deadline=None)
@given(LENGTHS, st.lists(st.floats(0.05, 20.0), min_size=5, max_size=5))
def test_stretching_by_ones_changes_nothing_and_back_again_little(lengths_s: list[float], by: list[float]) -> None:
    legs: list[int] = []
    steps: list[float] = []
    for leg, length_s in enumerate(lengths_s):
        if leg % 2:  # before every second leg the leader holds
            legs.append(HOLD)
            steps.append(2.5)
        legs += [leg, leg]
        steps += [0.4 * length_s, 0.6 * length_s]
    joints_s = np.concatenate([[-3.0], np.cumsum(steps) - 3.0])
    mesh = Mesh(
        joints_s, tuple(0 if leg == HOLD else 3 for leg in legs), 0.5 * (joints_s[1:] + joints_s[:-1]), tuple(legs)
    )
    factors = np.array(by[: mesh.leg_count])
    assert mesh.stretched(np.ones(mesh.leg_count)) is mesh
    there = mesh.stretched(factors)
    np.testing.assert_allclose(there.leg_lengths_s, factors * mesh.leg_lengths_s, rtol=1e-9)
    held = mesh.leg_of_interval == HOLD
    np.testing.assert_allclose(np.diff(there.joints_s)[held], 2.5, rtol=1e-9)
    np.testing.assert_allclose(there.extra_s, 0.5 * (there.joints_s[1:] + there.joints_s[:-1]), rtol=1e-9)
    back = there.stretched(1.0 / factors)
    np.testing.assert_allclose(back.joints_s, joints_s, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(back.extra_s, mesh.extra_s, rtol=1e-9, atol=1e-9)


def test_holds_are_never_split() -> None:
    finer = HELD.split({1, 2, 4})
    assert finer.joints_s.tolist() == [1.0, 2.0, 3.0, 4.0, 8.0, 10.0, 13.0, 16.0]
    assert finer.legs == (0, 0, 0, HOLD, 1, 1, 1)
    assert finer.degrees == (3, 2, 2, 0, 4, 5, 5)
    assert finer.leg_lengths_s.tolist() == HELD.leg_lengths_s.tolist()
    assert finer.joints_s[finer.arrivals].tolist() == HELD.joints_s[HELD.arrivals].tolist()


def test_joints_that_do_not_grow_are_refused() -> None:
    with pytest.raises(ValueError, match="increasing joints"):
        Mesh(np.array([0.0, 1.0, 1.0]), (2, 2))


@pytest.mark.parametrize(
    ("intervals", "half", "lengths_s"),
    [
        (6, 15.0, [2.0, 3.0, 10.0]),
        (6, 6.0, [2.0, 2.0, 2.0]),  # no time to grow
        (8, 18.0, [2.0, 3.0, 4.5, 8.5]),
        (8, 11.0, [2.0, 3.0, 3.0, 3.0]),
        (2, 7.0, [7.0]),
    ],
)
def test_a_counted_mesh_grows_by_half_from_both_ends(intervals: int, half: float, lengths_s: list[float]) -> None:
    mesh = counted(3.0, 3.0 + 2.0 * half, intervals, 2.0, 4)
    np.testing.assert_allclose(np.diff(mesh.joints_s), lengths_s + lengths_s[::-1])
    assert (mesh.joints_s[0], mesh.joints_s[-1], mesh.degrees) == (3.0, 3.0 + 2.0 * half, (4,) * intervals)


@pytest.mark.parametrize(
    ("half", "lengths_s"),
    [
        (0.5, [0.5]),
        (5.0, [1.0, 1.5, 2.5]),  # what is left is no less than half of the step before it
        (4.9, [1.0, 1.5, 2.4]),
        (3.2, [1.0, 2.2]),  # 0.7 s would be less
        (20.0, [1.0, 1.5, 2.25, 3.375, 4.0, 4.0, 3.875]),  # no longer than 4 s
    ],
)
def test_a_mesh_is_fine_at_both_ends_and_no_interval_is_a_splinter(half: float, lengths_s: list[float]) -> None:
    mesh = end_refined(-2.0, -2.0 + 2.0 * half, 4.0, 1.0, 5)
    np.testing.assert_allclose(np.diff(mesh.joints_s), lengths_s + lengths_s[::-1])
    assert (mesh.joints_s[0], mesh.joints_s[-1]) == (-2.0, -2.0 + 2.0 * half)
    assert mesh.degrees == (5,) * (2 * len(lengths_s))


def test_instants_are_enforced_once() -> None:
    assert HELD.enforcing_at(np.array([6.0, 1.5])).extra_s.tolist() == [1.5, 3.0, 6.0, 13.0]
