"""The series of Eq. 1 against a library's integrator, which knows nothing of series."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gcs.physics.quadrotor import Quadrotor, equations_of_motion
from gcs.physics.wind import SteadyWind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof.power_series import motion_series
from gcs.types import Array

UNIT_S = 0.06
CONTROLS = np.array([[4.9, 0.4, -0.2], [0.01, 0.02, 0.0], [-0.02, 0.0, 0.03], [0.002, -0.003, 0.0]])  # (4, powers)


def flown(q: Quadrotor, state: Array, end_s: float) -> Array:
    """The state after a time, by an explicit Runge-Kutta method of order 8."""

    def slope(t_s: float, x: Array) -> Array:
        u = [sum(c * (t_s / UNIT_S) ** k for k, c in enumerate(row)) for row in CONTROLS]
        return np.array(equations_of_motion(x, u, q), dtype=np.float64)

    found = solve_ivp(slope, (0.0, end_s), state, method="DOP853", rtol=1e-12, atol=1e-13)
    return np.asarray(found.y[:, -1])


def begin(rng: np.random.Generator) -> Array:
    return np.concatenate(
        [rng.uniform(-20, 20, 2), [-rng.uniform(0.2, 12.0)], rng.uniform(-3, 3, 3), rng.uniform(-0.5, 0.5, 6)]
    )


def control(order: int, count: int) -> Array:
    c = np.zeros((order + 1, 4, count))
    c[:3] = CONTROLS.T[:, :, None]
    return c


WINDS = {
    "calm": SteadyWind(),
    "even": SteadyWind(3.0, -2.0),
    "sheared": SteadyWind(4.0, 1.0, reference_m=10.0, exponent=0.4),
}


@pytest.mark.parametrize("wind", WINDS)
def test_the_series_is_the_solution_of_eq_1(meadow_plan: Plan, wind: str) -> None:
    q = replace(meadow_plan.quadrotor, wind=WINDS[wind])
    rng = np.random.default_rng(7)
    states = np.stack([begin(rng) for _ in range(6)], axis=1)
    series = motion_series(states, control(9, 6), np.full(6, UNIT_S), q)
    for share in (0.5, 1.0):
        at = (series * share ** np.arange(10)[:, None, None]).sum(axis=0)
        for n in range(6):
            exact = flown(q, states[:, n], share * UNIT_S)
            np.testing.assert_allclose(at[:, n], exact, rtol=1e-9, atol=1e-9)


def test_what_is_left_out_falls_with_the_order(meadow_plan: Plan) -> None:
    q = replace(meadow_plan.quadrotor, wind=WINDS["sheared"])
    state = begin(np.random.default_rng(8))
    exact = flown(q, state, UNIT_S)
    off = [
        np.abs(motion_series(state[:, None], control(order, 1), np.array([UNIT_S]), q).sum(axis=0)[:, 0] - exact).max()
        for order in (3, 5, 7)
    ]
    assert np.all(np.array(off[1:]) < 0.05 * np.array(off[:-1]))


def test_time_is_counted_in_units(meadow_plan: Plan) -> None:
    """A series in units half as long has coefficients 2^k times smaller, where the control does not change."""
    state = begin(np.random.default_rng(9))[:, None]
    steady = control(6, 1)
    steady[1:] = 0.0
    whole, half = (motion_series(state, steady, np.array([unit]), meadow_plan.quadrotor) for unit in (0.1, 0.05))
    np.testing.assert_allclose(half * 2.0 ** np.arange(7)[:, None, None], whole, rtol=1e-10, atol=1e-14)
