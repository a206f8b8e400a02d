"""Units and bounds of the program's unknowns (Eqs. 15, 16, 51), and the steps of the thrust that the jerk limits."""

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from gcs.physics.quadrotor import level_flight_thrust_N
from gcs.physics.states import RATES
from gcs.plan.nlp.assembly import dm
from gcs.plan.nlp.route_phases import fix_at_point
from gcs.plan.nlp.variables import ControlForm, VariableLayout
from gcs.plan.ocp import stage_functions
from gcs.plan.ocp.bounds import boundary_values, leader_control_bounds, leader_state_bounds
from gcs.plan.ocp.problem import Problem
from gcs.types import Array

# Unit of each state in the program: its typical size in flight, so that IPOPT works with values near one.
STATE_UNIT = np.array([100.0, 100.0, 10.0, 5.0, 5.0, 1.0, 0.1, 0.1, 1.0, 0.05, 0.05, 0.05])

_NEAR_BOUND = 0.15  # of the range: a state that is farther from its bounds between nodes does not reach them


def scales(problem: Problem, layout: VariableLayout) -> tuple[Array, Array]:
    """Unit and shift (n,) of every unknown."""
    hover = np.zeros(layout.nu)
    hover[0] = problem.quadrotor.weight_N
    control_unit = 0.5 * (problem.control_high - problem.control_low)
    control_unit[0] = problem.control_high[0] - hover[0]
    chains = [np.array([c.unit, *c.most[:3]]) for c in problem.coordinates]
    state_unit = np.concatenate([STATE_UNIT, *chains])
    control_unit = np.concatenate([control_unit, [c.most[3] for c in problem.coordinates]])
    unit = np.concatenate([np.tile(state_unit, layout.state_points), np.tile(control_unit, layout.control_points)])
    return unit, np.concatenate([np.zeros(layout.nx * layout.state_points), np.tile(hover, layout.control_points)])


def bounds(problem: Problem, layout: VariableLayout) -> tuple[Array, Array]:
    """Eq. 51 on every unknown; Eq. 15 and Eq. 16 at the ends as equal bounds."""
    state_low, state_high = leader_state_bounds(problem, layout.point_times_s())
    control_low, control_high = leader_control_bounds(problem, layout.control_times_s())
    first, last = 0, layout.mesh.intervals
    start, end_low, end_high = boundary_values(problem)
    state_low[first] = state_high[first] = start
    state_low[last], state_high[last] = end_low, end_high
    for point, joint in zip(problem.points, layout.mesh.arrivals.tolist(), strict=True):
        fix_at_point(point, joint, problem.quadrotor, (state_low, state_high), (control_low, control_high))
    if (problem.winds_differ or problem.jerk_left_mps3 is not None) and layout.control_form is ControlForm.LINEAR:
        # Thrust must not jump where phases join: a vehicle with more tilt than the leader would have to tilt at once.
        for end, state in ((first, start), (last, end_low)):
            if not problem.winds_differ and state[RATES].any():
                continue  # a flight that begins in the middle of another one
            control_low[end, 0] = control_high[end, 0] = level_flight_thrust_N(state, problem.quadrotor)
    if problem.start_thrust_N is not None and layout.control_form is ControlForm.LINEAR:
        control_low[first, 0] = control_high[first, 0] = problem.start_thrust_N
    # Coordinates rest in every derivative, so that the ground phases join without a jump.
    chains = layout.nu - len(problem.control_low)
    if chains and layout.control_form is ControlForm.LINEAR:
        for end in (first, last):
            control_low[end, -chains:] = control_high[end, -chains:] = 0.0
    return (
        np.concatenate([state_low.ravel(), control_low.ravel()]),
        np.concatenate([state_high.ravel(), control_high.ravel()]),
    )


def thrust_steps(problem: Problem, layout: VariableLayout, unit: Array) -> ca.DM | None:
    """Matrix (M, n) of the steps of U1 over the intervals, in seconds at the largest rate; None without a limit."""
    if problem.jerk_left_mps3 is None or layout.control_form is not ControlForm.LINEAR:
        return None
    count = layout.mesh.intervals
    rate = stage_functions.THRUST_SHARE * problem.jerk_left_mps3 * problem.quadrotor.mass_kg
    columns = [layout.control(point) for point in range(count + 1)]
    values = unit[columns] / rate
    rows = np.tile(np.arange(count), 2)
    entries = np.concatenate([-values[:-1], values[1:]])
    return dm(sparse.csc_matrix((entries, (rows, columns[:-1] + columns[1:])), shape=(count, layout.size)))


def box_may_bind(problem: Problem, times_s: Array, states: Array) -> NDArray[np.bool_]:
    """Mask (T, nx) of the states' bounds that can bind at `times_s` near the last known states (T, nx).

    A guess says nothing about rates, which change fastest: their bounds are all there.
    """
    low, high = leader_state_bounds(problem, times_s)
    with np.errstate(invalid="ignore"):
        near = _NEAR_BOUND * (high - low)
    found = (states - low < near) | (high - states < near)
    found[:, RATES] = True
    return np.asarray(found)
