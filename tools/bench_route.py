"""How long does a drawn route take to plan? 2 to 100 points over Simulation 1's mountains, against A to B.

./tools/run python tools/bench_route.py [--points 2 5 20 50 100] [--repeat 3] [--json FILE]
./tools/run python tools/bench_route.py --random 100 [--seed 1] [--jobs 2] [--json FILE]

Six vehicles of the mission fly along points that were drawn once, a fixed seed for each number: a random walk of legs
of 60 to 160 m that turns by at most 110 degrees, 8 to 14 m above the higher end's ground, at 3.5 m/s on average. Each
row is the median of `--repeat` runs in processes of their own: CPU time of the plan and of its verification, solves,
iterations, and the largest memory of the process.

`--random` plans random routes of 5 to 30 points among mountains and no-fly zones, verifies them and counts; each
failure is an `Infeasible` that names a leg and a number, or it is reported as a fault.
"""

from __future__ import annotations

import argparse
import json
import re
import resource
import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from gcs import load_scenario, make_plan, verify
from gcs.errors import GcsError, Infeasible
from gcs.physics.quadrotor import Array
from gcs.plan.trajectory.plan import MeshRound
from gcs.scenario.environment.no_fly import outside_m
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Boundary, NoFlyZone, RoutePoint, Scenario

ROOT = Path(__file__).resolve().parent.parent
MISSION = ROOT / "missions" / "simulation1"
LEG_M, TURN_RAD, HEIGHT_M = (60.0, 160.0), np.radians(110.0), (8.0, 14.0)
SPEED_MPS = 3.5
LAND_M = 2.0  # above the ground at the end, as in the mission
ROOM_M = 40.0  # between points and the edge of the map
LOW_M = 12.0  # ground under a point: room for a climb below the ceiling
BESIDE_M = 25.0  # between points and zones
ZONES, ZONE_M = 4, (15.0, 45.0)
GOAL_20, GOAL_SHARE = 4.0, 0.98
_TRIES = 2000


@dataclass(frozen=True)
class Row:
    """One planned route."""

    points: int
    verified: bool
    plan_s: float  # CPU time
    verify_s: float
    solves: int
    iterations: int
    memory_MB: float
    words: str = ""


def drawn(points: int, seed: int, zones: int = 0) -> Scenario:
    """Simulation 1 with so many route points between its start and an end beside the last of them."""
    base = load_scenario(MISSION)
    if not points:
        return base
    rng = np.random.default_rng([seed, points])
    closed = tuple(_zone(base, rng) for _ in range(zones))
    places = _walk(base, points + 1, closed, rng)
    length_m = float(np.linalg.norm(np.diff(np.vstack([base.start.position_m, places[:, :3]]), axis=0), axis=1).sum())
    places[-1, 2] += LAND_M - places[-1, 3]
    *route, end = [tuple(np.round(place, 1).tolist()) for place in places[:, :3]]
    time_table = base.time.model_copy(update={"flight_s": float(np.ceil(length_m / SPEED_MPS))})
    return base.model_copy(
        update={
            "route": tuple(RoutePoint(position_m=place) for place in route),
            "end": Boundary(position_m=end, roll_pitch_yaw_deg=base.end.roll_pitch_yaw_deg),
            "time": time_table,
            "no_fly": closed,
        }
    )


def _zone(base: Scenario, rng: np.random.Generator) -> NoFlyZone:
    north_m, east_m = rng.uniform(200.0, 1300.0, 2)
    return NoFlyZone(north_m=float(north_m), east_m=float(east_m), radius_m=float(rng.uniform(*ZONE_M)))


def _walk(base: Scenario, count: int, zones: tuple[NoFlyZone, ...], rng: np.random.Generator) -> Array:
    """Places (count, 4) of a walk from the start over low ground: north, east, height, and that over the ground."""
    place, course = np.array(base.start.position_m[:2]), np.pi / 4.0
    found: list[list[float]] = []
    for _ in range(_TRIES * count):
        if len(found) == count:
            break
        turned = course + rng.uniform(-TURN_RAD, TURN_RAD)
        ahead = place + rng.uniform(*LEG_M) * np.array([np.cos(turned), np.sin(turned)])
        inside = all(low + ROOM_M < at < high - ROOM_M for at, (low, high) in zip(ahead, _box(base), strict=True))
        ground_m = float(ground_height_m(base.terrain, ahead[:1], ahead[1:])[0])
        if not inside or ground_m > LOW_M or not _is_free(zones, ahead):
            course += rng.uniform(-0.3, 0.3)  # out of a corner in the end
            continue
        place, course = ahead, turned
        over_m = float(rng.uniform(*HEIGHT_M))
        found.append([*ahead.tolist(), ground_m + over_m, over_m])
    return np.array(found)


def _box(base: Scenario) -> tuple[tuple[float, float], tuple[float, float]]:
    return base.limits.north_m, base.limits.east_m


def _is_free(zones: tuple[NoFlyZone, ...], place: Array) -> bool:
    north, east = place[:1], place[1:]
    return all(float(outside_m(zone, np.zeros(1), north, east)[0]) > BESIDE_M for zone in zones)


def planned(task: tuple[int, int, int]) -> Row:
    """The row of one route: (points, seed, zones)."""
    points, seed, zones = task
    scenario = drawn(points, seed, zones)
    rounds: list[MeshRound] = []
    began = time.process_time()
    words, ok, verify_s = "", False, 0.0
    try:
        plan = make_plan(scenario, rounds.append)
        plan_s = time.process_time() - began
        report = verify(plan)
        verify_s = time.process_time() - began - plan_s
        ok = report.ok
        words = "" if ok else "; ".join(str(check) for check in report.checks if not check.ok)
    except GcsError as failure:
        plan_s = time.process_time() - began
        words = f"{type(failure).__name__}: {failure.message}"
        if isinstance(failure, Infeasible) and not re.search(r"leg \d+.*\d", failure.message):
            words = f"names no leg: {words}"
    memory_MB = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    iterations = sum(done.iterations for done in rounds)
    return Row(points, ok, plan_s, verify_s, len(rounds), iterations, memory_MB, words)


def _apart(tasks: list[tuple[int, int, int]], jobs: int) -> list[Row]:
    """Rows of tasks, each in a fresh process, for its memory."""
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        return list(pool.map(planned, tasks))


def _growth(args: argparse.Namespace) -> list[Row]:
    rows = []
    print("points  verified  plan CPU s  x A to B  verify CPU s  solves  iterations  memory MB", flush=True)
    for points in [0, *args.points]:
        runs = _apart([(points, args.seed, 0)] * args.repeat, 1)
        row = sorted(runs, key=lambda run: run.plan_s)[len(runs) // 2]
        rows.append(row)
        name = f"{points:6}" if points else "A to B"
        verdict = "yes" if row.verified else "NO"
        ratio = row.plan_s / rows[0].plan_s
        print(
            f"{name}  {verdict:>8}  {row.plan_s:10.2f}  {ratio:8.2f}  {row.verify_s:12.2f}  {row.solves:6}"
            f"  {row.iterations:10}  {row.memory_MB:9.0f}  {row.words}",
            flush=True,
        )
    by_points = {row.points: row.plan_s for row in rows}
    if 20 in by_points:
        print(f"20 points: {by_points[20] / by_points[0]:.2f} x A to B (goal: at most {GOAL_20:g})")
    return rows


def _random(args: argparse.Namespace) -> list[Row]:
    rng = np.random.default_rng(args.seed)
    tasks = [
        (int(rng.integers(5, 31)), args.seed * 1000 + n, int(rng.integers(0, ZONES + 1))) for n in range(args.random)
    ]
    rows = []
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        for number, row in enumerate(pool.map(planned, tasks)):
            rows.append(row)
            verdict = "verified" if row.verified else f"FAILED {row.words}"
            print(f"{number:4}: {row.points:2} points, {row.plan_s:6.1f} s, {row.solves} solves: {verdict}", flush=True)
    share = sum(row.verified for row in rows) / len(rows)
    median_s = statistics.median(row.plan_s for row in rows)
    print(
        f"verified: {100.0 * share:.1f} % of {len(rows)} (goal: {100.0 * GOAL_SHARE:g} %); median {median_s:.1f} s CPU"
    )
    return rows


def main() -> None:
    """Plan the routes that the command line asks for, and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, nargs="+", default=[2, 5, 20, 50, 100])
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--random", type=int, default=0, help="plan so many random routes instead")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    rows = _random(args) if args.random else _growth(args)
    if args.json:
        args.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))


if __name__ == "__main__":
    main()
