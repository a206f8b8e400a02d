"""One nonlinear program for any start, any time and any lengths of its intervals: built once, solved often.

Its parameters are the lengths of intervals, the shares of the cost, the followers' offsets, and the positions and radii
of spare no-fly disks. Bounds and guesses are arguments of each solve: bounds are tightened where the last solution
violated a limit between nodes, and the next solve takes a few iterations.
"""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy import sparse

from gcs.errors import PlanningError
from gcs.plan.nlp.assembly import Constants, assemble, dm
from gcs.plan.nlp.ipopt import OPTIONS, WARM_OPTIONS, Options, Solver, solver
from gcs.plan.nlp.mesh import Mesh
from gcs.plan.nlp.program_bounds import scales, thrust_steps
from gcs.plan.nlp.transcription import Program, RowMasks, bounded_program
from gcs.plan.nlp.variables import VariableLayout
from gcs.plan.nlp.violations import Violation
from gcs.plan.ocp import stage_functions
from gcs.plan.ocp.active_vehicles import MOVED, RADIUS, SLOT, active_vehicles
from gcs.plan.ocp.objective_sum import cost_shares, share_rows
from gcs.plan.ocp.objectives import TERMINAL_WEIGHTS
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.constraint_id import COLUMNS, Kind
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import NoFlyZone, Scenario
from gcs.types import Array

# Distance from the edge of a new disk at the nodes: the path around it may not be smooth.
NEW_RESERVE_M = 0.5
# From a nearby solution: its multipliers show the active constraints. Where new ones become active, mu has to grow.
_NEAR = 1e-5
_AGAIN: Options = {
    **{key: _NEAR if isinstance(value, float) else value for key, value in WARM_OPTIONS.items()},
    "ipopt.mu_strategy": "adaptive",
    "ipopt.tol": 1e-5,  # of 100 m, or of the objective; violations are less than a tenth of that
    "ipopt.constr_viol_tol": 1e-6,
    "ipopt.max_iter": 40,
}
_AFRESH: Options = {"ipopt.mu_strategy": "adaptive", "ipopt.max_iter": 100}
_EXCESS = 1.25  # times the violation: the polynomial between two nodes changes less than the nodes do
_SCALED = (Kind.TURNING, Kind.ACCELERATION, Kind.JERK)  # whose rows are 1 - (size / limit)^2


@dataclass(frozen=True)
class ParametricNlp:
    """The functions of a program of M intervals, and IPOPT for them."""

    whole: Problem  # the first flight: its limits, terrain, zones and references of the cost
    unused: tuple[NoFlyZone, ...]  # disks far from all vehicles
    intervals: int
    degree: int
    weight_s: float  # integral of Q over the whole flight
    nlp: ca.Function
    derivatives: dict[str, ca.Function]
    again: Solver  # IPOPT from a nearby solution, with its multipliers
    afresh: Solver  # IPOPT from any guess

    def program(self, problem: Problem, mesh: Mesh, last: Trajectory) -> Program:
        """The program of one flight, with the zones of the first flight and new disks; `last` is near its solution."""
        layout = VariableLayout(mesh)
        times = layout.node_times_s()
        known = len(self.whole.scenario.no_fly)
        used = len(problem.scenario.no_fly) - known
        zones = (*problem.scenario.no_fly, *self.unused[used:])
        problem = replace(problem, scenario=with_zones(problem.scenario, zones), spare_disks=len(self.unused))
        # Rows are those of the whole shape: its rest may be rigid, and would have fewer than the program.
        chosen = active_vehicles(replace(problem, shape=self.whole.shape), times, last.state(times))
        slots = chosen.parameters.reshape(len(times), -1, SLOT)
        free = np.zeros((len(times), len(stage_functions.path_ids(problem, chosen)[0])), dtype=bool)
        first = chosen.ground.shape[1] + sum(rows.shape[1] for rows in chosen.zones[: -len(self.unused) or None])
        for number, zone in enumerate(zones[known:]):
            rows = slice(first, first + chosen.zones[-1].shape[1])
            slots[:, rows, MOVED] += np.array([zone.north_m, zone.east_m], dtype=np.float64)
            slots[:, rows, RADIUS] = zone.radius_m
            slots[:, rows, RADIUS] += NEW_RESERVE_M
            free[:, rows] = number >= used
            first = rows.stop
        lengths = np.repeat(np.diff(mesh.joints_s), self.degree)
        quadrature, weight = layout.quadrature(), _weight(self.whole, times)
        shares = cost_shares(self.whole, times, quadrature / self.whole.duration_s, quadrature * weight / self.weight_s)
        parameters = np.concatenate([lengths, shares.ravel(order="F"), slots.ravel()])
        if len(parameters) != self.nlp.size1_in(1):
            raise PlanningError.because(
                "other vehicles are near a limit than those that the programs of this plan were built for",
                hint="land, return or hold (`gcs attach`); the old plan has not changed",
            )
        functions = self.nlp, self.derivatives
        return bounded_program(problem, layout, chosen, functions, RowMasks(free=free), parameters)


def parametric_nlp(whole: Problem, mesh: Mesh, spare_disks: int) -> ParametricNlp:
    """The program for as many intervals as `mesh` has, all of one degree."""
    (degree,) = set(mesh.degrees)
    layout = VariableLayout(Mesh(np.arange(mesh.intervals + 1.0), mesh.degrees))
    (_, north_m), (_, east_m) = whole.scenario.limits.north_m, whole.scenario.limits.east_m
    unused = (NoFlyZone(north_m=north_m + 1000.0, east_m=east_m + 1000.0, radius_m=100.0),) * spare_disks
    zones = (*whole.scenario.no_fly, *unused)
    problem = replace(whole, scenario=with_zones(whole.scenario, zones), spare_disks=spare_disks)
    real = VariableLayout(mesh)
    chosen = active_vehicles(problem, real.node_times_s(), np.zeros((real.nodes, layout.nx)))
    unit, shift = scales(problem, layout)
    sampling = layout.sampling(layout.node_times_s())
    a, b = layout.collocation()
    row_unit = sparse.diags(1.0 / np.tile(unit[: layout.nx], a.shape[0] // layout.nx))
    nodes, width = layout.nodes, chosen.parameters.shape[1]
    rows = share_rows(problem)
    parameters = ca.MX.sym("p", nodes * (1 + rows + width))
    lengths, shares, slots = ca.vertsplit(parameters, (nodes * np.cumsum([0, 1, rows, width])).tolist())
    counts = (chosen.ground.shape[1], max((d.shape[1] for d in chosen.zones), default=0), chosen.moving.shape[1])
    nlp, derivatives = assemble(
        stage_functions.functions(problem, *counts),
        Constants(
            nodes=nodes,
            extra=0,
            sampling=dm(sampling @ sparse.diags(unit)),
            offset=ca.DM(sampling @ shift),
            a=dm(row_unit @ a @ sparse.diags(unit)),
            a_shift=ca.DM(row_unit @ (a @ shift)),
            b=dm(row_unit @ b),
            shares=ca.reshape(shares, rows, nodes),
            slots=ca.reshape(slots, width, nodes),
            state_unit=unit[: layout.nx],
            lengths=lengths.T,
            parameters=parameters,
            thrust_steps=thrust_steps(problem, layout, unit),
            interval_s=np.array(layout.first_node[:-1]),
        ),
    )
    weight_s = float(real.quadrature() @ _weight(whole, real.node_times_s()))
    again, afresh = (solver(nlp, derivatives, {**OPTIONS, **options}) for options in (_AGAIN, _AFRESH))
    return ParametricNlp(whole, unused, mesh.intervals, degree, weight_s, nlp, derivatives, again, afresh)


def with_zones(scenario: Scenario, zones: tuple[NoFlyZone, ...]) -> Scenario:
    """The scenario with other no-fly zones."""
    return scenario.model_copy(update={"no_fly": zones})


def _weight(whole: Problem, times_s: Array) -> Array:
    return TERMINAL_WEIGHTS[whole.objective.terminal_weight](times_s, whole.end_s)


def tightened(program: Program, trajectory: Trajectory, violations: tuple[Violation, ...]) -> Program:
    """The same program with tighter bounds at the nodes and joints beside each violation."""
    y_low, y_high, g_low = program.y_low.copy(), program.y_high.copy(), program.g_low.copy()
    layout = program.layout
    points = layout.point_times_s()
    order = np.argsort(points)
    nodes = layout.node_times_s()
    rows = layout.nx * (layout.nodes + layout.mesh.intervals)
    per_node = (len(g_low) - rows - program.step_rows) // len(nodes)
    for violation in violations:
        kind = violation.constraint.kind
        component = COLUMNS.get(kind, layout.nx)
        if component < layout.nx:
            above = bool(trajectory.state(violation.t_s)[component] > 0.0) if component != 2 else None
            for point in order[_beside(points[order], violation.t_s)]:
                at = layout.nx * int(point) + component
                by = min(_EXCESS * violation.by_si / program.unit[at], 0.4 * (y_high[at] - y_low[at]))
                if above is not False:
                    y_high[at] -= by
                if above is not True:
                    y_low[at] += by
        else:
            by = _EXCESS * (2 * violation.share if kind in _SCALED else violation.by_si)
            for node in _beside(nodes, violation.t_s):
                first = rows + per_node * int(node)
                for at in range(first, first + per_node):
                    row, _ = program.g_ids[at]
                    if (row.kind, row.of) == (kind, violation.constraint.of) and np.isfinite(g_low[at]):
                        g_low[at] += by
    return replace(program, y_low=y_low, y_high=y_high, g_low=g_low)


def _beside(times_s: Array, t_s: float) -> Array:
    """Indices of the last instant before and the first after."""
    after = int(np.clip(np.searchsorted(times_s, t_s), 1, len(times_s) - 1))
    return np.array([after - 1, after])
