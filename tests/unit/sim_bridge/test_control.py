"""The controller: gains from physics, feed-forward from flatness, and what is given up first."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.quadrotor import derivative, thrust_and_tilt
from sim_bridge.control import Controller, tilt_along
from sim_bridge.gains import ControlLimits, chain_gain, lqr_gains, motor_limits
from sim_bridge.reference import Reference, hold
from tests.unit.sim_bridge.flights import F150, F150_LIMITS, FIELD, course

VEHICLES = [(F150, F150_LIMITS), (F150, motor_limits(F150)), (FIELD, motor_limits(FIELD))]


def test_the_gain_of_a_double_integrator_has_its_closed_form():
    authority, scale = 2.0, 0.5
    stiffness = authority / scale
    np.testing.assert_allclose(
        chain_gain((1.0,), (scale, np.inf), authority), [stiffness, np.sqrt(2.0 * stiffness)], rtol=1e-9
    )


@pytest.mark.parametrize(("q", "limits"), VEHICLES)
def test_every_chain_is_stable_and_well_damped_whatever_the_vehicle(q, limits):
    gains = lqr_gains(q, limits)
    for gain, links in ((gains.tilt, (1.0, q.gravity_mps2, 1.0)), (gains.height, (1.0,)), (gains.yaw, (1.0,))):
        closed = np.diag(links, 1)
        closed[-1] -= gain
        poles = np.linalg.eigvals(closed)
        damping = -poles.real / np.abs(poles)
        assert damping.min() > 0.35
        assert np.abs(poles).max() < 25.0  # rad/s: a quarter of what 100 Hz control can follow


def test_the_weak_vehicle_uses_its_feedback_share_for_a_decimetre():
    gain = lqr_gains(F150, F150_LIMITS).tilt
    turn = 0.3 * F150.arm_m * 0.0501 / 0.0219
    np.testing.assert_allclose(gain[0] * 0.1, turn, rtol=1e-6)


def test_a_vehicle_that_cannot_lift_itself_is_refused():
    with pytest.raises(ValueError, match="does not lift"):
        Controller(F150, ControlLimits(4.8, (0.05, 0.05, 0.02)))


def test_feed_forward_rates_and_accelerations_are_derivatives_of_the_tilt():
    flight = course(yaw_swing_rad=0.4)
    pads = np.zeros((1, 3))

    def tilt(k):
        r = flight.at(k, pads)
        _, roll, pitch = thrust_and_tilt(r.acceleration_ned_mps2, r.velocity_ned_mps, r.yaw_ned_rad, F150)
        return np.column_stack([roll, pitch])

    for k in (5000, 6000, 8500):
        r = flight.at(k, pads)
        _, rate, turn = tilt_along(r, r.acceleration_ned_mps2, r.velocity_ned_mps, r.yaw_ned_rad, F150)
        h = 0.2
        before, now, after = tilt(k - 20), tilt(k), tilt(k + 20)
        np.testing.assert_allclose(rate, (after - before) / (2 * h), atol=2e-4)
        np.testing.assert_allclose(turn, (after - 2 * now + before) / h**2, atol=5e-4)


@pytest.mark.parametrize(("q", "limits"), VEHICLES)
def test_on_the_reference_the_control_makes_exactly_the_wanted_acceleration(q, limits):
    flight = course(yaw_swing_rad=0.0)
    r = flight.at(6000, np.zeros((1, 3)))
    tilt, rate, turn = tilt_along(r, r.acceleration_ned_mps2, r.velocity_ned_mps, r.yaw_ned_rad, q)
    state = np.zeros((1, 12))
    state[:, :3], state[:, 3:6] = r.position_ned_m, r.velocity_ned_mps
    state[:, 6:8], state[:, 8], state[:, 9:11] = tilt, r.yaw_ned_rad, rate
    control = Controller(q, limits).command(r, state, np.array([False]))
    moving = derivative(state, control, q)
    np.testing.assert_allclose(moving[:, 3:6], r.acceleration_ned_mps2, atol=1e-9)
    np.testing.assert_allclose(moving[:, 9:11], turn, atol=1e-9)


def test_far_away_it_asks_for_no_more_than_the_limits_and_keeps_the_height():
    controller = Controller(F150, F150_LIMITS)
    state = np.zeros((1, 12))
    state[0, 6:8] = 0.1, -0.1
    far = hold(np.array([[1e3, -1e3, 0.0]]), np.array([3.0]))
    control = controller.command(far, state, np.array([False]))[0]
    assert control[0] <= F150_LIMITS.thrust_N
    assert (np.abs(control[1:]) <= F150_LIMITS.torque).all()
    lift = control[0] * np.cos(0.1) ** 2
    np.testing.assert_allclose(lift, F150.weight_N, rtol=1e-6)


def test_yaw_takes_the_short_way_round():
    controller, state = Controller(F150, F150_LIMITS), np.zeros((1, 12))
    state[0, 8] = np.radians(179.0)
    there = hold(np.zeros((1, 3)), np.array([np.radians(-179.0)]))
    assert controller.command(there, state, np.array([False]))[0, 3] > 0.0


def test_on_the_ground_it_idles_until_the_reference_rises():
    controller, state, ground = Controller(F150, F150_LIMITS), np.zeros((1, 12)), np.array([True])
    still = hold(np.array([[5.0, 0.0, -5.0]]), np.zeros(1))
    idle = controller.command(still, state, ground)[0]
    assert 0.0 < idle[0] < 0.5 * F150.weight_N
    np.testing.assert_array_equal(idle[1:], 0.0)
    zero = np.zeros((1, 3))
    up = Reference(zero, zero, np.array([[0.0, 0.0, -0.1]]), zero, zero, np.zeros(1), np.zeros(1))
    assert controller.command(up, state, ground)[0, 0] > F150.weight_N


def test_a_reference_of_the_wrong_shape_is_refused():
    with pytest.raises(ValueError, match="position_ned_m"):
        hold(np.zeros((2, 2)), np.zeros(2))
