"""Definition 1: what counts as being in formation, against pairs of vehicles, hand arithmetic and recorded flights."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from gcs.plan.trajectory.distances import formation_error_m, formation_errors_m
from gcs.scenario.values.formations import places_up_m
from gcs.types import Array

PLACES = places_up_m("triangle", 10, 4.0)
RECORDED = Path(__file__).parents[3] / "recorded"


def worst_pair_m(positions: Array, offsets: Array) -> Array:
    """Eq. 4, pair by pair: the largest |(xi_i - xi_j) - (h_i - h_j)| at each time (N,). It knows no centre."""
    pairs = combinations(range(len(positions)), 2)
    off = [(positions[i] - positions[j]) - (offsets[i] - offsets[j]) for i, j in pairs]
    return np.asarray(np.linalg.norm(off, axis=-1).max(axis=0))


def fitted_errors_m(positions: Array, offsets: Array) -> Array:
    """The distance of each vehicle (V,) from the formation laid over it by least squares, found by an iteration."""

    def residuals(centre: Array) -> Array:
        return np.asarray(positions - offsets - centre).ravel()

    centre = least_squares(residuals, np.zeros(3), xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    return np.asarray(np.sqrt(((positions - offsets - centre) ** 2).sum(axis=1)))


def recorded(autopilot: str) -> Array:
    """How far six real vehicles were off their places (V, N, 3), m."""
    with np.load(RECORDED / f"follow_{autopilot}.npz") as cut:
        return np.asarray(cut["off_mm"][..., :3] / 1e3)


def test_by_hand() -> None:
    """Three in a row, 10 m apart; the last is 3 m too far, so the centre moves 1 m: they are 1, 1 and 2 m off."""
    offsets = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [20.0, 0.0, 0.0]])[:, None]
    positions = np.array([[100.0, 50.0, -7.0], [110.0, 50.0, -7.0], [123.0, 50.0, -7.0]])[:, None]
    assert formation_errors_m(positions, offsets)[:, 0].tolist() == pytest.approx([1.0, 1.0, 2.0])
    assert formation_error_m(positions, offsets).tolist() == pytest.approx([2.0])


def test_a_right_angle_by_hand() -> None:
    """Four of which two are 4 m north and 4 m west of their places: the centre is 1 m off each way."""
    positions = np.zeros((4, 1, 3))
    positions[0, 0] = (4.0, 0.0, 0.0)
    positions[1, 0] = (0.0, -4.0, 0.0)
    errors = formation_errors_m(positions, np.zeros((4, 1, 3)))[:, 0]
    assert errors.tolist() == pytest.approx([10.0**0.5, 10.0**0.5, 2.0**0.5, 2.0**0.5])


def test_a_formation_that_is_elsewhere_as_a_whole_has_no_error() -> None:
    path = np.random.default_rng(1).normal(size=(1, 7, 3)) * 100.0
    offsets = np.repeat(PLACES[:, None], 7, axis=1)
    np.testing.assert_allclose(formation_error_m(path + offsets, offsets), 0.0, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_the_error_lies_between_half_the_worst_pair_and_the_worst_pair(seed: int) -> None:
    """Of two that are d off each other, one is d/2 off any centre; and the centre of all is no further than d."""
    rng = np.random.default_rng(seed)
    offsets = rng.normal(size=(6, 50, 3)) * 10.0
    positions = offsets + rng.normal(size=(1, 50, 3)) * 100.0 + rng.normal(size=(6, 50, 3))
    error, pair = formation_error_m(positions, offsets), worst_pair_m(positions, offsets)
    assert np.all(error >= 0.5 * pair - 1e-12)
    assert np.all(error <= pair + 1e-12)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_recorded_vehicles_are_off_by_what_pairs_and_a_fit_say(autopilot: str) -> None:
    off = recorded(autopilot)
    shape = np.repeat(places_up_m("triangle", len(off), 6.4)[:, None], off.shape[1], axis=1)
    positions = shape + off + np.array([300.0, -200.0, -40.0])
    error, pair = formation_error_m(positions, shape), worst_pair_m(positions, shape)
    assert np.all((0.5 * pair <= error + 1e-9) & (error <= pair + 1e-9))
    for n in range(0, off.shape[1], off.shape[1] // 10):
        wanted = fitted_errors_m(positions[:, n], shape[:, n])
        np.testing.assert_allclose(formation_errors_m(positions, shape)[:, n], wanted, atol=1e-6)
        assert error[n] == pytest.approx(wanted.max(), abs=1e-6)
