"""Turning keeps distances, shrinking ratios, straight is straight; all begin and end at rest, exactly in place."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from gcs.plan.formation import transforms
from gcs.plan.formation.shape import Shape
from gcs.plan.formation.time_scaling import smooth_step
from gcs.types import Array

R = np.linspace(0.0, 1.0, 211)
PLACES = np.concatenate([np.zeros((1, 3)), np.random.default_rng(3).normal(size=(7, 3)) * 6.0])
TARGETS = np.concatenate([np.zeros((1, 3)), np.random.default_rng(4).normal(size=(7, 3)) * 6.0])
AXIS = np.array([1.0, -2.0, 0.5])
DOWN = np.array([0.0, 0.0, 1.0])
ANGLES = [math.radians(deg) for deg in (-0.5, 1.0, 30.0, -90.0, 180.0, 360.0, 1000.0, -3600.0)]


def closed_form(angle_rad: float, order: int) -> Array:
    """Derivatives of exp(i angle s(r)) by the chain rule, written out (Faà di Bruno)."""
    s = [smooth_step()(R, nu=k) for k in range(5)]
    i = 1j * angle_rad
    chain = [
        np.ones_like(R),
        i * s[1],
        i * s[2] + i**2 * s[1] ** 2,
        i * s[3] + 3 * i**2 * s[1] * s[2] + i**3 * s[1] ** 3,
        i * s[4] + i**2 * (4 * s[1] * s[3] + 3 * s[2] ** 2) + 6 * i**3 * s[1] ** 2 * s[2] + i**4 * s[1] ** 4,
    ]
    return np.asarray(np.exp(i * s[0]) * chain[order])


@pytest.mark.parametrize("angle_rad", ANGLES)
def test_a_rotation_is_the_closed_form_to_a_millionth_of_a_micrometre(angle_rad: float) -> None:
    """East of the leader about the vertical: cos is along east, + turns right, towards south."""
    turn = transforms.rotation(np.array([[0.0, 1.0, 0.0]]), DOWN, angle_rad)
    for order, tolerance in enumerate((1e-12, 1e-11, 1e-9, 1e-7, 1e-5)):
        exact = closed_form(angle_rad, order)
        found = turn.offsets(R, order)[0]
        size = max(1.0, np.abs(exact).max())
        np.testing.assert_allclose(found[:, 1], exact.real, atol=tolerance * size)
        np.testing.assert_allclose(-found[:, 0], exact.imag, atol=tolerance * size)
        np.testing.assert_array_equal(found[:, 2], 0.0)


@pytest.mark.parametrize("angle_rad", ANGLES)
def test_a_rotation_has_no_jumps_where_its_pieces_meet(angle_rad: float) -> None:
    turn = transforms.rotation(PLACES, AXIS, angle_rad)
    joints = turn.joints_s[1:-1]
    for order in range(5):
        jump = np.abs(turn.offsets(joints, order) - turn.offsets(np.nextafter(joints, 0.0), order))
        assert jump.max() <= 1e-9 * max(1.0, np.abs(turn.offsets(joints, order)).max())


@pytest.mark.parametrize("angle_rad", ANGLES)
def test_a_rotation_keeps_all_distances_and_is_right_handed(angle_rad: float) -> None:
    turn = transforms.rotation(PLACES, AXIS, angle_rad)
    for r in R[::30]:
        np.testing.assert_allclose(pdist(turn.at(float(r))), pdist(PLACES), atol=1e-10)
    exact = Rotation.from_rotvec(angle_rad * AXIS / np.linalg.norm(AXIS)).apply(PLACES)
    np.testing.assert_allclose(turn.at(1.0), exact, atol=1e-12)
    np.testing.assert_allclose(transforms.rotated(PLACES, AXIS, angle_rad), exact, atol=1e-12)


def test_turning_right_takes_who_is_ahead_to_the_east() -> None:
    turn = transforms.rotation(np.array([[5.0, 0.0, 0.0]]), DOWN, math.pi / 2.0)
    np.testing.assert_allclose(turn.at(1.0), [[0.0, 5.0, 0.0]], atol=1e-14)


@pytest.mark.parametrize("scale", [0.3, 1.0, 2.5])
def test_shrinking_keeps_the_ratios_of_all_distances(scale: float) -> None:
    shrink = transforms.shrinking(PLACES, scale)
    for r in R[::30]:
        size = 1.0 + (scale - 1.0) * smooth_step()(r)
        np.testing.assert_allclose(pdist(shrink.at(float(r))), size * pdist(PLACES), rtol=1e-12)
    np.testing.assert_allclose(shrink.at(1.0), scale * PLACES, rtol=1e-14)


def test_straight_is_straight_and_everyone_is_in_step() -> None:
    move = transforms.straight(PLACES, TARGETS)
    share = smooth_step()(R)
    np.testing.assert_allclose(
        move.offsets(R), PLACES[:, None] + (TARGETS - PLACES)[:, None] * share[:, None], atol=1e-13
    )
    np.testing.assert_array_equal(move.at(0.0), PLACES)
    np.testing.assert_array_equal(move.at(1.0), TARGETS)


@pytest.mark.parametrize(
    "move",
    [
        transforms.straight(PLACES, TARGETS),
        transforms.shrinking(PLACES, 0.4),
        transforms.rotation(PLACES, AXIS, 2.5),
        transforms.rotation(PLACES, AXIS, -7.0),
    ],
    ids=["straight", "shrinking", "rotation", "more than a turn"],
)
def test_a_change_begins_and_ends_in_place_at_rest_and_never_moves_the_leader(move: Shape) -> None:
    np.testing.assert_allclose(move.at(0.0), PLACES, atol=1e-14)
    for order, tolerance in ((1, 1e-11), (2, 1e-10), (3, 1e-8)):
        assert np.abs(move.offsets(np.array([0.0, 1.0]), order)).max() < tolerance
    for order in range(5):
        np.testing.assert_array_equal(move.offsets(R, order)[0], 0.0)


def test_the_papers_times_are_of_the_longest_way_at_full_speed() -> None:
    places = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 7.0], [0.0, -2.0, 0.0]])
    assert transforms.paper_rotation_time_s(places, DOWN, -1.5, 2.0) == pytest.approx(1.5 * 5.0 / 2.0)
    assert transforms.paper_shrink_time_s(places, 0.25, 2.0) == pytest.approx(0.75 * math.sqrt(74.0) / 2.0)
    assert transforms.paper_shrink_time_s(places, 3.0, 2.0) == pytest.approx(2.0 * math.sqrt(74.0) / 2.0)
    assert transforms.paper_reshape_time_s(places, places[[0, 2, 1]], 2.0) == pytest.approx(math.sqrt(94.0) / 2.0)


def test_the_paper_is_never_slower_than_what_can_be_flown() -> None:
    """v_max from the first instant is a bound from below, for every time law with that v_max."""
    peak = 35.0 / 16.0
    paper = transforms.paper_reshape_time_s(PLACES, TARGETS, 1.0)
    assert paper < peak * transforms.reshape_paths_m(PLACES, TARGETS).max()
