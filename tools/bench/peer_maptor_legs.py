# mypy: ignore-errors
"""The common problem of several legs in maptor: a phase a leg, each begins with the last one's final state and time."""

from __future__ import annotations

import casadi as ca
import maptor
import numpy as np
from maptor.radau import _compute_radau_collocation_components

from tools.bench.contender import run
from tools.bench.leader import NU, NX
from tools.bench.route import Legs, RouteResult

ca.has_nlpsol("ipopt")  # loads the library: that is part of importing


def solve(route: Legs) -> RouteResult:
    """Define, solve, take apart."""
    problem = maptor.Problem("legs")
    phases, cost, before = [], 0.0, None
    for leg in range(route.count):
        phase = problem.set_phase(leg + 1)
        phases.append(phase)
        before, integral = _describe(phase, route, leg, before)
        cost = cost + integral
    problem.minimize(cost)
    nodes = _guess(phases, route)
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
    result = RouteResult(
        raw.objective, stats["iter_count"], stats["t_wall_total"], stats["return_status"], stats["success"]
    )
    ends_s = [0.0, *(float(raw.phase_terminal_times[leg + 1]) for leg in range(route.count))]
    result.joints_s, result.points_s = route.joints_of(ends_s), ends_s[1:-1]
    for leg in range(route.count):
        states, controls = (
            parts[leg + 1]
            for parts in (
                raw.phase_solved_state_trajectories_per_interval,
                raw.phase_solved_control_trajectories_per_interval,
            )
        )
        for i, interval in enumerate(route.intervals[leg]):
            at_x, at_u = nodes[interval]
            result.state_tau.append(at_x)
            result.state.append(np.asarray(states[i]).reshape(NX, -1).T)
            result.control_tau.append(at_u)
            result.control.append(np.asarray(controls[i]).reshape(NU, -1).T)
    return result


def _describe(phase, route, leg, before):
    """One phase; returns what the next one continues from, and the cost."""
    last = leg == route.count - 1
    t = phase.time(
        initial=0.0 if before is None else before[0].final, final=route.end_s if last else (0.0, route.end_s)
    )
    starts, ends = ([*zip(*route.box_of(leg, end=end), strict=True)] for end in (False, True))
    x = []
    for i in range(NX):
        start = float(starts[i][0]) if before is None else before[1][i].final
        low, high = map(float, ends[i])
        final = low if low == high else (low, high)
        box = (float(route.x_low[i]), float(route.x_high[i]))
        x.append(phase.state(f"x{i}", initial=start, final=final, boundary=box))
    u = [phase.control(f"u{i}", boundary=(float(route.u_low[i]), float(route.u_high[i]))) for i in range(NU)]
    phase.dynamics(dict(zip(x, route.rates(x, u, ca), strict=True)))
    phase.path_constraints(*(value >= 0 for value in route.path(x, u, ca)))
    phase.mesh(route.degrees_of(leg), 2.0 * np.array([0.0, *np.cumsum(route.shares_of(leg)[:-1]), 1.0]) - 1.0)
    return (t, x), phase.add_integral(route.cost_rate(x, t, ca))


def _guess(phases, route):
    """Give every phase its guess; returns the nodes of state and control on [0, 1] of all intervals."""
    nodes = []
    for leg, phase in enumerate(phases):
        states, controls = [], []
        for i in route.intervals[leg]:
            rule = _compute_radau_collocation_components(route.degrees[i])
            at = [0.5 * (np.asarray(n) + 1.0) for n in (rule.state_approximation_nodes, rule.collocation_nodes)]
            nodes.append(at)
            states.append(route.guess(route.times_s(i, at[0]))[0].T)
            controls.append(route.guess(route.times_s(i, at[1]))[1].T)
        start_s, end_s = (float(t_s) for t_s in route.ends_s[leg : leg + 2])
        phase.guess(states, controls, start_s, end_s, 1.0 / route.count)
    return nodes


if __name__ == "__main__":
    run(solve, "maptor", Legs)
