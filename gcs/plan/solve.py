"""One nonlinear program handed to IPOPT, and its failures said in words.

Knows: IPOPT's options and statuses. Does not know: what the unknowns mean beyond the names of their constraints.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from gcs.errors import Infeasible, PlanningError
from gcs.plan.transcription import Program
from gcs.quadrotor import Array

_OPTIONS = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-6,
    "ipopt.max_iter": 500,
    # MUMPS' own scaling only costs time here: the program is scaled where it is made.
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_scaling": 0,
}
_WARM_OPTIONS = {
    "ipopt.warm_start_init_point": "yes",
    "ipopt.warm_start_bound_push": 1e-6,
    "ipopt.warm_start_bound_frac": 1e-6,
    "ipopt.warm_start_slack_bound_push": 1e-6,
    "ipopt.warm_start_slack_bound_frac": 1e-6,
    "ipopt.mu_init": 1e-4,
}
_IN_WORDS = {
    "Infeasible_Problem_Detected": "no motion satisfies all constraints near the one it tried",
    "Maximum_Iterations_Exceeded": "it ran out of iterations",
    "Restoration_Failed": "it could not get closer to satisfying the constraints",
    "Invalid_Number_Detected": "a function returned a number that is not finite",
}


@dataclass(frozen=True)
class Solution:
    """Unknowns that satisfy the program to the solver's tolerance, and what they cost."""

    y: Array
    objective: float
    iterations: int
    seconds: float


def solve(program: Program, start: Array, *, warm: bool = False) -> Solution:
    """Minimise; raises Infeasible or PlanningError with the solver's status and the worst constraint."""
    began = time.perf_counter()
    options: dict[str, Any] = {**program.derivatives, **_OPTIONS, **(_WARM_OPTIONS if warm else {})}
    solver = ca.nlpsol("solver", "ipopt", program.nlp, options)
    result = solver(x0=start, lbx=program.y_low, ubx=program.y_high, lbg=program.g_low, ubg=program.g_high)
    stats = solver.stats()
    y = np.asarray(result["x"]).ravel()
    if not stats["success"]:
        raise _failure(program, y, stats["return_status"])
    return Solution(y, float(result["f"]), int(stats["iter_count"]), time.perf_counter() - began)


def _failure(program: Program, y: Array, status: str) -> PlanningError:
    g = np.asarray(program.nlp(y, [])[1]).ravel()
    excess = np.nan_to_num(np.maximum(g - program.g_high, program.g_low - g), nan=np.inf)
    worst = int(np.argmax(excess))
    name, t_s = program.g_names[worst]
    reason = _IN_WORDS.get(status, "the solver gave up")
    kind = Infeasible if status == "Infeasible_Problem_Detected" else PlanningError
    return kind(
        f"no plan: {reason} (IPOPT: {status}); "
        f"furthest from being held is {name} at t = {t_s:.1f} s, by {excess[worst]:.3g}",
        hint="give more time ([time] flight_s), a higher ceiling ([limits] height_m) or a smaller clearance",
    )
