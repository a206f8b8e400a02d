"""How often does the planner find its way? Random maps, planned, verified and counted.

./tools/run python tools/bench_maps.py [--maps 200] [--seed 1] [--jobs 2] [--json FILE]

Each map: 5 to 25 mountains up to 60 m, 0 to 6 no-fly disks, a ceiling between 12 and 35 m, six vehicles from a random
place to another at least 500 m away, with time for 2.5 to 3.5 m/s along the straight line. Maps without a way under
the ceiling are found by the route search and counted apart. Beside it: the share a straight-line guess would reach.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

import gcs
from gcs.errors import GcsError, Infeasible
from gcs.plan.nlp.mesh_refinement import optimise
from gcs.plan.ocp.problem import flight_problem
from gcs.plan.search.initial_guess import along, straight_route
from gcs.plan.search.routes import find_routes, survey
from gcs.scenario.environment.no_fly import outside_m
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Mountains, NoFlyZone, Scenario, Terrain
from tools.bench.frame import ROOT, show

SIDE_M = 1500.0
HEIGHT_M = 3.0  # of start and end
ROOM_M = 20.0  # between the ends and the edge of the map
FLAT_M = 1.36  # ground no higher than the ripple: an end may stand there


@dataclass(frozen=True)
class Outcome:
    """What became of one map."""

    number: int
    kind: str  # verified, no way, infeasible, failed
    seconds: float
    words: str
    straight: bool  # whether the straight-line guess alone leads to a plan that holds between its nodes


def random_map(number: int, seed: int) -> Scenario:
    """Map `number` of the series `seed`: Simulation 1's vehicles and formation in another world."""
    rng = np.random.default_rng([seed, number])
    base = gcs.load_scenario(ROOT / "missions" / "simulation1")
    while True:
        peaks, disks = int(rng.integers(5, 26)), int(rng.integers(0, 7))
        mountains = Mountains(
            north_m=tuple(rng.uniform(0, SIDE_M, peaks)),
            east_m=tuple(rng.uniform(0, SIDE_M, peaks)),
            height_m=tuple(rng.uniform(10, 60, peaks)),
            spread_north_m=tuple(rng.uniform(20, 100, peaks)),
            spread_east_m=tuple(rng.uniform(20, 100, peaks)),
        )
        terrain = Terrain(ripple=base.terrain.ripple, mountains=mountains)
        no_fly = tuple(
            NoFlyZone(north_m=n, east_m=e, radius_m=r)
            for n, e, r in zip(
                rng.uniform(100, 1400, disks), rng.uniform(100, 1400, disks), rng.uniform(20, 150, disks), strict=True
            )
        )
        start, end = rng.uniform(ROOM_M, SIDE_M - ROOM_M, (2, 2))
        distance = float(np.linalg.norm(end - start))
        if distance >= 500.0 and all(_open(p, terrain, no_fly) for p in (start, end)):
            break
    ceiling_m, speed_mps = float(rng.uniform(12, 35)), float(rng.uniform(2.5, 3.5))
    course_deg = float(np.degrees(np.arctan2(end[1] - start[1], end[0] - start[0])))
    data = base.model_dump(mode="json")
    old_start = np.array(data["start"]["position_m"])
    data["name"] = f"map{number}"
    data["limits"] |= {"height_m": [0.0, ceiling_m], "roll_pitch_yaw_deg": [180.0, 60.0, 360.0]}
    data["terrain"], data["no_fly"] = terrain.model_dump(mode="json"), [d.model_dump(mode="json") for d in no_fly]
    for key, place in (("start", start), ("end", end)):
        position = [*place.tolist(), HEIGHT_M]
        data[key] = {"position_m": position, "velocity_mps": [0.0] * 3, "roll_pitch_yaw_deg": [0.0, 0.0, course_deg]}
    data["objective"]["heading_ref_deg"] = course_deg
    data["time"]["flight_s"] = distance / speed_mps + 20.0
    for vehicle in data["formation"]["vehicle"]:
        moved = np.array(vehicle["position_m"]) - old_start + data["start"]["position_m"]
        vehicle["position_m"] = moved.tolist()
    return Scenario.model_validate(data)


def _open(place: np.ndarray, terrain: Terrain, no_fly: tuple[NoFlyZone, ...]) -> bool:
    """Flat ground around a place, and no zone near."""
    north, east = np.meshgrid(place[0] + np.array([-3.0, 0.0, 3.0]), place[1] + np.array([-3.0, 0.0, 3.0]))
    flat = float(ground_height_m(terrain, north, east).max()) < FLAT_M
    return flat and all(outside_m(zone, np.array(0.0), place[0], place[1]) > 10.0 for zone in no_fly)


def attempt(number: int, seed: int) -> Outcome:
    """Plan and verify one map."""
    scenario = random_map(number, seed)
    problem = flight_problem(scenario)
    began = time.perf_counter()
    try:
        find_routes(problem, survey(problem))
    except Infeasible as no_way:
        return Outcome(number, "no way", time.perf_counter() - began, no_way.message, False)
    began = time.perf_counter()
    try:
        report = gcs.verify(gcs.make_plan(scenario))
        kind, words = ("verified", "") if report.ok else ("failed", str(report.failures[0]))
    except Infeasible as failure:
        kind, words = "infeasible", failure.message
    except GcsError as failure:
        kind, words = "failed", failure.message
    seconds = time.perf_counter() - began
    try:
        optimise(problem, along(problem, straight_route(problem)))
        straight = True
    except GcsError:
        straight = False
    return Outcome(number, kind, seconds, words, straight)


def main() -> None:
    """Run the series and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maps", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with ProcessPoolExecutor(options.jobs) as pool:
        outcomes = list(pool.map(attempt, range(options.maps), [options.seed] * options.maps))
    rows = [asdict(outcome) for outcome in outcomes]
    show("random maps", rows)
    possible = [o for o in outcomes if o.kind != "no way"]
    verified = [o.seconds for o in possible if o.kind == "verified"]
    print(f"verified: {len(verified)} of {len(possible)} with a way under their ceiling")
    print(f"straight-line guess: {sum(o.straight for o in possible)} of {len(possible)}")
    print(f"time to a verified plan: median {statistics.median(verified):.1f} s, worst {max(verified):.1f} s")
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
