# mypy: ignore-errors
"""The common problem in mpopt: Legendre-Gauss-Radau collocation, at both ends of every segment too."""

import casadi as ca
import numpy as np
from mpopt import mp

from tools.bench.contender import Result, run, timed
from tools.bench.leader import NU, NX, Leader

ca.has_nlpsol("ipopt")  # loads the library: that is part of importing


def solve(leader: Leader) -> Result:
    """Define, solve, take apart."""
    ocp = mp.OCP(n_states=NX, n_controls=NU, n_phases=1)

    def parts(vector, count):
        return [vector[i] for i in range(count)]

    ocp.dynamics[0] = lambda x, u, t, a=None: leader.rates(parts(x, NX), parts(u, NU), ca)
    ocp.running_costs[0] = lambda x, u, t, a=None: leader.cost_rate(parts(x, NX), t, ca)
    ocp.path_constraints[0] = lambda x, u, t, a=None: [-value for value in leader.path(parts(x, NX), parts(u, NU), ca)]
    ocp.terminal_constraints[0] = lambda xf, tf, x0, t0, a=None: [xf[i] - leader.x_end[i] for i in range(NX)]
    ocp.x00[0], ocp.xf0[0] = leader.x_start, leader.x_end
    ocp.lbx[0], ocp.ubx[0], ocp.lbu[0], ocp.ubu[0] = leader.x_low, leader.x_high, leader.u_low, leader.u_high
    ocp.lbtf[0] = ocp.ubtf[0] = ocp.tf0[0] = leader.end_s
    ocp.midu[0] = 0  # an extra constraint on the control, on by default, that the common problem does not have
    ocp.validate()
    optimiser = mp.mpopt(ocp, len(leader.degrees), list(leader.degrees), "LGR")
    optimiser._MUTE_ = True
    options = {"ipopt.tol": 1e-6, "ipopt.max_iter": 500}
    optimiser.create_solver(options=options)
    taus = [np.asarray(optimiser.collocation._taus_fn(d)) for d in leader.degrees]
    taus = [(tau - optimiser.tau0) / (optimiser.tau1 - optimiser.tau0) for tau in taus]
    times = [leader.joints_s[0], *(t for i, tau in enumerate(taus) for t in leader.times_s(i, tau[1:]))]
    x, u = leader.guess(times)
    start = np.concatenate([x.T.ravel(), u.T.ravel(), [0.0, leader.end_s]])
    spent_s, inner = [], optimiser.nlp_solver
    optimiser.nlp_solver = timed(inner, spent_s)
    solution = optimiser.solve(initial_solution={"x0": start}, mpopt_options={"nlp_sw_params": leader.shares_of(0)})
    result = Result.of(solution["f"], inner.stats(), sum(spent_s))
    y = np.asarray(solution["x"]).ravel()
    x = y[: NX * len(times)].reshape(NX, -1).T
    u = y[NX * len(times) : (NX + NU) * len(times)].reshape(NU, -1).T
    at = 0
    for degree, tau in zip(leader.degrees, taus, strict=True):
        result.add(tau, x[at : at + degree + 1], tau, u[at : at + degree + 1])
        at += degree
    return result


if __name__ == "__main__":
    run(solve, "mpopt")
