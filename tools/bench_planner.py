"""Skein's planner beside its peers on one problem, in one run:  ./tools/run python tools/bench_planner.py [--quick]

Simulation 1's leader alone, with the same objective, bounds, scaling, guess and tolerance for every contender. What
every solver calls a solution is then looked at between its nodes by Skein's verifier. Peers are installed on first
use, each into an environment of its own under .bench/; one that does not install or solve is named and left out.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import tempfile
from dataclasses import asdict
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from gcs.plan.nlp.ipopt import solve
from gcs.plan.nlp.program.transcription import transcribe
from gcs.plan.ocp.problem import Problem
from tools.bench import describe, environments, race
from tools.bench.findings import Findings, cost, look, trajectory
from tools.bench.goals import Goal, judge
from tools.bench.race import Contender, Record

WIDTH = 190  # a table of twelve columns also has to fit where there is no terminal
UNIFORM, ENDS, OWN = "15 uniform x 4", "30 end-refined x 4", "own mesh"


def main(
    repetitions: Annotated[int, typer.Option(help="Runs of every contender on every mesh; medians count.")] = 5,
    quick: Annotated[bool, typer.Option("--quick", help="One run each, yapss as the only peer.")] = False,
    coupled_limit_s: Annotated[float, typer.Option(help="Time for six vehicles as one program; 0: leave out.")] = 300.0,
    json_path: Annotated[Path | None, typer.Option("--json", help="Write all numbers here.")] = None,
) -> None:
    """Measure, judge, print."""
    console, log = Console(width=WIDTH), Console(stderr=True)
    problem = describe.leader_problem()
    meshes = {UNIFORM: describe.uniform(problem), ENDS: describe.refined_at_ends(problem)}
    entries, missing = _entries(environments.PEERS[:2] if quick else environments.PEERS, list(meshes))
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        files = {mesh: scratch / f"problem{i}.json" for i, mesh in enumerate(meshes)}
        for mesh, file in files.items():
            file.write_text(json.dumps(describe.numbers(problem, meshes[mesh])))
        files[OWN] = files[UNIFORM]
        records = race.run(entries, files, 1 if quick else repetitions, scratch, log.print)
        if coupled_limit_s > 0 and not quick:
            log.print("once: six vehicles as one program")
            contender = Contender(
                "coupled, six vehicles",
                (sys.executable, "-m", "tools.bench.coupled"),
                (str(coupled_limit_s),),
                is_peer=False,
                limit_s=coupled_limit_s + 60.0,
            )
            records += race.run([(contender, UNIFORM)], files, 1, scratch)
    reference = None if quick else _reference(problem)
    findings = {
        id(r): look(problem, trajectory(r.result, meshes.get(r.mesh, meshes[UNIFORM]).joints_s.tolist()))
        for r in records
        if r.runs and "state" in r.result and "six" not in r.contender.name
    }
    goals = judge(records, findings, reference)
    _print(console, records, findings, goals, missing, reference)
    if json_path:
        json_path.write_text(json.dumps(_as_json(records, findings, goals, missing, reference), indent=1) + "\n")


def _entries(peers: tuple[environments.Peer, ...], meshes: list[str]) -> tuple[list[tuple[Contender, str]], list[str]]:
    """The contenders of each environment, and those that cannot take part, in words."""
    entries: list[tuple[Contender, str]] = []
    missing: list[str] = []
    contenders = [race.skein("skein, Eq. 41", "lagrange"), race.skein("skein, linear control", "linear")]
    for peer in peers:
        try:
            python = environments.environment(peer)
        except environments.Unavailable as error:
            missing.append(f"{peer.name} is left out: {error}")
            continue
        contenders.append(
            Contender(peer.name, (str(python), "-m", f"tools.bench.{peer.module}"), peer.arguments, is_peer=True)
        )
    for mesh in meshes:
        entries += [(contender, mesh) for contender in contenders]
    entries.append((race.skein("skein, six, Eq. 41", "six lagrange"), UNIFORM))
    entries += [(race.skein("skein, refined", "refined"), OWN), (race.skein("skein, six refined", "six refined"), OWN)]
    return entries, missing


def _reference(problem: Problem) -> float:
    """The objective on a mesh so fine that it no longer changes."""
    program = transcribe(problem, describe.converged(problem), describe.straight(problem))
    return cost(problem, program.trajectory(solve(program, program.scaled(describe.straight(problem))).y))


def _print(
    console: Console,
    records: list[Record],
    findings: dict[int, Findings],
    goals: list[Goal],
    missing: list[str],
    reference: float | None,
) -> None:
    verdicts = Table("goal", "measured", "wanted", "", title="Ratios")
    for goal in goals:
        sign = ">=" if goal.at_least else "<="
        verdicts.add_row(goal.name, f"{goal.value:.3g}", f"{sign} {goal.bound:g}", "met" if goal.met else "missed")
    console.print(verdicts)
    for mesh, group in race.by_mesh(records).items():
        table = Table(
            *("solver", "cold", "cold/yapss", "solver/yapss", "iterations", "objective", "of it truly"),
            *("clearance", "limits", "control box", "5 s windows", "verified"),
            title=mesh,
        )
        yapss = next((r for r in group if r.contender.name.startswith("yapss")), None)
        for record in group:
            table.add_row(*_row(record, findings.get(id(record)), yapss))
        console.print(table)
    console.print(
        "clearance, limits, control box: largest violation between nodes, in m, of the limit, of half the box's width; "
        "of it truly: Eq. 35 integrated over the polynomials",
        style="dim",
    )
    for line in missing + [f"{r.contender.name} on {r.mesh}: {r.failure}" for r in records if r.failure]:
        console.print(line)
    if reference:
        console.print(f"converged objective {reference:.6f}")
    for line in _about(records):
        console.print(line, style="dim")


def _row(record: Record, found: Findings | None, yapss: Record | None) -> list[str]:
    if record.failure:
        return [record.contender.name, "failed"]
    row = [
        record.contender.name,
        f"{record.median('cold_s'):.3f} s",
        f"{record.median('cold_s') / yapss.median('cold_s'):.2f}" if yapss else "",
        f"{record.median('solver_s') / yapss.median('solver_s'):.2f}" if yapss else "",
        f"{record.median('iterations'):.0f}",
        f"{record.result['objective']:.6f}",
    ]
    if found is None:
        return row
    return [
        *row,
        f"{found.objective:.6f}",
        f"{found.clearance_m:.3f}",
        f"{found.limit:.2%}" + (f" ({found.limit_name})" if found.limit > 1e-4 else ""),
        f"{found.control:.2f}",
        f"{found.window_m:.4f} m",
        "yes" if found.verified else "no",
    ]


def _about(records: list[Record]) -> list[str]:
    """Versions, machine and date."""
    versions = {
        name: number
        for r in records
        if r.runs
        for name, number in r.result.get("versions", {}).items()
        if name[0] != "c"
    }
    return [
        ", ".join(f"{name} {number}" for name, number in sorted(versions.items())) + f"; casadi {version('casadi')}",
        f"Python {platform.python_version()}, {platform.platform()}, {_processor()}, {os.cpu_count()} cores",
        f"one thread each; load {os.getloadavg()[0]:.1f}; {datetime.now().astimezone():%Y-%m-%d %H:%M %Z}",
    ]


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")


def _as_json(
    records: list[Record],
    findings: dict[int, Findings],
    goals: list[Goal],
    missing: list[str],
    reference: float | None,
) -> dict[str, Any]:
    keys = ("cold_s", "cold_cpu_s", "solver_s", "iterations", "objective")
    return {
        "goals": [asdict(goal) | {"met": goal.met} for goal in goals],
        "converged_objective": reference,
        "records": [
            {
                "contender": r.contender.name,
                "mesh": r.mesh,
                "failure": r.failure,
                "runs": [{key: run[key] for key in keys if key in run} for run in r.runs],
                "versions": r.result.get("versions", {}) if r.runs else {},
                "findings": asdict(findings[id(r)]) | {"verified": findings[id(r)].verified}
                if id(r) in findings
                else None,
            }
            for r in records
        ],
        "missing": missing,
        "about": _about(records),
    }


if __name__ == "__main__":
    typer.run(main)
