"""Benchmark of drawn routes: 2 to 100 points over Simulation 1's mountains, against A to B.

./tools/run python tools/bench_route.py [--points 2 5 20 50 100] [--repeat 3] [--json FILE]
./tools/run python tools/bench_route.py --random 100 [--seed 1] [--jobs 2] [--json FILE]

Six vehicles of the mission fly along points that were drawn once, a fixed seed for each number: a random walk of legs
of 60 to 160 m that turns by at most 110 degrees, 8 to 14 m above the higher end's ground, at 3.5 m/s on average. Each
row is the median of `--repeat` runs in processes of their own: CPU time of the plan and of its verification, solves,
iterations, and the largest memory of the process.

`--random` plans random routes of 5 to 30 points among mountains and no-fly zones, verifies them and counts; each
failure is an `Infeasible` that names a leg and a number, or it is reported as a fault.
"""

import re
import statistics
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gcs import load_scenario, make_plan, verify
from gcs.errors import GcsError, Infeasible
from gcs.plan.trajectory.plan import MeshRound
from gcs.scenario.environment.no_fly import outside_m
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Boundary, NoFlyZone, RoutePoint, Scenario
from gcs.types import Array
from tools.bench.frame import ROOT, apart, finish, options, serve
from tools.bench.memory import peak_mb

MISSION = ROOT / "missions" / "simulation1"
LEG_M, TURN_RAD, HEIGHT_M = (60.0, 160.0), np.radians(110.0), (8.0, 14.0)
SPEED_MPS = 3.5
LAND_M = 2.0  # above the ground at the end, as in the mission
ROOM_M = 40.0  # between points and the edge of the map
LOW_M = 12.0  # ground under a point: room for a climb below the ceiling
BESIDE_M = 25.0  # between points and zones
ZONES, ZONE_M = 4, (15.0, 45.0)
GOAL_SHARE = 0.98
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
    box = base.limits.north_m, base.limits.east_m
    found: list[list[float]] = []
    for _ in range(_TRIES * count):
        if len(found) == count:
            break
        turned = course + rng.uniform(-TURN_RAD, TURN_RAD)
        ahead = place + rng.uniform(*LEG_M) * np.array([np.cos(turned), np.sin(turned)])
        inside = all(low + ROOM_M < at < high - ROOM_M for at, (low, high) in zip(ahead, box, strict=True))
        free = all(float(outside_m(zone, np.zeros(1), ahead[:1], ahead[1:])[0]) > BESIDE_M for zone in zones)
        ground_m = float(ground_height_m(base.terrain, ahead[:1], ahead[1:])[0])
        if not inside or ground_m > LOW_M or not free:
            course += rng.uniform(-0.3, 0.3)  # out of a corner in the end
            continue
        place, course = ahead, turned
        over_m = float(rng.uniform(*HEIGHT_M))
        found.append([*ahead.tolist(), ground_m + over_m, over_m])
    return np.array(found)


def planned(points: int, seed: int, zones: int) -> dict[str, Any]:
    """The row of one route."""
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
    iterations = sum(done.iterations for done in rounds)
    return asdict(Row(points, ok, plan_s, verify_s, len(rounds), iterations, peak_mb(), words))


def growth(numbers: list[int], seed: int, repeat: int) -> list[Row]:
    """A to B, then so many points: of each the run of the median time."""
    rows = []
    for points in [0, *numbers]:
        runs = sorted((Row(**apart(__file__, points, seed, 0)) for _ in range(repeat)), key=lambda run: run.plan_s)
        rows.append(runs[len(runs) // 2])
        print(f"{points} points: {rows[-1].plan_s / rows[0].plan_s:.2f} x A to B", flush=True)
    return rows


def at_random(count: int, seed: int, jobs: int) -> list[Row]:
    """Routes of 5 to 30 points among zones."""
    rng = np.random.default_rng(seed)
    tasks = [(int(rng.integers(5, 31)), seed * 1000 + n, int(rng.integers(0, ZONES + 1))) for n in range(count)]
    with ThreadPoolExecutor(jobs) as pool:
        rows = [Row(**found) for found in pool.map(lambda task: apart(__file__, *task), tasks)]
    share = sum(row.verified for row in rows) / len(rows)
    median_s = statistics.median(row.plan_s for row in rows)
    print(f"verified: {share:.1%} of {len(rows)} (wanted: {GOAL_SHARE:.0%}); median {median_s:.1f} s CPU")
    return rows


def main() -> None:
    """Plan the routes that the command line asks for, and print a row for each."""
    serve(planned)
    args = options(__doc__, points=[2, 5, 20, 50, 100], repeat=3, random=0, seed=1, jobs=2, json=None)
    rows = at_random(args.random, args.seed, args.jobs) if args.random else growth(args.points, args.seed, args.repeat)
    finish("routes planned and verified, CPU seconds", [asdict(row) for row in rows], args.json)


if __name__ == "__main__":
    main()
