"""What does a larger formation cost? The same flight planned for 6, 50, 200 and 1,000 vehicles.

./tools/run python tools/bench_scale.py [--vehicles 6 50 200 1000] [--repeat 5] [--changes] [--json FILE]

Simulation 1 over its seven mountains under a ceiling of 35 m, on a map a little wider; a square grid with 0.5 m between
neighbours, as near as the paper's vehicles are. Mountains stand in the way of all vehicles, so the ground binds all
along. Every run is a process of its own, sizes take turns. Time and memory of planning and of the verifier are
reported apart; ratios are to the smallest formation. `--changes` adds a shrink, a turn and a reshape on schedule.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

import gcs
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.cross_table import check
from tools.bench.memory import peak_mb

ROOT = Path(__file__).resolve().parent.parent
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
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, nargs="+", default=[6, 50, 200, 1000])
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--changes", action="store_true")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one is not None:
        print(json.dumps(measure(options.one, options.changes)))
        return
    runs = []
    for _ in range(options.repeat):
        for vehicles in options.vehicles:
            runs.append(_in_its_own_process(vehicles, options.changes))
            print(f"{vehicles:5d} vehicles: {runs[-1]['plan_s']:.2f} s, verified: {runs[-1]['verified']}", flush=True)
    medians = [_median([run for run in runs if run["vehicles"] == vehicles]) for vehicles in options.vehicles]
    _show(medians)
    if options.json:
        options.json.write_text(json.dumps({"runs": runs, "medians": medians}, indent=1), encoding="utf-8")


def _in_its_own_process(vehicles: int, changes: bool) -> dict[str, Any]:
    command = [sys.executable, __file__, "--one", str(vehicles), *(["--changes"] if changes else [])]
    done = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT)
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def _median(runs: list[dict[str, Any]]) -> dict[str, Any]:
    first = runs[0]
    numbers = {key: statistics.median(run[key] for run in runs) for key in first if key != "verified"}
    return numbers | {"verified": all(run["verified"] for run in runs)}


def _show(medians: list[dict[str, Any]]) -> None:
    table = Table(title="the same flight for larger formations, medians")
    for column in ("vehicles", "planning", "x", "memory", "x", "solves", "verifier", "x", "verified", "clearance"):
        table.add_column(column, justify="right")
    least = medians[0]
    for row in medians:
        table.add_row(
            f"{row['vehicles']:.0f}",
            f"{row['plan_s']:.2f} s",
            f"{row['plan_s'] / least['plan_s']:.2f}",
            f"{row['memory_mb']:.0f} MB",
            f"{row['memory_mb'] / least['memory_mb']:.2f}",
            f"{row['solves']:.0f}",
            f"{row['verify_s']:.2f} s",
            f"{row['verify_s'] / least['verify_s']:.1f}",
            "yes" if row["verified"] else "NO",
            f"{row['clearance_m']:.2f} m",
        )
    console = Console(width=110)
    console.print(table)
    for key, goal in GOALS.items():
        ratio = medians[-1][key] / least[key]
        console.print(f"{key}: {ratio:.2f} x, asked {goal:g} x: {'met' if ratio <= goal else 'MISSED'}")


if __name__ == "__main__":
    main()
