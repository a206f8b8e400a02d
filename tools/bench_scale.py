"""Benchmark of formation size: the same flight planned for 6, 50, 200 and 1,000 vehicles.

./tools/run python tools/bench_scale.py [--vehicles 6 50 200 1000] [--repeat 5] [--changes] [--json FILE]

Simulation 1 over its seven mountains under a ceiling of 35 m, on a map a little wider; a square grid with 0.5 m between
neighbours, as near as the paper's vehicles are. The mountains are in the way of all vehicles, so the ground binds all
along. Every run is a process of its own, sizes take turns. Time and memory of planning and of the verifier are
reported apart; ratios are to the smallest formation. `--changes` adds a shrink, a turn and a reshape on schedule.
"""

import time
from typing import Any

import gcs
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.cross_table import check
from tools.bench.frame import ROOT, apart, finish, medians, options, serve
from tools.bench.memory import peak_mb

SPACING_M = 0.5
GOALS = {"plan_s": 1.5, "memory_mb": 2.0}  # of 1,000 vehicles, times those of 6
CHANGES: list[dict[str, Any]] = [
    {"kind": "shrink", "scale": 0.96, "at_s": 40.0},
    {"kind": "rotate", "angle_deg": 15.0, "at_s": 80.0},
    {"kind": "reshape", "to": "grid", "assignment": "fixed", "at_s": 140.0},
]


def scenario(vehicles: int, *, changes: bool = False) -> Scenario:
    """The flight for so many vehicles."""
    data = gcs.load_scenario(ROOT / "missions" / "simulation1").model_dump(mode="json")
    data["limits"] |= {"north_m": [-40.0, 1540.0], "east_m": [-40.0, 1540.0]}
    grid = {"name": "grid", "generator": "grid", "spacing_m": SPACING_M}
    data["formation"] = {"leader": 1, "count": vehicles, "start_shape": "grid", "shape": [grid]}
    if changes:
        data["formation"] |= {"change": CHANGES, "change_speed_mps": 1.0, "change_accel_mps2": 0.2}
    made = Scenario.model_validate(data)
    if mistakes := check(made):
        raise SystemExit("\n".join(map(str, mistakes)))
    return made


def measure(vehicles: int, changes: bool) -> dict[str, Any]:
    """One run in this process."""
    task = scenario(vehicles, changes=changes)
    began = time.perf_counter()
    plan = gcs.make_plan(task)
    planned = time.perf_counter()
    memory = peak_mb()
    report = gcs.verify(plan)
    return {
        "vehicles": vehicles,
        "plan_s": planned - began,
        "memory_mb": memory,
        "verify_s": time.perf_counter() - planned,
        "verify_memory_mb": peak_mb(),
        "solves": len(plan.mesh_history),
        "verified": report.ok,
        "clearance_m": report.clearance_min_m,
        "separation_m": report.separation_min_m,
    }


def main() -> None:
    """Run, print, and write what was asked for."""
    serve(measure)
    asked = options(__doc__, vehicles=[6, 50, 200, 1000], repeat=5, changes=False, json=None)
    runs = [apart(__file__, n, asked.changes) for _ in range(asked.repeat) for n in asked.vehicles]
    rows = [medians([run for run in runs if run["vehicles"] == vehicles]) for vehicles in asked.vehicles]
    record = {"runs": runs, "medians": rows}
    finish("the same flight for larger formations, medians", rows, asked.json, record)
    for key, goal in GOALS.items():
        ratio = rows[-1][key] / rows[0][key]
        print(f"{key}: {ratio:.2f} x, asked {goal:g} x: {'met' if ratio <= goal else 'MISSED'}")


if __name__ == "__main__":
    main()
