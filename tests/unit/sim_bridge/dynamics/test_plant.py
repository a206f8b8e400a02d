"""The true motion: Eq. 1 against another integrator and another hand, the motors, the ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gcs.physics.quadrotor import control_from_rotors, rotors_from_control
from sim_bridge.dynamics.integrator import Stepper, Turn
from sim_bridge.dynamics.plant import Motors, Plant
from tests.unit.sim_bridge.flights import F150, FIELD, flat_ground

STEP_S = 0.02


def eq1_by_rotation_matrix(state, control, q, wind):
    """Eq. 1 once more: thrust along the body's axis, turned by yaw, pitch, roll matrices."""
    roll, pitch, yaw = state[6:9]
    about_x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    about_y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    about_z = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    thrust = about_z @ about_y @ about_x @ [0.0, 0.0, -control[0]]
    force = thrust - np.array(q.drag_Nspm) * (state[3:6] - wind)
    inertia = np.diag(q.inertia_kgm2)
    rates = state[9:12]
    moment = np.array([q.arm_m, q.arm_m, 1.0]) * control[1:] - np.array(q.drag_moment_Nms) * rates
    turn = np.linalg.solve(inertia, moment - np.cross(rates, inertia @ rates))
    return np.concatenate([state[3:6], force / q.mass_kg + [0, 0, q.gravity_mps2], rates, turn])


def random_motion(q, seed=1):
    """States (12, 4), controls (4, 4) and wind (3, 4), livelier than any flight."""
    rng = np.random.default_rng(seed)
    state = np.concatenate([rng.normal(size=(6, 4)), 0.3 * rng.normal(size=(6, 4))])
    control = np.vstack([q.weight_N * (1 + 0.1 * rng.normal(size=4)), 0.01 * rng.normal(size=(3, 4))])
    return state, control, rng.normal(size=(3, 4))


@pytest.mark.parametrize("q", [F150, FIELD])
def test_the_stepper_agrees_with_an_independent_integrator(q):
    state, control, wind = random_motion(q)
    flown, stepper = state, Stepper(q, STEP_S)
    for _ in range(100):
        flown, _ = stepper(flown, control, wind)
    for i in range(4):
        exact = solve_ivp(
            lambda _, x, i=i: eq1_by_rotation_matrix(x, control[:, i], q, wind[:, i]),
            (0.0, 100 * STEP_S),
            state[:, i],
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
        )
        np.testing.assert_allclose(flown[:, i], exact.y[:, -1], atol=5e-5)


def test_without_drag_the_stepper_still_steps():
    q = replace(F150, drag_Nspm=(0.0, 0.0, 0.1), drag_moment_Nms=(0.0, 0.0, 0.0))
    state, control = np.zeros((12, 1)), np.zeros((4, 1))
    state[3] = 2.0
    fallen, _ = Stepper(q, STEP_S)(state, control, np.zeros((3, 1)))
    np.testing.assert_allclose(fallen[0, 0], 2.0 * STEP_S, rtol=1e-12)
    np.testing.assert_allclose(fallen[5, 0], 9.8 * STEP_S, rtol=1e-2)


@pytest.mark.parametrize("q", [F150, FIELD])
def test_a_falling_vehicle_ends_at_the_speed_at_which_drag_carries_it(q):
    plant = plant_in_the_air(1e4, q)
    for _ in range(round(150.0 / STEP_S)):
        plant.step(np.zeros((4, 1)), np.zeros((3, 1)))
    np.testing.assert_allclose(plant.state[5, 0], q.weight_N / q.drag_Nspm[2], rtol=1e-6)


def test_turning_there_and_back_is_no_turn():
    rng = np.random.default_rng(3)
    turn, vectors = Turn.of(rng.normal(size=(3, 5))), rng.normal(size=(3, 5))
    np.testing.assert_allclose(turn.to_body(turn.to_ned(vectors)), vectors, atol=1e-12)
    np.testing.assert_allclose(turn.to_ned(np.tile([[0.0], [0.0], [1.0]], 5)), turn.thrust_axis(), atol=1e-12)


def test_an_accelerometer_feels_what_gravity_does_not_explain():
    q = FIELD
    state, control, wind = random_motion(q, seed=4)
    stepper = Stepper(q, 1e-5)
    moved, turn = stepper(state, control, wind)
    felt = turn.to_ned(stepper.specific_force(moved, control, wind, turn))
    acceleration = (moved[3:6] - state[3:6]) / 1e-5
    np.testing.assert_allclose(felt, acceleration - [[0.0], [0.0], [9.8]], atol=1e-4)


def plant_in_the_air(height_m, q=F150, vehicles=1):
    """A plant whose ground fell away after take-off, so that the vehicles start at a height."""
    level = [0.0]
    plant = Plant(q, lambda n, _: n * 0 - level[0], np.zeros((vehicles, 3)), np.zeros(vehicles), STEP_S)
    lift = np.tile([[1.0001 * q.weight_N], [0.0], [0.0], [0.0]], vehicles)
    plant.step(lift, np.zeros((3, vehicles)))
    plant.state[5] = 0.0
    level[0] = height_m
    return plant


def hovering(q=F150):
    return np.array([[q.weight_N], [0.0], [0.0], [0.0]])


def test_hover_is_an_equilibrium_at_the_rotor_speed_of_the_weight():
    rotors = rotors_from_control(hovering().T, F150)
    np.testing.assert_allclose(rotors, 333.0, atol=0.1)
    plant = plant_in_the_air(10.0)
    start = plant.state.copy()
    for _ in range(250):
        plant.step(control_from_rotors(rotors, F150).T, np.zeros((3, 1)))
    np.testing.assert_allclose(plant.state, start, atol=1e-6)
    assert not plant.landed.any()
    np.testing.assert_allclose(plant.specific_force_mps2[:, 0], [0.0, 0.0, -9.8], atol=1e-9)


def test_wind_carries_a_hovering_vehicle_to_its_own_speed():
    plant = plant_in_the_air(10.0)
    wind = np.array([[1.0], [-2.0], [0.0]])
    for _ in range(3000):
        plant.step(hovering(), wind)
    share = 1.0 - np.exp(-60.0 * 0.073 / 0.5)
    np.testing.assert_allclose(plant.state[3:5], share * wind[:2], rtol=1e-6)


def test_saturated_motors_give_up_yaw_first_and_keep_the_thrust():
    wanted = np.array([[F150.weight_N, 0.4, 0.0, 5.0]])
    rotors = rotors_from_control(wanted, F150)
    had = control_from_rotors(rotors, F150)
    assert rotors.max() <= F150.rotor_max_radps * (1 + 1e-12) and rotors.min() >= 0.0
    np.testing.assert_allclose(had[0, :3], wanted[0, :3], rtol=1e-9, atol=1e-12)
    assert 0.0 < had[0, 3] < 0.1


@pytest.mark.parametrize("q", [F150, FIELD])
def test_motors_mix_like_eq_2_and_give_up_alike(q):
    rng = np.random.default_rng(5)
    motors = Motors(q)
    small = np.vstack([q.weight_N * (1 + 0.05 * rng.normal(size=20)), 0.005 * rng.normal(size=(3, 20))])
    for wanted, reachable in ((small, True), (small * 10.0, False)):
        squared, speeds, free = motors.speeds(wanted)
        assert free == reachable
        np.testing.assert_allclose(speeds, rotors_from_control(wanted.T, q).T, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(motors.control(squared), control_from_rotors(speeds.T, q).T, rtol=1e-9, atol=1e-9)


def test_a_vehicle_stands_still_until_thrust_exceeds_weight():
    plant = Plant(F150, flat_ground, np.zeros((2, 3)), np.array([0.3, 0.3]), STEP_S)
    control = np.array([[F150.weight_N, 0.05, 0.05, 0.02], [1.02 * F150.weight_N, 0.0, 0.0, 0.0]]).T
    for _ in range(50):
        plant.step(control, np.array([[1.0, 1.0], [1.0, 1.0], [0.0, 0.0]]))
    np.testing.assert_array_equal(plant.state[:, 0], [0, 0, 0, 0, 0, 0, 0, 0, 0.3, 0, 0, 0])
    np.testing.assert_array_equal(plant.specific_force_mps2[:, 0], [0.0, 0.0, -9.8])
    assert plant.landed.tolist() == [True, False]
    assert plant.state[2, 1] < -0.05


def hill(north_m, east_m):
    return 2.0 + np.sin(north_m) + 0.3 * east_m


def test_a_falling_vehicle_ends_level_at_rest_on_the_exact_ground_and_never_below_it():
    pads = np.array([[0.0, 0.0, 0.0], [5.0, 1.0, 0.0]])
    plant = Plant(F150, hill, pads, np.array([0.1, -0.2]), STEP_S)
    np.testing.assert_allclose(-plant.state[2], hill(pads[:, 0], pads[:, 1]))
    climb = np.tile([1.2 * F150.weight_N, 1e-3, -1e-3, 0.0], (2, 1)).T
    lowest = []
    for control in [climb] * 150 + [0.5 * climb] * 600:
        plant.step(control, np.zeros((3, 2)))
        north, east, down = plant.state[:3]
        lowest.append((-down - hill(north, east)).min())
    assert plant.landed.all()
    assert max(lowest) > 1.0
    # A step that ends below the ground is put back onto it within the same step.
    assert min(lowest) >= -1e-12
    assert np.hypot(*(plant.state[:2].T - pads[:, :2]).T).min() > 0.1
    np.testing.assert_array_equal(plant.state[3:8], 0.0)
    np.testing.assert_array_equal(plant.state[9:], 0.0)
