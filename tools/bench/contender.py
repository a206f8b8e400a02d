"""How every contender is run: read the problem, solve it once, write what came out.

Knows: files, the clock, which times count. Does not know: any library. A contender is a module of its own that calls
`run` with a function from Leader (or Legs) to Result; it is started as a process of its own for every repetition.
"""

from __future__ import annotations

import contextlib
import json
import platform
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from tools.bench.leader import Leader


@dataclass
class Result:
    """One solution, in the units of Leader; interval by interval the points a polynomial runs through."""

    objective: float
    iterations: int
    solver_s: float
    status: str
    success: bool
    state_tau: list[Any] = field(default_factory=list)  # per interval (S,), on [0, 1]
    state: list[Any] = field(default_factory=list)  # per interval (S, 12)
    control_tau: list[Any] = field(default_factory=list)
    control: list[Any] = field(default_factory=list)


class Stopwatch:
    """Adds up the time spent within `watching`."""

    def __init__(self) -> None:
        self.seconds = 0.0

    @contextlib.contextmanager
    def watching(self) -> Iterator[None]:
        """Count what happens inside."""
        began = time.perf_counter()
        yield
        self.seconds += time.perf_counter() - began


def run(solve: Callable[[Any], Result], package: str, common: type[Leader] = Leader) -> None:
    """Solve the `common` problem with the numbers of sys.argv[1] cold and write the result to sys.argv[2]."""
    problem, answer = (Path(name) for name in sys.argv[1:3])
    leader = common(json.loads(problem.read_text()))
    with contextlib.redirect_stdout(sys.stderr):
        began, began_cpu = time.perf_counter(), time.process_time()
        result = solve(leader)
        cold_s, cold_cpu_s = time.perf_counter() - began, time.process_time() - began_cpu
    out = asdict(result) | {
        "cold_s": cold_s,
        "cold_cpu_s": cold_cpu_s,
        "versions": {name: version(name) for name in (package, "casadi", "numpy")},
        "python": platform.python_version(),
    }
    out["state"] = [np.asarray(part) * leader.state_unit for part in result.state]
    out["control"] = [np.asarray(part) * leader.control_unit + leader.control_shift for part in result.control]
    answer.write_text(json.dumps(out, default=lambda value: np.asarray(value).tolist()))
