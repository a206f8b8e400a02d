"""A race: every contender in an environment and a process of its own, taking turns; its solution verified; a table.

Peers need libraries that contradict each other and ours: each has an environment under .bench/, made on first use. One
that does not install, start or solve is named, with the reason, and left out.
"""

from __future__ import annotations

import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from gcs.plan.ocp.problem import Problem
from tools.bench.findings import Findings, look, trajectory
from tools.bench.frame import ONE_THREAD, ROOT

CACHE = ROOT / ".bench"
LIMIT_S, INSTALL_LIMIT_S = 300.0, 900.0
KEYS = ("cold_s", "cold_cpu_s", "flight_cpu_s", "plan_cpu_s", "verified_cpu_s", "solver_s", "iterations", "solves")


@dataclass(frozen=True)
class Contender:
    """A name, the module that runs it, and its arguments; a peer also has a package of the index."""

    name: str
    module: str
    arguments: tuple[str, ...] = ()
    package: str = ""
    pythons: tuple[str, ...] = ()  # that it has wheels for, newest first; none: the one that runs this

    @property
    def is_peer(self) -> bool:
        """It is another planner."""
        return bool(self.package)


YAPSS = tuple(
    Contender(name, "peer_yapss", (mu_strategy,), "yapss")
    for name, mu_strategy in (("yapss-lg", "adaptive"), ("yapss-lg, monotone mu", "monotone"))
)
MAPTOR = Contender("maptor", "peer_maptor", (), "maptor")
PEERS = (
    *YAPSS,
    Contender("mpopt", "peer_mpopt", (), "mpopt", ("3.10", "3.9", "3.8")),  # pins numpy 1.22
    MAPTOR,
    Contender("rockit", "peer_rockit", (), "rockit-meco"),
    Contender("pycollo", "peer_pycollo", (), "pycollo"),
)


class Unavailable(Exception):
    """A contender that cannot take part, and why."""


@dataclass
class Record:
    """All runs of one contender on one mesh; the last one's solution stands for all."""

    contender: Contender
    mesh: str
    runs: list[dict[str, Any]] = field(default_factory=list)
    failure: str = ""
    findings: Findings | None = None  # of the leader

    def median(self, key: str) -> float:
        """Of a number over all runs; infinite where there is none."""
        return statistics.median(run[key] for run in self.runs) if self.runs else float("inf")

    @property
    def result(self) -> dict[str, Any]:
        """The last run."""
        return self.runs[-1]


@dataclass(frozen=True)
class Goal:
    """A ratio that shall be at most (or at least) some number."""

    name: str
    value: float
    bound: float
    at_least: bool = False

    @property
    def met(self) -> bool:
        """The bound is kept."""
        return self.value >= self.bound if self.at_least else self.value <= self.bound


Judge = Callable[[list[Record]], list[Goal]]


def hold(
    problem: Problem,
    meshes: dict[str, dict[str, Any]],
    entries: Iterable[tuple[Contender, str]],
    judge: Judge,
    repetitions: int,
    json_path: Path | None,
) -> None:
    """Run `entries` (contender, mesh) on the numbers of `meshes`, look at their solutions, judge, print and write."""
    records = [Record(contender, mesh) for contender, mesh in entries]
    with tempfile.TemporaryDirectory() as name:
        files = {mesh: Path(name) / f"problem{i}.json" for i, mesh in enumerate(meshes)}
        for mesh, file in files.items():
            file.write_text(json.dumps(meshes[mesh]))
        for repetition in range(repetitions):
            for record in (r for r in records if not r.failure):
                print(f"{repetition + 1}/{repetitions}: {record.contender.name}, {record.mesh}", file=sys.stderr)
                try:
                    record.runs.append(once(record.contender, files[record.mesh], Path(name) / "answer.json"))
                except Unavailable as error:
                    record.failure = str(error)
    for record in records:
        if record.runs:
            record.findings = look(problem, trajectory(record.result))
    goals = judge(records)
    show(records, goals)
    if json_path:
        json_path.write_text(json.dumps(as_json(records, goals), indent=1) + "\n")


def once(contender: Contender, problem: Path, answer: Path) -> dict[str, Any]:
    """One run; Unavailable says what went wrong."""
    answer.unlink(missing_ok=True)
    python = environment(contender) if contender.is_peer else Path(sys.executable)
    line = [str(python), "-m", f"tools.bench.{contender.module}", str(problem), str(answer), *contender.arguments]
    _run(line, LIMIT_S, ONE_THREAD)
    result: dict[str, Any] = json.loads(answer.read_text())
    if not result["success"]:
        raise Unavailable(f"no solution: {result['status']} after {result['iterations']} iterations")
    return result


def environment(peer: Contender) -> Path:
    """The peer's own Python, installed on first use; raises Unavailable."""
    home = CACHE / peer.package
    python = home / "bin" / "python"
    stamp = home / ".installed"  # written last: without it the installation did not finish
    if not stamp.exists():
        print(f"installing {peer.package} into {home} (once)", file=sys.stderr)
        interpreter, chosen = _interpreter(peer)
        _run([interpreter, "-m", "venv", "--clear", str(home)], INSTALL_LIMIT_S, chosen)
        # A numerical library built from source takes ten minutes and lacks its neighbours' binary interface.
        wheels = ["-m", "pip", "-q", "install", "--only-binary", "numpy,scipy,casadi"]
        _run([str(python), *wheels, peer.package], INSTALL_LIMIT_S, {})
        stamp.touch()
    return python


def _interpreter(peer: Contender) -> tuple[str, dict[str, str]]:
    """A command and the environment variables that it needs."""
    if not peer.pythons:
        return sys.executable, {}
    for wanted in peer.pythons:
        # Where several Pythons are managed by pyenv, its stand-ins start the newest one of the family by this name.
        command, chosen = f"python{wanted}", {"PYENV_VERSION": wanted}
        try:
            _run([command, "-c", "pass"], INSTALL_LIMIT_S, chosen)
        except Unavailable:
            continue
        return command, chosen
    raise Unavailable(f"needs Python {' or '.join(peer.pythons)}, which is not installed")


def _run(line: list[str], limit_s: float, variables: dict[str, str]) -> None:
    settings: dict[str, Any] = {"capture_output": True, "text": True, "timeout": limit_s, "cwd": ROOT}
    try:
        done = subprocess.run(line, check=False, env=os.environ | variables, **settings)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise Unavailable(str(error)) from error
    if done.returncode:
        lines = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        raise Unavailable(next((line for line in lines if line.startswith("ERROR")), lines[-1]))


def show(records: list[Record], goals: list[Goal]) -> None:
    """Goals, then a row for each record; violations are the largest between nodes."""
    verdicts = Table("goal", "measured", "wanted", "")
    for goal in goals:
        sign = ">=" if goal.at_least else "<="
        verdicts.add_row(goal.name, f"{goal.value:.3g}", f"{sign} {goal.bound:g}", "met" if goal.met else "missed")
    table = Table("mesh", "contender", "first solution", "solver", "iterations", "flight refined", "plan verified")
    for name in ("objective, truly", "clearance", "limits", "control box", "5 s windows", "verified"):
        table.add_column(name)
    for record in records:
        table.add_row(*_row(record))
    console = Console(width=190)  # also where there is no terminal
    for shown in (verdicts, table, *about(records)):
        console.print(shown)


def _row(record: Record) -> list[str]:
    row = [record.mesh, record.contender.name]
    if record.failure:
        return [*row, record.failure]

    def seconds(key: str) -> str:
        return f"{record.median(key):.3f} s" if key in record.result else ""

    row += [seconds("cold_cpu_s"), seconds("solver_s"), f"{record.median('iterations'):.0f}"]
    row += [seconds("flight_cpu_s"), seconds("verified_cpu_s")]
    found = record.findings
    if found is None:
        return row
    limit = f"{found.limit:.2%}" + (f" ({found.limit_name})" if found.limit > 1e-4 else "")
    held = f"{found.window_m:.4f} m", "yes" if found.verified else "no"
    return [*row, f"{found.objective:.6f}", f"{found.clearance_m:.3f} m", limit, f"{found.control:.2f}", *held]


def about(records: list[Record]) -> list[str]:
    """Versions, machine and date."""
    versions = {name: v for r in records if r.runs for name, v in r.result["versions"].items() if not r.failure}
    return [
        ", ".join(f"{name} {number}" for name, number in sorted(versions.items())),
        f"Python {platform.python_version()}, {platform.platform()}, {os.cpu_count()} cores, one thread each; "
        f"load {os.getloadavg()[0]:.1f}; {datetime.now().astimezone():%Y-%m-%d %H:%M %Z}",
    ]


def as_json(records: list[Record], goals: list[Goal]) -> dict[str, Any]:
    """All numbers."""
    keys = (*KEYS, "objective", "points_s", "status")
    return {
        "goals": [asdict(goal) | {"met": goal.met} for goal in goals],
        "records": [
            {
                "contender": r.contender.name,
                "mesh": r.mesh,
                "failure": r.failure,
                "runs": [{key: run[key] for key in keys if key in run} for run in r.runs],
                "versions": r.result["versions"] if r.runs else {},
                "findings": asdict(r.findings) | {"verified": r.findings.verified} if r.findings else None,
            }
            for r in records
        ],
        "about": about(records),
    }
