"""The controller: gains from physics, feed-forward from flatness, what pushes, and what is given up first."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete

from gcs.physics.quadrotor import derivative, thrust_and_tilt
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S
from sim_bridge.dynamics.controller import Controller, DisturbanceObserver, tilt_along
from sim_bridge.dynamics.integrator import Stepper, Turn
from sim_bridge.dynamics.lqr_gains import ControlLimits, chain_gain, lqr_gains, motor_limits
from sim_bridge.dynamics.position_control import AROUND, PositionController
from sim_bridge.dynamics.sensors import RTK
from tests.unit.sim_bridge.flights import (
    F150,
    F150_LIMITS,
    FIELD,
    FIELD_LIMITS,
    YAW_RAD,
    course,
    fly,
    hold,
    reference_of,
    stand,
    steps,
)

VEHICLES = [(F150, F150_LIMITS), (F150, motor_limits(F150)), (FIELD, motor_limits(FIELD))]


def test_the_gain_of_a_double_integrator_has_its_closed_form():
    authority, scale = 2.0, 0.5
    stiffness = authority / scale
    np.testing.assert_allclose(
        chain_gain((1.0,), (scale, np.inf), authority), [stiffness, np.sqrt(2.0 * stiffness)], rtol=1e-9
    )


@pytest.mark.parametrize(("q", "limits"), VEHICLES)
def test_every_chain_is_stable_and_well_damped_whatever_the_vehicle(q, limits):
    """As sampled: controls are held for a step, which delays them by half of one."""
    gains = lqr_gains(q, limits)
    for gain, links in ((gains.tilt, (1.0, q.gravity_mps2, 1.0)), (gains.height, (1.0,)), (gains.yaw, (1.0,))):
        chain, drive = np.diag(links, 1), np.eye(len(gain))[:, -1:]
        step, held, *_ = cont2discrete((chain, drive, np.eye(len(gain)), np.zeros_like(drive)), CONTROL_PERIOD_S)
        poles = np.log(np.linalg.eigvals(step - held @ gain[None]).astype(complex)) / CONTROL_PERIOD_S
        damping = -poles.real / np.abs(poles)
        assert damping.min() > 0.35
        assert np.abs(poles).max() < 25.0  # rad/s: half a radian in a step


def test_the_weak_vehicle_uses_its_feedback_share_for_a_decimetre():
    gain = lqr_gains(F150, F150_LIMITS).tilt
    turn = 0.3 * F150.arm_m * 0.0501 / 0.0219
    np.testing.assert_allclose(gain[0] * 0.1, turn, rtol=1e-6)


def test_a_vehicle_that_cannot_lift_itself_is_refused():
    with pytest.raises(ValueError, match="does not lift"):
        Controller(F150, ControlLimits(4.8, (0.05, 0.05, 0.02)), 1, CONTROL_PERIOD_S)


def wanted_force(r, q):
    """What Eq. 1 leaves to the rotors on the reference itself, around now, (3, 3, V)."""
    drag, gravity = np.array(q.drag_Nspm), np.array([0.0, 0.0, q.gravity_mps2])
    force = q.mass_kg * (gravity - r[:, 2, :3]) - drag * r[:, 1, :3]
    first = -q.mass_kg * r[:, 3, :3] - drag * r[:, 2, :3]
    second = -q.mass_kg * r[:, 4, :3] - drag * r[:, 3, :3]
    return np.array([(force + t * first + 0.5 * t * t * second).T for t in AROUND])


def test_feed_forward_rates_and_accelerations_are_derivatives_of_the_tilt():
    flight = course(yaw_swing_rad=0.4)
    pads = np.zeros((1, 3))

    def tilt(k):
        r = flight.at(k, pads)
        _, roll, pitch = thrust_and_tilt(r[:, 2, :3], r[:, 1, :3], r[:, 0, 3], F150)
        return np.stack([roll, pitch])

    for k in map(steps, (50.0, 60.0, 85.0)):
        r = flight.at(k, pads)
        angles, rate, turn = tilt_along(wanted_force(r, F150), r[:, 0, 3], r[:, 1, 3])
        h = 0.2
        before, now, after = tilt(k - steps(h)), tilt(k), tilt(k + steps(h))
        np.testing.assert_allclose(angles, now, atol=1e-12)
        np.testing.assert_allclose(rate, (after - before) / (2 * h), atol=2e-4)
        np.testing.assert_allclose(turn, (after - 2 * now + before) / h**2, atol=5e-4)


@pytest.mark.parametrize(("q", "limits"), VEHICLES)
def test_the_law_without_limits_is_the_law_within_its_limits(q, limits):
    """One matrix where nothing is limited; a slow vehicle, slow at 1 km/s, goes the long way to the same force."""
    law, slow = PositionController(q, limits), PositionController(q, limits)
    slow.speed_max_mps = np.full(50, 1e3)
    rng = np.random.default_rng(7)

    def near(size):
        return size * rng.normal(size=(50, 3))

    r = reference_of(near(0.1), near(3.0), near(0.1), near(0.1), near(0.1), np.zeros(50), np.zeros(50))
    state = np.concatenate((r[:, 0, :3].T, r[:, 1, :3].T, np.zeros((6, 50)))) + 0.005 * rng.normal(size=(12, 50))
    push = 0.02 * rng.normal(size=(3, 50))
    np.testing.assert_allclose(law(r, state, push), slow(r, state, push), rtol=1e-9, atol=1e-9)
    state[:3] += 2e3 * rng.normal(size=(3, 50))
    far = law(r, state, push)[1]
    np.testing.assert_allclose(far, slow(r, state, push)[1], rtol=1e-9, atol=1e-9)
    assert (np.linalg.norm(far, axis=0) <= limits.thrust_N * (1 + 1e-12)).all()


def new_controller(q, limits):
    return Controller(q, limits, 1, CONTROL_PERIOD_S)


def first_command(controller, reference, state, *, landed=False):
    """Controls (4,) for one vehicle's state (12,)."""
    applied = np.zeros((4, 1))
    return controller.command(reference, state[:, None], applied, np.array([landed]), any_landed=landed)[:, 0]


@pytest.mark.parametrize(("q", "limits"), VEHICLES)
def test_on_the_reference_the_control_makes_exactly_the_wanted_acceleration(q, limits):
    r = course(yaw_swing_rad=0.0).at(steps(60.0), np.zeros((1, 3)))
    tilt, rate, turn = tilt_along(wanted_force(r, q), r[:, 0, 3], r[:, 1, 3])[..., 0]
    state = np.zeros(12)
    state[:3], state[3:6] = r[:, 0, :3][0], r[:, 1, :3][0]
    state[6:8], state[8], state[9:11] = tilt, r[:, 0, 3][0], rate
    moving = derivative(state, first_command(new_controller(q, limits), r, state), q)
    np.testing.assert_allclose(moving[3:6], r[:, 2, :3][0], atol=1e-9)
    np.testing.assert_allclose(moving[9:11], turn, atol=1e-9)


def test_far_away_it_asks_for_no_more_than_the_limits_and_keeps_the_height():
    state = np.zeros(12)
    state[6:8] = 0.1, -0.1
    far = hold(np.array([[1e3, -1e3, 0.0]]), np.array([3.0]))
    control = first_command(new_controller(F150, F150_LIMITS), far, state)
    assert control[0] <= F150_LIMITS.thrust_N
    assert (np.abs(control[1:]) <= F150_LIMITS.torque).all()
    lift = control[0] * np.cos(0.1) ** 2
    np.testing.assert_allclose(lift, F150.weight_N, rtol=1e-6)


def test_yaw_takes_the_short_way_round():
    state = np.zeros(12)
    state[8] = np.radians(179.0)
    there = hold(np.zeros((1, 3)), np.array([np.radians(-179.0)]))
    assert first_command(new_controller(F150, F150_LIMITS), there, state)[3] > 0.0


def test_on_the_ground_it_idles_until_the_reference_rises():
    controller, state = new_controller(F150, F150_LIMITS), np.zeros(12)
    still = hold(np.array([[5.0, 0.0, -5.0]]), np.zeros(1))
    idle = first_command(controller, still, state, landed=True)
    assert 0.0 < idle[0] < 0.5 * F150.weight_N
    np.testing.assert_array_equal(idle[1:], 0.0)
    zero = np.zeros((1, 3))
    up = reference_of(zero, zero, np.array([[0.0, 0.0, -0.1]]), zero, zero, np.zeros(1), np.zeros(1))
    assert first_command(controller, up, state, landed=True)[0] > F150.weight_N


def test_a_slow_vehicle_is_asked_for_no_more_speed_than_it_has():
    quick, slow = new_controller(FIELD, FIELD_LIMITS), new_controller(FIELD, FIELD_LIMITS)
    slow.slow_down(np.array([2.0]))
    zero = np.zeros((1, 3))
    past = reference_of(zero, np.array([[4.0, 0.0, 0.0]]), zero, zero, zero, np.zeros(1), np.zeros(1))
    state = np.zeros(12)
    state[3] = 3.0
    assert first_command(quick, past, state)[2] < 0.0  # pitches forward to gain speed
    assert first_command(slow, past, state)[2] > 0.0


def observer(q, period_s=0.02):
    gains = lqr_gains(q, motor_limits(q))
    return DisturbanceObserver(q, gains.push_radps, gains.push_max, period_s, 1)


@pytest.mark.parametrize("q", [F150, FIELD])
def test_a_constant_push_is_observed_and_a_step_of_the_control_is_not(q):
    """Wind of 1 m/s and a twist of 0.01 rad/s², on a level vehicle that tumbles for lack of control."""
    watch, h = observer(q), 0.02
    stepper = Stepper(q, h)
    state, wind, none = np.zeros((12, 1)), np.array([[1.0], [0.0], [0.0]]), np.zeros((3, 1))
    applied = np.array([[q.weight_N], [0.0], [0.0], [0.0]])
    for k in range(500):
        thrust = Turn.of(state[6:9]).thrust_axis() * applied[0]
        watch.observe(np.concatenate((state[3:6], state[9:])), thrust, applied[1:], none)
        applied = np.array([[q.weight_N * (1.02 if k > 250 else 1.0)], [0.0], [0.0], [0.0]])
        state, _ = stepper(state, applied, wind)
    expected = [q.drag_Nspm[0] / q.mass_kg, 0.0, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(watch.push[:, 0], expected, atol=2e-3)


def test_what_a_limit_withholds_is_not_mistaken_for_a_push():
    """Nothing winds up: the observer receives what the rotors produced, not what was wanted."""
    pads = np.zeros((1, 3))
    airframes = stand(F150, F150_LIMITS, RTK, pads, seed=2)
    away = hold(np.array([[50.0, 0.0, -3.0]]), np.array([YAW_RAD]))
    up = course(yaw_swing_rad=0.0)
    fly(airframes, up.part(0.0, 12.0), pads)
    for _ in range(steps(4.0)):
        airframes.step(away, np.array([True]))
    assert np.abs(airframes.control[0, 1:3]).max() > 0.0
    assert np.abs(airframes.controller.push[:3]).max() < 0.03


def test_a_reference_of_the_wrong_shape_is_refused():
    two = hold(np.zeros((2, 3)), np.zeros(2))
    for wrong in (two, two[:1, :4], two[:1, :, :2]):
        with pytest.raises(ValueError, match="the reference must have shape"):
            first_command(new_controller(F150, F150_LIMITS), wrong, np.zeros(12))
