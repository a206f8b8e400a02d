"""Show the pre-flight table, and read the operator's answer without blocking the links."""

from __future__ import annotations

import asyncio
import sys

from rich.markup import escape
from rich.table import Table

from gcs.cli.console import Screen
from gcs.flight.setup.preflight_check import PreflightCheck, complete


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
    table = checks_table(checks)
    if _narrowest(table) > screen.console.width:
        table = narrow_checks_table(checks)
    screen.show(table)
    vehicles_of: dict[str, list[str]] = {}
    for check in checks:
        if check.warning:
            vehicles_of.setdefault(check.warning, []).append(str(check.sysid))
    for text, sysids in vehicles_of.items():
        screen.warn(f"vehicle{'s' * (len(sysids) > 1)} {', '.join(sysids)}: {text}")


def checks_table(checks: tuple[PreflightCheck, ...]) -> Table:
    """Return the table of checks. A check that a vehicle lacks is not reported, and failed."""
    rows = _by_name(checks)
    columns = {"check": list(rows)}
    for row in rows.values():
        for c in row:
            columns.setdefault(str(c.sysid), []).append(_cell(c))
    columns["required"] = [row[0].required for row in rows.values()]
    table = Table(title=_title(rows))
    for heading, cells in columns.items():
        table.add_column(heading, overflow="fold", min_width=_longest_word([heading, *cells]))
    for texts in zip(*columns.values(), strict=True):
        table.add_row(*(escape(text) for text in texts))
    return table


def narrow_checks_table(checks: tuple[PreflightCheck, ...]) -> Table:
    """Return the table for terminals that have no room for one column per vehicle: vehicles stand in the cells."""
    rows = _by_name(checks)
    table = Table(title=_title(rows))
    for heading in ("check", "vehicles: measured", "required"):
        table.add_column(heading, overflow="fold")
    for name, row in rows.items():
        vehicles_of: dict[str, list[str]] = {}
        for c in row:
            vehicles_of.setdefault(_cell(c), []).append(str(c.sysid))
        remarkable = {_cell(c) for c in row if not c.ok or c.warning}
        told = [f"{', '.join(ids) if len(ids) < len(row) else 'all'}: {cell}" for cell, ids in vehicles_of.items()]
        apart = [line for line, cell in zip(told, vehicles_of, strict=True) if cell in remarkable]
        good = "; ".join(line for line in told if line not in apart)
        table.add_row(name, escape("\n".join((*apart, *([good] if good else [])))), escape(row[0].required))
    return table


def _by_name(checks: tuple[PreflightCheck, ...]) -> dict[str, list[PreflightCheck]]:
    rows: dict[str, list[PreflightCheck]] = {}
    for check in complete(checks):
        rows.setdefault(check.name, []).append(check)
    return rows


def _title(rows: dict[str, list[PreflightCheck]]) -> str:
    waived = [name for name, row in rows.items() if any(c.waived for c in row)]
    go = all(c.go for row in rows.values() for c in row)
    return ("GO" if go else "NO-GO") + (f", waived: {', '.join(waived)}" if waived else "")


def _narrowest(table: Table) -> int:
    """The width below which words would be broken: of columns, their padding and their lines."""
    return sum((column.min_width or 0) + 3 for column in table.columns) + 1


def _longest_word(texts: list[str]) -> int:
    return max((len(word) for text in texts for word in text.split()), default=1)


def _cell(check: PreflightCheck) -> str:
    mark = "WAIVED: " if check.waived else "FAILED: " if not check.ok else "WARNING: " if check.warning else ""
    return mark + check.measured
