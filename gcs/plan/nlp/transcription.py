"""The Gauss pseudospectral method on several intervals: from a Problem and a Mesh to a nonlinear program (Eqs. 36-50).

Everything but the vehicle itself is linear. Dynamics, objective and path constraints are small functions of one
instant's 16 numbers z = (state, control). Sampling matrices S map the unknowns w to all instants. Constant matrices A
and B assemble collocation (Eq. 44) and joints (Eq. 46): g = A w - B f(S w). First and second derivatives are assembled
in the same way (S' H S). Therefore the program is built in milliseconds and solved with exact Hessians.

Control is piecewise linear and continuous; its unknowns are the values at the joints. The paper's Eq. 41 extrapolates
from inner nodes and can leave the control box at the ends of an interval; a line between two points of a box cannot.
Eq. 41 is available for comparison.
"""

import itertools
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import PPoly

from gcs.plan.nlp.assembly import Constants, assemble, dm
from gcs.plan.nlp.gauss import gauss_rule
from gcs.plan.nlp.mesh import HOLD, Mesh
from gcs.plan.nlp.program_bounds import bounds, box_may_bind, scales, thrust_steps
from gcs.plan.nlp.route_phases import leg_constants, leg_times, point_rows
from gcs.plan.nlp.variables import ControlForm, VariableLayout
from gcs.plan.ocp import stage_functions
from gcs.plan.ocp.active_vehicles import ActiveVehicles, active_vehicles
from gcs.plan.ocp.bounds import leader_state_bounds
from gcs.plan.ocp.objective_sum import cost_shares
from gcs.plan.ocp.objectives import TERMINAL_WEIGHTS
from gcs.plan.ocp.problem import Problem
from gcs.plan.ocp.stage_functions import EVERYWHERE, RowReach
from gcs.plan.trajectory.constraint_id import ConstraintId, Form, Kind
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.types import Array
from gcs.util.long_work import report


@dataclass(frozen=True)
class Program:
    """The nonlinear program min f(y) s.t. low <= g(y) <= high in scaled unknowns y = (w - shift) / unit (Eq. 50)."""

    layout: VariableLayout
    unit: Array  # (n,)
    shift: Array  # (n,)
    y_low: Array
    y_high: Array
    g_low: Array
    g_high: Array
    y_ids: tuple[ConstraintId, ...]  # the limit of each unknown
    g_ids: tuple[tuple[ConstraintId, float], ...]  # constraint and time of each row of g; unique
    nlp: ca.Function
    derivatives: dict[str, ca.Function]  # grad_f, jac_g, hess_lag
    parameters: Array  # (p,) second argument of nlp and derivatives
    step_rows: int = 0  # so many last rows of g limit the steps of the thrust
    moving_shape: bool = False  # on a schedule
    end_s: float | None = None  # of the flight, where it is given
    free_time: bool = False
    leg_words: tuple[str, ...] = ()  # (K,) of each leg, for messages; none for a flight without points

    def leg_at(self, t_s: float) -> str:
        """The leg at a time of the mesh, or the one before a hold, in words; empty for a flight without points."""
        if not self.leg_words:
            return ""
        mesh = self.layout.mesh
        interval = int(np.clip(np.searchsorted(mesh.joints_s, t_s) - 1, 0, mesh.intervals - 1))
        held = mesh.leg_of_interval[interval] == HOLD
        return self.leg_words[int(mesh.leg_of_interval[interval - int(held)])]

    def scaled(self, trajectory: Trajectory) -> Array:
        """Unknowns y sampled from an existing trajectory: the warm start."""
        layout = self.layout
        states = trajectory.state(layout.point_times_s())
        w = np.concatenate([states.ravel(), trajectory.control(layout.control_times_s()).ravel()])
        y = np.append((w - self.shift) / self.unit, np.ones(len(self.y_low) - len(w)))
        return np.clip(y, self.y_low, self.y_high)

    def stretch(self, y: Array) -> Array:
        """Durations (K,) of the legs over those in the mesh; 1 where the time of one leg is given."""
        return y[self.layout.size :] if len(y) > self.layout.size else np.ones(1)

    def mesh(self, y: Array) -> Mesh:
        """The mesh with the durations of the legs in the solution."""
        return self.layout.mesh.stretched(self.stretch(y), self.end_s)

    def trajectory(self, y: Array) -> Trajectory:
        """Polynomials through the solution: states of degree K, control by its form."""
        layout = self.layout
        mesh = self.mesh(y)
        w = y[: layout.size] * self.unit + self.shift
        top = max(mesh.degrees)
        top_control = max(len(layout.control_support(i)[0]) for i in range(mesh.intervals)) - 1
        state = np.zeros((top + 1, mesh.intervals, layout.nx))
        control = np.zeros((top_control + 1, mesh.intervals, layout.nu))
        for i, degree in enumerate(mesh.degrees):
            h = mesh.joints_s[i + 1] - mesh.joints_s[i]
            first = layout.node(i, 0)
            nx = layout.nx
            values = np.vstack([w[layout.joint(i) :][:nx], w[first : first + nx * degree].reshape(degree, nx)])
            powers = h ** np.arange(degree, -1.0, -1.0)
            state[top - degree :, i] = gauss_rule(degree).power_basis() @ values / powers[:, None]
            points, support = layout.control_support(i)
            controls = w[layout.control(points.start) : layout.control(points.stop)].reshape(len(points), layout.nu)
            basis = np.linalg.inv(np.vander(0.5 * h * (support + 1.0)))
            control[top_control + 1 - len(points) :, i] = basis @ controls
        return Trajectory(PPoly(state, mesh.joints_s), PPoly(control, mesh.joints_s))


def transcribe(
    problem: Problem,
    mesh: Mesh,
    last: Trajectory,
    control_form: ControlForm = ControlForm.LINEAR,
    reach: RowReach = EVERYWHERE,
) -> Program:
    """The program of one problem on one mesh. The leader's `last` trajectory decides which vehicles are active when,
    and which rows the program has: those that can bind within `reach` of it."""
    report("building the program")
    layout = VariableLayout(mesh, control_form, tuple(c.name for c in problem.coordinates))
    nx = layout.nx
    unit, shift = scales(problem, layout)
    state_unit = unit[:nx]
    node_times = layout.node_times_s()
    times = np.concatenate([node_times, mesh.extra_s])
    chosen = active_vehicles(problem, times, last.state(times))
    sampling = layout.sampling(times)
    a, b = layout.collocation()
    row_unit = sparse.diags(1.0 / np.tile(state_unit, a.shape[0] // nx))
    weight = TERMINAL_WEIGHTS[problem.objective.terminal_weight](node_times, problem.end_s)
    quadrature = layout.quadrature()
    shares = cost_shares(problem, node_times, quadrature / problem.mean_s, quadrature * weight / (quadrature @ weight))
    counts = (chosen.ground.shape[1], max((d.shape[1] for d in chosen.zones), default=0), chosen.moving.shape[1])
    parts = stage_functions.functions(problem, *counts)
    used = box = None
    if problem.follows_course or reach is not EVERYWHERE:
        at = np.hstack([last.state(times), last.control(times)])
        values = np.asarray(parts.path.map(len(times))(at.T, chosen.parameters.T)).T
        used = stage_functions.path_may_bind(problem, chosen, values, reach, layout.nodes)
        box = box_may_bind(problem, mesh.extra_s, last.state(mesh.extra_s))
    times_of_legs, near = leg_times(problem, mesh), point_rows(problem, layout, unit, shift)
    functions = assemble(
        parts,
        Constants(
            nodes=layout.nodes,
            extra=len(mesh.extra_s),
            sampling=dm(sampling @ sparse.diags(unit)),
            offset=ca.DM(sampling @ shift),
            a=dm(row_unit @ a @ sparse.diags(unit)),
            a_shift=ca.DM(row_unit @ (a @ shift)),
            b=dm(row_unit @ b),
            shares=ca.DM(shares),
            slots=ca.DM(chosen.parameters.T),
            state_unit=state_unit,
            thrust_steps=(steps := thrust_steps(problem, layout, unit)),
            interval_s=None if steps is None else np.diff(mesh.joints_s),
            legs=None if times_of_legs is None else leg_constants(problem, mesh, times_of_legs),
            points=None if near is None else near.functions,
            path_rows=None if used is None else np.flatnonzero(used).tolist(),
            box_rows=None if box is None else np.flatnonzero(box).tolist(),
        ),
    )
    return bounded_program(problem, layout, chosen, functions, RowMasks(used=used, box=box))


@dataclass(frozen=True)
class RowMasks:
    """Which rows a program has, and which of them have an effect. None: all of them."""

    used: NDArray[np.bool_] | None = None  # (T, P) rows of the path that are in the program
    box: NDArray[np.bool_] | None = None  # (W, nx) bounds of the states at extra instants that are in it
    free: NDArray[np.bool_] | None = None  # (T, P) rows of the path without effect; None: none of them


def bounded_program(
    problem: Problem,
    layout: VariableLayout,
    chosen: ActiveVehicles,
    functions: tuple[ca.Function, dict[str, ca.Function]],
    rows: RowMasks,
    parameters: Array | None = None,
) -> Program:
    """The program of `functions` (nlp, derivatives), the bounds of this problem and the constraints of its rows."""
    nlp, derivatives = functions
    mesh, (unit, shift) = layout.mesh, scales(problem, layout)
    state_unit = unit[: layout.nx]
    y_low, y_high = bounds(problem, layout)
    box_low, box_high = leader_state_bounds(problem, mesh.extra_s)
    dynamics = np.zeros(layout.nx * (layout.nodes + mesh.intervals))
    free = stage_functions.path_is_free(problem, chosen)
    if rows.free is not None:
        free = free | rows.free
    used = np.ones_like(free) if rows.used is None else rows.used
    times = np.concatenate([layout.node_times_s(), mesh.extra_s])
    motion, limits = ([replace(one, form=form) for one in layout.state_ids] for form in (Form.MOTION, Form.BOUND))
    g_ids = [(one, float(t)) for t in layout.collocation_times_s() for one in motion]
    g_ids += [
        (one, float(t))
        for t, row, kept in zip(times, stage_functions.path_ids(problem, chosen), used, strict=True)
        for one in itertools.compress(row, kept)
    ]
    box = np.ones(box_low.shape, dtype=bool) if rows.box is None else rows.box
    g_ids += [
        (one, float(t)) for t, row in zip(mesh.extra_s, box, strict=True) for one in itertools.compress(limits, row)
    ]
    steps = layout.mesh.intervals if layout.control_form is ControlForm.LINEAR else 0
    steps *= problem.jerk_left_mps3 is not None
    y_low, y_high, y_ids = (y_low - shift) / unit, (y_high - shift) / unit, layout.limits()
    rows_low, rows_high = np.zeros(0), np.zeros(0)
    if (near := point_rows(problem, layout, unit, shift)) is not None:
        rows_low, rows_high = near.low, near.high
        g_ids += near.ids
    if (legs := leg_times(problem, mesh)) is not None:
        y_low, y_high = np.append(y_low, legs.low), np.append(y_high, legs.high)
        y_ids = (*y_ids, *legs.ids)
        rows_low, rows_high = np.append(rows_low, legs.rows_low), np.append(rows_high, legs.rows_high)
        g_ids += legs.row_ids
    ways = map(ConstraintId, (Kind.THRUST_GROWTH, Kind.THRUST_FALL))
    g_ids += [(way, float(t)) for way in ways for t in mesh.joints_s[:steps]]
    return Program(
        layout,
        unit,
        shift,
        y_low,
        y_high,
        np.concatenate(
            [
                dynamics,
                np.where(free, -np.inf, 0.0)[used],
                (box_low / state_unit)[box],
                rows_low,
                np.full(2 * steps, -np.inf),
            ]
        ),
        np.concatenate(
            [dynamics, np.full(used.sum(), np.inf), (box_high / state_unit)[box], rows_high, np.zeros(2 * steps)]
        ),
        y_ids,
        tuple(g_ids),
        nlp,
        derivatives,
        np.zeros(0) if parameters is None else parameters,
        2 * steps,
        bool(problem.shape.moving_s),
        None if problem.free_time is not None and not problem.free_time.is_fixed else problem.end_s,
        problem.free_time is not None,
        tuple(problem.leg_words(leg) for leg in range(mesh.leg_count)) if problem.points else (),
    )
