"""Windows of 5 s: against a closed form, and against another integrator where the control was spoiled."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import Quadrotor, equations_of_motion
from gcs.plan.trajectory.ground_phases import vertical
from gcs.plan.trajectory.integration_windows import WindowErrors, window_errors
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.types import Array

Q = Quadrotor(0.5, 0.075, (0.0219, 0.0219, 0.0366), 1.105e-5, 1.779e-7, (0.073,) * 3, (0.0055,) * 3, 400.0)


def errors(flown: Trajectory, window_s: float = 5.0) -> WindowErrors:
    return window_errors(lambda t: flown.state(t)[None], lambda t: flown.control(t)[None], flown.joints_s, Q, window_s)


def spoiled(flown: Trajectory, by: Array) -> Trajectory:
    """Another control: a constant on top."""
    control = flown.control.c.copy()
    control[-1] += by
    return Trajectory(flown.state, PPoly(control, flown.control.x))


def test_an_exact_motion_has_no_error() -> None:
    assert errors(vertical(0.0, 12.0, np.zeros(3), -3.0, 0.3, Q)).error_m.max() < 1e-9


def test_too_much_thrust_in_a_hover_is_a_fall_with_drag() -> None:
    """m w' = -d - K w from rest, so z = -d/K (t - m/K (1 - exp(-K t / m)))."""
    extra, tau = 0.01, 0.5 / 0.073
    hover = spoiled(vertical(0.0, 12.0, np.zeros(3), 0.0, 0.0, Q), np.array([extra, 0, 0, 0]))
    found = errors(hover)
    for start, error in zip(found.start_s, found.error_m[0], strict=True):
        t = min(5.0, 12.0 - start)  # the last windows end with the flight
        assert error == pytest.approx(extra / 0.073 * (t - tau * (1 - np.exp(-t / tau))), rel=1e-6)
    assert found.start_s.tolist() == list(range(12))


def test_the_length_of_a_window_is_what_is_asked() -> None:
    hover = spoiled(vertical(0.0, 12.0, np.zeros(3), 0.0, 0.0, Q), np.array([0.01, 0, 0, 0]))
    assert errors(hover, 2.0).error_m.max() < errors(hover, 4.0).error_m.max() / 3


def test_windows_start_at_joints_too_and_every_vehicle_has_its_own(meadow_plan: Plan) -> None:
    plan = meadow_plan
    found = window_errors(plan.states, plan.controls, plan.joints_s, plan.quadrotor)
    assert set(plan.joints_s[:-1]) <= set(found.start_s)
    assert np.diff(found.start_s).max() <= 1.0 + 1e-9
    assert found.error_m.shape == (3, len(found.start_s))
    assert found.error_m.max() < 1e-3


def test_a_spoiled_flight_errs_as_scipy_says(meadow_plan: Plan) -> None:
    """Every fifth window, in an adaptive integrator of order eight that starts anew at each joint."""
    flown = spoiled(meadow_plan.leader_trajectory, np.array([0.003, 1e-5, -2e-5, 1e-5]))
    found = errors(flown)

    def eq_1(piece: int, t: float, x: Array) -> Array:
        since = t - flown.joints_s[piece]
        u = np.array([np.polyval(flown.control.c[:, piece, i], since) for i in range(4)])
        return np.array(equations_of_motion(tuple(x), tuple(u), Q))

    for window in range(0, len(found.start_s), 5):
        start = found.start_s[window]
        end = min(start + 5.0, flown.end_s)
        stops = [start, *flown.joints_s[(flown.joints_s > start) & (flown.joints_s < end)], end]
        x, worst = flown.state(start), 0.0
        for low, high in itertools.pairwise(stops):
            piece = int(np.searchsorted(flown.joints_s, low, side="right")) - 1
            grid = np.linspace(low, high, 40)
            leg = solve_ivp(lambda t, y, p=piece: eq_1(p, t, y), (low, high), x, "DOP853", grid, rtol=1e-10, atol=1e-12)
            worst = max(worst, np.linalg.norm(leg.y[:3] - flown.state(grid).T[:3], axis=0).max())
            x = leg.y[:, -1]
        assert found.error_m[0, window] == pytest.approx(worst, rel=2e-3)
        assert worst > 1e-3 or end - start < 2.0  # there was something to measure
