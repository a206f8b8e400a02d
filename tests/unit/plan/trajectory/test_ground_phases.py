"""Up, hovering and down solve Eq. 1 exactly: by substitution, and by somebody else's integrator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gcs.physics.quadrotor import Quadrotor, derivative
from gcs.plan.trajectory.ground_phases import smooth_step, vertical
from gcs.plan.trajectory.trajectory import Trajectory

Q = Quadrotor(0.5, 0.075, (0.0219, 0.0219, 0.0366), 1.105e-5, 1.779e-7, (0.073, 0.08, 0.095), (0.0055,) * 3, 400.0)
PLACE = np.array([-3.0, 7.0, -0.25])


@pytest.fixture(params=[-3.0, 1.5, -0.25], ids=["up", "down", "hover"])
def flown(request: pytest.FixtureRequest) -> Trajectory:
    return vertical(-7.3, 4.4, PLACE, request.param, 0.7, Q)


def test_eq_1_holds_at_every_instant(flown: Trajectory) -> None:
    times = np.linspace(-7.3, 4.4, 400)
    rates = derivative(flown.state(times), flown.control(times), Q)
    np.testing.assert_allclose(flown.state(times, nu=1), rates, atol=1e-12)


def test_an_integrator_that_knows_only_newton_ends_at_the_same_place(flown: Trajectory) -> None:
    """Vertical motion written out: m z'' = m g - U1 - K3 z'."""

    def newton(t: float, zw: np.ndarray) -> list[float]:
        thrust = flown.control(t)[0]
        return [zw[1], 9.8 - thrust / 0.5 - 0.095 / 0.5 * zw[1]]

    end = solve_ivp(newton, (-7.3, 4.4), [PLACE[2], 0.0], "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(end, flown.state(4.4)[[2, 5]], atol=1e-9)


def test_it_starts_and_ends_at_rest_where_it_was_told(flown: Trajectory) -> None:
    for t, down in ((-7.3, PLACE[2]), (4.4, flown.state(4.4)[2])):
        np.testing.assert_allclose(flown.state(t), [*PLACE[:2], down, 0, 0, 0, 0, 0, 0.7, 0, 0, 0], atol=1e-12)
        np.testing.assert_allclose(flown.control(t), [Q.weight_N, 0, 0, 0], atol=1e-12)


def test_the_smooth_step_is_c2_and_as_fast_as_its_docstring_says() -> None:
    step = smooth_step(2.0, 6.0, 10.0, 13.0)
    times = np.linspace(2.0, 6.0, 1001)
    assert step(2.0) == pytest.approx(10.0)
    assert step(6.0) == pytest.approx(13.0)
    for order in (1, 2):
        assert step(2.0, nu=order) == pytest.approx(0.0, abs=1e-12)
        assert step(6.0, nu=order) == pytest.approx(0.0, abs=1e-12)
    assert step(times, nu=1).max() == pytest.approx(15 / 8 * 3.0 / 4.0)
    assert (np.diff(step(times)[:, 0] if step(times).ndim > 1 else step(times)) >= 0).all()
