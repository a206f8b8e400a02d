"""Runs every contender on every mesh, each time in a process of its own, taking turns so that noise falls on all alike.

Knows: processes and time limits. Does not know: solvers, goals, tables.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 300.0
# One thread each: on a machine with few cores threads measure the neighbours.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@dataclass(frozen=True)
class Contender:
    """A name and how to start it: `command` before the two file names, `arguments` after."""

    name: str
    command: tuple[str, ...]
    arguments: tuple[str, ...]
    is_peer: bool
    limit_s: float = LIMIT_S


@dataclass
class Record:
    """All runs of one contender on one mesh; the last one's solution stands for all."""

    contender: Contender
    mesh: str
    runs: list[dict[str, Any]] = field(default_factory=list)
    failure: str = ""

    def median(self, key: str) -> float:
        """Of a number over all runs; infinite where there is none."""
        return statistics.median(run[key] for run in self.runs) if self.runs else float("inf")

    @property
    def result(self) -> dict[str, Any]:
        """The last run."""
        return self.runs[-1]


def skein(name: str, what: str) -> Contender:
    """Skein in this environment."""
    return Contender(name, (sys.executable, "-m", "tools.bench.skein"), (what,), is_peer=False)


def run(
    entries: list[tuple[Contender, str]],
    problems: dict[str, Path],
    repetitions: int,
    scratch: Path,
    on_run: Callable[[str], None] = lambda _: None,
) -> list[Record]:
    """Records in the order of `entries` (contender, mesh). One that fails is not run again."""
    records = [Record(contender, mesh) for contender, mesh in entries]
    for repetition in range(repetitions):
        for record in records:
            if record.failure:
                continue
            on_run(f"{repetition + 1}/{repetitions}: {record.contender.name} on {record.mesh}")
            try:
                record.runs.append(once(record.contender, problems[record.mesh], scratch / "answer.json"))
            except RuntimeError as error:
                record.failure = str(error)
    return records


def once(contender: Contender, problem: Path, answer: Path) -> dict[str, Any]:
    """One run; RuntimeError says what went wrong."""
    answer.unlink(missing_ok=True)
    command = [*contender.command, str(problem), str(answer), *contender.arguments]
    try:
        done = subprocess.run(
            command,
            cwd=ROOT,
            env=os.environ | ONE_THREAD,
            capture_output=True,
            text=True,
            timeout=contender.limit_s,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise RuntimeError(f"stopped after {contender.limit_s:g} s") from error
    if done.returncode or not answer.exists():
        lines = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        raise RuntimeError(lines[-1])
    result: dict[str, Any] = json.loads(answer.read_text())
    if not result["success"]:
        raise RuntimeError(f"no solution: {result['status']} after {result['iterations']} iterations")
    return result


def by_mesh(records: list[Record]) -> dict[str, list[Record]]:
    """Grouped, in order."""
    groups: dict[str, list[Record]] = defaultdict(list)
    for record in records:
        groups[record.mesh].append(record)
    return groups
