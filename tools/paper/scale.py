"""Planning time and memory against the number of vehicles, for three ways to plan a formation.

Knows: sizes, limits, and when to stop. Does not know: how any of them plans.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from matplotlib.figure import Figure

from tools.bench.describe import leader_problem, uniform
from tools.bench.frame import ONE_THREAD
from tools.bench_scale import SPACING_M
from tools.paper.drawing import save
from tools.paper.run import CORES, ROOT, Run
from tools.pictures.scenery import LIMIT, colour

TITLE = "Scale: planning against the number of vehicles"
NAMES = {
    "rigid": "virtual rigid body (ours)",
    "swarms": "PSO, one vehicle after another",
    "together": "an optimal control problem each, in one program",
}
SIZES = {
    "rigid": (6, 50, 200, 1000),
    "swarms": (1, 2, 6, 12, 25, 50, 100),
    "together": (1, 2, 3, 4, 6),
}
REPEAT = {"rigid": 3, "swarms": 1, "together": 1}
LIMITS_S = {"rigid": 20.0, "swarms": 20.0, "together": 90.0}  # the program of six should be seen
SHORT_LIMIT_S = 0.5
_SHORT = {"rigid": (6,), "swarms": (1,), "together": ()}
_TIMEOUT_FACTOR = 20.0  # times the limit, which is the processor's: the machine may be busy


def measure(run: Run) -> dict[str, Any]:
    """Sizes grow until one takes longer than the limit."""
    mesh = uniform(leader_problem())
    curves: dict[str, list[dict[str, Any]]] = {way: [] for way in NAMES}
    stops: dict[str, dict[str, float]] = {}

    def grow(way: str, sizes: tuple[int, ...]) -> None:
        limit_s = SHORT_LIMIT_S if run.short else LIMITS_S[way]
        for vehicles in sizes:
            run.log(f"{NAMES[way]}: {vehicles}")
            runs = [_once(way, vehicles, limit_s) for _ in range(1 if run.short else REPEAT[way])]
            if any(r is None or not r["done"] for r in runs):
                stops[way] = {"vehicles": vehicles, "limit_s": limit_s}
                return
            curves[way].append(_median([r for r in runs if r is not None]))
            run.log(f"{NAMES[way]}: {curves[way][-1]}")

    jobs = dict(_SHORT if run.short else SIZES)
    grow("rigid", jobs.pop("rigid"))  # alone: its ratio is the claim, and two runs at a time slow each other
    with ThreadPoolExecutor(CORES) as pool:
        for ended in [pool.submit(grow, *job) for job in jobs.items()]:
            ended.result()
    save(_draw(curves, stops), run, "scale.png")
    first, last = (next(p for p in curves["rigid"] if p["vehicles"] == n) for n in _span(curves["rigid"]))
    return {
        "spacing_m": SPACING_M,
        "mesh": {"intervals": mesh.intervals, "degree": mesh.degrees[0]},
        "curves": curves,
        "stops": stops,
        "ratio": {
            "vehicles": last["vehicles"],
            "time": last["seconds"] / first["seconds"],
            "memory": last["memory_mb"] / first["memory_mb"],
        },
    }


def page(record: dict[str, Any]) -> list[str]:
    """The picture of the central claim, and its numbers."""
    ratio = record["ratio"]
    lines = [
        f"Simulation 1's flight for a square grid with {record['spacing_m']:g} m between neighbours. The virtual rigid "
        "body is planned with refinement until no limit is violated between the nodes. The program of separate "
        f"problems is solved once on {record['mesh']['intervals']} intervals of degree {record['mesh']['degree']} and "
        "not looked at between them, with the separation of every pair at every node; PSO is that of §4.3 above. "
        "Each run is a process of its own with one thread; seconds are the processor's.",
        "",
        f"**{ratio['vehicles']:.0f} vehicles take {ratio['time']:.2f} times the time of six and {ratio['memory']:.2f} "
        "times the memory.**",
        "",
        "![planning time and memory against the number of vehicles](paper/scale.png)",
        "",
        "| way | " + " | ".join(["vehicles", "time", "memory"]) + " |",
        "| --- | ---: | ---: | ---: |",
    ]
    for way, curve in record["curves"].items():
        for point in curve:
            lines.append(
                f"| {NAMES[way]} | {point['vehicles']:.0f} | {point['seconds']:.2f} s | {point['memory_mb']:.0f} MB |"
            )
        if stop := record["stops"].get(way):
            lines.append(
                f"| {NAMES[way]} | {stop['vehicles']:.0f} | no plan after {stop['limit_s']:g} s; stopped here | |"
            )
    return lines


def _span(curve: list[dict[str, Any]]) -> tuple[int, int]:
    """Six, and the largest."""
    sizes = [point["vehicles"] for point in curve]
    return 6, max(sizes)


def _once(way: str, vehicles: int, limit_s: float) -> dict[str, Any] | None:
    """None where it was not ready in time."""
    command = [sys.executable, "-m", "tools.paper.scale_one", way, str(vehicles), str(limit_s)]
    most_s = None if way == "rigid" else _TIMEOUT_FACTOR * max(limit_s, 10.0)
    try:
        done = subprocess.run(
            command, cwd=ROOT, env=os.environ | ONE_THREAD, capture_output=True, text=True, check=True, timeout=most_s
        )
    except subprocess.TimeoutExpired:
        return None
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def _median(runs: list[dict[str, Any]]) -> dict[str, Any]:
    return {key: statistics.median(r[key] for r in runs) for key in ("vehicles", "seconds", "memory_mb")}


def _draw(curves: dict[str, list[dict[str, Any]]], stops: dict[str, dict[str, float]]) -> Figure:
    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    panels = figure.subplots(1, 2)
    for axes, key, name in zip(
        panels, ("seconds", "memory_mb"), ("planning time, s of one core", "memory, MB"), strict=True
    ):
        for row, (way, curve) in enumerate(curves.items()):
            sizes = [point["vehicles"] for point in curve]
            axes.plot(sizes, [point[key] for point in curve], "o-", color=colour(row), label=NAMES[way], ms=4)
            if way in stops and key == "seconds":
                stop = stops[way]
                axes.plot(stop["vehicles"], stop["limit_s"], "x", color=colour(row), ms=9, mew=2)
        if key == "seconds":
            if stops:
                axes.plot([], [], "x", color=LIMIT, ms=9, mew=2, label="stopped: no plan by then")
            figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncol=4, fontsize=7)
        axes.set(xlabel="vehicles", ylabel=name, xscale="log")
        if key == "seconds":
            axes.set_yscale("log")
        else:
            axes.set_ylim(bottom=0.0)
        axes.grid(alpha=0.3, which="both")
    return figure
