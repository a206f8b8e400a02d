"""The true motion: Eq. 1 against another integrator and another hand, the motors, the ground."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gcs.quadrotor import control_from_rotors, rotors_from_control
from sim_bridge.motion import derivative as fleet_derivative
from sim_bridge.motion import jacobian, rk4
from sim_bridge.plant import Plant
from tests.unit.sim_bridge.flights import F150, FIELD, flat_ground

STEP_S = 0.01


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


@pytest.mark.parametrize("q", [F150, FIELD])
def test_rk4_agrees_with_an_independent_integrator(q):
    rng = np.random.default_rng(1)
    state = np.concatenate([rng.normal(size=(6, 4)), 0.3 * rng.normal(size=(6, 4))])
    control = np.vstack([q.weight_N * (1 + 0.1 * rng.normal(size=4)), 0.01 * rng.normal(size=(3, 4))])
    wind = rng.normal(size=(3, 4))
    flown = state
    for _ in range(200):
        flown = rk4(flown, control, q, wind, STEP_S)
    for i in range(4):
        exact = solve_ivp(
            lambda _, x, i=i: eq1_by_rotation_matrix(x, control[:, i], q, wind[:, i]),
            (0.0, 200 * STEP_S),
            state[:, i],
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
        )
        np.testing.assert_allclose(flown[:, i], exact.y[:, -1], atol=2e-8)


def test_jacobian_agrees_with_finite_differences():
    rng = np.random.default_rng(2)
    state, h = rng.normal(size=(12, 5)), 1e-6
    control = np.vstack([F150.weight_N + rng.normal(size=5), 0.05 * rng.normal(size=(3, 5))])
    exact = jacobian(state, control, F150)
    for k in range(12):
        nudge = np.zeros((12, 1))
        nudge[k] = h
        up, down = (fleet_derivative(state + sign * nudge, control, F150) for sign in (1, -1))
        np.testing.assert_allclose(exact[:, :, k], ((up - down) / (2 * h)).T, atol=1e-7)


def plant_in_the_air(height_m, q=F150, vehicles=1):
    """A plant whose ground fell away after take-off, so that the vehicles start at a height."""
    level = [0.0]
    plant = Plant(q, lambda n, _: n * 0 - level[0], np.zeros((vehicles, 3)), np.zeros(vehicles))
    lift = np.tile([1.01 * q.weight_N, 0, 0, 0], (vehicles, 1))
    plant.step(lift, np.zeros((vehicles, 3)), 1e-6)
    level[0] = height_m
    return plant


def test_hover_is_an_equilibrium_at_the_rotor_speed_of_the_weight():
    rotors = rotors_from_control(np.array([[F150.weight_N, 0.0, 0.0, 0.0]]), F150)
    np.testing.assert_allclose(rotors, 333.0, atol=0.1)
    plant = plant_in_the_air(10.0)
    start = plant.state.copy()
    for _ in range(500):
        plant.step(control_from_rotors(rotors, F150), np.zeros((1, 3)), STEP_S)
    np.testing.assert_allclose(plant.state, start, atol=1e-6)
    assert not plant.landed.any()


def test_wind_carries_a_hovering_vehicle_to_its_own_speed():
    plant = plant_in_the_air(10.0)
    wind = np.array([[1.0, -2.0, 0.0]])
    for _ in range(6000):
        plant.step(np.array([[F150.weight_N, 0.0, 0.0, 0.0]]), wind, STEP_S)
    share = 1.0 - np.exp(-60.0 * 0.073 / 0.5)
    np.testing.assert_allclose(plant.state[0, 3:5], share * wind[0, :2], rtol=1e-6)


def test_saturated_motors_give_up_yaw_first_and_keep_the_thrust():
    wanted = np.array([[F150.weight_N, 0.4, 0.0, 5.0]])
    rotors = rotors_from_control(wanted, F150)
    had = control_from_rotors(rotors, F150)
    assert rotors.max() <= F150.rotor_max_radps * (1 + 1e-12) and rotors.min() >= 0.0
    np.testing.assert_allclose(had[0, :3], wanted[0, :3], rtol=1e-9, atol=1e-12)
    assert 0.0 < had[0, 3] < 0.1


def test_a_vehicle_stands_still_until_thrust_exceeds_weight():
    plant = Plant(F150, flat_ground, np.zeros((2, 3)), np.array([0.3, 0.3]))
    control = np.array([[F150.weight_N, 0.05, 0.05, 0.02], [1.02 * F150.weight_N, 0.0, 0.0, 0.0]])
    for _ in range(100):
        plant.step(control, np.array([[1.0, 1.0, 0.0]] * 2), STEP_S)
    np.testing.assert_array_equal(plant.state[0], [0, 0, 0, 0, 0, 0, 0, 0, 0.3, 0, 0, 0])
    assert plant.landed.tolist() == [True, False]
    assert plant.state[1, 2] < -0.05


def hill(north_m, east_m):
    return 2.0 + np.sin(north_m) + 0.3 * east_m


def test_a_falling_vehicle_ends_level_at_rest_on_the_exact_ground_and_never_below_it():
    pads = np.array([[0.0, 0.0, 0.0], [5.0, 1.0, 0.0]])
    plant = Plant(F150, hill, pads, np.array([0.1, -0.2]))
    np.testing.assert_allclose(-plant.state[:, 2], hill(pads[:, 0], pads[:, 1]))
    climb = np.tile([1.2 * F150.weight_N, 1e-3, -1e-3, 0.0], (2, 1))
    lowest = []
    for control in [climb] * 300 + [0.5 * climb] * 1200:
        plant.step(control, np.zeros((2, 3)), STEP_S)
        north, east, down = plant.state[:, :3].T
        lowest.append((-down - hill(north, east)).min())
    assert plant.landed.all()
    assert max(lowest) > 1.0
    # A step that ends below the ground is put back onto it within the same step.
    assert min(lowest) >= -1e-12
    assert np.hypot(*(plant.state[:, :2] - pads[:, :2]).T).min() > 0.1
    np.testing.assert_array_equal(plant.state[:, 3:8], 0.0)
    np.testing.assert_array_equal(plant.state[:, 9:], 0.0)
