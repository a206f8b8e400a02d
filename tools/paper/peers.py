"""Benchmarks beside their peers, from the records in docs/bench that `--benchmarks` makes anew.

Knows: how each benchmark is run, and how its record becomes a table, ratios first. Does not know: what it measures.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gcs.files import atomic_write
from tools.paper.run import DOCS, ROOT, Log, Run, about, about_line

TITLE = "Benchmarks and peers"
FOLDER = "bench"
PEERS = ("mavsdk", "pymavlink")
Table = list[list[str]]


def planner(found: Any) -> Table:
    """Goals, then every solver's times over the first peer's."""
    rows = [["ratio", "measured", "asked", ""]]
    for goal in found["goals"]:
        sign = "at least" if goal["at_least"] else "at most"
        rows.append(
            [goal["name"], f"{goal['value']:.3g}", f"{sign} {goal['bound']:g}", "met" if goal["met"] else "missed"]
        )
    return rows


def planner_times(found: Any) -> Table:
    """Every solver on every mesh."""
    rows = [["mesh", "solver", "over yapss", "cold", "verified between its nodes"]]
    for record in found["records"]:
        first = next(
            (r for r in found["records"] if r["contender"].startswith("yapss") and r["mesh"] == record["mesh"]), None
        )
        if not record["runs"]:
            rows.append([record["mesh"], record["contender"], "", record["failure"], ""])
            continue
        cold = _middle(record)
        ratio = f"{cold / _middle(first):.2f}" if first is not None and first["runs"] else ""
        verified = (record["findings"] or {}).get("verified")
        rows.append(
            [
                record["mesh"],
                record["contender"],
                ratio,
                f"{cold:.3f} s",
                {True: "yes", False: "no", None: ""}[verified],
            ]
        )
    return rows


def scale(found: Any) -> Table:
    """Over the smallest formation."""
    rows = [["vehicles", "time ×", "memory ×", "verifier ×", "planning", "memory", "verified"]]
    least = found["medians"][0]
    for row in found["medians"]:
        ratios = [f"{row[key] / least[key]:.2f}" for key in ("plan_s", "memory_mb", "verify_s")]
        absolute = [f"{row['plan_s']:.2f} s", f"{row['memory_mb']:.0f} MB", "yes" if row["verified"] else "**no**"]
        rows.append([f"{row['vehicles']:.0f}", *ratios, *absolute])
    return rows


def export(found: Any) -> Table:
    """Each format for the largest fleet over the smallest."""
    least, most = found["medians"][0], found["medians"][-1]
    rows = [
        [
            "format",
            f"{most['vehicles']} vehicles over {least['vehicles']}",
            f"{least['vehicles']}",
            f"{most['vehicles']}",
        ]
    ]
    for name, cell in most["formats"].items():
        small = least["formats"][name]["seconds"]
        rows.append([name, f"{cell['seconds'] / small:.1f}", f"{small:.2f} s", f"{cell['seconds']:.2f} s"])
    return rows


def readers(found: Any) -> Table:
    """Reading missions, over the fastest reader."""
    most = found["medians"][-1]
    fastest = min(most["readers"].values())
    rows = [["reader", "over the fastest", f"all {most['vehicles']} missions"]]
    return rows + [[name, f"{s / fastest:.1f}", f"{s:.3f} s"] for name, s in most["readers"].items()]


def bridge(found: Any) -> Table:
    """Emulated vehicles on one core."""
    rows = [["vehicles", "times real time", "steps/s", "messages/s"]]
    return rows + [
        [f"{r['vehicles']}", f"{r['times_real_time']:.2f}", f"{r['steps_per_s']:.0f}", f"{r['messages_per_s']:.0f}"]
        for r in found
    ]


def stream(found: Any) -> Table:
    """Punctuality of setpoints, in parts of a period."""
    rows = [
        ["case", "interval p99, of a period", "interval p50 / p99 / max", "late p50 / p99 / max", "CPU of one core"]
    ]
    for r in found:
        spread = [
            " / ".join(f"{r[f'{what}_{word}_ms']:.2f}" for word in ("p50", "p99", "max")) + " ms"
            if f"{what}_p50_ms" in r
            else "no deadlines"
            for what in ("interval", "late")
        ]
        rows.append([r["case"], f"{r['interval_p99_ms'] * r['rate_hz'] / 1e3:.3f}", *spread, f"{100 * r['cpu']:.0f} %"])
    return rows


def upload(found: Any) -> Table:
    """Deliveries on a fake clock."""
    rows = [
        ["autopilot", "sent as", "round trip", "loss", "over the floor", "sent", "read back equal", "errors", "wrong"]
    ]
    for r in found["cells"]:
        over = "" if r["of_floor"] is None else f"{r['of_floor']:.2f}"
        absolute = (f"{r['sent_s']:.2f} s", f"{r['held_s']:.2f} s", f"{r['errors']}", f"{r['wrong']}")
        rows.append(
            [
                r["autopilot"],
                r["transfer"],
                f"{1e3 * r['round_trip_s']:.0f} ms",
                f"{100 * r['loss']:.0f} %",
                over,
                *absolute,
            ]
        )
    return rows


def race(found: Any) -> Table:
    """Six vehicles at once, ours and MAVSDK."""
    rows = [["round trip", "loss", "client", "sent", "failed of six", "wrong"]]
    for r in found["race"]:
        counts = (f"{r['sent_s']:.1f} s", f"{r['failures']}", f"{r['wrong']}")
        rows.append([f"{1e3 * r['round_trip_s']:.0f} ms", f"{100 * r['loss']:.0f} %", r["client"], *counts])
    return rows


def maps(found: Any) -> Table:
    """How many random maps get a plan."""
    possible = [o for o in found if o["kind"] != "no way"]
    verified = [o for o in possible if o["kind"] == "verified"]
    straight = sum(o["straight"] for o in possible)
    seconds = [o["seconds"] for o in verified] or [0.0]
    return [
        ["maps with a way", "verified plans", "by a straight-line guess", "median", "worst"],
        [
            f"{len(possible)} of {len(found)}",
            f"{100 * len(verified) / len(possible):.0f} %",
            f"{100 * straight / len(possible):.0f} %",
            f"{statistics.median(seconds):.1f} s",
            f"{max(seconds):.1f} s",
        ],
    ]


TABLES: dict[str, tuple[str, tuple[str, ...], tuple[Callable[[Any], Table], ...]]] = {
    "planner": (
        "One vehicle's plan beside other solvers",
        ("--repetitions", "3", "--coupled-limit-s", "0"),
        (planner, planner_times),
    ),
    "scale": ("Large formations", ("--repeat", "3"), (scale,)),
    "maps": ("Random maps", ("--maps", "30"), (maps,)),
    "export": ("Exports, and reading them", ("--repeat", "1"), (export, readers)),
    "upload": ("Uploads over bad links", ("--uploads", "20", "--race", "0.05:0", "0.05:0.2"), (upload, race)),
    "stream": ("Setpoint streams", ("--seconds", "20"), (stream,)),
    "bridge": ("Emulated vehicles", ("--seconds", "3", "--profile", "0"), (bridge,)),
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
    return {"benchmarks": benchmarks}


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


def _middle(record: dict[str, Any]) -> float:
    return float(statistics.median(run["cold_s"] for run in record["runs"]))
