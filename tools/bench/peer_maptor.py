# mypy: ignore-errors
"""The common problem in maptor: Legendre-Gauss-Radau collocation on a fixed mesh."""

from __future__ import annotations

import casadi as ca
import maptor
import numpy as np
from maptor.radau import _compute_radau_collocation_components

from tools.bench.contender import Result, run
from tools.bench.leader import NU, NX, Leader

ca.has_nlpsol("ipopt")  # loads the library: that is part of importing


def solve(leader: Leader) -> Result:
    """Define, solve, take apart."""
    problem = maptor.Problem("leader")
    phase = problem.set_phase(1)
    t = phase.time(initial=0.0, final=leader.end_s)
    x = [
        phase.state(f"x{i}", initial=float(a), final=float(b), boundary=(float(low), float(high)))
        for i, (a, b, low, high) in enumerate(
            zip(leader.x_start, leader.x_end, leader.x_low, leader.x_high, strict=True)
        )
    ]
    u = [phase.control(f"u{i}", boundary=(float(leader.u_low[i]), float(leader.u_high[i]))) for i in range(NU)]
    phase.dynamics(dict(zip(x, leader.rates(x, u, ca), strict=True)))
    phase.path_constraints(*(value >= 0 for value in leader.path(x, u, ca)))
    problem.minimize(phase.add_integral(leader.cost_rate(x, t, ca)))
    phase.mesh(leader.degrees, 2.0 * leader.joints_s / leader.end_s - 1.0)
    nodes = []
    for degree in leader.degrees:
        rule = _compute_radau_collocation_components(degree)
        nodes.append([0.5 * (np.asarray(n) + 1.0) for n in (rule.state_approximation_nodes, rule.collocation_nodes)])
    guesses = [
        (leader.guess(leader.times_s(i, at_x))[0].T, leader.guess(leader.times_s(i, at_u))[1].T)
        for i, (at_x, at_u) in enumerate(nodes)
    ]
    phase.guess([g[0] for g in guesses], [g[1] for g in guesses], 0.0, leader.end_s, 1.0)
    options = {
        "ipopt.tol": 1e-6,
        "ipopt.max_iter": 500,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "print_time": 0,
        "record_time": True,
    }
    solution = maptor.solve_fixed_mesh(problem, nlp_options=options, show_summary=False)
    raw = solution._raw_solution
    stats = raw.raw_solution.stats()
    result = Result(raw.objective, stats["iter_count"], stats["t_wall_total"], stats["return_status"], stats["success"])
    for i, (at_x, at_u) in enumerate(nodes):
        result.state_tau.append(at_x)
        result.state.append(np.asarray(raw.phase_solved_state_trajectories_per_interval[1][i]).reshape(NX, -1).T)
        result.control_tau.append(at_u)
        result.control.append(np.asarray(raw.phase_solved_control_trajectories_per_interval[1][i]).reshape(NU, -1).T)
    return result


if __name__ == "__main__":
    run(solve, "maptor")
