"""The page: sections write their measurements to paper.json, which fills docs/paper.md and the README."""

import json
import re
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache, reduce
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import numpy as np
import typer

import gcs
from gcs.plan.ocp.problem import flight_problem
from gcs.plan.search.homotopy_classes import best_class
from gcs.plan.trajectory.energy import drag_energy_J
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import NED_FROM_UP, heading_ref_deg
from gcs.util.atomic_write import atomic_write
from tools.bench.describe import alone
from tools.paper import figures, peers, sentences, swarm, unstated
from tools.paper.peers import ROOT
from tools.paper.track import Track

DOCS = ROOT / "docs"
DOCUMENTS = (DOCS / "paper.md", ROOT / "README.md")
CORES, SEEDS = 2, 5  # of PSO; processes at a time: their own seconds are what counts
FLIGHTS = {"1": "constant", "t²": "squared", "1/(tf-t+0.5)": "scenario", "1/(tf-t+0.5)²": "inverse_square"}
WEIGHTS = tuple(f"terminal_weighting/{name}.toml" for name in FLIGHTS.values())
SIMULATIONS = ("simulation1", "simulation2")
NUMBERS = (
    {"tracks": 8, "formation": 11, "attitude": 10, "thrust": 12, "moments": 13, "velocity": 14},
    {"tracks": 15, "attitude": 17, "velocity": 18, "thrust": 19, "moments": 20},
)
BENT_DEG, COURSE_MPS = 5.0, 0.5
MARK = re.compile(
    r"(?P<number>-?\d+(?:\.(?P<decimals>\d+))?)?(?P<mark><!-- paper: (?P<key>[\w.]+) -->)(?(number)|\n.*?<!-- end -->)",
    re.DOTALL,
)


@cache
def plan_of(mission: str) -> Plan:
    """The plan of missions/`mission`."""
    return gcs.make_plan(gcs.load_scenario(ROOT / "missions" / mission))


def judged(plans: dict[str, Plan]) -> dict[str, Any]:
    """The sentences of §2.5.3 on four flights, or those of §4.1 and §4.2 on two."""
    one, *others = map(Track, plans.values())
    groups = {"W": (one, *others)} if len(plans) == len(WEIGHTS) else {"A": (one,), "B": (one, *others)}
    return {name: found for group, of in groups.items() for name, found in sentences.judge(group, *of).items()}


def weighting(pictures: Path) -> dict[str, Any]:
    """Figs. 6 and 7."""
    plans = {mission: plan_of(mission) for mission in WEIGHTS}
    changed = {m: unstated.with_value(plan.scenario, unstated.HEADING_SCALE, BENT_DEG) for m, plan in plans.items()}
    bent = [Track(gcs.make_plan(scenario)) for scenario in changed.values()]
    figures.weights(dict(zip(FLIGHTS, map(Track, plans.values()), strict=True)), bent, BENT_DEG, pictures)
    return {"found": judged(plans), "varied": unstated.vary(plans, judged)}


def simulations(pictures: Path) -> dict[str, Any]:
    """Figs. 8 to 20."""
    plans = {name: plan_of(name) for name in SIMULATIONS}
    for plan, numbers in zip(plans.values(), NUMBERS, strict=True):
        figures.simulation(Track(plan), numbers, pictures)
    return {"found": judged(plans), "varied": unstated.vary(plans, judged)}


def readings(_: Path) -> dict[str, Any]:
    """Simulations 1 and 2 with the limits of U2 and U3 read as forces (f1, f2) and as moments (m1, m2)."""
    columns: dict[str, Any] = {}
    for number, name in enumerate(SIMULATIONS, start=1):
        moments = unstated.with_value(plan_of(name).scenario, "limits.roll_pitch_force_N", unstated.MOMENTS)
        tracks = {"f": Track(plan_of(name)), "m": Track(gcs.make_plan(moments))}
        apart = np.subtract(*(t.states[:, :3] for t in tracks.values()))
        for reading, t in tracks.items():
            u2, u3, _ = 100.0 * np.abs(t.controls[:, 1:]).max(axis=0) / t.torque
            columns[f"{reading}{number}"] = {
                "turn_radps2": t.plan.quadrotor.arm_m * t.torque[0] / t.plan.quadrotor.inertia_kgm2[0],
                "pitch_rate_degps": float(np.degrees(np.abs(t.states[:, 10]).max())),
                "roll_deg": float(np.abs(t.roll_deg).max()),
                "u2_share": float(u2),
                "u3_share": float(u3),
                "energy_J": float(drag_energy_J(t.plan)[t.plan.leader]),
                "apart_m": float(np.linalg.norm(apart, axis=1).max()),
            }
    return columns


def swarms(pictures: Path, seeds: int = SEEDS, generations: int = swarm.MOST_GENERATIONS) -> dict[str, Any]:
    """Simulation 2 by PSO beside ours, seed by seed; Figs. 21 and 22."""
    track = Track(plan_of("simulation2"))
    scenario, asked = track.plan.scenario, heading_ref_deg(track.plan.scenario)
    with ProcessPoolExecutor(CORES, get_context("spawn")) as pool:
        turns = [*pool.map(turn, range(1, seeds + 1), [scenario] * seeds, [generations] * seeds)]
    same = {
        "feasible": len(track.plan.sysids) if track.report.ok else 0,
        "late_s": abs(track.plan.phase("mission").end_s - track.end_s),
        "course_off_deg": swarm.turn_deg(track.course_deg[track.speed_mps > COURSE_MPS][-1], asked),
        "yaw_off_deg": swarm.turn_deg(track.yaw_deg[-1], asked),
        "slowed_J": float(drag_energy_J(track.plan).sum()),
        "clearance_m": float(track.clearance_m.min()),
        "separation_m": track.report.separation_min_m,
    }
    every_seed: dict[str, list[dict[str, Any]]] = {
        "ours": [{"one_s": one_s, "six_s": six_s, "six_ratio": 1.0} | same for one_s, six_s, _ in turns],
        "converged": [(r := swarm.row(f, scenario)) | {"six_ratio": r["six_s"] / six_s} for _, six_s, f in turns],
    }
    rows = {who: {k: float(median(r[k] for r in of)) for k in of[0]} for who, of in every_seed.items()}
    tracks = [f.track_m for *_, fleet in turns for f in fleet]
    aside_m = [float(np.abs(np.interp(t[:, 0], *track.states[:, :2].T) - t[:, 1]).mean()) for t in tracks]
    drawn = swarm.together(turns[-1][2])[:, ::5] * NED_FROM_UP
    t_s = np.arange(drawn.shape[1]) * 5 * swarm.GRID_S
    figures.over_ground(scenario, t_s, drawn, 21, pictures, track.states[:, :3])
    found = sentences.judge("C", rows["ours"], rows["converged"], aside_m)
    return {"seeds": seeds, "rows": rows, "every_seed": every_seed, "found": found}


def turn(seed: int, scenario: Scenario, generations: int) -> tuple[float, float, list[swarm.Found]]:
    """Our times for one and for all vehicles, and PSO until it converges."""
    took_s = []
    for task in (alone(scenario), scenario):
        began = time.process_time()
        best_class(flight_problem(task), lambda _: None)
        took_s.append(time.process_time() - began)
    return took_s[0], took_s[1], swarm.fleet(scenario, seed, generations)


SECTIONS: dict[str, Callable[[Path], Any]] = {f.__name__: f for f in (weighting, simulations, readings, swarms)}


def shown(record: dict[str, Any]) -> dict[str, Any]:
    """A record with its tables, and the records of docs/bench: what the marks of the documents lead to."""
    of = {name: dict(section) for name, section in record.items()}
    for section in of.values():
        section["measured"] = (
            f"<sub>Measured {peers.about_line(section['about'])}; took {section['took_s']:.0f} s</sub>"
        )
        if found := section.get("found"):
            varied = section.get("varied")
            decides = [unstated.column(varied, n) if varied else "not varied" for n in range(len(found))]
            rows = (sentences.TABLE[name].row(one, by) for (name, one), by in zip(found.items(), decides, strict=True))
            beside = "".join(_beside(number, found) for number in figures.CAPTIONS)
            section["table"] = "\n".join((beside + sentences.HEAD, *rows, "", section["measured"]))
    of["simulations"]["values"] = "\n".join((unstated.HEAD, *map(unstated.summary, record["simulations"]["varied"])))
    return of | peers.shown()


def _beside(number: int, found: dict[str, Any]) -> str:
    """A figure and what the paper says of it, side by side."""
    of = [(sentences.TABLE[name], one) for name, one in found.items()]
    said = [f"{s.id}: {s.says} – {s.verdict(one)}" for s, one in of if str(number) in s.figures.split(", ")]
    head = f"Fig. {number}: {figures.CAPTIONS[number]}"
    cells = f"| ![{head}](paper/fig{number:02d}.png) | {'<br>'.join(said)} |"
    return f"| {head} | what the paper says of it |\n| --- | --- |\n{cells}\n\n" if said else ""


def updated(text: str, of: dict[str, Any]) -> str:
    """The text with every marked number, `1.27<!-- paper: scale.ratio.time -->`, and table, up to `<!-- end -->`.

    A number keeps the decimals that it is written with. Raises KeyError for a mark that leads nowhere.
    """

    def anew(match: re.Match[str]) -> str:
        value = reduce(lambda found, key: found[key], match["key"].split("."), of)
        if match["number"] is None:
            return f"{match['mark']}\n\n{value}\n\n<!-- end -->"
        return f"{float(value):.{len(match['decimals'] or '')}f}{match['mark']}"  # type: ignore[arg-type]

    return MARK.sub(anew, text)


def main(
    section: Annotated[list[str] | None, typer.Option(help=f"Only these of {', '.join(SECTIONS)}.")] = None,
    benchmark: Annotated[list[str] | None, typer.Option(help=f"Run these of {', '.join(peers.BENCHMARKS)}.")] = None,
    render: Annotated[bool, typer.Option("--render", help="Measure nothing, print the records again.")] = False,
) -> None:
    """Measure, draw, and write docs/paper.md, its record and figures, and the marked numbers of the README."""
    file = DOCS / "paper.json"
    record: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    for name in benchmark or ():
        peers.refresh(name)
    for name in section or ([] if render or benchmark else SECTIONS):
        print(f"section {name}", flush=True)
        machine, began = peers.about(), time.perf_counter()
        measured = SECTIONS[name](DOCS / "paper")
        record[name] = {"about": machine, "took_s": time.perf_counter() - began, **measured}
        atomic_write(file, json.dumps(record, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    of = shown(record)
    for document in DOCUMENTS:
        atomic_write(document, updated(document.read_text(encoding="utf-8"), of))
