"""Benchmark of re-planning: re-plans from disturbed states, counted, timed and verified.

./tools/run python tools/bench_replan.py [--replans 100] [--seed 1] [--missions simulation1,field] [--json FILE]

Each re-plan: a random time of the mission, the leader up to 20 m beside its place and some tenths of a m/s off; every
second one with a new disk of 10 to 30 m on the way ahead. States that no flight may begin from (inside a
zone, under the clearance, over a limit) are drawn again. The first plan is made again between re-plans for
comparison, so that other load slows both; seconds are CPU seconds.
"""

import statistics
import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import gcs
from gcs.errors import GcsError, Infeasible
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.ocp.margins import box, clearance, height, no_fly, state_limits
from gcs.plan.replanning.replanner import LEAST_S
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import outside_m
from gcs.scenario.schema.scenario import NoFlyZone
from gcs.types import Array
from tools.bench.frame import ROOT, finish, options

ASIDE_M, BELOW_M, SPEED_MPS = 20.0, 3.0, 0.2
RADII_M = (10.0, 30.0)
AHEAD_S, LEFT_S = 20.0, 30.0  # a disk stands so far ahead at least, and so far from the end
EVERY = 10  # re-plans after which the first plan is made again
GOAL = 0.15


@dataclass(frozen=True)
class Outcome:
    """What became of one re-plan."""

    t_s: float
    zone: bool
    kind: str  # verified, infeasible, failed
    seconds: float
    verify_s: float
    iterations: int
    words: str


def disturbed(plan: Plan, rng: np.random.Generator, *, zone: bool) -> tuple[float, Array, tuple[NoFlyZone, ...]]:
    """A time, a state that a flight may begin from, and zones it may begin outside of."""
    mission = plan.phase("mission")
    while True:
        t_s = float(rng.uniform(mission.start_s, mission.end_s - max(LEAST_S, (AHEAD_S + LEFT_S) if zone else LEFT_S)))
        state = np.array(plan.leader_trajectory.state(t_s))
        bearing, away = rng.uniform(0.0, 2.0 * np.pi), ASIDE_M * np.sqrt(rng.uniform())
        state[POSITION] += [away * np.cos(bearing), away * np.sin(bearing), rng.uniform(-BELOW_M, BELOW_M)]
        state[VELOCITY] += rng.normal(0.0, SPEED_MPS, 3)
        zones: tuple[NoFlyZone, ...] = ()
        if zone:
            centre = plan.leader_trajectory.state(rng.uniform(t_s + AHEAD_S, mission.end_s - LEFT_S))[:2]
            zones = (NoFlyZone(north_m=centre[0], east_m=centre[1], radius_m=float(rng.uniform(*RADII_M))),)
        if _may_begin(plan, t_s, state, zones):
            return t_s, state, zones


def _may_begin(plan: Plan, t_s: float, state: Array, zones: tuple[NoFlyZone, ...]) -> bool:
    scenario = plan.scenario
    places = state[POSITION] + plan.offsets(np.array([t_s]))
    found = [*state_limits(scenario, state[None, None]), *box(scenario, places), height(scenario, places)]
    found += [clearance(scenario, places), *no_fly(scenario, places, np.array([t_s]))]
    margins = [*(m.value for m in found), *(outside_m(z, np.array(t_s), places[..., 0], places[..., 1]) for z in zones)]
    return all(float(value.min()) >= 0.0 for value in margins)


def measure(name: str, count: int, seed: int) -> tuple[list[Outcome], list[float], float]:
    """Re-plan one mission; outcomes, times of the first plan, and the time to build."""
    scenario = gcs.load_scenario(ROOT / "missions" / name)
    cold: list[float] = []

    def make() -> Plan:
        began = time.process_time()
        plan = gcs.make_plan(scenario)
        cold.append(time.process_time() - began)
        return plan

    plan = make()
    began = time.process_time()
    replanner = gcs.Replanner(plan)
    build_s = time.process_time() - began
    rng = np.random.default_rng(seed)
    outcomes: list[Outcome] = []
    for number in range(count):
        t_s, state, zones = disturbed(plan, rng, zone=number % 2 == 1)
        outcomes.append(_attempt(replanner, t_s, state, zones))
        if number % EVERY == EVERY - 1:
            make()
    return outcomes, cold, build_s


def _attempt(replanner: gcs.Replanner, t_s: float, state: Array, zones: tuple[NoFlyZone, ...]) -> Outcome:
    began = time.process_time()
    try:
        plan = replanner.replan(state, t_s, zones)
    except GcsError as failure:
        kind = "infeasible" if isinstance(failure, Infeasible) else "failed"
        return Outcome(t_s, bool(zones), kind, time.process_time() - began, 0.0, 0, failure.message)
    seconds = time.process_time() - began
    report = gcs.verify(plan)
    verify_s = time.process_time() - began - seconds
    words = "" if report.ok else str(report.failures[0])
    iterations = sum(done.iterations for done in plan.mesh_history)
    return Outcome(t_s, bool(zones), "verified" if report.ok else "failed", seconds, verify_s, iterations, words)


def main() -> None:
    """Run the series and print the ratios."""
    asked = options(__doc__, replans=100, seed=1, missions="simulation1,field", json=None)
    written, rows = {}, []
    for name in asked.missions.split(","):
        outcomes, cold, build_s = measure(name, asked.replans, asked.seed)
        for words, zones in (("no new zone", (False,)), ("a new zone", (True,)), ("all", (False, True))):
            chosen = [o for o in outcomes if o.zone in zones]
            counts = summary(chosen, statistics.median(cold))
            rows.append({"mission": name, "zone": words, **counts})
        for outcome in outcomes:
            if outcome.kind != "verified":
                print(f"{outcome.kind} at {outcome.t_s:.1f} s after {outcome.seconds:.2f} s: {outcome.words}")
        written[name] = {"cold_s": cold, "build_s": build_s, "replans": [asdict(o) for o in outcomes]}
    finish(f"re-plans; wanted: a median of at most {GOAL:g} of the first plan", rows, asked.json, written)


def summary(chosen: list[Outcome], first_s: float) -> dict[str, Any]:
    """Counts, and times over that of the first plan."""
    seconds = np.array([o.seconds for o in chosen if o.kind == "verified"])
    median_s, most_s = np.quantile(seconds, (0.5, 0.95)) if len(seconds) else (np.nan, np.nan)
    return {
        "re-plans": len(chosen),
        "verified": len(seconds),
        "infeasible": sum(o.kind == "infeasible" for o in chosen),
        "median s": median_s,
        "of first": median_s / first_s,
        "p95 of first": most_s / first_s,
    }


if __name__ == "__main__":
    main()
