"""One run of a contender in a process of its own: read the problem, solve it once, write the result."""

from __future__ import annotations

import contextlib
import json
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from tools.bench.leader import Leader

IPOPT = {
    "ipopt.tol": 1e-6,
    "ipopt.max_iter": 500,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "print_time": 0,
    "record_time": True,
}


@dataclass
class Result:
    """One solution, in the units of Leader; interval by interval the points a polynomial runs through."""

    objective: float
    iterations: int
    solver_s: float
    status: str
    success: bool
    joints_s: list[float] = field(default_factory=list)  # ends of all intervals; none: those of the problem
    points_s: list[float] = field(default_factory=list)  # arrival at each point
    state_tau: list[Any] = field(default_factory=list)  # per interval (S,), on [0, 1]
    state: list[Any] = field(default_factory=list)  # per interval (S, 12)
    control_tau: list[Any] = field(default_factory=list)
    control: list[Any] = field(default_factory=list)

    @classmethod
    def of(cls, objective: Any, stats: dict[str, Any], solver_s: float | None = None) -> Result:
        """With what CasADi tells of a solver."""
        took_s = stats["t_wall_total"] if solver_s is None else solver_s
        return cls(float(objective), stats["iter_count"], took_s, stats["return_status"], stats["success"])

    def add(self, state_tau: Any, state: Any, control_tau: Any, control: Any) -> None:
        """One more interval."""
        self.state_tau.append(state_tau)
        self.state.append(state)
        self.control_tau.append(control_tau)
        self.control.append(control)


def timed(call: Callable[..., Any], spent_s: list[float]) -> Callable[..., Any]:
    """The same function, which notes the time that it takes."""

    def run(*arguments: Any, **named: Any) -> Any:
        began = time.perf_counter()
        answer = call(*arguments, **named)
        spent_s.append(time.perf_counter() - began)
        return answer

    return run


def run(solve: Callable[[Leader], Result], package: str) -> None:
    """Solve the problem with the numbers of sys.argv[1] cold and write the result to sys.argv[2]."""
    problem, answer = (Path(name) for name in sys.argv[1:3])
    leader = Leader(json.loads(problem.read_text()))
    with contextlib.redirect_stdout(sys.stderr):
        began, began_cpu = time.perf_counter(), time.process_time()
        result = solve(leader)
        cold_s, cold_cpu_s = time.perf_counter() - began, time.process_time() - began_cpu
    result.joints_s = result.joints_s or leader.joints_s.tolist()
    out = asdict(result) | {"cold_s": cold_s, "cold_cpu_s": cold_cpu_s} | made_with(package)
    out["state"] = [np.asarray(part) * leader.state_unit for part in result.state]
    out["control"] = [np.asarray(part) * leader.control_unit + leader.control_shift for part in result.control]
    answer.write_text(json.dumps(out, default=lambda value: np.asarray(value).tolist()))


def made_with(package: str) -> dict[str, Any]:
    """Versions of a package and of what all have in common."""
    versions = {name: version(name) for name in (package, "casadi", "numpy")}
    return {"versions": versions, "python": platform.python_version()}
