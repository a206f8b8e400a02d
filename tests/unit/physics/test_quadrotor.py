"""Eqs. 1 and 2: against equations written anew here and an integrator of scipy; inverses by property."""

from __future__ import annotations

import math

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from gcs.physics.quadrotor import (
    Quadrotor,
    control_from_rotors,
    derivative,
    equations_of_motion,
    rotors_from_control,
    thrust_and_tilt,
)
from gcs.types import Array

# Table 1 with three different inertias and drags, so that no index can be swapped unseen.
Q = Quadrotor(
    mass_kg=0.5,
    arm_m=0.075,
    inertia_kgm2=(0.0219, 0.0231, 0.0366),
    thrust_coeff_Ns2=1.105e-5,
    moment_coeff_Nms2=1.779e-7,
    drag_Nspm=(0.073, 0.081, 0.095),
    drag_moment_Nms=(0.0055, 0.0061, 0.0072),
    rotor_max_radps=400.0,
)


def vectors(size: int, most: float) -> st.SearchStrategy[Array]:
    return st.lists(st.floats(-most, most), min_size=size, max_size=size).map(np.array)


def rotor_speeds(low: float = 0.0) -> st.SearchStrategy[Array]:
    return st.lists(st.floats(low, 400.0), min_size=4, max_size=4).map(np.array)


def eq_1(x: Array, u: Array, wind: Array) -> Array:
    """By rotation matrix and cross product: thrust along the body's -z, Euler rates taken as body rates."""
    roll, pitch, yaw = x[6:9]
    about_x = np.array([[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]])
    about_y = np.array([[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0], [-math.sin(pitch), 0, math.cos(pitch)]])
    about_z = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])
    force = about_z @ about_y @ about_x @ np.array([0.0, 0.0, -u[0]]) - np.array([0.073, 0.081, 0.095]) * (
        x[3:6] - wind
    )
    inertia, omega = np.array([0.0219, 0.0231, 0.0366]), x[9:12]
    moment = np.array([0.075 * u[1], 0.075 * u[2], u[3]]) - np.array([0.0055, 0.0061, 0.0072]) * omega
    spin = (moment - np.cross(omega, inertia * omega)) / inertia
    return np.concatenate([x[3:6], force / 0.5 + np.array([0, 0, 9.8]), omega, spin])


@given(vectors(12, 2.0), vectors(4, 3.0), vectors(3, 5.0))
def test_eq_1_is_newton_and_euler(state: Array, control: Array, wind: Array) -> None:
    np.testing.assert_allclose(derivative(state, control, Q, wind), eq_1(state, control, wind), rtol=1e-9, atol=1e-9)


def test_a_flight_of_five_seconds_agrees_with_scipy() -> None:
    """Eq. 1 in fixed RK4 steps against the other writing in an adaptive integrator."""

    def control(t: float) -> Array:
        return np.array([4.9 + 0.2 * math.sin(t), 0.01 * math.cos(2 * t), -0.008 * math.sin(t), 0.002 * math.cos(t)])

    start = np.array([0, 0, -10.0, 2, 1, 0, 0.05, -0.02, 0.7, 0, 0, 0])
    calm = np.zeros(3)
    other = solve_ivp(lambda t, x: eq_1(x, control(t), calm), (0, 5), start, "DOP853", rtol=1e-12, atol=1e-12)
    ours, h = start, 0.005
    for k in range(1000):
        t = k * h
        k1 = derivative(ours, control(t), Q)
        k2 = derivative(ours + h / 2 * k1, control(t + h / 2), Q)
        k3 = derivative(ours + h / 2 * k2, control(t + h / 2), Q)
        k4 = derivative(ours + h * k3, control(t + h), Q)
        ours = ours + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    np.testing.assert_allclose(ours, other.y[:, -1], atol=1e-8)


def test_hover_falling_and_drag_have_their_closed_forms() -> None:
    level, hover = np.zeros(12), np.array([Q.weight_N, 0, 0, 0])
    np.testing.assert_allclose(derivative(level, hover, Q), 0.0, atol=1e-15)
    assert derivative(level, np.zeros(4), Q)[5] == pytest.approx(9.8)
    moving = level.copy()
    moving[3] = 5.0
    assert derivative(moving, hover, Q)[3] == pytest.approx(-0.073 * 5.0 / 0.5)
    assert derivative(moving, hover, Q, np.array([5.0, 0.0, 0.0]))[3] == 0.0  # drifting with the air


@pytest.mark.parametrize("batch", [(), (1,), (6,), (2, 5), (0,)])
def test_any_batch_is_its_rows(batch: tuple[int, ...]) -> None:
    random = np.random.default_rng(1)
    state, control = random.normal(size=(*batch, 12)), random.normal(size=(*batch, 4))
    wind = random.normal(size=(*batch, 3))
    out = derivative(state, control, Q, wind)
    assert out.shape == (*batch, 12)
    for index in np.ndindex(batch):
        np.testing.assert_array_equal(out[index], derivative(state[index], control[index], Q, wind[index]))
    assert rotors_from_control(control, Q).shape == (*batch, 4)
    assert all(part.shape == batch for part in thrust_and_tilt(state[..., :3], state[..., 3:6], state[..., 8], Q))


def test_one_control_serves_many_states() -> None:
    assert derivative(np.zeros((7, 12)), np.array([4.9, 0, 0, 0]), Q).shape == (7, 12)


@given(vectors(12, 1.5), vectors(4, 3.0))
def test_casadi_symbols_give_what_arrays_give(state: Array, control: Array) -> None:
    x, u = casadi.SX.sym("x", 12), casadi.SX.sym("u", 4)
    parts = equations_of_motion(casadi.vertsplit(x), casadi.vertsplit(u), Q, xp=casadi)
    symbolic = casadi.Function("f", [x, u], [casadi.vertcat(*parts)])
    np.testing.assert_allclose(
        np.array(symbolic(state, control)).ravel(), derivative(state, control, Q), rtol=1e-12, atol=1e-12
    )


def test_eq_2_turns_the_vehicle_the_way_it_is_printed() -> None:
    np.testing.assert_allclose(control_from_rotors(np.full(4, 333.0), Q), [4 * 1.105e-5 * 333**2, 0, 0, 0], atol=1e-15)
    first = control_from_rotors(np.array([100.0, 0, 0, 0]), Q)
    half = math.sqrt(2) / 2 * 1.105e-5 * 1e4
    np.testing.assert_allclose(first, [1.105e-5 * 1e4, half, half, 1.779e-7 * 1e4])
    assert list(np.sign(control_from_rotors(np.array([0, 100.0, 0, 0]), Q))) == [1, -1, 1, -1]


@given(rotor_speeds())
def test_reachable_controls_are_met_exactly(rotors: Array) -> None:
    control = control_from_rotors(rotors, Q)
    again = control_from_rotors(rotors_from_control(control, Q), Q)
    np.testing.assert_allclose(again, control, rtol=1e-9, atol=1e-12)


@given(vectors(4, 20.0))
def test_rotors_keep_their_limits_and_give_up_yaw_first(control: Array) -> None:
    rotors = rotors_from_control(control, Q)
    assert np.isfinite(rotors).all()
    assert (rotors >= 0).all()
    assert (rotors <= Q.rotor_max_radps).all()
    got = control_from_rotors(rotors, Q)
    most = 4 * Q.thrust_coeff_Ns2 * Q.rotor_max_radps**2
    assert got[0] == pytest.approx(np.clip(control[0], 0, most), abs=1e-9)  # thrust is kept
    # Yaw takes nothing from roll and pitch, and these shrink together and never turn over.
    without_yaw = control_from_rotors(rotors_from_control(control * [1, 1, 1, 0], Q), Q)
    assert (np.abs(got[1:3]) >= np.abs(without_yaw[1:3]) - 1e-9).all()
    assert got[1] * control[2] == pytest.approx(got[2] * control[1], abs=1e-7)
    share = got[1:] * np.sign(control[1:])
    assert (share >= -1e-9).all()
    assert (share <= np.abs(control[1:]) + 1e-9).all()


def test_full_torque_and_yaw_at_hover_lose_yaw_only() -> None:
    wanted = np.array([0.3, 0.05, 0.05, 0.02])
    got = control_from_rotors(rotors_from_control(wanted, Q), Q)
    np.testing.assert_allclose(got[:3], wanted[:3], atol=1e-12)
    assert 0 < got[3] < wanted[3]


@given(vectors(3, 4.0), vectors(3, 5.0), st.floats(-math.pi, math.pi))
def test_thrust_and_tilt_cause_the_acceleration_asked_for(acceleration: Array, velocity: Array, yaw: float) -> None:
    thrust, roll, pitch = thrust_and_tilt(acceleration, velocity, np.array(yaw), Q)
    state = np.concatenate([np.zeros(3), velocity, [roll, pitch, yaw], np.zeros(3)])
    control = np.array([float(thrust), 0, 0, 0])
    np.testing.assert_allclose(derivative(state, control, Q)[3:6], acceleration, atol=1e-9)


@given(st.floats(0.5, 8.0), st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), st.floats(-3.0, 3.0), vectors(3, 5.0))
def test_thrust_and_tilt_come_back(thrust: float, roll: float, pitch: float, yaw: float, velocity: Array) -> None:
    state = np.concatenate([np.zeros(3), velocity, [roll, pitch, yaw], np.zeros(3)])
    acceleration = derivative(state, np.array([thrust, 0, 0, 0]), Q)[3:6]
    found = thrust_and_tilt(acceleration, velocity, np.array(yaw), Q)
    np.testing.assert_allclose([float(part) for part in found], [thrust, roll, pitch], atol=1e-7)
