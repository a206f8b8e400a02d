"""A race: contenders take turns, each in its own environment and process; their solutions are verified and tabulated.

Peers need libraries that conflict with each other and with ours, so each has an environment under .bench/, made on
first use. One that does not install, start or solve is named, with the reason, and left out.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from gcs.plan.ocp.problem import Problem
from tools.bench.findings import Findings, look, trajectory
from tools.bench.frame import ONE_THREAD, ROOT, finish, show

CACHE = ROOT / ".bench"
LIMIT_S, INSTALL_LIMIT_S = 300.0, 900.0
KEYS = (
    *("cold_s", "cold_cpu_s", "flight_cpu_s", "plan_cpu_s", "verified_cpu_s", "solver_s"),
    *("iterations", "solves", "objective", "points_s", "status"),
)


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
    verdicts = [asdict(goal) | {"met": goal.met} for goal in goals]
    show("goals", verdicts)
    written = {"goals": verdicts, "records": [_as_json(record) for record in records]}
    finish("contenders, one thread each", [_row(record) for record in records], json_path, written)


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


def _row(record: Record) -> dict[str, Any]:
    """One line of the table; violations are the largest between nodes."""
    row: dict[str, Any] = {"mesh": record.mesh, "contender": record.contender.name}
    for key in ("cold_cpu_s", "solver_s", "iterations", "flight_cpu_s", "verified_cpu_s"):
        row[key] = record.median(key) if record.runs and key in record.result else None
    found = record.findings
    for key in ("objective", "clearance_m", "limit", "limit_name", "control", "window_m", "verified"):
        row[key] = None if found is None else getattr(found, key)
    return row | {"failure": record.failure}


def _as_json(record: Record) -> dict[str, Any]:
    found = record.findings
    return {
        "contender": record.contender.name,
        "mesh": record.mesh,
        "failure": record.failure,
        "runs": [{key: run[key] for key in KEYS if key in run} for run in record.runs],
        "versions": record.result["versions"] if record.runs else {},
        "findings": asdict(found) | {"verified": found.verified} if found else None,
    }
