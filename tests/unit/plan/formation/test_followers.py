"""A follower's states and controls, re-integrated by Eq. 1, are the leader's flight plus the shape's motion."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson, solve_ivp
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import Quadrotor, derivative
from gcs.physics.states import ATTITUDE, POSITION, RATES, VELOCITY
from gcs.plan.formation.followers import (
    BEND_S,
    follower_states_and_controls,
    formation_motion,
    rounded_thrust,
)
from gcs.plan.formation.shape import Shape, joined, rigid, stretched
from gcs.plan.formation.transforms import rotation, shrinking
from gcs.types import Array

Q = Quadrotor(
    mass_kg=2.0,
    arm_m=0.25,
    inertia_kgm2=(0.0217, 0.025, 0.04),
    thrust_coeff_Ns2=8.55e-6,
    moment_coeff_Nms2=1.37e-7,
    drag_Nspm=(0.3, 0.25, 0.4),
    drag_moment_Nms=(0.02, 0.03, 0.01),
    rotor_max_radps=1070.0,
)
END_S = 6.0
States = Callable[[Array], Array]


def leader_start(random: np.random.Generator) -> Array:
    start = np.zeros(12)
    start[POSITION] = random.normal(size=3) * 10.0
    start[VELOCITY] = random.normal(size=3) * 2.0
    start[ATTITUDE] = random.uniform([-0.3, -0.3, -3.0], [0.3, 0.3, 3.0])
    start[RATES] = random.uniform(-0.2, 0.2, 3)
    return start


def smooth_control(random: np.random.Generator) -> PPoly:
    """One cubic for every control, gentle enough that nobody turns over."""
    size = np.array([2.0, 0.002, 0.002, 0.001])
    c = random.normal(size=(4, 1, 4)) * size / np.array([END_S**3, END_S**2, END_S, 1.0])[:, None, None]
    c[-1, 0, 0] += Q.weight_N
    return PPoly(c, np.array([0.0, END_S]))


def flown(start: Array, control: PPoly) -> States:
    """Eq. 1 from `start`, stopped and started again at every joint."""
    parts = []
    for low, high in pairwise(control.x):
        piece = int(np.searchsorted(control.x, low, side="right")) - 1
        inside = PPoly(control.c[:, piece : piece + 1], control.x[piece : piece + 2])
        solved = solve_ivp(
            lambda t, x, u=inside: derivative(x, u(t), Q),
            (low, high),
            start,
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
            dense_output=True,
        )
        start = solved.y[:, -1]
        parts.append(solved.sol)

    def states(t: Array) -> Array:
        piece = np.clip(np.searchsorted(control.x, t, side="right") - 1, 0, len(parts) - 1)
        return np.array([parts[i](at) for i, at in zip(np.atleast_1d(piece), np.atleast_1d(t), strict=True)])

    return states


def polynomial_offsets(random: np.random.Generator, vehicles: int) -> Callable[[Array], list[Array]]:
    """Offsets (V, N, 3) as polynomials of degree 6, with their first four derivatives."""
    c = random.normal(size=(7, 1, vehicles, 3)) * 2.0 / END_S ** np.arange(6.0, -1.0, -1.0)[:, None, None, None]
    functions = PPoly(c, np.array([0.0, END_S]))
    return lambda t: [np.moveaxis(functions(t, nu=order), 0, 1) for order in range(5)]


@pytest.mark.parametrize("seed", range(4))
def test_eq_1_under_the_followers_control_follows_its_states(seed: int) -> None:
    random = np.random.default_rng(seed)
    control, offsets = smooth_control(random), polynomial_offsets(random, 2)
    leader = flown(leader_start(random), control)

    def follower(t: Array) -> tuple[Array, Array]:
        thrust = tuple(control(t, nu=order)[:, 0] for order in range(3))
        return follower_states_and_controls(leader(t), control(t), thrust, offsets(t), Q)

    planned = follower(np.array([0.0, END_S]))[0]
    for vehicle in range(2):
        solved = solve_ivp(
            lambda t, x, v=vehicle: derivative(x, follower(np.array([t]))[1][v, 0], Q),
            (0.0, END_S),
            planned[vehicle, 0],
            method="DOP853",
            rtol=1e-10,
            atol=1e-11,
        )
        np.testing.assert_allclose(solved.y[:, -1], planned[vehicle, 1], atol=3e-8)


@pytest.mark.parametrize("seed", range(4))
def test_where_it_is_and_how_fast_is_the_leaders_plus_the_shapes(seed: int) -> None:
    random = np.random.default_rng(seed)
    control, offsets = smooth_control(random), polynomial_offsets(random, 3)
    leader = flown(leader_start(random), control)
    t = np.linspace(0.0, END_S, 9)
    x, place = leader(t), offsets(t)
    thrust = (control(t)[:, 0], control(t, nu=1)[:, 0], control(t, nu=2)[:, 0])
    states, controls = follower_states_and_controls(x, control(t), thrust, place, Q)
    np.testing.assert_allclose(states[..., POSITION], x[:, POSITION] + place[0], atol=1e-12)
    np.testing.assert_allclose(states[..., VELOCITY], x[:, VELOCITY] + place[1], atol=1e-12)
    wanted = derivative(x, control(t), Q)[:, VELOCITY] + place[2]
    np.testing.assert_allclose(derivative(states, controls, Q)[..., VELOCITY], wanted, atol=1e-12)
    np.testing.assert_allclose(states[..., [8, 11]], np.broadcast_to(x[:, [8, 11]], (3, 9, 2)), atol=1e-12)


def test_without_motion_in_the_shape_everyone_flies_as_the_leader_does() -> None:
    random = np.random.default_rng(9)
    control = smooth_control(random)
    t = np.linspace(0.0, END_S, 13)
    x = flown(leader_start(random), control)(t)
    place = np.repeat(random.normal(size=(3, 1, 3)), len(t), axis=1)
    still = [place, *[np.zeros_like(place)] * 4]
    thrust = (control(t)[:, 0], control(t, nu=1)[:, 0], control(t, nu=2)[:, 0])
    states, controls = follower_states_and_controls(x, control(t), thrust, still, Q)
    np.testing.assert_allclose(states[..., 3:], np.broadcast_to(x[:, 3:], (3, 13, 9)), atol=1e-13)
    np.testing.assert_allclose(controls, np.broadcast_to(control(t), (3, 13, 4)), atol=1e-12)


def cornered_control(random: np.random.Generator, joints: Array) -> PPoly:
    """Piecewise linear: corners at every joint, no jump."""
    values = random.normal(size=(len(joints), 4)) * np.array([0.4, 0.005, 0.005, 0.002]) + [Q.weight_N, 0.0, 0.0, 0.0]
    slopes = np.diff(values, axis=0) / np.diff(joints)[:, None]
    return PPoly(np.stack([slopes, values[:-1]]), joints)


JOINTS = np.array([0.0, 1.5, 1.8, 2.0, 3.6, 6.0])


def moving_shape(places: Array) -> Shape:
    """Turning while the leader's thrust has its corners, rigid before and after."""
    turned = places.copy()
    turned[:, :2] = np.column_stack([-places[:, 1], places[:, 0]])
    return joined(
        [
            rigid(places, 0.0, 0.5),
            stretched(rotation(places, np.array([0.0, 0.0, 1.0]), np.pi / 2.0), 0.5, 5.0),
            rigid(turned, 5.0, 6.0),
        ]
    )


def test_only_while_the_shape_moves_do_followers_differ_and_the_leader_never_does() -> None:
    random = np.random.default_rng(2)
    control = cornered_control(random, JOINTS)
    states = PPoly(random.normal(size=(4, len(JOINTS) - 1, 12)) * 0.05, JOINTS)
    places = np.concatenate([np.zeros((1, 3)), random.normal(size=(3, 3)) * 3.0])
    shape = moving_shape(places)
    t = np.array([0.0, 0.49, 2.0, 4.9, 5.0, 6.0])
    x, u = formation_motion(states, control, shape, Q, t)
    still = [0, 1, 4, 5]
    for vehicle in range(4):
        np.testing.assert_array_equal(x[vehicle][still][:, 3:], states(t)[still][:, 3:])
        np.testing.assert_array_equal(u[vehicle][still], control(t)[still])
        place = states(t)[still][:, :3] + shape.offsets(t)[vehicle][still]
        np.testing.assert_array_equal(x[vehicle][still][:, :3], place)
    assert np.abs(u[1:, 2, 1] - control(2.0)[1]).min() > 1e-6
    rows = np.array([3, 1])
    some = formation_motion(states, control, shape, Q, t, rows)
    np.testing.assert_array_equal(some[0], x[rows])
    np.testing.assert_array_equal(some[1], u[rows])


@pytest.mark.parametrize("seed", range(3))
def test_over_corners_of_the_thrust_height_is_exact_and_sideways_is_within_a_millimetre(seed: int) -> None:
    """Eq. 1's acceleration less the wanted one, integrated twice; and attitudes that rates and moments bear out."""
    random = np.random.default_rng(seed)
    control = cornered_control(random, JOINTS)
    leader = flown(leader_start(random) * 0.3, control)
    places = np.concatenate([np.zeros((1, 3)), random.normal(size=(3, 3))])
    shape = moving_shape(places)
    t = np.linspace(0.5, 5.0, 4501)[:-1]
    x, u = leader(t), control(t)
    states, controls = follower_states_and_controls(
        x, u, rounded_thrust(control, t), [shape.offsets(t, order) for order in range(5)], Q
    )
    wanted = derivative(x, u, Q)[:, VELOCITY] + shape.offsets(t, 2)
    off = derivative(states, controls, Q)[..., VELOCITY] - wanted
    assert np.abs(off[..., 2]).max() < 1e-12
    assert np.abs(off[1:, :, :2]).max() > 1e-6  # there are corners to get over
    drift = cumulative_simpson(cumulative_simpson(off, x=t, axis=1, initial=0.0), x=t, axis=1, initial=0.0)
    assert np.linalg.norm(drift, axis=-1).max() < 1e-3
    step = t[1] - t[0]
    corners = np.abs(t[1:-1, None] - JOINTS).min(axis=1) < 2.5 * step
    rate = (states[:, 2:, ATTITUDE] - states[:, :-2, ATTITUDE]) / (2.0 * step)
    np.testing.assert_allclose(rate[:, ~corners], states[:, 1:-1][:, ~corners][..., RATES], atol=3e-6)
    turning = (states[:, 2:, RATES] - states[:, :-2, RATES]) / (2.0 * step)
    borne_out = derivative(states, controls, Q)[:, 1:-1, RATES]
    np.testing.assert_allclose(turning[:, ~corners], borne_out[:, ~corners], atol=1e-4)


def test_a_follower_neither_jumps_nor_changes_its_rates_at_once() -> None:
    random = np.random.default_rng(4)
    control = cornered_control(random, JOINTS)
    leader = flown(leader_start(random) * 0.3, control)
    shape = stretched(shrinking(random.normal(size=(3, 3)) * 4.0, 0.5), 0.0, END_S)
    before, after = (
        follower_states_and_controls(
            leader(t), control(t), rounded_thrust(control, t), [shape.offsets(t, order) for order in range(5)], Q
        )[0]
        for t in (np.nextafter(JOINTS[1:-1], 0.0), JOINTS[1:-1])
    )
    np.testing.assert_allclose(before, after, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_rounded_thrust_is_the_thrust_outside_its_bends_and_smooth_in_them(seed: int) -> None:
    random = np.random.default_rng(seed)
    joints = np.concatenate([[0.0], np.cumsum(random.uniform(0.05, 4.0, 9))])
    control = cornered_control(random, joints)
    widths = np.minimum(BEND_S, 0.45 * np.minimum(np.diff(joints)[:-1], np.diff(joints)[1:]))
    t = np.linspace(joints[0], joints[-1], 20001)[1:-1]
    u0, u1, u2 = rounded_thrust(control, t)
    outside = (np.abs(t[:, None] - joints[1:-1]) >= widths).all(axis=1)
    assert outside.any()
    assert (~outside).any()
    for order, part in enumerate((u0, u1, u2)):
        np.testing.assert_allclose(part[outside], control(t[outside], nu=order)[:, 0], atol=1e-12)
    assert np.abs(u0 - control(t)[:, 0]).max() > 1e-3
    # Its edges and its middle: value and two derivatives go through.
    places = np.concatenate([joints[1:-1] - widths, joints[1:-1], joints[1:-1] + widths])
    near = [rounded_thrust(control, places + side * 1e-9) for side in (-1.0, 1.0)]
    for order, (left, right) in enumerate(zip(*near, strict=True)):
        size = np.abs((u0, u1, u2)[order]).max()
        np.testing.assert_allclose(left, right, atol=1e-5 * max(size, 1.0))


def test_each_derivative_of_a_rounded_thrust_is_that_of_the_one_before() -> None:
    control = cornered_control(np.random.default_rng(8), np.array([0.0, 2.0, 2.4, 6.0]))
    t, step = np.linspace(0.5, 5.5, 997), 1e-5
    less, more = rounded_thrust(control, t - step), rounded_thrust(control, t + step)
    exact = rounded_thrust(control, t)
    for order in (0, 1):
        slope = (more[order] - less[order]) / (2.0 * step)
        np.testing.assert_allclose(slope, exact[order + 1], atol=1e-4 * np.abs(exact[2]).max())


def test_a_thrust_without_joints_has_nothing_to_round() -> None:
    control = smooth_control(np.random.default_rng(1))
    t = np.linspace(0.0, END_S, 50)
    for order, part in enumerate(rounded_thrust(control, t)):
        np.testing.assert_array_equal(part, control(t, nu=order)[:, 0])
