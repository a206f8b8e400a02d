# mypy: ignore-errors
"""The common problem in pycollo: Lobatto collocation. Time is a state here: its equations may not name it."""

import casadi as ca
import numpy as np
import pycollo
import sympy

from tools.bench.contender import Result, run
from tools.bench.leader import NU, NX, Leader

ca.has_nlpsol("ipopt")  # loads the library: that is part of importing


def solve(leader: Leader) -> Result:
    """Define, solve, take apart."""
    x, u = sympy.symbols(f"x:{NX}"), sympy.symbols(f"u:{NU}")
    clock = sympy.Symbol("clock")  # in units of the flight
    problem = pycollo.OptimalControlProblem(name="leader")
    phase = problem.new_phase(name="flight")
    phase.state_variables = [*x, clock]
    phase.control_variables = list(u)
    phase.state_equations = {**dict(zip(x, leader.rates(x, u, sympy), strict=True)), clock: 1.0 / leader.end_s}
    phase.integrand_functions = [leader.cost_rate(x, clock * leader.end_s, sympy)]
    phase.path_constraints = leader.path(x, u, sympy)
    problem.objective_function = phase.integral_variables[0]
    bounds = phase.bounds
    bounds.initial_time, bounds.final_time = 0.0, leader.end_s
    bounds.state_variables = [[a, b] for a, b in zip([*leader.x_low, 0.0], [*leader.x_high, 1.0], strict=True)]
    bounds.control_variables = [[a, b] for a, b in zip(leader.u_low, leader.u_high, strict=True)]
    bounds.integral_variables = [[0.0, 100.0]]
    bounds.path_constraints = [[0.0, 1e3], [0.0, 1.0]]
    ends = [[float(a), float(a)] for a in (*leader.x_start, 0.0)], [[float(a), float(a)] for a in (*leader.x_end, 1.0)]
    bounds.initial_state_constraints = dict(zip((*x, clock), ends[0], strict=True))
    bounds.final_state_constraints = dict(zip((*x, clock), ends[1], strict=True))
    phase.guess.time = leader.guess_s
    phase.guess.state_variables = np.vstack([leader.guess_x.T, leader.guess_s / leader.end_s])
    phase.guess.control_variables = leader.guess_u.T
    phase.guess.integral_variables = np.array([1.0])
    count = len(leader.degrees)
    phase.mesh.number_mesh_sections = count
    phase.mesh.mesh_section_sizes = leader.shares_of(0)
    phase.mesh.number_mesh_section_nodes = [d + 1 for d in leader.degrees]
    settings = problem.settings
    settings.nlp_tolerance, settings.max_nlp_iterations, settings.max_mesh_iterations = 1e-6, 500, 1
    settings.scaling_method = None  # the unknowns are scaled already
    settings.display_mesh_result_graph = False
    problem.initialise()
    problem.solve()
    iteration = problem._backend.mesh_iterations[0]
    found = iteration.solution
    result = Result.of(found.objective, problem._backend.nlp_solver.stats())
    y, dy, control = (np.asarray(part[0]) for part in (found._y, found._dy, found._u))
    tau = 0.5 * (np.asarray(iteration.mesh.tau[0]) + 1.0) * leader.end_s
    at = 0
    for i, degree in enumerate(leader.degrees):
        span = slice(at, at + degree + 1)
        h = leader.joints_s[i + 1] - leader.joints_s[i]
        nodes = (tau[span] - leader.joints_s[i]) / h
        # Its states are integrals of the polynomial through the derivatives: one degree more than there are nodes.
        more = np.linspace(0.0, 1.0, degree + 2)
        slopes = np.polynomial.polynomial.polyfit(nodes, dy[:NX, span].T * h, degree)
        integral = np.polynomial.polynomial.polyint(slopes)
        state = y[:NX, at] + np.polynomial.polynomial.polyval(more, integral).T
        result.add(more, state, nodes, control[:, span].T)
        at += degree
    return result


if __name__ == "__main__":
    run(solve, "pycollo")
