"""One way of planning one size of formation, in a process of its own: time, memory, and whether there was a plan.

Knows: the three ways. Does not know: which sizes are asked for. Run as `python -m tools.paper.scale_one WAY N LIMIT_S`.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import casadi as ca

import gcs
from gcs.plan.ocp.problem import flight_problem
from tools.bench import coupled
from tools.bench.describe import alone, uniform
from tools.bench.memory import peak_mb
from tools.bench_scale import scenario
from tools.paper import swarm_fleet


def rigid(vehicles: int, _: float) -> bool:
    """The virtual rigid body, from the scenario to the plan."""
    return len(gcs.make_plan(scenario(vehicles)).sysids) == vehicles


def swarms(vehicles: int, limit_s: float) -> bool:
    """One swarm after another, each at most until the time is over."""
    task = scenario(vehicles)
    fleet = swarm_fleet.plan(task, 1, total_s=limit_s)
    return len(fleet.found) == vehicles


def together(vehicles: int, limit_s: float) -> bool:
    """As many optimal control problems as vehicles, in one program with every pair's separation."""
    task = scenario(vehicles)
    mesh = uniform(flight_problem(alone(task)))
    return bool(coupled.solve(mesh, limit_s, task, clock="cpu")["success"])


WAYS = {"rigid": rigid, "swarms": swarms, "together": together}


def main(way: str, vehicles: str, limit_s: str) -> None:
    """Measure and print."""
    ca.has_nlpsol("ipopt")  # loads the library: that is part of importing
    began = time.process_time()
    done = WAYS[way](int(vehicles), float(limit_s))
    result: dict[str, Any] = {
        "vehicles": int(vehicles),
        "seconds": time.process_time() - began,
        "memory_mb": peak_mb(),
        "done": done,
    }
    print(json.dumps(result))


if __name__ == "__main__":
    main(*sys.argv[1:4])
