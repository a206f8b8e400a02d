"""What is fixed at ends, points and holds, the units of the unknowns, and the steps of the thrust."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.physics.quadrotor import hover_trim, level_flight_thrust_N
from gcs.plan.nlp.mesh import Mesh
from gcs.plan.nlp.program_bounds import STATE_UNIT, bounds, scales, thrust_steps
from gcs.plan.nlp.route_phases import first_mesh
from gcs.plan.nlp.variables import ControlForm, VariableLayout
from gcs.plan.ocp.bounds import leader_state_bounds
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tests.unit.plan.formations import ROOMY, SHRINK, STRONG, auto, fleet
from tests.unit.plan.problems import alone, changed, meadow
from tests.unit.plan.route_flights import CORNER, FAR, flight_through

THREE = Mesh(np.array([0.0, 5.0, 12.0, 20.0]), (2, 3, 2))


def layout_of(problem: Problem, mesh: Mesh = THREE, form: ControlForm = ControlForm.LINEAR) -> VariableLayout:
    return VariableLayout(mesh, form, tuple(c.name for c in problem.coordinates))


def split(layout: VariableLayout, values: Array) -> tuple[Array, Array]:
    """States (state points, nx) and controls (control points, nu) of what belongs to the unknowns."""
    cut = layout.nx * layout.state_points
    return values[:cut].reshape(-1, layout.nx), values[cut:].reshape(-1, layout.nu)


@pytest.fixture(scope="module")
def calm(simulation1: Scenario) -> Problem:
    return flight_problem(meadow(alone(simulation1)))


def test_both_ends_are_fixed_and_nothing_else_is(calm: Problem) -> None:
    layout = layout_of(calm)
    low, high = (split(layout, part) for part in bounds(calm, layout))
    np.testing.assert_array_equal(low[0][0], calm.start_state)
    np.testing.assert_array_equal(high[0][0], calm.start_state)
    np.testing.assert_array_equal(low[0][3], calm.end_state)
    np.testing.assert_array_equal(high[0][3], calm.end_state)
    free_low, free_high = leader_state_bounds(calm, layout.point_times_s())
    inner = np.delete(np.arange(layout.state_points), [0, 3])
    np.testing.assert_array_equal(low[0][inner], free_low[inner])
    np.testing.assert_array_equal(high[0][inner], free_high[inner])
    assert (low[1] == calm.control_low).all()
    assert (high[1] == calm.control_high).all()


def test_units_are_sizes_in_flight_and_thrust_counts_from_the_weight(calm: Problem) -> None:
    layout = layout_of(calm)
    unit, shift = (split(layout, part) for part in scales(calm, layout))
    assert (unit[0] == STATE_UNIT).all()
    assert STATE_UNIT.tolist() == [100.0, 100.0, 10.0, 5.0, 5.0, 1.0, 0.1, 0.1, 1.0, 0.05, 0.05, 0.05]
    weight_N = calm.quadrotor.weight_N
    expected = [calm.control_high[0] - weight_N, *(0.5 * (calm.control_high - calm.control_low))[1:]]
    np.testing.assert_allclose(unit[1], np.tile(expected, (4, 1)))
    assert (shift[0] == 0.0).all()
    np.testing.assert_allclose(shift[1], np.tile([weight_N, 0.0, 0.0, 0.0], (4, 1)))


def test_coordinates_have_units_of_their_own_and_no_snap_at_both_ends(simulation1: Scenario) -> None:
    problem = flight_problem(fleet(simulation1, 3, "row", (auto(SHRINK),)))
    (scale,) = problem.coordinates
    layout = layout_of(problem, Mesh(np.array([0.0, 9.0, 20.0, 30.0]), (2, 3, 2)))
    unit, shift = (split(layout, part) for part in scales(problem, layout))
    np.testing.assert_allclose(unit[0][5, 12:], [scale.unit, *scale.most[:3]])
    np.testing.assert_allclose(unit[1][2, 4], scale.most[3])
    assert not shift[0].any()
    assert not shift[1][:, 4].any()
    low, high = (split(layout, part) for part in bounds(problem, layout))
    assert high[1][:, 4].tolist() == [0.0, scale.most[3], scale.most[3], 0.0]
    assert low[1][:, 4].tolist() == [0.0, -scale.most[3], -scale.most[3], 0.0]
    assert (high[1][0, :4] > 0.0).all()
    eq_41 = layout_of(problem, Mesh(np.array([0.0, 9.0, 20.0, 30.0]), (2, 3, 2)), ControlForm.LAGRANGE)
    assert (split(eq_41, bounds(problem, eq_41)[1])[1][:, 4] == scale.most[3]).all()


def test_a_hold_is_a_hover_in_the_trim_of_its_wind(simulation1: Scenario) -> None:
    """Everything but a free yaw is fixed where it begins; the control is, at both of its ends."""
    wind = {"wind": {"from_deg": 270.0, "speed_mps": 2.0}}
    held = {**CORNER, "hold_s": 4.0, "heading_deg": 30.0}
    problem = flight_problem(flight_through(simulation1, held, {**FAR, "heading_deg": -20.0}, **wind))
    problem = replace(problem, point_s=(20.0, 40.0))
    layout = layout_of(problem, first_mesh(problem, 9.0, 6.0, 2))
    first, second = layout.mesh.arrivals.tolist()
    (low, controls_low), (high, controls_high) = (split(layout, part) for part in bounds(problem, layout))
    q, place = problem.quadrotor, problem.points[0].place_ned_m
    thrust, roll, pitch = hover_trim(6.0, np.radians(30.0), q)
    assert abs(roll) > 0.01
    hover = [*place, 0.0, 0.0, 0.0, roll, pitch, np.radians(30.0), 0.0, 0.0, 0.0]
    np.testing.assert_allclose(low[first], hover)
    np.testing.assert_allclose(high[first], hover)
    assert (low[first + 1] < high[first + 1]).all()  # the end of the hold follows from its begin
    np.testing.assert_allclose(low[second, [0, 1, 2, 8]], [*problem.points[1].place_ned_m, np.radians(-20.0)])
    np.testing.assert_allclose(high[second, [0, 1, 2, 8]], low[second, [0, 1, 2, 8]])
    assert (low[second, 3:8] < high[second, 3:8]).all()
    for controls in (controls_low, controls_high):
        np.testing.assert_allclose(controls[[first, first + 1]], [[thrust, 0.0, 0.0, 0.0]] * 2)
    assert (controls_low[first + 2] < controls_high[first + 2]).all()


def test_within_a_radius_the_place_is_free(simulation1: Scenario) -> None:
    problem = flight_problem(flight_through(simulation1, {**CORNER, "radius_m": 3.0}))
    problem = replace(problem, point_s=(30.0,))
    layout = layout_of(problem, first_mesh(problem, 9.0, 6.0, 2))
    (joint,) = layout.mesh.arrivals.tolist()
    low, high = (split(layout, part)[0] for part in bounds(problem, layout))
    assert (low[joint] < high[joint]).all()


def test_at_a_hold_the_shape_rests_too(simulation1: Scenario) -> None:
    problem = flight_problem(
        flight_through(
            simulation1,
            {**CORNER, "hold_s": 4.0},
            vehicles=3,
            formation={"change": [auto({**SHRINK, "scale": 0.95})]},
        )
    )
    problem = replace(problem, point_s=(30.0,))
    layout = layout_of(problem, first_mesh(problem, 9.0, 6.0, 2))
    (joint,) = layout.mesh.arrivals.tolist()
    low, high = (split(layout, part)[0] for part in bounds(problem, layout))
    assert not low[joint, 13:16].any()
    assert not high[joint, 13:16].any()
    assert low[joint, 12] < high[joint, 12]


@pytest.mark.parametrize("form", ControlForm)
def test_thrust_joins_the_other_phases_where_the_jerk_is_limited(simulation1: Scenario, form: ControlForm) -> None:
    limited = changed(meadow(alone(simulation1)), limits={**ROOMY, "jerk_max_mps3": 2.0}, vehicle=STRONG)
    problem = flight_problem(limited)
    state = problem.start_state.copy()
    state[5:8] = 0.4, 0.1, 0.2
    for given, ends in ((problem, [0, -1]), (replace(problem, start_state=state), [0, -1])):
        layout = layout_of(given, form=form)
        low, high = (split(layout, part)[1] for part in bounds(given, layout))
        if form is ControlForm.LAGRANGE:
            assert (low < high).all()
            continue
        thrusts = [level_flight_thrust_N(s, given.quadrotor) for s in (given.start_state, given.end_state)]
        np.testing.assert_allclose(low[ends, 0], thrusts)
        np.testing.assert_allclose(high[ends, 0], thrusts)
        assert (low[1:-1, 0] < high[1:-1, 0]).all()
        assert (low[:, 1:] < high[:, 1:]).all()
    state[10] = 0.01  # in the middle of another flight, which has a thrust of its own
    low, high = (
        split(layout_of(problem), part)[1] for part in bounds(replace(problem, start_state=state), layout_of(problem))
    )
    assert low[0, 0] < high[0, 0]
    assert low[-1, 0] == high[-1, 0]


def test_steps_of_the_thrust_are_seconds_at_its_largest_rate(simulation1: Scenario) -> None:
    """A share of 0.3 of the jerk may change the size of the thrust."""
    limited = changed(meadow(alone(simulation1)), limits={**ROOMY, "jerk_max_mps3": 2.0}, vehicle=STRONG)
    problem = flight_problem(limited)
    layout = layout_of(problem)
    unit, _ = scales(problem, layout)
    steps = thrust_steps(problem, layout, unit)
    assert steps is not None
    w = np.zeros(layout.size)
    for point, thrust in enumerate((10.0, 13.0, 12.0, 12.5)):
        w[layout.control(point)] = thrust
        w[layout.control(point) + 1] = 99.0
    rate_Nps = 0.3 * 2.0 * 2.0
    np.testing.assert_allclose(np.array(steps @ (w / unit)).ravel(), np.array([3.0, -1.0, 0.5]) / rate_Nps)
    assert thrust_steps(problem, layout_of(problem, form=ControlForm.LAGRANGE), unit) is None
    assert thrust_steps(flight_problem(meadow(alone(simulation1))), layout, unit) is None
