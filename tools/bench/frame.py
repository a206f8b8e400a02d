"""Helpers of the benchmarks: options, measurements in separate processes, medians, tables, records, ports."""

import argparse
import json
import os
import socket
import statistics
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parents[2]
# On a machine with few cores threads measure the neighbours.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
_HERE = "--measure-here"
Row = dict[str, Any]


def options(doc: str | None, *places: str, **defaults: Any) -> argparse.Namespace:
    """The command line: paths that must be given, then options by name and default.

    A list is some values, of text some of these; a tuple is one of these, else the first; False a switch; None a file.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    for place in places:
        parser.add_argument(place, type=Path)
    for name, default in defaults.items():
        how: dict[str, Any] = {"type": Path if default is None else type(default), "default": default}
        if default is False:
            how = {"action": "store_true"}
        elif isinstance(default, tuple):
            how = {"choices": default, "default": default[0]}
        elif isinstance(default, list):
            kind = type(default[0]) if default else str
            how |= {"nargs": "+", "type": kind, "choices": (default or None) if kind is str else None}
        parser.add_argument(f"--{name.replace('_', '-')}", **how)
    return parser.parse_args()


def apart(file: str, *task: Any) -> Row:
    """What `serve` of the program `file` measures for a task, in a fresh process."""
    line = [sys.executable, file, _HERE, json.dumps(task)]
    done = subprocess.run(line, check=True, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=os.environ | ONE_THREAD)
    found: Row = json.loads(done.stdout.splitlines()[-1])
    return found


def serve(measure: Callable[..., Row]) -> None:
    """At the beginning of a program: measure what `apart` asks for, and end."""
    if sys.argv[1:2] == [_HERE]:
        print(json.dumps(measure(*json.loads(sys.argv[2]))))
        raise SystemExit


def medians(runs: Sequence[Row]) -> Row:
    """Of every number; a verdict holds if it holds in all runs."""
    first = runs[0]
    return {
        key: all(run[key] for run in runs) if isinstance(value, bool) else statistics.median(run[key] for run in runs)
        for key, value in first.items()
    }


def show(title: str, rows: Sequence[Row]) -> None:
    """A column for each key, numbers in five digits."""
    if not rows:
        return
    table = Table(*rows[0], title=title)
    for row in rows:
        table.add_row(*map(_cell, row.values()))
    Console(width=190).print(table)  # also where there is no terminal


def finish(title: str, rows: Sequence[Row], file: Path | None, record: Any = None) -> None:
    """Print the rows, and write the record, or else the rows, to the file that was asked for."""
    show(title, rows)
    if file is not None:
        file.write_text(json.dumps(rows if record is None else record, indent=1) + "\n", encoding="utf-8")


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None or isinstance(value, str):
        return value or ""
    if isinstance(value, list | tuple):
        return " / ".join(map(_cell, value))
    return f"{value:.5g}" if abs(value) < 1e4 else f"{value:,.0f}"


def free_port() -> int:
    """A UDP port that no program uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
