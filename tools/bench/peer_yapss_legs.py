# mypy: ignore-errors
"""The common problem of several legs in yapss: a phase a leg, joined by constraints on state and time."""

from __future__ import annotations

import itertools
import sys

import numpy as np
import yapss
import yapss.math
from yapss._private import solver as internals
from yapss._private.mseipopt import initialize_ipopt

from tools.bench.contender import Stopwatch, run
from tools.bench.leader import NU, NX
from tools.bench.peer_yapss import MU_STRATEGY
from tools.bench.route import Legs, RouteResult

initialize_ipopt()  # loads the library: that is part of importing


def solve(route: Legs, mu_strategy: str) -> RouteResult:
    """Define, solve, take apart."""
    legs, joints = route.count, route.count - 1
    ocp = yapss.Problem(name="legs", nx=[NX] * legs, nu=[NU] * legs, nq=[1] * legs, nh=[2] * legs, nd=(NX + 1) * joints)

    def objective(arg):
        arg.objective = sum(arg.phase[leg].integral[0] for leg in range(legs))

    def continuous(arg):
        for leg in arg.phase_list:
            phase = arg.phase[leg]
            x, u, t = phase.state, phase.control, phase.time
            phase.dynamics[:] = route.rates(x, u, yapss.math)
            phase.integrand[:] = (route.cost_rate(x, t, yapss.math),)
            phase.path[:] = route.path(x, u, yapss.math)

    def discrete(arg):
        rows = []
        for before, after in itertools.pairwise(range(legs)):
            rows += list(arg.phase[before].final_state - arg.phase[after].initial_state)
            rows.append(arg.phase[before].final_time - arg.phase[after].initial_time)
        arg.discrete = rows

    ocp.functions.objective, ocp.functions.continuous = objective, continuous
    ocp.functions.discrete = discrete
    ocp.bounds.discrete.lower[:] = ocp.bounds.discrete.upper[:] = 0.0
    for leg in range(legs):
        _describe(ocp, route, leg)
    ocp.spectral_method, ocp.derivatives.method, ocp.derivatives.order = "lg", "auto", "second"
    options = ocp.ipopt_options
    options.tol, options.max_iter, options.print_level, options.sb = 1e-6, 500, 0, "yes"
    options.mu_strategy = mu_strategy

    # The library reports neither the solver's own time nor its iterations.
    watch, iterations = Stopwatch(), []
    call = internals._solve_ipopt_problem

    def timed(problem, *rest):
        problem.set_intermediate_callback(lambda mode, count, *_: iterations.append(count) or True)
        with watch.watching():
            return call(problem, *rest)

    internals._solve_ipopt_problem = timed
    solution = ocp.solve()
    result = RouteResult(
        solution.objective,
        max(iterations, default=0),
        watch.seconds,
        solution.nlp_info.ipopt_status_message,
        solution.nlp_info.ipopt_status == 0,
    )
    ends_s = [0.0, *(float(solution.phase[leg].final_time) for leg in range(legs))]
    result.joints_s, result.points_s = route.joints_of(ends_s), ends_s[1:-1]
    for leg in range(legs):
        _take_apart(result, solution.phase[leg], route.degrees_of(leg))
    return result


def _describe(ocp, route, leg):
    """Bounds, guess and mesh of one phase."""
    bounds, guess, mesh = ocp.bounds.phase[leg], ocp.guess.phase[leg], ocp.mesh.phase[leg]
    if leg == 0:
        bounds.initial_time.lower = bounds.initial_time.upper = 0.0
    else:
        bounds.initial_time.lower, bounds.initial_time.upper = 0.0, route.end_s
    bounds.final_time.lower = route.end_s if leg == route.count - 1 else 0.0
    bounds.final_time.upper = route.end_s
    bounds.duration.lower, bounds.duration.upper = route.duration_of(leg)
    bounds.initial_state.lower[:], bounds.initial_state.upper[:] = route.box_of(leg, end=False)
    bounds.final_state.lower[:], bounds.final_state.upper[:] = route.box_of(leg, end=True)
    bounds.state.lower[:], bounds.state.upper[:] = route.x_low, route.x_high
    bounds.control.lower[:], bounds.control.upper[:] = route.u_low, route.u_high
    bounds.path.lower[:] = 0.0
    times_s, x, u = route.guess_of(leg)
    guess.time, guess.state, guess.control = times_s, x.T, u.T
    guess.integral = [1.0 / route.count]
    mesh.collocation_points, mesh.fraction = tuple(route.degrees_of(leg)), tuple(route.shares_of(leg))


def _take_apart(result, phase, degrees):
    """Add the intervals of one phase to the result."""
    state_at, control_at = 0, 0
    for degree in degrees:
        nodes = 0.5 * (np.polynomial.legendre.leggauss(degree)[0] + 1.0)
        result.state_tau.append([0.0, *nodes])
        result.state.append(phase.state[:, state_at : state_at + degree + 1].T)
        result.control_tau.append(nodes)
        result.control.append(phase.control[:, control_at : control_at + degree].T)
        state_at, control_at = state_at + degree + 1, control_at + degree


if __name__ == "__main__":
    run(lambda route: solve(route, MU_STRATEGY[sys.argv[3]]), "yapss", Legs)
