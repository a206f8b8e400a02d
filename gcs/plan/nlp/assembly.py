"""The program and its exact derivatives, made of functions of one instant and constant matrices (Eqs. 44-50)."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from gcs.plan.nlp.mesh import HOLD
from gcs.plan.ocp import stage_functions
from gcs.types import Array


def dm(matrix: sparse.spmatrix) -> ca.DM:
    """A SciPy matrix as a CasADi matrix, with sorted row indices."""
    ordered = sparse.csc_matrix(matrix)
    ordered.sort_indices()
    rows, columns = ordered.shape
    pattern = ca.Sparsity(rows, columns, ordered.indptr.tolist(), ordered.indices.tolist())
    return ca.DM(pattern, ordered.data)


@dataclass(frozen=True)
class PointFunctions:
    """Rows about the states at some joints, and their exact derivatives."""

    pick: ca.DM  # (S, n): the states that the rows are about
    offset: ca.DM  # (S,)
    values: ca.Function  # states (S,) -> rows (R,)
    jacobian: ca.Function  # states -> (R, S)
    hessian: ca.Function  # states, multipliers (R,) -> (S, S)
    count: int  # R


@dataclass(frozen=True)
class LegConstants:
    """Legs whose durations are unknowns, the last ones: each over its duration in the mesh."""

    costs: Array  # (K,) of the time of each leg as long as in the mesh
    of_node: NDArray[np.intp]  # (N,) number of the leg
    of_interval: NDArray[np.intp]  # (M,) number of the leg, or HOLD
    times: Array  # (R, K) rows that are linear in the durations

    @property
    def count(self) -> int:
        """Number K of legs."""
        return len(self.costs)

    def columns(self, values: ca.MX) -> ca.MX:
        """Values (r, N) of all nodes as a matrix (r N, K): those of a leg's nodes in its column."""
        rows = values.size1()
        ends = rows * np.searchsorted(self.of_node, np.arange(self.count + 1))
        size = rows * len(self.of_node)
        pattern = ca.Sparsity(size, self.count, ends.tolist(), list(range(size)))
        return ca.MX(pattern, ca.densify(ca.vec(values)))


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
    legs: LegConstants | None = None
    points: PointFunctions | None = None
    path_rows: list[int] | None = None  # those of the path that the program has, instant by instant; None: all
    box_rows: list[int] | None = None  # those of the states' bounds at extra instants, instant by instant; None: all


def assemble(parts: stage_functions.StageFunctions, k: Constants) -> tuple[ca.Function, dict[str, ca.Function]]:
    """The program and its exact derivatives as CasADi functions of y and p."""
    nx, nz = parts.motion.size1_out(0), parts.motion.size1_in(0)
    nodes, points = k.nodes, k.nodes + k.extra
    sampling, a, b, shares = k.sampling, k.a, k.b, k.shares
    unknowns = ca.MX.sym("y", sampling.size2() + (k.legs.count if k.legs else 0))
    y, stretch = unknowns[: sampling.size2()], unknowns[sampling.size2() :]
    lengths, fixed_shares = k.lengths, shares
    if k.legs is not None:
        lengths = ca.reshape(stretch[k.legs.of_node.tolist()], 1, nodes)
        shares = ca.vertcat(k.shares[0, :] * lengths, k.shares[1:, :])
    p = ca.MX.sym("p", 0) if k.parameters is None else k.parameters
    z = ca.reshape(ca.mtimes(sampling, y) + k.offset, nz, points)
    zn = z[:, :nodes]
    s_nodes, s_watch = sampling[: nz * nodes, :], sampling[nz * nodes :, :]
    boxed = range(nx * k.extra) if k.box_rows is None else k.box_rows
    state_rows = [nz * (row // nx) + row % nx for row in boxed]
    watch_unit = ca.DM(np.tile(1.0 / k.state_unit, k.extra)[boxed])
    box = ca.diag(watch_unit) @ s_watch[state_rows, :] if state_rows else ca.DM(0, sampling.size2())
    box_shift = k.offset[nz * nodes :][state_rows] * watch_unit if state_rows else ca.DM(0, 1)

    path_count = parts.path.size1_out(0)
    path_rows: slice | list[int] = slice(None) if k.path_rows is None else k.path_rows
    path_size = path_count * points if k.path_rows is None else len(k.path_rows)

    f = ca.sum2(parts.cost.map(nodes)(zn, shares))
    moved = parts.motion.map(nodes)(zn)
    g = ca.vertcat(
        ca.mtimes(a, y) + k.a_shift - ca.mtimes(b, ca.vec(_times_lengths(moved, lengths))),
        ca.vec(parts.path.map(points)(z, k.slots))[path_rows],
        ca.mtimes(box, y) + box_shift,
    )
    steps, spans = _thrust_steps(k, stretch)
    around, around_jacobian = ca.MX(0, 1), ca.MX(0, sampling.size2())
    if k.points is not None:
        states = ca.mtimes(k.points.pick, y) + k.points.offset
        around, around_jacobian = k.points.values(states), ca.mtimes(k.points.jacobian(states), k.points.pick)
    linear = ca.DM(0, 0) if k.legs is None else ca.DM(k.legs.times)
    g = ca.vertcat(g, around, ca.mtimes(linear, stretch) if k.legs else ca.MX(0, 1))
    g = ca.vertcat(g, ca.mtimes(steps, y) - spans, -ca.mtimes(steps, y) - spans)

    # IPOPT's interface copies only stored entries: a sparse gradient would leave the others unset.
    gradient = ca.densify(ca.mtimes(s_nodes.T, ca.vec(parts.cost_gradient.map(nodes)(zn, shares))))
    motion_blocks = _block_diagonal(parts.motion_jacobian, nodes, zn)
    jacobian = ca.vertcat(
        a - ca.mtimes([b, _block_diagonal(parts.motion_jacobian, nodes, zn, lengths=lengths), s_nodes]),
        ca.mtimes(_block_diagonal(parts.path_jacobian, points, z, k.slots)[path_rows, :], sampling),
        ca.MX(box),
        around_jacobian,
        ca.MX(linear.size1(), sampling.size2()),
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
    if k.points is not None:
        first = a.size1() + path_size + box.size1()
        bent = k.points.hessian(states, lam[first : first + k.points.count])
        hessian += ca.mtimes([k.points.pick.T, bent, k.points.pick])
    if k.legs is not None:
        # The program is linear in the stretch of each leg, in the mean cost and in the motion.
        over_time = ca.vertcat(fixed_shares[0, :], ca.DM.zeros(1, nodes), fixed_shares[2:, :])
        legs = k.legs
        f += ca.dot(ca.DM(legs.costs), stretch)
        cost_gradient = ca.mtimes(s_nodes.T, legs.columns(parts.cost_gradient.map(nodes)(zn, over_time)))
        of_time = ca.sum1(legs.columns(parts.cost.map(nodes)(zn, over_time))).T + ca.DM(legs.costs)
        gradient = ca.vertcat(gradient, ca.densify(of_time))
        grown = _grown(k, legs)
        rest = g.size1() - a.size1() - linear.size1() - 2 * grown.size1()
        column = ca.vertcat(-ca.mtimes(b, legs.columns(moved)), ca.MX(rest, legs.count), linear, grown, grown)
        jacobian = ca.horzcat(jacobian, column)
        pulled = ca.reshape(ca.mtimes(motion_blocks.T, ca.vec(pull)), nz, nodes)
        mixed = sigma * cost_gradient + ca.mtimes(s_nodes.T, legs.columns(pulled))
        corner = ca.horzcat(ca.MX(legs.count, sampling.size2()), ca.MX(legs.count, legs.count))
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
    if k.legs is None:
        return k.thrust_steps, ca.MX(ca.DM(k.interval_s))
    held = ca.DM(np.where(k.legs.of_interval == HOLD, k.interval_s, 0.0))
    return k.thrust_steps, held - ca.mtimes(_grown(k, k.legs), stretch)


def _grown(k: Constants, legs: LegConstants) -> ca.DM:
    """Derivative (M, K) of minus the lengths of the intervals by the stretches of the legs."""
    if k.interval_s is None:
        return ca.DM(0, legs.count)
    moving = np.flatnonzero(legs.of_interval != HOLD)
    shape = len(k.interval_s), legs.count
    return dm(sparse.csc_matrix((-k.interval_s[moving], (moving, legs.of_interval[moving])), shape=shape))


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
