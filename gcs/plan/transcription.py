"""The Gauss pseudospectral method on several intervals: from a Problem and a Mesh to a nonlinear program (Eqs. 36-50).

Knows: CasADi, and that everything but the vehicle itself is linear. Dynamics, objective and path constraints are small
functions of one instant's 16 numbers z = (state, control); sampling matrices S take the unknowns w to all instants,
and constant matrices A, B assemble collocation (Eq. 44) and joints (Eq. 46): g = A w - B f(S w). First and second
derivatives are assembled the same way (S' H S), which is why the program is built in milliseconds and solved with
exact Hessians. Does not know: how the program is solved, whether its solution is any good between the instants.

Control is piecewise linear and continuous, its unknowns the values at the joints. The paper's Eq. 41 extrapolates from
inner nodes and leaves the control box at the ends of an interval; a line between two points of a box cannot. Eq. 41 is
there to compare with.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy import sparse
from scipy.interpolate import PPoly

from gcs.plan import instant
from gcs.plan.gauss import gauss_rule
from gcs.plan.layout import NU, NX, NZ, STATE_WORDS, ControlForm, Layout
from gcs.plan.mesh import Mesh
from gcs.plan.problem import TERMINAL_WEIGHTS, Problem
from gcs.plan.trajectory import Trajectory
from gcs.quadrotor import Array

# One unit of each number in the program: of the size it has in flight, so that IPOPT sees values near one.
STATE_UNIT = np.array([100.0, 100.0, 10.0, 5.0, 5.0, 1.0, 0.1, 0.1, 1.0, 0.05, 0.05, 0.05])


def _dm(matrix: sparse.spmatrix) -> ca.DM:
    """A SciPy matrix as CasADi's, which wants rows in order."""
    ordered = sparse.csc_matrix(matrix)
    ordered.sort_indices()
    rows, columns = ordered.shape
    pattern = ca.Sparsity(rows, columns, ordered.indptr.tolist(), ordered.indices.tolist())
    return ca.DM(pattern, ordered.data)


@dataclass(frozen=True)
class Program:
    """The nonlinear program min f(y) s.t. low <= g(y) <= high in scaled unknowns y = (w - shift) / unit (Eq. 50)."""

    layout: Layout
    unit: Array  # (n,)
    shift: Array  # (n,)
    y_low: Array
    y_high: Array
    g_low: Array
    g_high: Array
    y_names: tuple[str, ...]  # what limits each unknown
    g_names: tuple[tuple[str, float], ...]  # what each row of g is, and when: no two alike
    nlp: ca.Function
    derivatives: dict[str, ca.Function]  # grad_f, jac_g, hess_lag

    def scaled(self, trajectory: Trajectory) -> Array:
        """Unknowns y that sample an existing trajectory: the warm start."""
        mesh, layout = self.layout.mesh, self.layout
        states = trajectory.state(np.concatenate([mesh.joints_s, layout.node_times_s()]))
        w = np.concatenate([states.ravel(), trajectory.control(layout.control_times_s()).ravel()])
        return np.clip((w - self.shift) / self.unit, self.y_low, self.y_high)

    def trajectory(self, y: Array) -> Trajectory:
        """Polynomials through the solution: states of degree K, control as its form has it."""
        mesh, layout = self.layout.mesh, self.layout
        w = y * self.unit + self.shift
        top = max(mesh.degrees)
        top_control = max(len(layout.control_support(i)[0]) for i in range(mesh.intervals)) - 1
        state = np.zeros((top + 1, mesh.intervals, NX))
        control = np.zeros((top_control + 1, mesh.intervals, NU))
        for i, degree in enumerate(mesh.degrees):
            h = mesh.joints_s[i + 1] - mesh.joints_s[i]
            first = layout.node(i, 0)
            values = np.vstack([w[layout.joint(i) :][:NX], w[first : first + NX * degree].reshape(degree, NX)])
            powers = h ** np.arange(degree, -1.0, -1.0)
            state[top - degree :, i] = gauss_rule(degree).power_basis() @ values / powers[:, None]
            points, support = layout.control_support(i)
            controls = w[layout.control(points.start) : layout.control(points.stop)].reshape(len(points), NU)
            basis = np.linalg.inv(np.vander(0.5 * h * (support + 1.0)))
            control[top_control + 1 - len(points) :, i] = basis @ controls
        return Trajectory(PPoly(state, mesh.joints_s), PPoly(control, mesh.joints_s))


def transcribe(problem: Problem, mesh: Mesh, control_form: ControlForm = ControlForm.LINEAR) -> Program:
    """Build the program for one problem on one mesh."""
    layout = Layout(mesh, control_form)
    unit, shift = _scales(problem, layout)
    node_times = layout.node_times_s()
    times = np.concatenate([node_times, mesh.watch_s])
    sampling = layout.sampling(times)
    scaled_sampling = _dm(sampling @ sparse.diags(unit))
    offset = ca.DM(sampling @ shift)
    a, b = layout.collocation()
    row_unit = np.tile(STATE_UNIT, a.shape[0] // NX)
    a_scaled = _dm(sparse.diags(1.0 / row_unit) @ a @ sparse.diags(unit))
    a_shift = ca.DM((a @ shift) / row_unit)
    b_scaled = _dm(sparse.diags(1.0 / row_unit) @ b)

    weight = TERMINAL_WEIGHTS[problem.objective.terminal_weight](node_times, problem.end_s)
    quadrature = layout.quadrature()
    shares = ca.DM(np.vstack([quadrature / problem.duration_s, quadrature * weight / (quadrature @ weight)]))

    parts = instant.functions(problem)
    nlp, derivatives = _assemble(
        parts, layout.nodes, len(mesh.watch_s), scaled_sampling, offset, a_scaled, a_shift, b_scaled, shares
    )
    y_low, y_high = _bounds(problem, layout)
    dynamics_rows = a.shape[0]
    path_rows = len(parts.path_names)
    watched = len(mesh.watch_s)
    names = [(f"Eq. 1 for {name}", float(t)) for t in layout.collocation_times_s() for name in STATE_WORDS]
    names += [(name, float(t)) for t in times for name in parts.path_names]
    names += [(f"limit of {name}", float(t)) for t in mesh.watch_s for name in STATE_WORDS]
    return Program(
        layout,
        unit,
        shift,
        (y_low - shift) / unit,
        (y_high - shift) / unit,
        np.concatenate(
            [
                np.zeros(dynamics_rows),
                np.zeros(path_rows * len(times)),
                np.tile(problem.state_low / STATE_UNIT, watched),
            ]
        ),
        np.concatenate(
            [
                np.zeros(dynamics_rows),
                np.full(path_rows * len(times), np.inf),
                np.tile(problem.state_high / STATE_UNIT, watched),
            ]
        ),
        layout.names(),
        tuple(names),
        nlp,
        derivatives,
    )


def _assemble(
    parts: instant.Instant,
    nodes: int,
    watched: int,
    sampling: ca.DM,
    offset: ca.DM,
    a: ca.DM,
    a_shift: ca.DM,
    b: ca.DM,
    shares: ca.DM,
) -> tuple[ca.Function, dict[str, ca.Function]]:
    """Program and exact derivatives as CasADi functions of y."""
    points = nodes + watched
    y, p = ca.MX.sym("y", sampling.size2()), ca.MX.sym("p", 0)
    z = ca.reshape(ca.mtimes(sampling, y) + offset, NZ, points)
    zn = z[:, :nodes]
    s_nodes, s_watch = sampling[: NZ * nodes, :], sampling[NZ * nodes :, :]
    state_rows = [NZ * i + j for i in range(watched) for j in range(NX)]
    watch_unit = ca.DM(np.tile(1.0 / STATE_UNIT, watched))
    box = ca.diag(watch_unit) @ s_watch[state_rows, :] if watched else ca.DM(0, sampling.size2())
    box_shift = offset[NZ * nodes :][state_rows] * watch_unit if watched else ca.DM(0, 1)

    f = ca.sum2(parts.cost.map(nodes)(zn, shares))
    g = ca.vertcat(
        ca.mtimes(a, y) + a_shift - ca.mtimes(b, ca.vec(parts.motion.map(nodes)(zn))),
        ca.vec(parts.path.map(points)(z)),
        ca.mtimes(box, y) + box_shift,
    )
    nlp = ca.Function("nlp", [y, p], [f, g], ["x", "p"], ["f", "g"])

    # IPOPT's interface copies gradients as they are stored: a sparse one would leave the gaps unset.
    gradient = ca.densify(ca.mtimes(s_nodes.T, ca.vec(parts.cost_gradient.map(nodes)(zn, shares))))
    jacobian = ca.vertcat(
        a - ca.mtimes([b, _block_diagonal(parts.motion_jacobian, nodes, zn), s_nodes]),
        ca.mtimes(_block_diagonal(parts.path_jacobian, points, z), sampling),
        ca.MX(box),
    )
    sigma, lam = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.size1())
    costate = -ca.mtimes(b.T, lam[: a.size1()])
    path_count = len(parts.path_names)
    lam_path = ca.reshape(lam[a.size1() : a.size1() + path_count * points], path_count, points)
    curvature = _block_diagonal(
        parts.motion_hessian, nodes, zn, shares, ca.repmat(sigma, 1, nodes), ca.reshape(costate, NX, nodes)
    )
    hessian = ca.mtimes([s_nodes.T, curvature, s_nodes])
    hessian += ca.mtimes([sampling.T, _block_diagonal(parts.path_hessian, points, z, lam_path), sampling])
    return nlp, {
        "grad_f": ca.Function("grad_f", [y, p], [f, gradient], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [y, p], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "hess_lag",
            [y, p, sigma, lam],
            [ca.triu(hessian)],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    }


def _block_diagonal(function: ca.Function, count: int, *arguments: ca.MX | ca.DM) -> ca.MX:
    """Evaluate `function` at every instant and set its (sparse) results on a diagonal of blocks.

    Side by side and on the diagonal, blocks store their nonzeros in the same column-major order.
    """
    side_by_side = function.map(count)(*arguments)
    pattern = ca.diagcat(*([function.sparsity_out(0)] * count))
    return ca.MX(pattern, side_by_side.nz[:])


def _scales(problem: Problem, layout: Layout) -> tuple[Array, Array]:
    """Unit and shift (n,) of every unknown."""
    hover = np.array([problem.quadrotor.weight_N, 0.0, 0.0, 0.0])
    control_unit = 0.5 * (problem.control_high - problem.control_low)
    control_unit[0] = problem.control_high[0] - hover[0]
    unit = np.concatenate([np.tile(STATE_UNIT, layout.state_points), np.tile(control_unit, layout.control_points)])
    return unit, np.concatenate([np.zeros(NX * layout.state_points), np.tile(hover, layout.control_points)])


def _bounds(problem: Problem, layout: Layout) -> tuple[Array, Array]:
    """Eq. 51 on every unknown, Eqs. 15 and 16 at the ends as bounds that coincide."""
    states, controls = layout.state_points, layout.control_points
    low = np.concatenate([np.tile(problem.state_low, states), np.tile(problem.control_low, controls)])
    high = np.concatenate([np.tile(problem.state_high, states), np.tile(problem.control_high, controls)])
    for index, state in (
        (layout.joint(0), problem.start_state),
        (layout.joint(layout.mesh.intervals), problem.end_state),
    ):
        low[index : index + NX] = high[index : index + NX] = state
    return low, high
