"""Show the pre-flight table, and read the operator's answer without blocking the links."""

from __future__ import annotations

import asyncio
import sys

from rich.table import Table

from gcs.cli.console import Screen
from gcs.flight.setup.preflight import PreflightCheck


async def typed_line() -> str:
    """The next line of standard input without its line end; empty without an input. It may be cancelled at any time."""
    if sys.stdin is None or sys.stdin.closed:
        return ""
    loop = asyncio.get_running_loop()
    arrived = asyncio.Event()
    try:
        loop.add_reader(sys.stdin, arrived.set)
    except PermissionError:  # a file: its next line is there at once
        return sys.stdin.readline().strip()
    try:
        await arrived.wait()
    finally:
        loop.remove_reader(sys.stdin)
    return sys.stdin.readline().strip()


def show_checks(screen: Screen, checks: tuple[PreflightCheck, ...]) -> None:
    """Show a table: one row per check, one column per vehicle, failed checks marked, and the requirement."""
    sysids = list(dict.fromkeys(c.sysid for c in checks))
    found = {(c.name, c.sysid): c for c in checks}
    go = all(c.ok for c in checks)
    table = Table("check", *(str(s) for s in sysids), "required", title="GO" if go else "NO-GO")
    for name in dict.fromkeys(c.name for c in checks):
        row = [found[name, s] for s in sysids]
        table.add_row(name, *((c.measured if c.ok else f"FAILED: {c.measured}") for c in row), row[0].required)
    screen.show(table)
