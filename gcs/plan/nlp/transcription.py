"""The Gauss pseudospectral method on several intervals: from a Problem and a Mesh to a nonlinear program (Eqs. 36-50).

Everything but the vehicle itself is linear. Dynamics, objective and path constraints are small functions of one
instant's 16 numbers z = (state, control). Sampling matrices S map the unknowns w to all instants. Constant matrices A
and B assemble collocation (Eq. 44) and joints (Eq. 46): g = A w - B f(S w). First and second derivatives are assembled
in the same way (S' H S). Therefore the program is built in milliseconds and solved with exact Hessians.

Control is piecewise linear and continuous; its unknowns are the values at the joints. The paper's Eq. 41 extrapolates
from inner nodes and can leave the control box at the ends of an interval; a line between two points of a box cannot.
Eq. 41 is available for comparison.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import RATES, Array, level_flight_thrust_N
from gcs.plan.nlp.gauss import gauss_rule
from gcs.plan.nlp.mesh import Mesh
from gcs.plan.nlp.variables import ControlForm, VariableLayout
from gcs.plan.ocp import stage_functions
from gcs.plan.ocp.active_vehicles import ActiveVehicles, active_vehicles
from gcs.plan.ocp.bounds import boundary_values, leader_control_bounds, leader_state_bounds
from gcs.plan.ocp.objective_sum import cost_shares, duration_cost
from gcs.plan.ocp.objectives import TERMINAL_WEIGHTS
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.trajectory import Trajectory

# Unit of each state in the program: its typical size in flight, so that IPOPT works with values near one.
STATE_UNIT = np.array([100.0, 100.0, 10.0, 5.0, 5.0, 1.0, 0.1, 0.1, 1.0, 0.05, 0.05, 0.05])


def dm(matrix: sparse.spmatrix) -> ca.DM:
    """A SciPy matrix as a CasADi matrix, with sorted row indices."""
    ordered = sparse.csc_matrix(matrix)
    ordered.sort_indices()
    rows, columns = ordered.shape
    pattern = ca.Sparsity(rows, columns, ordered.indptr.tolist(), ordered.indices.tolist())
    return ca.DM(pattern, ordered.data)


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
    y_names: tuple[str, ...]  # name of each unknown's limit
    g_names: tuple[tuple[str, float], ...]  # name and time of each row of g; unique
    nlp: ca.Function
    derivatives: dict[str, ca.Function]  # grad_f, jac_g, hess_lag
    parameters: Array  # (p,) second argument of nlp and derivatives
    step_rows: int = 0  # so many last rows of g limit the steps of the thrust
    moving_shape: bool = False  # on a schedule

    def scaled(self, trajectory: Trajectory) -> Array:
        """Unknowns y sampled from an existing trajectory: the warm start."""
        layout = self.layout
        states = trajectory.state(layout.point_times_s())
        w = np.concatenate([states.ravel(), trajectory.control(layout.control_times_s()).ravel()])
        y = np.append((w - self.shift) / self.unit, np.ones(len(self.y_low) - len(w)))
        return np.clip(y, self.y_low, self.y_high)

    def stretch(self, y: Array) -> float:
        """Time of flight over that of the mesh; 1 where the time is given."""
        return float(y[-1]) if len(y) > self.layout.size else 1.0

    def trajectory(self, y: Array) -> Trajectory:
        """Polynomials through the solution: states of degree K, control by its form."""
        layout = self.layout
        mesh = layout.mesh.stretched(self.stretch(y))
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
    problem: Problem, mesh: Mesh, last: Trajectory, control_form: ControlForm = ControlForm.LINEAR
) -> Program:
    """The program of one problem on one mesh. The leader's `last` trajectory decides which vehicles are active when."""
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
    used = None
    if problem.follows_course:
        at = np.hstack([last.state(times), last.control(times)])
        values = np.asarray(parts.path.map(len(times))(at.T, chosen.parameters.T)).T
        used = stage_functions.path_may_bind(problem, chosen, values)
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
            time_cost=None if problem.free_time is None else duration_cost(problem),
            path_rows=None if used is None else np.flatnonzero(used).tolist(),
        ),
    )
    return bounded_program(problem, layout, chosen, functions, used=used)


def bounded_program(
    problem: Problem,
    layout: VariableLayout,
    chosen: ActiveVehicles,
    functions: tuple[ca.Function, dict[str, ca.Function]],
    *,
    parameters: Array | None = None,
    unused: NDArray[np.bool_] | None = None,
    used: NDArray[np.bool_] | None = None,
) -> Program:
    """The program made of `functions` (nlp, derivatives), the bounds of this problem and the names of all rows.

    `unused` (T, P): mask of rows of the path without effect. `used` (T, P): mask of those in the program; else all.
    """
    nlp, derivatives = functions
    mesh, (unit, shift) = layout.mesh, scales(problem, layout)
    state_unit = unit[: layout.nx]
    y_low, y_high = bounds(problem, layout)
    box_low, box_high = leader_state_bounds(problem, mesh.extra_s)
    dynamics = np.zeros(layout.nx * (layout.nodes + mesh.intervals))
    free = stage_functions.path_is_free(problem, chosen)
    if unused is not None:
        free = free | unused
    used = np.ones_like(free) if used is None else used
    words = layout.state_words
    times = np.concatenate([layout.node_times_s(), mesh.extra_s])
    names = [(f"Eq. 1 for {name}", float(t)) for t in layout.collocation_times_s() for name in words]
    names += [
        (name, float(t))
        for t, row, kept in zip(times, stage_functions.path_names(problem, chosen), used, strict=True)
        for name in itertools.compress(row, kept)
    ]
    names += [(f"limit of {name}", float(t)) for t in mesh.extra_s for name in words]
    steps = layout.mesh.intervals if layout.control_form is ControlForm.LINEAR else 0
    steps *= problem.jerk_left_mps3 is not None
    names += [(f"rate of the {way} thrust", float(t)) for way in ("growing", "falling") for t in mesh.joints_s[:steps]]
    y_low, y_high, y_names = (y_low - shift) / unit, (y_high - shift) / unit, layout.names()
    if (time := problem.free_time) is not None:
        y_low = np.append(y_low, time.earliest_s / problem.duration_s)
        y_high = np.append(y_high, time.latest_s / problem.duration_s)
        y_names = (*y_names, "limit of the time of flight")
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
                (box_low / state_unit).ravel(),
                np.full(2 * steps, -np.inf),
            ]
        ),
        np.concatenate([dynamics, np.full(used.sum(), np.inf), (box_high / state_unit).ravel(), np.zeros(2 * steps)]),
        y_names,
        tuple(names),
        nlp,
        derivatives,
        np.zeros(0) if parameters is None else parameters,
        2 * steps,
        bool(problem.shape.moving_s),
    )


@dataclass(frozen=True)
class Constants:
    """The parts of a program that do not depend on its unknowns: numbers, or functions of its parameters."""

    nodes: int
    extra: int  # instants between the nodes
    sampling: ca.DM
    offset: ca.DM
    a: ca.DM
    a_shift: ca.DM
    b: ca.DM
    shares: ca.DM | ca.MX  # (R, nodes): `cost_shares`
    slots: ca.DM | ca.MX  # (slots, instants)
    state_unit: Array  # (nx,)
    lengths: ca.MX | None = None  # (1, nodes) of each node's interval, where b is made for intervals of 1 s
    parameters: ca.MX | None = None  # (p,) symbols
    thrust_steps: ca.DM | None = None  # (M, n): steps of U1 over the intervals, in seconds at the largest rate
    interval_s: Array | None = None  # (M,) lengths of the intervals; with `lengths`, the first node (M,) of each
    time_cost: float | None = None  # cost of the time of flight, where its stretch is the last unknown
    path_rows: list[int] | None = None  # those of the path that the program has, instant by instant; None: all


def assemble(parts: stage_functions.StageFunctions, k: Constants) -> tuple[ca.Function, dict[str, ca.Function]]:
    """The program and its exact derivatives as CasADi functions of y and p."""
    nx, nz = parts.motion.size1_out(0), parts.motion.size1_in(0)
    nodes, points = k.nodes, k.nodes + k.extra
    sampling, a, b, shares = k.sampling, k.a, k.b, k.shares
    unknowns = ca.MX.sym("y", sampling.size2() + (k.time_cost is not None))
    y, stretch = unknowns[: sampling.size2()], unknowns[sampling.size2() :]
    lengths, fixed_shares = k.lengths, shares
    if k.time_cost is not None:
        lengths = ca.repmat(stretch, 1, nodes)
        shares = ca.vertcat(k.shares[0, :] * lengths, k.shares[1:, :])
    p = ca.MX.sym("p", 0) if k.parameters is None else k.parameters
    z = ca.reshape(ca.mtimes(sampling, y) + k.offset, nz, points)
    zn = z[:, :nodes]
    s_nodes, s_watch = sampling[: nz * nodes, :], sampling[nz * nodes :, :]
    state_rows = [nz * i + j for i in range(k.extra) for j in range(nx)]
    watch_unit = ca.DM(np.tile(1.0 / k.state_unit, k.extra))
    box = ca.diag(watch_unit) @ s_watch[state_rows, :] if k.extra else ca.DM(0, sampling.size2())
    box_shift = k.offset[nz * nodes :][state_rows] * watch_unit if k.extra else ca.DM(0, 1)

    path_count = parts.path.size1_out(0)
    path_rows: Any = slice(None) if k.path_rows is None else k.path_rows
    path_size = path_count * points if k.path_rows is None else len(k.path_rows)

    f = ca.sum2(parts.cost.map(nodes)(zn, shares))
    moved = parts.motion.map(nodes)(zn)
    g = ca.vertcat(
        ca.mtimes(a, y) + k.a_shift - ca.mtimes(b, ca.vec(_times_lengths(moved, lengths))),
        ca.vec(parts.path.map(points)(z, k.slots))[path_rows],
        ca.mtimes(box, y) + box_shift,
    )
    steps, spans = _thrust_steps(k, stretch)
    g = ca.vertcat(g, ca.mtimes(steps, y) - spans, -ca.mtimes(steps, y) - spans)

    # IPOPT's interface copies only stored entries: a sparse gradient would leave the others unset.
    gradient = ca.densify(ca.mtimes(s_nodes.T, ca.vec(parts.cost_gradient.map(nodes)(zn, shares))))
    motion_blocks = _block_diagonal(parts.motion_jacobian, nodes, zn)
    jacobian = ca.vertcat(
        a - ca.mtimes([b, _block_diagonal(parts.motion_jacobian, nodes, zn, lengths=lengths), s_nodes]),
        ca.mtimes(_block_diagonal(parts.path_jacobian, points, z, k.slots)[path_rows, :], sampling),
        ca.MX(box),
        ca.MX(steps),
        ca.MX(-steps),
    )
    sigma, lam = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.size1())
    pull = ca.reshape(-ca.mtimes(b.T, lam[: a.size1()]), nx, nodes)
    costate = _times_lengths(pull, lengths)
    lam_path = lam[a.size1() : a.size1() + path_size]
    if k.path_rows is not None:
        lam_path = ca.MX.zeros(path_count * points, 1)
        lam_path[path_rows] = lam[a.size1() : a.size1() + path_size]
    lam_path = ca.reshape(lam_path, path_count, points)
    curvature = _block_diagonal(parts.motion_hessian, nodes, zn, shares, ca.repmat(sigma, 1, nodes), costate)
    hessian = ca.mtimes([s_nodes.T, curvature, s_nodes])
    hessian += ca.mtimes([sampling.T, _block_diagonal(parts.path_hessian, points, z, k.slots, lam_path), sampling])
    if k.time_cost is not None:
        # The program is linear in the stretch of time, in the mean cost and in the motion.
        over_time = ca.vertcat(fixed_shares[0, :], ca.DM.zeros(1, nodes), fixed_shares[2:, :])
        f += k.time_cost * stretch
        cost_gradient = ca.mtimes(s_nodes.T, ca.vec(parts.cost_gradient.map(nodes)(zn, over_time)))
        gradient = ca.vertcat(gradient, ca.sum2(parts.cost.map(nodes)(zn, over_time)) + k.time_cost)
        grown = ca.DM(0, 1) if k.interval_s is None else ca.DM(-k.interval_s)
        rest = g.size1() - a.size1() - 2 * grown.size1()
        column = ca.vertcat(-ca.mtimes(b, ca.vec(moved)), ca.MX(rest, 1), ca.MX(grown), ca.MX(grown))
        jacobian = ca.horzcat(jacobian, column)
        mixed = sigma * cost_gradient + ca.mtimes(s_nodes.T, ca.mtimes(motion_blocks.T, ca.vec(pull)))
        corner = ca.horzcat(ca.MX(1, sampling.size2()), ca.MX(1, 1))
        hessian = ca.vertcat(ca.horzcat(hessian, mixed), corner)
    nlp = ca.Function("nlp", [unknowns, p], [f, g], ["x", "p"], ["f", "g"])
    return nlp, {
        "grad_f": ca.Function("grad_f", [unknowns, p], [f, gradient], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [unknowns, p], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "hess_lag",
            [unknowns, p, sigma, lam],
            [ca.triu(hessian)],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    }


def _thrust_steps(k: Constants, stretch: ca.MX) -> tuple[ca.DM, ca.MX]:
    """The steps of U1 over the intervals, and what they may be (M, 1); none where the jerk is not limited."""
    if k.thrust_steps is None or k.interval_s is None:
        return ca.DM(0, k.sampling.size2()), ca.MX(0, 1)
    if k.lengths is not None:
        return k.thrust_steps, k.lengths[k.interval_s.astype(int).tolist()].T
    spans = ca.MX(ca.DM(k.interval_s))
    return k.thrust_steps, spans if k.time_cost is None else spans * stretch


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


def _times_lengths(rows: ca.MX, lengths: ca.MX | None) -> ca.MX:
    """Columns (n, nodes) times the length of each node's interval."""
    return rows if lengths is None else rows * ca.repmat(lengths, rows.size1(), 1)


def _block_diagonal(
    function: ca.Function, count: int, *arguments: ca.MX | ca.DM, lengths: ca.MX | None = None
) -> ca.MX:
    """The block-diagonal matrix of the (sparse) results of `function` at all instants.

    Side by side and on the diagonal, blocks store their nonzeros in the same column-major order.
    """
    values = function.map(count)(*arguments).nz[:]
    pattern = ca.diagcat(*([function.sparsity_out(0)] * count))
    if lengths is not None:
        values = values * ca.vec(ca.repmat(lengths, function.nnz_out(0), 1))
    return ca.MX(pattern, values)


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
    if (problem.winds_differ or problem.jerk_left_mps3 is not None) and layout.control_form is ControlForm.LINEAR:
        # Thrust must not jump where phases join: a vehicle with more tilt than the leader would have to tilt at once.
        for end, state in ((first, start), (last, end_low)):
            if not problem.winds_differ and state[RATES].any():
                continue  # a flight that begins in the middle of another one
            control_low[end, 0] = control_high[end, 0] = level_flight_thrust_N(state, problem.quadrotor)
    # Coordinates rest in every derivative, so that the ground phases join without a jump.
    chains = layout.nu - len(problem.control_low)
    if chains and layout.control_form is ControlForm.LINEAR:
        for end in (first, last):
            control_low[end, -chains:] = control_high[end, -chains:] = 0.0
    return (
        np.concatenate([state_low.ravel(), control_low.ravel()]),
        np.concatenate([state_high.ravel(), control_high.ravel()]),
    )
