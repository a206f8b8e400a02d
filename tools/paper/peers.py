"""Benchmarks beside their peers, from the records in docs/bench that `--benchmarks` makes anew.

Knows: how each benchmark is run, and which tables its record becomes. Does not know: what it measures.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gcs.files import atomic_write
from tools.paper.peer_tables import (
    Table,
    bridge,
    first_share,
    legs,
    maps,
    planner,
    planner_times,
    replan,
    route,
    scale,
    upload,
)
from tools.paper.run import DOCS, ROOT, Log, Run, about, about_line

TITLE = "Benchmarks and peers"
FOLDER = "bench"
PEERS = ("mavsdk", "pymavlink")

TABLES: dict[str, tuple[str, tuple[str, ...], tuple[Callable[[Any], Table], ...]]] = {
    "planner": (
        "One vehicle's plan beside other solvers",
        ("--repetitions", "3"),
        (planner, planner_times),
    ),
    "scale": ("Large formations", ("--repeat", "3"), (scale,)),
    "replan": ("Plans that change in flight", ("--replans", "50"), (replan,)),
    "maps": ("Random maps", ("--maps", "30"), (maps,)),
    "route": ("Drawn routes", ("--points", "2", "5", "20", "50", "100", "--repeat", "1"), (route,)),
    "legs": ("A drawn route beside other solvers", ("--repetitions", "3"), (legs,)),
    "upload": (
        "Uploads over bad links",
        ("--uploads", "20"),
        (upload,),
    ),
    "bridge": ("Emulated vehicles", ("--seconds", "3"), (bridge,)),
}
ALL = (*TABLES, "flights")  # whose table is a section of its own


def load(name: str) -> dict[str, Any] | None:
    """The record of a benchmark, with its versions, machine and date."""
    file = DOCS / FOLDER / f"{name}.json"
    kept: dict[str, Any] | None = json.loads(file.read_text(encoding="utf-8")) if file.exists() else None
    return kept


def refresh(names: list[str], flights: tuple[str, ...], log: Log = print) -> None:
    """Run benchmarks one after another and keep their records; `flights` are the options of that one."""
    folder = DOCS / FOLDER
    folder.mkdir(exist_ok=True)
    for name in names:
        options = TABLES[name][1] if name in TABLES else flights
        log(f"benchmark {name}")
        machine = about() | {"peers": {peer: version(peer) for peer in PEERS}}
        began = time.perf_counter()
        with tempfile.TemporaryDirectory() as scratch:
            out = Path(scratch) / "out.json"
            command = [sys.executable, f"tools/bench_{name}.py", *options, "--json", str(out)]
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
            if not out.exists():
                log(f"benchmark {name} has no record: {done.stderr.strip()[-500:]}")
                continue
            record = json.loads(out.read_text(encoding="utf-8"))
        kept = {"about": machine, "took_s": time.perf_counter() - began, "options": list(options), "record": record}
        atomic_write(folder / f"{name}.json", json.dumps(kept, indent=1) + "\n")


def measure(run: Run) -> dict[str, Any]:
    """What was recorded, as tables; the record of the page keeps them, so that it can be printed alone."""
    benchmarks = {}
    for name, (title, _, makers) in TABLES.items():
        kept = load(name)
        if kept is None:
            run.log(f"no record of benchmark {name}: make one with --benchmarks")
            continue
        tables = [maker(kept["record"]) for maker in makers]
        benchmarks[name] = {
            "title": title,
            "command": " ".join(["tools/bench_" + name + ".py", *kept["options"]]),
            "about": kept["about"],
            "took_s": kept["took_s"],
            "tables": [table for table in tables if len(table) > 1],
        }
    return {"benchmarks": benchmarks, "figures": _figures()}


def _figures() -> dict[str, Any]:
    """Numbers that the README tells."""
    kept = load("replan")
    return {} if kept is None else {"replan": {name: first_share(found) for name, found in kept["record"].items()}}


def page(record: dict[str, Any]) -> list[str]:
    """A heading and tables for each."""
    lines = [
        "Each benchmark is a program of its own (`tools/bench_*.py`); `tools/paper.py --benchmarks all` runs them and "
        "keeps their records in `docs/bench`. Ratios come before times: times belong to the machine.",
    ]
    if not record["benchmarks"]:
        return [*lines, "", "None is recorded yet."]
    for name, benchmark in record["benchmarks"].items():
        lines += ["", f"### {benchmark['title']}", "", f"`{benchmark['command']}` ([record](bench/{name}.json))"]
        for table in benchmark["tables"]:
            lines += ["", _row(table[0]), _row(["---"] * len(table[0])), *map(_row, table[1:])]
        peers = ", ".join(f"{peer} {number}" for peer, number in benchmark["about"]["peers"].items())
        lines += ["", f"<sub>{about_line(benchmark['about'])}; {peers}; took {benchmark['took_s']:.0f} s.</sub>"]
    return lines


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"
