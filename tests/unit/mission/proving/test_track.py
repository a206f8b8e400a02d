"""The motion of a fleet beside its mean, and its steps at joints."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PPoly

import gcs
from gcs.mission.proving.track import FleetMotion

NOTHING = np.zeros(0)


def together(rng: np.random.Generator, vehicles: int) -> list[gcs.PolynomialTrack]:
    """A formation that keeps its shape along one curve of degree 7, with steps of it at the joints."""
    course, x = rng.normal(0.0, 1.0, (8, 5, 3)), np.cumsum(rng.uniform(0.5, 2.0, 6))
    tracks = []
    for row in range(vehicles):
        c = course.copy()
        c[-1] += rng.uniform(-9.0, 9.0, 3)
        tracks.append(gcs.PolynomialTrack(f"v{row}", PPoly(c, x)))
    return tracks


def test_beside_the_mean_a_formation_that_keeps_its_shape_stands() -> None:
    motion = FleetMotion.of(together(np.random.default_rng(1), 5), NOTHING)
    low, high, slow, fast = motion.relative.windows[-1]
    assert np.abs(high - low).max() < 1e-6
    assert max(np.abs(slow).max(), np.abs(fast).max()) < 1e-6


def test_differences_are_the_same_beside_the_mean_where_some_have_joints_of_their_own() -> None:
    rng = np.random.default_rng(2)
    first, second, third = together(rng, 3)
    inner = PPoly(rng.normal(0.0, 1.0, (3, 2, 3)), [2.0, 2.6, 3.3])
    motion = FleetMotion.of([first, second, third, gcs.PolynomialTrack("own", inner)], NOTHING)
    t_s = rng.uniform(motion.edges_s[0], motion.edges_s[-1], 500)
    for a, b in ((0, 1), (1, 3), (2, 3)):
        rows = np.full(len(t_s), a), np.full(len(t_s), b)
        apart, beside = (each.places(rows[0], t_s) - each.places(rows[1], t_s) for each in (motion, motion.relative))
        np.testing.assert_allclose(beside, apart, atol=1e-8)


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_steps_are_those_of_the_polynomials_at_their_joints(derivative: int) -> None:
    tracks = together(np.random.default_rng(3), 2)
    motion = FleetMotion.of(tracks, np.array([1.7, 4.1]))
    steps = motion.steps(derivative)
    for row, track in enumerate(tracks):
        of = track.position_ned_m.derivative(derivative)
        for joint in range(1, 5):
            at_s = of.x[joint]
            before = [np.polyval(of.c[:, joint - 1, axis], at_s - of.x[joint - 1]) for axis in range(3)]
            (piece,) = np.flatnonzero((motion.row == row) & (motion.starts_s == at_s))
            assert steps[piece] == pytest.approx(np.linalg.norm(of.c[-1, joint] - before), rel=1e-6)
    assert (np.sort(steps)[:-8] < 1e-6).all()  # none where windows divide a piece
