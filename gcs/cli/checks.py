"""The go/no-go table of a flight.

Knows: how it is shown. Does not know: what is good enough (`gcs.flight.preflight`).
"""

from __future__ import annotations

from rich.table import Table

from gcs.cli.console import Screen
from gcs.flight.preflight import Check


def show_checks(screen: Screen, checks: tuple[Check, ...]) -> None:
    """A row per check, a column per vehicle; what is not good is marked."""
    sysids = list(dict.fromkeys(c.sysid for c in checks))
    found = {(c.name, c.sysid): c for c in checks}
    go = all(c.ok for c in checks)
    table = Table("check", *(str(s) for s in sysids), "asked", title="GO" if go else "NO-GO")
    for name in dict.fromkeys(c.name for c in checks):
        row = [found[name, s] for s in sysids]
        table.add_row(name, *((c.found if c.ok else f"NO: {c.found}") for c in row), row[0].asked)
    screen.show(table)
