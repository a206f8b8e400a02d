"""The leader's bounds keep all followers within their limits, and are no tighter than that."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs.errors import Infeasible
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.formation.followers import follower_states_and_controls
from gcs.plan.formation.shape import rigid
from gcs.plan.formation.timeline import lay
from gcs.plan.ocp.bounds import boundary_values, leader_control_bounds, leader_state_bounds
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.formations import SHRINK, SWAPPED, TO_FILE, TURN, at, auto, fleet

FAST = {"change_speed_mps": 2.0, "change_accel_mps2": 1.2}
SWAP = {"kind": "reshape", "to": "b", "assignment": "fixed"}


def laid(scenario: Scenario) -> Problem:
    problem = flight_problem(scenario)
    starts = tuple(float(c.at_s) for c in scenario.formation.change if c.at_s is not None)
    return replace(problem, shape=lay(scenario, starts, problem.start_s, problem.end_s).shape)


@pytest.fixture(params=["turn", "shrink", "lanes"])
def problem(request: pytest.FixtureRequest, simulation1: Scenario) -> Problem:
    long = {"flight_s": 40.0}
    make: dict[str, Scenario] = {
        "turn": fleet(simulation1, 5, "row", (at(TURN, 2.0),), time=long, formation=FAST),
        "shrink": fleet(simulation1, 5, "wedge", (at({**SHRINK, "scale": 2.0}, 2.0),), time=long, formation=FAST),
        "lanes": fleet(simulation1, 3, "a", (at(SWAP, 2.0),), SWAPPED, time=long, formation=FAST),
    }
    return laid(make[request.param])


TIMES = np.linspace(0.0, 39.9, 400)


def test_a_leader_on_his_bounds_has_a_follower_on_the_limit_and_none_beyond(problem: Problem) -> None:
    low, high = leader_state_bounds(problem, TIMES)
    for part, order in ((POSITION, 0), (VELOCITY, 1)):
        offsets = problem.shape.offsets(TIMES, order)
        np.testing.assert_allclose((low[:, part] + offsets).min(axis=0), np.tile(problem.state_low[part], (400, 1)))
        np.testing.assert_allclose((high[:, part] + offsets).max(axis=0), np.tile(problem.state_high[part], (400, 1)))


def test_while_the_shape_is_rigid_only_places_matter(problem: Problem) -> None:
    rigid_at = ~problem.shape.is_moving(TIMES)
    assert rigid_at.any()
    assert not rigid_at.all()
    low, high = leader_state_bounds(problem, TIMES[rigid_at])
    np.testing.assert_array_equal(low[:, 3:], np.tile(problem.state_low[3:], (rigid_at.sum(), 1)))
    np.testing.assert_array_equal(high[:, 3:], np.tile(problem.state_high[3:], (rigid_at.sum(), 1)))
    control_low, control_high = leader_control_bounds(problem, TIMES[rigid_at])
    np.testing.assert_allclose(control_low, np.tile(problem.control_low, (rigid_at.sum(), 1)), atol=1e-9)
    np.testing.assert_allclose(control_high, np.tile(problem.control_high, (rigid_at.sum(), 1)), atol=1e-9)


def test_followers_of_a_level_leader_at_the_ends_of_his_controls_stay_within_theirs(problem: Problem) -> None:
    """The leader flies straight on; tilt, rates, thrust and moments are those that the shape needs."""
    low, high = leader_control_bounds(problem, TIMES)
    full_low, full_high = problem.control_limits
    offsets = [problem.shape.offsets(TIMES, order) for order in range(5)]
    still = np.zeros(len(TIMES))
    state = np.zeros((len(TIMES), 12))
    _, state_high = leader_state_bounds(problem, TIMES)
    for bound in (low, high):
        control = np.tile([problem.quadrotor.weight_N, 0.0, 0.0, 0.0], (len(TIMES), 1))
        control[:, 0] = bound[:, 0]
        states, controls = follower_states_and_controls(
            state, control, (control[:, 0], still, still), offsets, problem.quadrotor
        )
        room = 1.02 * (full_high - full_low)[0]
        assert controls[..., 0].min() >= full_low[0] - 0.02 * room
        assert controls[..., 0].max() <= full_high[0] + 0.02 * room
    hover = np.tile([problem.quadrotor.weight_N, 0.0, 0.0, 0.0], (len(TIMES), 1))
    states, controls = follower_states_and_controls(
        state, hover, (hover[:, 0], still, still), offsets, problem.quadrotor
    )
    # What is left to the leader and what the shape takes is not more than there is.
    for axis in (1, 2):
        assert (np.abs(controls[..., axis]).max(axis=0) + high[:, axis] <= full_high[axis] + 1e-3).all()
    for row in (6, 7, 9, 10):
        taken = np.abs(states[..., row]).max(axis=0)
        assert (taken + state_high[:, row] <= problem.state_high[row] + 1e-3).all()


def test_the_control_margin_stays_where_it_is_larger(simulation1: Scenario) -> None:
    """A slow change takes less than the share that is kept for feedback: it costs nothing."""
    problem = laid(fleet(simulation1, 3, changes=(at(TURN, 2.0),), limits={"control_margin": 0.3}))
    low, high = leader_control_bounds(problem, TIMES[:290])
    np.testing.assert_allclose(low, np.tile(problem.control_low, (290, 1)))
    np.testing.assert_allclose(high, np.tile(problem.control_high, (290, 1)))


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"limits": {"east_m": [-5.0, 5.0]}}, "larger than the limit of east position"),
        ({"limits": {"north_m": [0.0, 3.0]}, "begin": "file"}, "larger than the limit of north position"),
    ],
)
def test_a_formation_that_does_not_fit_into_its_limits_is_refused(
    simulation1: Scenario, tables: dict[str, Any], words: str
) -> None:
    problem = flight_problem(fleet(simulation1, 5, **{"begin": "row"} | tables))
    with pytest.raises(Infeasible, match=words):
        leader_state_bounds(problem, TIMES)


def test_coordinates_have_bounds_of_their_own_and_end_at_rest(simulation1: Scenario) -> None:
    problem = flight_problem(fleet(simulation1, 5, "row", (auto(SHRINK), auto(TO_FILE))))
    low, high = leader_state_bounds(problem, TIMES[:7])
    assert low.shape == high.shape == (7, 20)
    for number, c in enumerate(problem.coordinates):
        first = 12 + 4 * number
        np.testing.assert_array_equal(low[:, first : first + 4], np.tile([c.low, *np.negative(c.most[:3])], (7, 1)))
        np.testing.assert_array_equal(high[:, first : first + 4], np.tile([c.high, *c.most[:3]], (7, 1)))
        assert leader_control_bounds(problem, TIMES[:7])[1][0, 4 + number] == c.most[3]
    start, end_low, end_high = boundary_values(problem)
    np.testing.assert_array_equal(start[12:], [1.0, 0, 0, 0, 0.0, 0, 0, 0])
    np.testing.assert_array_equal(end_low, end_high)
    np.testing.assert_array_equal(end_low[12:], start[12:])


def test_with_the_course_the_heading_may_end_anywhere_at_rest(simulation1: Scenario) -> None:
    problem = flight_problem(fleet(simulation1, 5, "row", formation={"frame": "course"}))
    _, low, high = boundary_values(problem)
    assert low[12] < -6.0 < 6.0 < high[12]
    np.testing.assert_array_equal(low[13:], 0.0)
    np.testing.assert_array_equal(high[13:], 0.0)


def test_bounds_of_a_rigid_formation_do_not_know_when(simulation1: Scenario) -> None:
    problem = flight_problem(fleet(simulation1, 5, "row"))
    again = replace(problem, shape=rigid(problem.shape.at(0.0), problem.start_s, problem.end_s))
    for found, other in zip(
        leader_state_bounds(problem, TIMES[:3]), leader_state_bounds(again, TIMES[:3]), strict=True
    ):
        np.testing.assert_array_equal(found, other)
        np.testing.assert_array_equal(found[0], found[2])
