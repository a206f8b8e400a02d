"""IPOPT on one nonlinear program: options, and messages for its failures."""

import os
import sys
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import TextIO, cast

import casadi as ca
import numpy as np

from gcs.errors import Infeasible, OutOfTime, PlanningError
from gcs.plan.nlp.transcription import Program
from gcs.plan.trajectory.constraint_id import ConstraintId
from gcs.types import Array
from gcs.util.long_work import left_s, report

# MUMPS' matrices are small: threads of its linear algebra wait more than they compute, and the last bits of a plan
# would depend on the number of cores. The library reads this when IPOPT is loaded, at the first solve.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
Options = dict[str, str | float | int]
_SOLVE_S = 900.0  # far longer than any solve that succeeds
OPTIONS: Options = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-6,
    "ipopt.max_iter": 250,  # solves that succeed take 20 to 100
    "ipopt.max_wall_time": _SOLVE_S,
    # MUMPS' own scaling only costs time here: the program is scaled where it is made.
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_scaling": 0,
    # Approximate minimum fill: half the time of MUMPS' own choice on long flights, the same on short ones.
    "ipopt.mumps_pivot_order": 2,
}
# With coordinates of the shape, blocks are larger, and approximate minimum degree takes two thirds of the time.
_SHAPE_OPTIONS = {"ipopt.mumps_pivot_order": 0}
# While the shape moves on a schedule the optimum is flat: within IPOPT's own tolerance, costs differ by 0.3 % and
# heights by 1 m, from processor to processor. A warm start would end 3e-6 above the optimum, 9 cm away.
_EXACT_OPTIONS: Options = {"ipopt.dual_inf_tol": 1e-8}
# With a free time, the active limits change often; a barrier parameter that may grow again converges sooner.
_TIME_OPTIONS = {"ipopt.mu_strategy": "adaptive"}
# Over several legs most of the time is spent on solving with the same factors again to refine each step. Steps that
# are not refined are good enough.
_LEG_OPTIONS = {"ipopt.fast_step_computation": "yes"}
WARM_OPTIONS: Options = {
    "ipopt.warm_start_init_point": "yes",
    "ipopt.warm_start_bound_push": 1e-6,
    "ipopt.warm_start_bound_frac": 1e-6,
    "ipopt.warm_start_slack_bound_push": 1e-6,
    "ipopt.warm_start_slack_bound_frac": 1e-6,
    "ipopt.warm_start_mult_bound_push": 1e-6,
    "ipopt.mu_init": 1e-6,
}
# A guess near a solution: a larger barrier would push the flight away from it, and back over many iterations.
_NEAR_OPTIONS = {"ipopt.mu_init": 1e-3}
# CasADi ends a solve at Ctrl-C, suppresses the exception and reports this status; nothing else causes it.
_INTERRUPTED = "NonIpopt_Exception_Thrown"
_STOPPED = "User_Requested_Stop"  # by the callback
# A guess is given up where after so many iterations the violation was never below this share of the first one: those
# that succeed have a hundredth after 12, and those that do not creep on as long as they may.
_CREEPS_AFTER, _CREEPS_SHARE = 30, 0.1
_CASADI = "CasADi - "  # begins its messages
_IN_WORDS = {
    "Infeasible_Problem_Detected": "no flight near the initial guess satisfies all constraints",
    "Maximum_Iterations_Exceeded": "the iteration limit was reached",
    _STOPPED: "the constraints contradict each other",
    "Maximum_WallTime_Exceeded": f"one solve took longer than {_SOLVE_S / 60.0:g} min",
    "Restoration_Failed": "the solver could not reduce the violation of the constraints",
    "Invalid_Number_Detected": "a function returned a number that is not finite",
}


@dataclass(frozen=True)
class Solution:
    """Unknowns that satisfy the program to the solver's tolerance, and their cost."""

    y: Array
    y_multipliers: Array  # of the bounds of y
    g_multipliers: dict[tuple[ConstraintId, float], float]  # of the rows of g, by constraint and time
    objective: float
    iterations: int
    seconds: float


def solve(
    program: Program,
    start: Array,
    before: Solution | None = None,
    *,
    near: bool = False,
    most: int | None = None,
    giving_up: bool = False,
) -> Solution:
    """The solution from `start`; a warm start where there is a solution `before`, on the previous mesh.

    `near`: the start is the solution of a similar problem. `most`: the largest number of iterations.
    `giving_up`: a solve that creeps ends earlier.

    Raises Infeasible or PlanningError with the solver's status, the worst constraint and the limits that oppose it;
    KeyboardInterrupt at Ctrl-C.
    """
    began = time.perf_counter()
    options: Options = {**OPTIONS}
    if program.layout.coordinates:
        options |= _SHAPE_OPTIONS
    elif program.moving_shape:
        options |= _EXACT_OPTIONS
    if program.free_time:
        options |= _TIME_OPTIONS
    if program.layout.mesh.leg_count > 1:
        options |= _LEG_OPTIONS
    if near:
        options |= _NEAR_OPTIONS
    if most is not None:
        options |= {"ipopt.max_iter": most}
    guess: dict[str, Array | list[float]] = {"x0": start}
    if before is not None:
        options |= WARM_OPTIONS if program.layout.mesh.leg_count > 1 else WARM_OPTIONS | _EXACT_OPTIONS
        # To a microsecond: a row that moved with its leg has the same time but for the last bits.
        known = {(one, round(t_s, 6)): price for (one, t_s), price in before.g_multipliers.items()}
        guess["lam_g0"] = [known.get((one, round(t_s, 6)), 0.0) for one, t_s in program.g_ids]
        if len(before.y) == len(start):
            guess["lam_x0"] = before.y_multipliers
    made = solver(program.nlp, program.derivatives, options)
    if giving_up:
        made.iterations.give_up(program.g_low, program.g_high)
    found = run(made, program, guess)
    return replace(found, seconds=time.perf_counter() - began)


_ROWS = ca.nlpsol_out().index("g")


class _Iterations(ca.Callback):
    """Reports every iteration of a solve. CasADi requires its inputs: the results of a solver."""

    def __init__(self, nlp: ca.Function) -> None:
        super().__init__()
        unknowns, rows, parameters = nlp.size1_in(0), nlp.size1_out(1), nlp.size1_in(1)
        sizes = {"x": unknowns, "f": 1, "g": rows, "lam_x": unknowns, "lam_g": rows, "lam_p": parameters}
        self._sizes = [sizes[name] for name in ca.nlpsol_out()]
        self.done = 0
        self._limits: tuple[Array, Array] | None = None
        self._violations: list[float] = []
        self.construct("iterations", {})

    def give_up(self, low: Array, high: Array) -> None:
        """Stop a solve whose rows (G,) stay far outside of their bounds."""
        self._limits = low, high

    @property
    def creeps(self) -> bool:
        """Whether so far no iteration came near to the bounds of all rows."""
        first = self._violations[0] if self._violations else 0.0
        return len(self._violations) > _CREEPS_AFTER and min(self._violations) > _CREEPS_SHARE * first

    def get_n_in(self) -> int:
        """CasADi's number of inputs."""
        return len(self._sizes)

    def get_n_out(self) -> int:
        """One output: whether to stop."""
        return 1

    def get_sparsity_in(self, number: int) -> ca.Sparsity:
        """CasADi's shape of an input."""
        return ca.Sparsity.dense(self._sizes[number])

    def eval(self, results: Sequence[ca.DM]) -> list[int]:
        """Called after every iteration."""
        self.done += 1
        if self._limits is not None:
            rows, (low, high) = np.asarray(results[_ROWS]).ravel(), self._limits
            self._violations.append(float(np.maximum(low - rows, rows - high).max(initial=0.0)))
        if left_s() < 0.0 or self.creeps:
            return [1]  # an exception would not come through
        report(lambda: f"solving: iteration {self.done} of at most {OPTIONS['ipopt.max_iter']}")
        return [0]


@dataclass(frozen=True)
class Solver:
    """IPOPT for one program, for any parameters and bounds."""

    function: ca.Function
    iterations: _Iterations  # CasADi does not keep it alive


def solver(nlp: ca.Function, derivatives: dict[str, ca.Function], options: Options) -> Solver:
    """IPOPT for one program."""
    iterations = _Iterations(nlp)
    watched = {**derivatives, **options, "iteration_callback": iterations}
    return Solver(ca.nlpsol("solver", "ipopt", nlp, watched), iterations)


def run(solver: Solver, program: Program, guess: Mapping[str, Array | list[float]]) -> Solution:
    """The solution from a guess (x0, and where known lam_x0, lam_g0). Raises as `solve` does."""
    began = time.perf_counter()
    bounds = {"lbx": program.y_low, "ubx": program.y_high, "lbg": program.g_low, "ubg": program.g_high}
    with redirect_stderr(cast("TextIO", _WithoutInterrupts(sys.stderr))):
        solver.iterations.done = 0
        result = solver.function(p=program.parameters, **bounds, **guess)
    stats = solver.function.stats()
    y, y_multipliers, g_multipliers = (np.asarray(result[name]).ravel() for name in ("x", "lam_x", "lam_g"))
    if stats["return_status"] == _INTERRUPTED:
        raise KeyboardInterrupt
    if stats["return_status"] == _STOPPED and not solver.iterations.creeps:
        if left_s() >= 0.0:
            raise KeyboardInterrupt  # it came while the callback ran
        raise OutOfTime.because(f"solving, after {solver.iterations.done} iterations")
    if not stats["success"]:
        raise _failure(program, y, y_multipliers, g_multipliers, stats["return_status"])
    return Solution(
        y,
        y_multipliers,
        dict(zip(program.g_ids, g_multipliers.tolist(), strict=True)),
        float(result["f"]),
        int(stats["iter_count"]),
        time.perf_counter() - began,
    )


class _WithoutInterrupts:
    """A stream that passes all on, at once, but the lines that CasADi writes about Ctrl-C, piece by piece."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._line = ""

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        if self._line or text.startswith(_CASADI):
            self._line += text
            if self._line.endswith("\n"):
                line, self._line = self._line, ""
                if "KeyboardInterruptException" not in line:
                    self._stream.write(line)
        else:
            self._stream.write(text)
        return len(text)


def _failure(program: Program, y: Array, y_multipliers: Array, g_multipliers: Array, status: str) -> PlanningError:
    g = np.asarray(program.nlp(y, program.parameters)[1]).ravel()
    excess = np.nan_to_num(np.maximum(g - program.g_high, program.g_low - g), nan=np.inf)
    worst = int(np.argmax(excess))
    constraint, t_s = program.g_ids[worst]
    reason = _IN_WORDS.get(status, "the solver stopped without a solution")
    kind = Infeasible if status == "Infeasible_Problem_Detected" else PlanningError
    leg = program.leg_at(t_s)
    against = _opposing(program, y_multipliers, g_multipliers)
    return kind.because(
        f"{reason} (IPOPT: {status}); the largest violation is of {constraint} at t = {t_s:.1f} s"
        + (f" in {leg}" if leg else "")
        + (f", against the {against}" if against else ""),
        hint="give more time ([time] flight_s), a higher ceiling ([limits] height_m), "
        "or less clearance ([limits] clearance_min_m)",
    )


def _opposing(program: Program, y_multipliers: Array, g_multipliers: Array) -> str:
    """The limit and the obstacle with the largest multipliers, summed over the flight."""
    limits: dict[ConstraintId, float] = defaultdict(float)
    obstacles: dict[ConstraintId, float] = defaultdict(float)
    for i in np.flatnonzero(program.y_low < program.y_high):
        limits[program.y_ids[i]] += abs(y_multipliers[i])
    for i in np.flatnonzero(program.g_low < program.g_high):
        one, _ = program.g_ids[i]
        (limits if one in limits else obstacles)[one] += abs(g_multipliers[i])
    most = [max(push.items(), key=itemgetter(1)) for push in (limits, obstacles) if push]
    least = 0.01 * max(push for _, push in most)
    return " and the ".join(str(one) for one, push in most if np.isfinite(push) and push > least)
