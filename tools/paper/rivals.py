"""§4.3: the same six vehicles planned by particle swarm optimisation (PSO), beside ours (Figs. 21 and 22).

Knows: what both are asked and how they compare. Does not know: how either plans.
"""

from __future__ import annotations

import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np

import gcs
from gcs.plan.ocp.problem import flight_problem
from gcs.plan.search.homotopy_classes import best_class
from gcs.plan.trajectory.energy import drag_energy_J
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.si import NED_FROM_UP, heading_ref_deg
from tools.bench.describe import alone
from tools.paper import swarm, swarm_fleet, views
from tools.paper.claims import Claim, beside, kept, table
from tools.paper.run import CORES, ROOT, Run
from tools.paper.speed_model import path_limits
from tools.paper.swarm_fleet import Fleet
from tools.paper.track import Track

TITLE = "Particle swarm optimisation (§4.3, Figs. 21 and 22)"
SEEDS, SHORT_SEEDS, SHORT_S = 5, 1, 0.2
_COURSE_MPS = 0.5
_NAMES = {"ours": "ours", "equal": "PSO, stopped at our time", "converged": "PSO, converged"}
_ROWS = (
    ("plan one vehicle", "one_s", "{:.2f} s"),
    ("plan six", "six_s", "{:.2f} s"),
    ("six of ours fit into it", "six_ratio", "{:.1f}"),
    ("vehicles with a feasible plan by the search", "feasible", "{:.0f} of 6"),
    ("arrival off the time asked for, worst vehicle", "late_s", "{:.3g} s"),
    ("arrival of the first and of the last vehicle apart", "spread_s", "{:.3g} s"),
    ("course at the arrival off the heading asked for", "course_off_deg", "{:.0f}°"),
    ("yaw at the arrival off the heading asked for", "yaw_off_deg", "{:.2g}°"),
    ("speed at t = 0 off the one asked for", "start_off_mps", "{:.2g} m/s"),
    ("energy of all six, Eq. 32", "energy_J", "{:.0f} J"),
    ("the same ways at the constant speed that arrives on time", "slowed_J", "{:.0f} J"),
    ("clearance over the exact ground", "clearance_m", "{:.2f} m"),
    ("separation of any two at any time", "separation_m", "{:.2f} m"),
)
_INFORMATION = {
    "place over time": "yes",
    "speed": "one along the path, from a model beside the search",
    "attitude and rates": "no",
    "controls U1..U4": "no",
    "arrival at a time asked for": "no",
    "heading asked for at the end": "no",
}


def measure(run: Run) -> dict[str, Any]:
    """Ours and theirs, seed by seed, taking turns."""
    scenario = gcs.load_scenario(ROOT / "missions" / "simulation2")
    seeds = SHORT_SEEDS if run.short else SEEDS
    plan = run.plan("simulation2")
    ours, equal, converged = [], [], []
    if run.short:
        fleet = swarm_fleet.plan(scenario, 1, SHORT_S)
        ended = [(SHORT_S, SHORT_S * len(plan.sysids), fleet, fleet)]
    else:
        with ProcessPoolExecutor(CORES, get_context("spawn")) as pool:
            ended = list(pool.map(_turn, range(1, seeds + 1), [scenario] * seeds))
    for one_s, six_s, at_once, until_still in ended:
        ours.append(_our_row(run, plan, one_s, six_s))
        equal.append(_row(at_once, scenario, six_s))
        converged.append(_row(until_still, scenario, six_s))
    rows = {"ours": _medians(ours), "equal": _medians(equal), "converged": _medians(converged)}
    track, limits = Track(plan), path_limits(scenario)
    _draw(run, scenario, until_still, track)
    return {
        "seeds": seeds,
        "particles": swarm.PARTICLES,
        "points": swarm.POINTS,
        "level_mps": limits.level_mps,
        "vertical_mps": limits.vertical_mps,
        "accel_mps2": limits.turning_mps2,
        "still_generations": swarm.STILL_GENERATIONS,
        "still_percent": 100.0 * swarm.STILL,
        "rows": rows,
        "every_seed": {"ours": ours, "equal": equal, "converged": converged},
        "claims": kept(_claims(rows, [fleet for *_, fleet in ended], track), "C"),
    }


def page(record: dict[str, Any]) -> list[str]:
    """The table, what each tells, the figures."""
    rows = record["rows"]
    lines = [
        f"The data of Simulation 2. A swarm of {record['particles']} particles (pymoo, constriction factors) looks for "
        f"the fastest path through {record['points']} points beside the straight line and their heights, with "
        "clearance, ceiling, box, turning radius and the tracks planned before as constraints; one particle begins on "
        "the straight way. Vehicles are planned one after another.",
        "",
        "A path is flown at one speed along it, the largest that these limits allow: "
        f"{record['level_mps']:g} m/s over ground and {record['vertical_mps']:g} m/s up or down, so that every axis "
        f"keeps its limit in any direction; {record['accel_mps2']:.2g} m/s² for turning and as much for changes of "
        "speed (together Eq. 18); the speeds of Eqs. 15 and 16 at the ends. With a limit of its own for every axis, "
        "the slowest axis alone would decide, and nearly all paths would take the same time.",
        "",
        f"It has converged when {record['still_generations']} generations gain less than "
        f"{record['still_percent']:g} %; at "
        f"equal time each vehicle has a sixth of what ours takes for all. Medians of {record['seeds']} seeds, one run, "
        "one machine; seconds are the processor's, one thread each, so that others on the machine do not count.",
        "",
        "| | " + " | ".join(_NAMES.values()) + " |",
        "| --- | ---: | ---: | ---: |",
    ]
    for label, key, form in _ROWS:
        cells = [form.format(rows[who][key]) if rows[who][key] is not None else "none" for who in _NAMES]
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    lines += ["", "| what each yields | ours | PSO |", "| --- | --- | --- |"]
    lines += [f"| {what} | yes | {theirs} |" for what, theirs in _INFORMATION.items()]
    lines += [
        "",
        "PSO plans meet the places and speeds of Eqs. 15 and 16, but no direction. Slowed to a constant speed, they "
        "arrive on time as well, which the paper does not try. They have no attitude and no controls in "
        "either case.",
        "",
    ]
    lines += beside("paper/fig21.png", 21, "the tracks of PSO in 3D", record["claims"])
    lines += beside("paper/fig22.png", 22, "the tracks of PSO from above, our leader dashed", record["claims"])
    return [*lines, *table(record["claims"])]


def _turn(seed: int, scenario: Scenario) -> tuple[float, float, Fleet, Fleet]:
    """Our times for one and for all vehicles; PSO with the same time, and PSO until it converges."""
    one_s, six_s = (_own_time_s(s) for s in (alone(scenario), scenario))
    at_once = swarm_fleet.plan(scenario, seed, six_s / len(scenario.formation.sysids))
    return one_s, six_s, at_once, swarm_fleet.plan(scenario, seed)


def _own_time_s(scenario: Scenario) -> float:
    """Processor time from the scenario to the flight."""
    began = time.process_time()
    best_class(flight_problem(scenario), lambda _: None)
    return time.process_time() - began


def _our_row(run: Run, plan: Plan, one_s: float, six_s: float) -> dict[str, Any]:
    track, report = Track(plan), run.report("simulation2")
    energy = float(drag_energy_J(plan).sum())
    asked = heading_ref_deg(plan.scenario)
    return {
        "one_s": one_s,
        "six_s": six_s,
        "six_ratio": 1.0,
        "feasible": len(plan.sysids) if report.ok else 0,
        "late_s": abs(plan.phase("mission").end_s - plan.flight_s),
        "spread_s": 0.0,
        "course_off_deg": swarm_fleet.turn_deg(float(track.course_deg[track.speed_mps > _COURSE_MPS][-1]), asked),
        "yaw_off_deg": swarm_fleet.turn_deg(float(track.yaw_deg[-1]), asked),
        "start_off_mps": float(
            np.linalg.norm(track.velocity_ned_mps[0] - np.array(plan.scenario.start.velocity_mps) * NED_FROM_UP)
        ),
        "energy_J": energy,
        "slowed_J": energy,
        "clearance_m": float(track.clearance_m.min()),
        "separation_m": report.separation_min_m,
    }


def _row(fleet: Fleet, scenario: Scenario, our_six_s: float) -> dict[str, Any]:
    arrivals = [f.arrival_s for f in fleet.found]
    first = fleet.tracks_m[0]
    asked = heading_ref_deg(scenario)
    velocity = (first[1] - first[0]) / swarm_fleet.GRID_S
    six_s = sum(f.seconds for f in fleet.found)
    return {
        "one_s": fleet.found[0].seconds,
        "six_s": six_s,
        "six_ratio": six_s / our_six_s,
        "feasible": sum(f.feasible for f in fleet.found),
        "late_s": max(abs(a - scenario.time.flight_s) for a in arrivals),
        "spread_s": max(arrivals) - min(arrivals),
        "course_off_deg": max(swarm_fleet.turn_deg(swarm_fleet.course_deg(t), asked) for t in fleet.tracks_m),
        "yaw_off_deg": None,
        "start_off_mps": float(np.linalg.norm(velocity - np.array(scenario.start.velocity_mps))),
        "energy_J": swarm_fleet.energy_J(fleet),
        "slowed_J": swarm_fleet.energy_J(fleet, scenario.time.flight_s),
        "clearance_m": swarm_fleet.clearance_m(fleet),
        "separation_m": swarm_fleet.separation_m(fleet),
    }


def _medians(rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        key: None if rows[0][key] is None else float(statistics.median(row[key] for row in rows)) for key in rows[0]
    }


def _claims(rows: dict[str, dict[str, Any]], fleets: list[Fleet], track: Track) -> list[Claim]:
    ours, theirs = rows["ours"], rows["converged"]
    north = track.states[:, 0]
    aside = [
        float(np.abs(np.interp(t[:, 0], north, track.states[:, 1]) - t[:, 1]).mean())
        for f in fleets
        for t in f.tracks_m
    ]
    return [
        _claim(
            "the way of PSO, its heading changed between the peaks, is close to that of Simulation 2",
            "their tracks are {least:.0f} to {most:.0f} m beside ours on average; median {median:.0f} m",
            {"least": min(aside), "most": max(aside), "median": float(np.median(aside))},
            float(np.median(aside)) < 50.0,
            "each vehicle finds a way of its own; some choose another side of the mountains",
            "the median of all vehicles and seeds",
        ),
        _claim(
            "PSO plans one vehicle faster than our method plans the formation",
            "{one:.2f} s against {six:.2f} s",
            {"one": theirs["one_s"], "six": ours["six_s"]},
            theirs["one_s"] < ours["six_s"],
            "how long PSO takes depends on when it counts as converged",
        ),
        _claim(
            "for all six it takes longer than our method",
            "{theirs:.1f} s against {ours:.2f} s",
            {"theirs": theirs["six_s"], "ours": ours["six_s"]},
            theirs["six_s"] > ours["six_s"],
            "one search for each vehicle against one for the formation",
        ),
        _claim(
            "PSO can neither require a final direction",
            "its course at the arrival is {off:.0f}° off the heading asked for, at the worst",
            {"off": theirs["course_off_deg"]},
            theirs["course_off_deg"] > 5.0,
            "nothing in its path knows of a heading; ours meets it with its yaw, not with its course",
        ),
        _claim(
            "nor arrive at a given time",
            "{late:.0f} s off at the worst; ours {ours:.2g} s",
            {"late": theirs["late_s"], "ours": ours["late_s"]},
            theirs["late_s"] > 1.0,
            "the shortest time is what it looks for",
        ),
    ]


def _claim(says: str, measured: str, numbers: dict[str, float], holds: bool, why: str, read: str = "") -> Claim:
    return Claim("§4.3", (21, 22), says, measured, numbers, holds, why, read)


def _draw(run: Run, scenario: Scenario, fleet: Fleet, track: Track) -> None:
    last = max(len(t) for t in fleet.tracks_m)
    index = np.arange(0, last, 5)
    tracks = np.stack([t[np.minimum(index, len(t) - 1)] for t in fleet.tracks_m]) * NED_FROM_UP
    sysids = scenario.formation.sysids
    t_s = np.asarray(index * swarm_fleet.GRID_S)
    views.in_space(run, scenario, sysids, t_s, tracks, "fig21.png")
    views.from_above(run, scenario, sysids, t_s, tracks, "fig22.png", track.states[:, :3])
