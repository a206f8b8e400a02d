"""Five points for Skein and for planners of several phases, in one run:  ./tools/run python tools/bench_legs.py

Simulation 1's leader flies through the five points of `bench_route.drawn(5, 1)`: six legs, each a phase of free
duration, in a given time. Objective, bounds, scaling, guess, tolerance and mesh (Skein's first one) are the same for
all. A peer is done at its first solution; Skein goes on to the verified plan, with take-off, run-up and landing. What
every solver calls a solution is then looked at between its nodes. Times are CPU times, so other programs count little.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import tempfile
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from tools.bench import environments, race
from tools.bench.describe_route import route_mesh, route_numbers, route_problem
from tools.bench.environments import Peer, Unavailable
from tools.bench.findings import Findings, look, trajectory
from tools.bench.goals import Goal
from tools.bench.race import Contender, Record
from tools.bench.route_goals import LEADER, SAME_FORM, SIX, judge_legs, points_off_s

WIDTH = 190
MESH = "first mesh"
PEERS = (
    Peer("yapss-lg", "yapss", "peer_yapss_legs", ("default",)),
    Peer("yapss-lg, monotone mu", "yapss", "peer_yapss_legs", ("monotone",)),
    Peer("maptor", "maptor", "peer_maptor_legs"),
)
CPU_KEYS = ("cold_cpu_s", "flight_cpu_s", "plan_cpu_s", "verified_cpu_s")


def main(
    repetitions: Annotated[int, typer.Option(help="Runs of every contender; medians count.")] = 3,
    json_path: Annotated[Path | None, typer.Option("--json", help="Write all numbers here.")] = None,
) -> None:
    """Measure, judge, print."""
    console, log = Console(width=WIDTH), Console(stderr=True)
    problem, route = route_problem()
    entries, missing = _entries()
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "problem.json"
        file.write_text(json.dumps(route_numbers(problem, route, route_mesh(problem))))
        records = race.run(entries, {MESH: file}, repetitions, Path(name), log.print)
    findings = {id(r): look(problem, trajectory(r.result, [])) for r in records if r.runs}
    goals = judge_legs(records, findings)
    _print(console, records, findings, goals)
    missing += [f"{r.contender.name} failed: {r.failure}" for r in records if r.failure]
    for line in [*missing, *_about(records)]:
        console.print(line)
    if json_path:
        json_path.write_text(json.dumps(_as_json(records, findings, goals, missing), indent=1) + "\n")


def _entries() -> tuple[list[tuple[Contender, str]], list[str]]:
    """All contenders, and those that cannot take part, in words."""
    module = (sys.executable, "-m", "tools.bench.skein_route")
    contenders = [
        Contender(name, module, (what,), is_peer=False)
        for name, what in ((SIX, "six"), (LEADER, "leader"), (SAME_FORM, "lagrange"))
    ]
    missing = []
    for peer in PEERS:
        try:
            python = environments.environment(peer)
        except Unavailable as error:
            missing.append(f"{peer.name} is left out: {error}")
            continue
        command = (str(python), "-m", f"tools.bench.{peer.module}")
        contenders.append(Contender(peer.name, command, peer.arguments, is_peer=True))
    return [(contender, MESH) for contender in contenders], missing


def _print(console: Console, records: list[Record], findings: dict[int, Findings], goals: list[Goal]) -> None:
    verdicts = Table("goal", "measured", "wanted", "", title="Ratios of CPU time, and agreement")
    for goal in goals:
        verdicts.add_row(goal.name, f"{goal.value:.3g}", f"<= {goal.bound:g}", "met" if goal.met else "missed")
    console.print(verdicts)
    table = Table(
        *("contender", "first solution", "flight refined", "plan verified", "iterations", "objective, truly"),
        *("times at points off", "5 s windows", "limits", "control box", "verified"),
        title="CPU time from the problem on, and the leader's flight between its nodes",
    )
    ours = next((r for r in records if r.contender.name == LEADER and r.runs), None)
    for record in records:
        if record.runs:
            table.add_row(*_row(record, findings[id(record)], ours))
    console.print(table)
    console.print(
        "iterations: of the first solution; times at points: off those of the leader's verified plan; limits, control "
        "box: largest violation between nodes, of the limit, of half the box's width",
        style="dim",
    )


def _row(record: Record, found: Findings, ours: Record | None) -> list[str]:
    def seconds(key: str) -> str:
        return f"{record.median(key):.2f} s" if key in record.result else ""

    return [
        record.contender.name,
        seconds("cold_cpu_s"),
        seconds("flight_cpu_s"),
        seconds("verified_cpu_s"),
        f"{record.median('iterations'):.0f}",
        f"{found.objective:.5f}",
        "" if ours is None else f"{points_off_s(ours, record):.2f} s",
        f"{found.window_m:.3f} m",
        f"{found.limit:.2%}" + (f" ({found.limit_name})" if found.limit > 1e-4 else ""),
        f"{found.control:.2f}",
        "yes" if found.verified else "no",
    ]


def _about(records: list[Record]) -> list[str]:
    """Versions, machine and date."""
    versions = {name: number for r in records if r.runs for name, number in r.result.get("versions", {}).items()}
    return [
        ", ".join(f"{name} {number}" for name, number in sorted(versions.items()) if name not in ("casadi", "numpy")),
        f"Python {platform.python_version()}, {os.cpu_count()} cores, one thread each; load {os.getloadavg()[0]:.1f}; "
        f"{datetime.now().astimezone():%Y-%m-%d %H:%M %Z}",
    ]


def _as_json(
    records: list[Record], findings: dict[int, Findings], goals: list[Goal], missing: list[str]
) -> dict[str, Any]:
    keys = (*CPU_KEYS, "iterations", "solves", "objective", "points_s", "status")
    return {
        "goals": [asdict(goal) | {"met": goal.met} for goal in goals],
        "records": [
            {
                "contender": r.contender.name,
                "failure": r.failure,
                "runs": [{key: run[key] for key in keys if key in run} for run in r.runs],
                "versions": r.result.get("versions", {}) if r.runs else {},
                "findings": asdict(findings[id(r)]) | {"verified": findings[id(r)].verified} if r.runs else None,
            }
            for r in records
        ],
        "missing": missing,
        "about": _about(records),
    }


if __name__ == "__main__":
    typer.run(main)
