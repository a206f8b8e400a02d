# mypy: ignore-errors
"""The common problem in rockit: Legendre-Gauss collocation; its controls are piecewise linear through the joints."""

import casadi as ca
import numpy as np
from rockit import DirectCollocation, Ocp
from rockit.sampling_method import FunctionGrid

from tools.bench.contender import IPOPT, Result, run
from tools.bench.leader import NU, NX, Leader

ca.has_nlpsol("ipopt")  # loads the library: that is part of importing


def solve(leader: Leader) -> Result:
    """Define, solve, take apart."""
    degree, count = leader.degrees[0], len(leader.degrees)
    ocp = Ocp(t0=0.0, T=leader.end_s)
    x, u = ocp.state(NX), ocp.control(NU, order=1)
    xs, us = ca.vertsplit(x), ca.vertsplit(u)
    ocp.set_der(x, ca.vertcat(*leader.rates(xs, us, ca)))
    ocp.add_objective(ocp.integral(leader.cost_rate(xs, ocp.t, ca)))
    ocp.subject_to(ocp.at_t0(x) == leader.x_start)
    ocp.subject_to(ocp.at_tf(x) == leader.x_end)
    for grid in ("control", "integrator_roots"):
        ocp.subject_to((leader.x_low <= x) <= leader.x_high, grid=grid)
    ocp.subject_to((leader.u_low <= u) <= leader.u_high, grid="control")
    for value in leader.path(xs, us, ca):
        ocp.subject_to(value >= 0, grid="integrator_roots")
    for variable, values in ((x, leader.guess_x), (u, leader.guess_u)):
        table = ca.interpolant("guess", "linear", [leader.guess_s], values.ravel())
        ocp.set_initial(variable, table(ocp.t))
    shares = list(leader.joints_s / leader.end_s)
    method = DirectCollocation(N=count, degree=degree, scheme="legendre", grid=FunctionGrid(lambda _: shares))
    ocp.method(method)
    ocp.solver("ipopt", dict(IPOPT))
    solution = ocp.solve()
    result = Result.of(solution.value(ocp.objective), solution.stats)
    at_joints, at_roots = (solution.sample(x, grid=grid)[1] for grid in ("control", "integrator_roots"))
    controls = solution.sample(u, grid="control")[1]
    nodes = np.asarray(ca.collocation_points(degree, "legendre"))
    for i in range(count):
        state = [at_joints[i], *at_roots[degree * i : degree * (i + 1)]]
        result.add([0.0, *nodes], state, [0.0, 1.0], controls[i : i + 2])
    return result


if __name__ == "__main__":
    run(solve, "rockit-meco")
