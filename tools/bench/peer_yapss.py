# mypy: ignore-errors
"""The common problem in yapss: Legendre-Gauss collocation, exact second derivatives; a phase a leg, joined by rows."""

import itertools
import sys

import numpy as np
import yapss
import yapss.math
from yapss._private import solver as internals
from yapss._private.mseipopt import initialize_ipopt

from tools.bench.contender import Result, run, timed
from tools.bench.leader import NU, NX, Leader

initialize_ipopt()  # loads the library: that is part of importing


def solve(leader: Leader, mu_strategy: str) -> Result:
    """Define, solve, take apart."""
    legs = leader.legs
    each = {"nx": [NX] * legs, "nu": [NU] * legs, "nq": [1] * legs, "nh": [2] * legs}
    ocp = yapss.Problem(name="leader", **each, nd=(NX + 1) * (legs - 1))

    def objective(arg):
        arg.objective = sum(arg.phase[leg].integral[0] for leg in range(legs))

    def continuous(arg):
        for leg in arg.phase_list:
            phase = arg.phase[leg]
            x, u, t = phase.state, phase.control, phase.time
            phase.dynamics[:] = leader.rates(x, u, yapss.math)
            phase.integrand[:] = (leader.cost_rate(x, t, yapss.math),)
            phase.path[:] = leader.path(x, u, yapss.math)

    def discrete(arg):
        rows = []
        for before, after in itertools.pairwise(range(legs)):
            rows += list(arg.phase[before].final_state - arg.phase[after].initial_state)
            rows.append(arg.phase[before].final_time - arg.phase[after].initial_time)
        arg.discrete = rows

    ocp.functions.objective, ocp.functions.continuous = objective, continuous
    if legs > 1:
        ocp.functions.discrete = discrete
        ocp.bounds.discrete.lower[:] = ocp.bounds.discrete.upper[:] = 0.0
    for leg in range(legs):
        _describe(ocp, leader, leg)
    ocp.spectral_method, ocp.derivatives.method, ocp.derivatives.order = "lg", "auto", "second"
    options = ocp.ipopt_options
    options.tol, options.max_iter, options.print_level, options.sb = 1e-6, 500, 0, "yes"
    options.mu_strategy = mu_strategy

    # The library reports neither the solver's own time nor its iterations.
    spent_s, iterations = [], []
    call = timed(internals._solve_ipopt_problem, spent_s)

    def counted(problem, *rest):
        problem.set_intermediate_callback(lambda mode, count, *_: iterations.append(count) or True)
        return call(problem, *rest)

    internals._solve_ipopt_problem = counted
    solution = ocp.solve()
    status = solution.nlp_info
    taken = max(iterations, default=0)
    result = Result(solution.objective, taken, sum(spent_s), status.ipopt_status_message, status.ipopt_status == 0)
    ends_s = [0.0, *(float(solution.phase[leg].final_time) for leg in range(legs))]
    result.joints_s, result.points_s = leader.joints_of(ends_s), ends_s[1:-1]
    for leg in range(legs):
        state_at, control_at, phase = 0, 0, solution.phase[leg]
        for degree in leader.degrees_of(leg):
            nodes = 0.5 * (np.polynomial.legendre.leggauss(degree)[0] + 1.0)
            state = phase.state[:, state_at : state_at + degree + 1].T
            result.add([0.0, *nodes], state, nodes, phase.control[:, control_at : control_at + degree].T)
            state_at, control_at = state_at + degree + 1, control_at + degree
    return result


def _describe(ocp, leader, leg):
    """Bounds, guess and mesh of one phase."""
    bounds, guess, mesh = ocp.bounds.phase[leg], ocp.guess.phase[leg], ocp.mesh.phase[leg]
    bounds.initial_time.lower, bounds.initial_time.upper = 0.0, leader.end_s if leg else 0.0
    bounds.final_time.lower = leader.end_s if leg == leader.legs - 1 else 0.0
    bounds.final_time.upper = leader.end_s
    if leader.legs > 1:
        bounds.duration.lower, bounds.duration.upper = leader.duration_of(leg)
    bounds.initial_state.lower[:], bounds.initial_state.upper[:] = leader.box_of(leg, end=False)
    bounds.final_state.lower[:], bounds.final_state.upper[:] = leader.box_of(leg, end=True)
    bounds.state.lower[:], bounds.state.upper[:] = leader.x_low, leader.x_high
    bounds.control.lower[:], bounds.control.upper[:] = leader.u_low, leader.u_high
    bounds.path.lower[:] = 0.0
    times_s, x, u = leader.guess_of(leg)
    guess.time, guess.state, guess.control, guess.integral = times_s, x.T, u.T, [1.0 / leader.legs]
    mesh.collocation_points, mesh.fraction = tuple(leader.degrees_of(leg)), tuple(leader.shares_of(leg))


if __name__ == "__main__":
    run(lambda leader: solve(leader, sys.argv[3]), "yapss")
