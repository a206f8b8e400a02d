"""Show the pre-flight table, and read the operator's answer without blocking the links."""

from __future__ import annotations

import asyncio
import sys

from rich.markup import escape
from rich.table import Table

from gcs.cli.console import Screen
from gcs.flight.setup.preflight_check import PreflightCheck, complete

_CHECK_WIDTH = 9  # the longest word of a check's name


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
    try:
        return sys.stdin.readline().strip()
    except (OSError, ValueError):  # the terminal was closed
        return ""


def show_checks(screen: Screen, checks: tuple[PreflightCheck, ...]) -> None:
    """Show a table: one row per check, one column per vehicle, failed checks marked, and the requirement."""
    screen.show(checks_table(checks))
    vehicles_of: dict[str, list[str]] = {}
    for check in checks:
        if check.warning:
            vehicles_of.setdefault(check.warning, []).append(str(check.sysid))
    for text, sysids in vehicles_of.items():
        screen.warn(f"vehicle{'s' * (len(sysids) > 1)} {', '.join(sysids)}: {text}")


def checks_table(checks: tuple[PreflightCheck, ...]) -> Table:
    """Return the table of checks. A check that a vehicle lacks is not reported, and failed."""
    rows: dict[str, list[PreflightCheck]] = {}
    for check in complete(checks):
        rows.setdefault(check.name, []).append(check)
    waived = [name for name, row in rows.items() if any(c.waived for c in row)]
    go = all(c.go for row in rows.values() for c in row)
    title = ("GO" if go else "NO-GO") + (f", waived: {', '.join(waived)}" if waived else "")
    sysids = dict.fromkeys(str(c.sysid) for row in rows.values() for c in row)
    table = Table(title=title)
    table.add_column("check", min_width=_CHECK_WIDTH)
    for heading in (*sysids, "required"):
        table.add_column(heading, overflow="fold")
    for name, row in rows.items():
        table.add_row(name, *(escape(_cell(c)) for c in row), escape(row[0].required))
    return table


def _cell(check: PreflightCheck) -> str:
    mark = "WAIVED: " if check.waived else "FAILED: " if not check.ok else "WARNING: " if check.warning else ""
    return mark + check.measured
