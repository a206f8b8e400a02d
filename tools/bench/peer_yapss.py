# mypy: ignore-errors
"""The common problem in yapss: Legendre-Gauss collocation, exact second derivatives."""

from __future__ import annotations

import sys

import numpy as np
import yapss
import yapss.math
from yapss._private import solver as internals
from yapss._private.mseipopt import initialize_ipopt

from tools.bench.contender import Result, Stopwatch, run
from tools.bench.leader import NU, NX, Leader

initialize_ipopt()  # loads the library: that is part of importing
MU_STRATEGY = {"default": "adaptive", "monotone": "monotone"}


def solve(leader: Leader, mu_strategy: str) -> Result:
    """Define, solve, take apart."""
    ocp = yapss.Problem(name="leader", nx=[NX], nu=[NU], nq=[1], nh=[2])

    def objective(arg):
        arg.objective = arg.phase[0].integral[0]

    def continuous(arg):
        phase = arg.phase[0]
        x, u, t = phase.state, phase.control, phase.time
        phase.dynamics[:] = leader.rates(x, u, yapss.math)
        phase.integrand[:] = (leader.cost_rate(x, t, yapss.math),)
        phase.path[:] = leader.path(x, u, yapss.math)

    ocp.functions.objective = objective
    ocp.functions.continuous = continuous
    bounds, guess, mesh = ocp.bounds.phase[0], ocp.guess.phase[0], ocp.mesh.phase[0]
    bounds.initial_time.lower = bounds.initial_time.upper = 0.0
    bounds.final_time.lower = bounds.final_time.upper = leader.end_s
    bounds.initial_state.lower[:] = bounds.initial_state.upper[:] = leader.x_start
    bounds.final_state.lower[:] = bounds.final_state.upper[:] = leader.x_end
    bounds.state.lower[:], bounds.state.upper[:] = leader.x_low, leader.x_high
    bounds.control.lower[:], bounds.control.upper[:] = leader.u_low, leader.u_high
    bounds.path.lower[:] = 0.0
    guess.time, guess.state, guess.control = leader.guess_s, leader.guess_x.T, leader.guess_u.T
    guess.integral = [1.0]
    mesh.collocation_points, mesh.fraction = tuple(leader.degrees), tuple(leader.shares)
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
    phase = solution.phase[0]
    result = Result(
        solution.objective,
        max(iterations, default=0),
        watch.seconds,
        solution.nlp_info.ipopt_status_message,
        solution.nlp_info.ipopt_status == 0,
    )
    state_at, control_at = 0, 0
    for degree in leader.degrees:
        nodes = 0.5 * (np.polynomial.legendre.leggauss(degree)[0] + 1.0)
        result.state_tau.append([0.0, *nodes])
        result.state.append(phase.state[:, state_at : state_at + degree + 1].T)
        result.control_tau.append(nodes)
        result.control.append(phase.control[:, control_at : control_at + degree].T)
        state_at, control_at = state_at + degree + 1, control_at + degree
    return result


if __name__ == "__main__":
    run(lambda leader: solve(leader, MU_STRATEGY[sys.argv[3]]), "yapss")
