"""Flown against planned: emulated flights in wind, by stream, mission and following, many seeds each.

./tools/run python tools/bench_flights.py [--seeds 20] [--mission simulation1 simulation2 field]
    [--mode stream mission follow] [--together 2] [--json FILE]

Each flight is `gcs.fly` in a process of its own: sensor noise, gusts and clocks by its seed, wind as in WIND. Position
errors compare true and planned places at equal time, from T0 to the planned arrival; times are arrivals. The table
has the mean over the flights, the 95th percentile and the worst. Missions fly as `--nav auto` does.
`--together` flights fly at a time; each wants a core.
"""

import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import gcs
from tools.bench.frame import ROOT, apart, finish, options, serve

WIND = {"simulation1": ("1@270", "0.3"), "simulation2": ("1@270", "0.3"), "field": ("3@270", "light")}
MODES = ("stream", "mission", "follow")
# Name in the table: key of the record, whether large values are the bad ones.
FIGURES = {
    "position RMS, m": ("rms_m", True),
    "position at most, m": ("worst_m", True),
    "shape, m": ("shape_m", True),
    "arrival time, s": ("arrival_s", True),
    "separation, m": ("separation_m", False),
    "clearance, m": ("clearance_m", False),
}


def fly_one(plan_file: Path | str, mode: str, seed: int, folder: Path | str) -> dict[str, Any]:
    """One flight in this process, or why it ended early."""
    plan, _ = gcs.load_plan(plan_file)
    wind, gusts = WIND[plan.scenario.name]
    emulated = gcs.Emulated(speedup="max", seed=seed, wind=wind, gusts=gusts)
    record: dict[str, Any] = {"mission": plan.scenario.name, "mode": mode, "seed": seed, "wind": wind, "gusts": gusts}
    try:
        by = "mission" if mode == "mission" else "stream"
        flown = gcs.fly(plan, mode=by, follow=mode == "follow", emulated=emulated, to=folder)
    except gcs.GcsError as error:
        return record | {"ended": str(error.message)}
    assert flown.verdict is not None
    judged: dict[str, float] = {c.name: c.value for c in flown.verdict.criteria}
    return record | {
        "held": flown.verdict.ok,
        "rms_m": max(flown.verdict.rms_m.values()),
        "worst_m": max(flown.verdict.max_m.values()),
        "shape_m": flown.verdict.formation_error_m,
        "arrival_s": judged["arrival time"],
        "separation_m": judged["separation"],
        "clearance_m": judged["clearance above ground"],
    }


def summary(records: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row per mission and mode: mean, 95th percentile towards the bad side, and worst of every figure."""
    rows = []
    for mission in dict.fromkeys(r["mission"] for r in records):
        for mode in dict.fromkeys(r["mode"] for r in records):
            flights = [r for r in records if (r["mission"], r["mode"]) == (mission, mode)]
            ended = [r for r in flights if "ended" in r]
            done = [r for r in flights if "ended" not in r]
            row: dict[str, Any] = {
                "mission": mission,
                "mode": mode,
                "flights": len(flights),
                "held": sum(r["held"] for r in done),
                "ended": [r["ended"] for r in ended],
            }
            for key, large_is_bad in FIGURES.values():
                values = np.array([r[key] for r in done], dtype=np.float64)
                if len(values):
                    bad = np.percentile(values, 95 if large_is_bad else 5)
                    worst = values.max() if large_is_bad else values.min()
                    row[key] = [float(values.mean()), float(bad), float(worst)]
            rows.append(row)
    return rows


def run(missions: list[str], modes: list[str], seeds: int, together: int) -> list[dict[str, Any]]:
    """All flights, so many at a time."""
    with tempfile.TemporaryDirectory() as name:
        orders = []
        for mission in missions:
            plan = gcs.make_plan(gcs.load_scenario(ROOT / "missions" / mission))
            file = Path(name) / f"{mission}.skein"
            gcs.save_plan(plan, gcs.verify(plan), file)
            orders += [
                (str(file), mode, seed, f"{name}/{mission}-{mode}-{seed}") for mode in modes for seed in range(seeds)
            ]
        with ThreadPoolExecutor(together) as pool:
            return list(pool.map(lambda order: apart(__file__, *order), orders))


def main() -> None:
    """Fly what was asked for."""
    serve(fly_one)
    asked = options(__doc__, seeds=20, mission=list(WIND), mode=list(MODES), together=2, json=None)
    records = run(asked.mission, asked.mode, asked.seeds, asked.together)
    rows = summary(records)
    shown = [row | {"ended": len(row["ended"])} for row in rows]
    finish("flights, each figure as mean / 95 % / worst", shown, asked.json, {"flights": records, "rows": rows})


if __name__ == "__main__":
    main()
