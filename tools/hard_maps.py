"""Benchmark of hard maps: walls with gaps, slaloms, ridges, forests of 25 mountains and pockets, drawn from a seed.

./tools/run python tools/hard_maps.py [--maps 25] [--seed 1] [--first 0] [--jobs 1] [--json FILE]
./tools/run python tools/hard_maps.py --against OLD.json --json NEW.json

Six vehicles of Simulation 1 fly 500 m or more through each map. A row is one map, in a process of its own: what became
of it, solves of the flight, of all routes and of the whole plan (with those that failed), iterations, CPU time of plan
and proof, and the objective. `--against` compares the record of another tree with that of `--json`, map by map.
"""

import json
import statistics
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from gcs import load_scenario, make_plan, verify
from gcs.errors import GcsError, Infeasible
from gcs.plan.nlp import ipopt
from gcs.plan.trajectory.plan import MeshRound
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tools.bench.frame import ROOT, Row, apart, finish, options, serve

MISSION = ROOT / "missions" / "simulation1"
FAMILIES = ("walls", "slalom", "ridges", "forest", "pocket")
SIDE_M, HEIGHT_M, ROOM_M = 1000.0, 3.0, 40.0
FLAT_M = 1.36  # ground no higher than the ripple: an end may stand there
SPEED_MPS = (2.4, 3.2)  # along the straight line
WORSE = 1e-3  # of the objective, that another tree's plan may be


def drawn(number: int, seed: int) -> tuple[str, Scenario]:
    """Map `number` of the series `seed`, and its family."""
    family, rng = FAMILIES[number % len(FAMILIES)], np.random.default_rng([seed, number])
    data = load_scenario(MISSION).model_dump(mode="json")
    for _ in range(1000):
        start, end = rng.uniform(ROOM_M, SIDE_M - ROOM_M, (2, 2))
        along = end - start
        length_m = float(np.linalg.norm(along))
        if length_m < 500.0:
            continue
        frame = np.array([along, [-along[1], along[0]]]) / length_m  # ahead and aside
        zones, mountains, ceiling_m = _obstacles(family, rng, start, length_m, frame)
        data |= {"no_fly": zones, "name": f"{family}{number}"}
        data["terrain"]["mountains"] = mountains
        data["limits"] |= {"height_m": [0.0, ceiling_m], "roll_pitch_yaw_deg": [180.0, 60.0, 360.0]}
        data["limits"] |= {"north_m": [0.0, SIDE_M], "east_m": [0.0, SIDE_M]}
        course_deg = float(np.degrees(np.arctan2(along[1], along[0])))
        for key, place in (("start", start), ("end", end)):
            data[key] = {
                "position_m": [*np.round(place, 1).tolist(), HEIGHT_M],
                "velocity_mps": [*(2.8 * frame[0]).tolist(), 0.0] if key == "start" else [0.0] * 3,
                "roll_pitch_yaw_deg": [0.0, 0.0, course_deg],
            }
        data["objective"]["heading_ref_deg"] = course_deg
        data["time"]["flight_s"] = float(np.round(length_m / rng.uniform(*SPEED_MPS) + 20.0))
        first = data["formation"]["vehicle"][0]["position_m"]
        moved = np.array(data["start"]["position_m"]) - first
        for vehicle in data["formation"]["vehicle"]:
            vehicle["position_m"] = (np.array(vehicle["position_m"]) + moved).tolist()
        try:
            scenario = Scenario.model_validate(data)
        except GcsError:
            continue
        hover = start - data["ground_phases"]["run_up_m"] * frame[0]
        if all(_flat(scenario, place) for place in (start, hover, end)):
            return family, scenario
    raise ValueError(f"no {family} in 1000 tries")


def _obstacles(
    family: str, rng: np.random.Generator, start: Array, length_m: float, frame: Array
) -> tuple[list[dict[str, Any]], dict[str, list[float]] | None, float]:
    """No-fly zones, mountains and ceiling of one map; places are counted from the start, ahead and aside."""

    def zone(corners: list[tuple[float, float]]) -> dict[str, Any]:
        return {"polygon_m": (start + np.array(corners) @ frame).tolist()}

    def wall(ahead: float, low: float, high: float, thick: float) -> dict[str, Any]:
        return zone([(ahead, low), (ahead + thick, low), (ahead + thick, high), (ahead, high)])

    few = {"north_m": [0.0], "east_m": [0.0], "height_m": [0.1], "spread_north_m": [20.0], "spread_east_m": [20.0]}
    if family == "walls":
        zones = []
        count = int(rng.integers(1, 4))
        for n in range(count):
            ahead = length_m * (n + 1 + rng.uniform(-0.2, 0.2)) / (count + 1)
            gap, wide, thick = rng.uniform(-120.0, 120.0), rng.uniform(12.0, 40.0), rng.uniform(5.0, 30.0)
            zones += [
                wall(ahead, gap + 0.5 * wide, gap + 300.0, thick),
                wall(ahead, gap - 300.0, gap - 0.5 * wide, thick),
            ]
        return zones, few, 30.0
    if family == "slalom":
        count = int(rng.integers(4, 8))
        zones = []
        for n in range(count):
            ahead, over = length_m * (n + 1) / (count + 1), rng.uniform(5.0, 45.0)
            side = 1.0 if n % 2 else -1.0
            if rng.uniform() < 0.5:
                low, high = sorted((-side * over, side * 200.0))
                zones.append(wall(ahead, low, high, rng.uniform(4.0, 20.0)))
            else:
                radius = rng.uniform(30.0, 60.0)
                north, east = start + np.array([ahead, side * (radius - over)]) @ frame
                zones.append({"north_m": float(north), "east_m": float(east), "radius_m": float(radius)})
        return zones, few, 30.0
    if family == "pocket":
        ahead, deep, half, thick = length_m * rng.uniform(0.4, 0.6), *rng.uniform((60, 30, 6), (160, 110, 20))
        aside = rng.uniform(-0.6, 0.6) * half
        inner = [(ahead - deep, half), (ahead, half), (ahead, -half), (ahead - deep, -half)]
        out = half + thick
        outer = [(ahead - deep, -out), (ahead + thick, -out), (ahead + thick, out), (ahead - deep, out)]
        return [zone([(a, b + aside) for a, b in inner + outer])], few, 30.0
    if family == "ridges":
        places, heights, spreads = [], [], []
        for ahead in length_m * (np.arange(1, 4) + rng.uniform(-0.2, 0.2, 3)) / 4.0:
            for aside in np.arange(-300.0, 301.0, 60.0) + rng.uniform(-25.0, 25.0, 11):
                places.append(start + np.array([ahead, aside]) @ frame)
                heights.append(rng.uniform(12.0, 42.0))
                spreads.append(rng.uniform(22.0, 45.0, 2))
        ceiling_m = float(rng.uniform(25.0, 40.0))
    else:
        places = list(rng.uniform(0.0, SIDE_M, (25, 2)))
        heights = rng.uniform(10.0, 60.0, 25).tolist()
        spreads = list(rng.uniform(20.0, 90.0, (25, 2)))
        ceiling_m = float(rng.uniform(14.0, 35.0))
    north, east = np.array(places).T.tolist()
    spread_north, spread_east = np.array(spreads).T.tolist()
    keys = ("north_m", "east_m", "height_m", "spread_north_m", "spread_east_m")
    return [], dict(zip(keys, (north, east, heights, spread_north, spread_east), strict=True)), ceiling_m


def _flat(scenario: Scenario, place: Array) -> bool:
    """Whether six vehicles may stand there."""
    low_m, high_m = np.array(place).min(), np.array(place).max()
    if low_m < 0.0 or high_m > SIDE_M:
        return False
    north, east = np.meshgrid(place[0] + np.array([-3.0, 0.0, 3.0]), place[1] + np.array([-3.0, 0.0, 3.0]))
    return float(ground_height_m(scenario.terrain, north, east).max()) < FLAT_M


def planned(number: int, seed: int) -> Row:
    """The row of one map."""
    family, scenario = drawn(number, seed)
    rounds: list[MeshRound] = []
    solves: list[float] = []
    run = ipopt.run

    def counted(*task: Any) -> ipopt.Solution:
        began = time.process_time()
        try:
            return run(*task)
        finally:
            solves.append(time.process_time() - began)

    began = time.process_time()
    row: Row = {"map": number, "family": family, "end": "", "flight": 0, "objective": None, "words": ""}
    try:
        with patch.object(ipopt, "run", counted):
            plan = make_plan(scenario, rounds.append)
        row |= {"flight": len(plan.mesh_history), "objective": plan.objective}
        report = verify(plan)
        row["end"], row["words"] = ("verified", "") if report.ok else ("failed", str(report.failures[0]))
    except Infeasible as failure:
        row |= {"end": "infeasible", "words": failure.message}
    except GcsError as failure:
        row |= {"end": "failed", "words": failure.message}
    row |= {"solves": len(solves), "iterations": sum(done.iterations for done in rounds)}
    row |= {"solve_s": sum(solves), "cpu_s": time.process_time() - began}
    return row


def compared(old: list[Row], new: list[Row]) -> list[str]:
    """What differs: totals, medians, and each map that is lost, won, or worse than before."""
    after = {row["map"]: row for row in new}
    pairs = [(row, after[row["map"]]) for row in old if row["map"] in after]
    words = [f"{name}: {summary([pair[k] for pair in pairs])}" for k, name in enumerate(("before", "after"))]
    ratio = sum(b["cpu_s"] for _, b in pairs) / sum(a["cpu_s"] for a, _ in pairs)
    words.append(f"CPU time: {ratio:.3f} of before")
    for a, b in pairs:
        if a["end"] != b["end"]:
            words.append(f"map {a['map']} ({a['family']}): {a['end']} before, {b['end']} after {b['words']}")
        elif a["objective"] and abs(change := b["objective"] / a["objective"] - 1.0) > WORSE:
            words.append(f"map {a['map']} ({a['family']}): objective {change:+.2%}")
    return words


def summary(rows: list[Row]) -> str:
    """Counts, medians and totals."""
    done = [row for row in rows if row["end"] == "verified"] or rows
    flight, every = ([row[key] for row in done] for key in ("flight", "solves"))
    most, all_most = (int(np.quantile(of, 0.95, method="inverted_cdf")) for of in (flight, every))
    return (
        f"{sum(row['end'] == 'verified' for row in rows)} of {len(rows)} verified; solves of the flight: "
        f"median {statistics.median(flight):g}, 95 % {most}; of the plan: median {statistics.median(every):g}, "
        f"95 % {all_most}; CPU time {sum(row['cpu_s'] for row in rows):.0f} s, "
        f"median {statistics.median(row['cpu_s'] for row in rows):.1f} s"
    )


def main() -> None:
    """Plan the maps, or compare two records."""
    serve(planned)
    args = options(__doc__, maps=25, first=0, seed=1, jobs=1, against=None, json=None)
    if args.against is not None:
        records = [json.loads(Path(file).read_text(encoding="utf-8")) for file in (args.against, args.json)]
        print("\n".join(compared(*records)))
        return
    numbers = range(args.first, args.first + args.maps)
    rows = []
    with ThreadPoolExecutor(args.jobs) as pool:
        for row in pool.map(lambda number: apart(__file__, number, args.seed), numbers):
            rows.append(row)
            print(row, flush=True)
    finish("hard maps", rows, args.json)
    print(summary(rows))


if __name__ == "__main__":
    main()
