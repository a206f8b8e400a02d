# mypy: ignore-errors
"""The common problem in maptor: Legendre-Gauss-Radau collocation; a phase a leg, begun where the last one ends."""

import casadi as ca
import maptor
import numpy as np
from maptor.radau import _compute_radau_collocation_components

from tools.bench.contender import IPOPT, Result, run
from tools.bench.leader import NU, NX, Leader

ca.has_nlpsol("ipopt")  # loads the library: that is part of importing


def solve(leader: Leader) -> Result:
    """Define, solve, take apart."""
    problem = maptor.Problem("leader")
    phases, cost, before = [], 0.0, None
    for leg in range(leader.legs):
        phases.append(problem.set_phase(leg + 1))
        before, integral = _describe(phases[-1], leader, leg, before)
        cost = cost + integral
    problem.minimize(cost)
    nodes = _guess(phases, leader)
    raw = maptor.solve_fixed_mesh(problem, nlp_options=dict(IPOPT), show_summary=False)._raw_solution
    result = Result.of(raw.objective, raw.raw_solution.stats())
    ends_s = [0.0, *(float(raw.phase_terminal_times[leg + 1]) for leg in range(leader.legs))]
    result.joints_s, result.points_s = leader.joints_of(ends_s), ends_s[1:-1]
    for leg in range(leader.legs):
        states = raw.phase_solved_state_trajectories_per_interval[leg + 1]
        controls = raw.phase_solved_control_trajectories_per_interval[leg + 1]
        for i, interval in enumerate(leader.intervals[leg]):
            at_x, at_u = nodes[interval]
            state, control = (np.asarray(part[i]).reshape(n, -1).T for part, n in ((states, NX), (controls, NU)))
            result.add(at_x, state, at_u, control)
    return result


def _describe(phase, leader, leg, before):
    """One phase; returns what the next one continues from, and the cost."""
    last = leg == leader.legs - 1
    begin_s = 0.0 if before is None else before[0].final
    t = phase.time(initial=begin_s, final=leader.end_s if last else (0.0, leader.end_s))
    starts, ends = ([*zip(*leader.box_of(leg, end=end), strict=True)] for end in (False, True))
    x = []
    for i in range(NX):
        start = float(starts[i][0]) if before is None else before[1][i].final
        low, high = map(float, ends[i])
        final = low if low == high else (low, high)
        box = (float(leader.x_low[i]), float(leader.x_high[i]))
        x.append(phase.state(f"x{i}", initial=start, final=final, boundary=box))
    u = [phase.control(f"u{i}", boundary=(float(leader.u_low[i]), float(leader.u_high[i]))) for i in range(NU)]
    phase.dynamics(dict(zip(x, leader.rates(x, u, ca), strict=True)))
    phase.path_constraints(*(value >= 0 for value in leader.path(x, u, ca)))
    phase.mesh(leader.degrees_of(leg), 2.0 * np.array([0.0, *np.cumsum(leader.shares_of(leg)[:-1]), 1.0]) - 1.0)
    return (t, x), phase.add_integral(leader.cost_rate(x, t, ca))


def _guess(phases, leader):
    """Give every phase its guess; returns the nodes of state and control on [0, 1] of all intervals."""
    nodes = []
    for leg, phase in enumerate(phases):
        states, controls = [], []
        for i in leader.intervals[leg]:
            rule = _compute_radau_collocation_components(leader.degrees[i])
            at = [0.5 * (np.asarray(n) + 1.0) for n in (rule.state_approximation_nodes, rule.collocation_nodes)]
            nodes.append(at)
            states.append(leader.guess(leader.times_s(i, at[0]))[0].T)
            controls.append(leader.guess(leader.times_s(i, at[1]))[1].T)
        start_s, end_s = (float(t_s) for t_s in leader.ends_s[leg : leg + 2])
        phase.guess(states, controls, start_s, end_s, 1.0 / leader.legs)
    return nodes


if __name__ == "__main__":
    run(solve, "maptor")
