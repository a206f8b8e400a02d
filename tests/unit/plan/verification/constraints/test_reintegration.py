"""Steps and bounds of re-integrated windows, on motions whose error is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.physics.quadrotor import Quadrotor, equations_of_motion
from gcs.physics.wind import SteadyWind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints import reintegration
from gcs.plan.verification.constraints.reintegration import IntegrationSteps, _growth, step_edges, window_errors
from gcs.plan.verification.proof.taylor import Taylor, constant
from gcs.types import Array

ORDER = 6


def test_steps_end_at_every_joint_and_every_second_and_are_no_longer_than_asked() -> None:
    edges = step_edges(np.array([-5.0, 2.25, 3.0, 3.5 - 1e-12, 9.0]), 2.0, 4.7, 0.1)
    assert (edges[0], edges[-1]) == (2.0, 4.7)
    steps = np.diff(edges)
    assert steps.min() > 0.0
    assert steps.max() <= 0.1 + 1e-12
    for mark in (2.25, 3.0, 3.5, 4.0):
        assert np.abs(edges - mark).min() < 1e-9
    assert len(edges) == 1 + 3 + 8 + 5 + 5 + 7
    # A mark next to another is one with it.
    assert np.diff(step_edges(np.array([3.0 + 1e-10]), 2.0, 4.0, 0.5)).min() == pytest.approx(0.5)


def falling(q: Quadrotor, extra_mps2: float, left_out_m: float = 0.0) -> tuple[IntegrationSteps, int]:
    """Planned at rest for 4 s, with a thrust that lets it sink."""
    edges = np.linspace(0.0, 4.0, 41)
    count = len(edges) - 1
    state, hover = np.zeros((count, 12)), constant(np.zeros((3, count)), ORDER)
    thrust = np.zeros((4, count))
    thrust[0] = q.weight_N - extra_mps2 * q.mass_kg
    place = Taylor(hover.c, hover.remainder + left_out_m)
    return IntegrationSteps(edges[:-1], edges[1:], state, place, constant(thrust, ORDER)), count


def error_m(steps: IntegrationSteps, first: list[int], last: list[int], q: Quadrotor) -> Array:
    return window_errors(steps, np.array(first), np.array(last), q)


def test_an_error_is_that_of_the_fall_with_drag_and_hardly_more(meadow_plan: Plan) -> None:
    """The vertical motion is v' = a - k v, from rest, for as long as each window takes."""
    q = meadow_plan.quadrotor
    steps, count = falling(q, 0.02)
    k = q.drag_Nspm[2] / q.mass_kg
    found = error_m(steps, [0, 10, 20], [count, count, 30], q)
    for bound, time_s in zip(found, (4.0, 3.0, 1.0), strict=True):
        fallen_m = 0.02 / k * (time_s - (1.0 - np.exp(-k * time_s)) / k)
        assert fallen_m <= bound <= fallen_m + 1e-5


def test_a_thrust_that_changes_within_steps_has_no_error_where_the_place_follows_it(meadow_plan: Plan) -> None:
    """Without drag, z'' = b t: the place is of the third order in time, whose powers count from the step's middle."""
    q, b = replace(meadow_plan.quadrotor, drag_Nspm=(0.0, 0.0, 0.0)), 0.05
    edges = np.linspace(0.0, 4.0, 41)
    r, middle = 0.05, 0.5 * (edges[:-1] + edges[1:])
    state, thrust, place = np.zeros((40, 12)), np.zeros((ORDER + 1, 4, 40)), np.zeros((ORDER + 1, 3, 40))
    state[:, 2], state[:, 5] = b / 6.0 * edges[:-1] ** 3, b / 2.0 * edges[:-1] ** 2
    thrust[0, 0], thrust[1, 0] = q.weight_N - q.mass_kg * b * middle, -q.mass_kg * b * r
    for power, part in enumerate((middle**3, 3.0 * middle**2 * r, 3.0 * middle * r**2, r**3 + 0.0 * middle)):
        place[power, 2] = b / 6.0 * part
    steps = IntegrationSteps(
        edges[:-1], edges[1:], state, Taylor(place, np.zeros((3, 40))), Taylor(thrust, np.zeros((4, 40)))
    )
    assert error_m(steps, [0, 15], [40, 40], q).max() < 1e-6


def test_what_the_place_leaves_out_is_added(meadow_plan: Plan) -> None:
    q = meadow_plan.quadrotor
    steps, count = falling(q, 0.0, 2e-3)
    # the same along three axes
    assert error_m(steps, [0], [count], q)[0] == pytest.approx(2e-3 * np.sqrt(3.0), abs=1e-6)
    assert error_m(falling(q, 0.0)[0], [0], [count], q)[0] < 1e-6


def test_what_the_control_leaves_out_grows_as_a_force_does(meadow_plan: Plan) -> None:
    """1 mN of thrust that is not known: half of its acceleration times the time squared, and a little more."""
    q = meadow_plan.quadrotor
    steps, count = falling(q, 0.0)
    remainder = steps.control.remainder.copy()
    remainder[0] += 1e-3
    unsure = replace(steps, control=Taylor(steps.control.c, remainder))
    vacuum_m = 0.5 * 1e-3 / q.mass_kg * 4.0**2
    assert 0.75 * vacuum_m < error_m(unsure, [0], [count], q)[0] < 2.0 * vacuum_m
    # A moment turns the vehicle, the thrust leans, and it is off by the fourth power of time: more than can be bounded.
    remainder = steps.control.remainder.copy()
    remainder[1] += 1.0
    assert np.isinf(error_m(replace(steps, control=Taylor(steps.control.c, remainder)), [0], [count], q)[0])


@pytest.mark.parametrize("exponent", [0.0, 1.0 / 7.0, 0.6])
def test_no_error_grows_faster_than_it_is_said_to(meadow_plan: Plan, exponent: float) -> None:
    """Derivatives of Eq. 1 by central differences, at states near the plan, in a wind that grows with height."""
    wind = SteadyWind(3.0, -2.0, reference_m=8.0, exponent=exponent)
    q = replace(meadow_plan.quadrotor, wind=wind, drag_Nspm=(0.3, 0.2, 0.25))
    steps, _ = falling(q, 0.3)
    most = _growth(steps, 0.2, q)
    random = np.random.default_rng(5)
    state = random.uniform(-1.0, 1.0, (12, 2000)) * np.repeat([5.0, 3.0, 1.2, 0.05], 3)[:, None]
    state[2] = -random.uniform(0.0, 12.0, 2000)  # above height 0
    control = np.repeat(np.array([[q.weight_N - 0.3 * q.mass_kg], [0.0], [0.0], [0.0]]), 2000, axis=1)
    found, step = np.empty((12, 12)), 1e-5
    for column in range(12):
        ahead, behind = state.copy(), state.copy()
        ahead[column] += step
        behind[column] -= step
        change = np.stack(equations_of_motion(ahead, control, q)) - np.stack(equations_of_motion(behind, control, q))
        found[:, column] = np.abs(change).max(axis=1) / (2.0 * step)
    assert (found <= most + 1e-6).all()
    exact = [(row, row) for row in (3, 4, 5)] + [(row, row + 3) for row in (0, 1, 2, 6, 7, 8)]
    for row, column in exact:
        assert most[row, column] == pytest.approx(found[row, column], rel=1e-6)
    for axis in (0, 1):
        assert most[3 + axis, 2] <= 2.5 * found[3 + axis, 2], "the wind's slope"


def test_growth_counts_with_the_rates_within_steps(meadow_plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """A roll that begins in the last step is in no step's first state."""
    q, told = meadow_plan.quadrotor, []
    monkeypatch.setattr(reintegration, "_growth", lambda *given: (told.append(given[1]), _growth(*given))[1])
    steps, count = falling(q, 0.0)
    steps.control.c[0, 1, -1] = q.inertia_kgm2[0] / q.arm_m * 10.0  # rad/s², for 0.1 s
    error_m(steps, [0], [count], q)
    assert told[0] > 1.0
