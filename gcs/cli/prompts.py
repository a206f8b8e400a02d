"""A question to the person at the keyboard, while vehicles go on being listened to.

Knows: standard input, the event loop. Does not know: what is asked, screens.
"""

from __future__ import annotations

import asyncio
import sys

from rich.table import Table

from gcs.cli.console import Screen
from gcs.flight.setup.preflight import PreflightCheck


async def typed_line() -> str:
    """The next line of standard input without its end; empty where there is none. May be cancelled at any time."""
    if sys.stdin is None or sys.stdin.closed:
        return ""
    loop = asyncio.get_running_loop()
    came = asyncio.Event()
    try:
        loop.add_reader(sys.stdin, came.set)
    except PermissionError:  # a file: it is all there
        return sys.stdin.readline().strip()
    try:
        await came.wait()
    finally:
        loop.remove_reader(sys.stdin)
    return sys.stdin.readline().strip()


def show_checks(screen: Screen, checks: tuple[PreflightCheck, ...]) -> None:
    """A row per check, a column per vehicle; what is not good is marked."""
    sysids = list(dict.fromkeys(c.sysid for c in checks))
    found = {(c.name, c.sysid): c for c in checks}
    go = all(c.ok for c in checks)
    table = Table("check", *(str(s) for s in sysids), "asked", title="GO" if go else "NO-GO")
    for name in dict.fromkeys(c.name for c in checks):
        row = [found[name, s] for s in sysids]
        table.add_row(name, *((c.found if c.ok else f"NO: {c.found}") for c in row), row[0].asked)
    screen.show(table)
