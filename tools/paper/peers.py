"""Benchmarks against peers: how each is run, its record in docs/bench, and its tables on the page."""

import json
import math
import os
import platform
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gcs.util.atomic_write import atomic_write
from tools.bench_flights import FIGURES, MODES, summary

Rows = Iterator[str]  # of a table, the first is its head
ROOT = Path(__file__).resolve().parents[2]
BENCH = ROOT / "docs" / "bench"


def about() -> dict[str, Any]:
    """Version, machine and date of a run, and how busy the machine was when it began."""
    names = re.findall(r"^model name\s*: (.+)$", Path("/proc/cpuinfo").read_text(encoding="utf-8"), re.M)
    return {
        "date": f"{datetime.now().astimezone():%Y-%m-%d %H:%M %Z}",
        "versions": {name: version(name) for name in ("skein-gcs", "casadi", "numpy", "scipy")},
        "python": platform.python_version(),
        "system": platform.system(),
        "processor": names[0] if names else platform.processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2),
        "peers": {name: version(name) for name in ("mavsdk", "pymavlink")},
    }


def about_line(about: dict[str, Any]) -> str:
    """The same for people."""
    versions = ", ".join(f"{name} {number}" for name, number in about["versions"].items())
    peers = "".join(f"; {name} {number}" for name, number in about.get("peers", {}).items())
    return (
        f"{about['date']}; {versions}; Python {about['python']}; {about['system']}, {about['processor']}, "
        f"{about['cores']} cores, load {about['load']:g} when it began{peers}"
    )


_FRONT = (  # mesh, contender, and its name in the README
    ("15 uniform x 4", "skein, Eq. 41", "Skein"),
    ("15 uniform x 4", "yapss-lg", "yapss"),
    ("15 uniform x 4", "mpopt", "mpopt"),
    ("15 uniform x 4", "rockit", "rockit"),
    ("15 uniform x 4", "pycollo", "pycollo"),
    ("15 uniform x 4", "maptor", "maptor"),
    ("own mesh", "skein, refined", "Skein, refined until verified"),
)


def _planner(found: Any) -> Rows:
    yield "ratio | measured | asked | "
    for goal in found["goals"]:
        asked = f"{'at least' if goal['at_least'] else 'at most'} {goal['bound']:g}"
        yield f"{goal['name']} | {goal['value']:.3g} | {asked} | {'met' if goal['met'] else 'missed'}"


def _solvers(found: Any) -> Rows:
    yield "mesh | solver | over yapss | cold | verified between its nodes"
    cold_s = {(r["mesh"], r["contender"]): [run["cold_s"] for run in r["runs"]] for r in found["records"]}
    for r in found["records"]:
        own_s, yapss_s = cold_s[r["mesh"], r["contender"]], cold_s.get((r["mesh"], "yapss-lg"))
        ratio = f"{statistics.median(own_s) / statistics.median(yapss_s):.2f}" if own_s and yapss_s else ""
        measured = f"{ratio} | {statistics.median(own_s):.3f} s" if own_s else f" | {r['failure']}"
        verified = {True: "yes", False: "no", None: ""}[(r["findings"] or {}).get("verified")]
        yield f"{r['mesh']} | {r['contender']} | {measured} | {verified}"


def _front(found: Any) -> Rows:
    """The README's table: how long each solver takes to its first solution, and which is verified."""
    yield "solver | first solution, on 15 intervals of 4 points | verified between its nodes"
    for mesh, contender, name in _FRONT:
        (r,) = (r for r in found["records"] if (r["mesh"], r["contender"]) == (mesh, contender))
        verified = {True: "yes", False: "no"}[r["findings"]["verified"]]
        yield f"{name} | {statistics.median(run['cold_s'] for run in r['runs']):.2f} s | {verified}"


def _table(rows: Rows) -> list[str]:
    head, *others = rows
    return [f"| {head} |", "|" + " --- |" * len(head.split(" | ")), *(f"| {row} |" for row in others)]


def _replan(found: Any) -> Rows:
    yield "mission | median, of the first plan | p95 | verified | no way left | median"
    for name, record in found.items():
        first_s, done = statistics.median(record["cold_s"]), record["replans"]
        seconds = sorted(o["seconds"] for o in done if o["kind"] == "verified")
        middle_s, most_s = statistics.median(seconds), seconds[min(len(seconds) - 1, int(0.95 * len(seconds)))]
        counts = f"{len(seconds)} of {len(done)} | {sum(o['kind'] == 'infeasible' for o in done)}"
        yield f"{name} | {middle_s / first_s:.2f} | {most_s / first_s:.2f} | {counts} | {middle_s:.2f} s"


def _scale(found: Any) -> Rows:
    yield "vehicles | time × | memory × | verifier × | planning | memory | verified"
    least, keys = found["medians"][0], ("plan_s", "memory_mb", "verify_s")
    for row in found["medians"]:
        ratios = " | ".join(f"{row[key] / least[key]:.2f}" for key in keys)
        verified = "yes" if row["verified"] else "**no**"
        yield f"{row['vehicles']:.0f} | {ratios} | {row['plan_s']:.2f} s | {row['memory_mb']:.0f} MB | {verified}"


def _flights(found: Any) -> Rows:
    """Mean, tail and worst of each figure; a vehicle that never arrives is infinitely late."""
    names = (f"{name}: mean / {'95' if large else '5'} % / worst" for name, (_, large) in FIGURES.items())
    yield " | ".join(["mission", "mode", "wind", "held", *names])
    winds = {f["mission"]: f"{f['wind']}, gusts {f['gusts']}" for f in found["flights"]}
    for row in summary(found["flights"]):
        values = (row.get(key, ()) for key, _ in FIGURES.values())
        cells = (" / ".join(f"{v:.2f}" if math.isfinite(v) else "never" for v in three) or "none" for three in values)
        held = f"{row['held']} of {row['flights']}"
        yield " | ".join([row["mission"], row["mode"], winds[row["mission"]], held, *cells])


# What it measures, how it is run, and tables of what no other document shows.
BENCHMARKS: dict[str, tuple[str, str, tuple[Callable[[Any], Rows], ...]]] = {
    "planner": ("one vehicle's plan beside other solvers", "--repetitions 3", (_planner, _solvers)),
    "replan": ("plans that change in flight", "--replans 50", (_replan,)),
    "scale": ("large formations, and the verifier", "--repeat 3", (_scale,)),
    "prove": ("[trajectories of any planner, proved](proving.md)", "", ()),
    "route": ("[drawn routes](planner.md)", "--points 2 5 20 50 100 --repeat 1", ()),
    "legs": ("[a drawn route beside other solvers](planner.md)", "--repetitions 3", ()),
    "upload": ("[uploads over bad links](links.md), beside MAVSDK", "--uploads 20", ()),
    "bridge": ("[emulated vehicles](sim_bridge.md)", "--seconds 3", ()),
    "graph": ("[who listens to whom](flying.md#who-listens-to-whom)", "", ()),
    "flights": ("flights in wind", f"--seeds 20 --mode {' '.join(MODES)}", (_flights,)),
}


def load(name: str) -> Any:
    """The record of a benchmark, with its versions, machine and date."""
    return json.loads((BENCH / f"{name}.json").read_text(encoding="utf-8"))


def refresh(name: str) -> None:
    """Run a benchmark and keep its record."""
    options, machine, began = BENCHMARKS[name][1].split(), about(), time.perf_counter()
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "out.json"
        command = [sys.executable, f"tools/bench_{name}.py", *options, "--json", str(out)]
        subprocess.run(command, cwd=ROOT, check=False)  # it fails where a goal is missed
        record = json.loads(out.read_text(encoding="utf-8"))
    kept = {"about": machine, "took_s": time.perf_counter() - began, "options": options, "record": record}
    atomic_write(BENCH / f"{name}.json", json.dumps(kept, indent=1) + "\n")


def tables(name: str) -> str:
    """What was recorded, and on which machine."""
    kept, lines = load(name), list[str]()
    for rows in BENCHMARKS[name][2]:
        lines += [*_table(rows(kept["record"])), ""]
    return "\n".join([*lines, f"<sub>{about_line(kept['about'])}; took {kept['took_s']:.0f} s</sub>"])


def shown() -> dict[str, Any]:
    """Tables of all benchmarks, and the ratios that the README has: re-plans over first plans, the largest over six."""
    commands = (
        f"| {what} | `tools/bench_{' '.join([f'{name}.py', *options.split()])}` "
        f"| [{load(name)['about']['date'][:10]}](bench/{name}.json) |"
        for name, (what, options, _) in BENCHMARKS.items()
    )
    replans = {
        name: statistics.median(o["seconds"] for o in found["replans"] if o["kind"] == "verified")
        / statistics.median(found["cold_s"])
        for name, found in load("replan")["record"].items()
    }
    least, *_, most = load("scale")["record"]["medians"]
    ratio = {name: most[key] / least[key] for name, key in (("time", "plan_s"), ("memory", "memory_mb"))}
    flown = [f for f in load("flights")["record"]["flights"] if f["mission"] != "field" and f["mode"] != "mission"]
    figures = {
        "replan": replans,
        "flown": {
            "flights": len(flown),
            "held": sum(f["held"] for f in flown),
            "worst_m": max(f["worst_m"] for f in flown),
        },
    }
    index = "\n".join(("| what | command | when |", "| --- | --- | --- |", *commands))
    page = {name: tables(name) for name in BENCHMARKS} | {"index": index, "figures": figures}
    page["front"] = "\n".join(_table(_front(load("planner")["record"])))
    return {"peers": page, "scale": {"ratio": {"vehicles": most["vehicles"], **ratio}}}
