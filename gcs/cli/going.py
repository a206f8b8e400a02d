"""Before and after a flight of vehicles on a link: the go/no-go table, and their parameters back.

Knows: how both are shown. Does not know: what is good enough (`gcs.flight.preflight`), flying.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from rich.table import Table

from gcs.cli.console import Screen
from gcs.errors import GcsError
from gcs.flight.preflight import Check, PreflightLimits, preflight, refuse_no_go
from gcs.link.fleet import Fleet
from gcs.link.session import VehicleSession
from gcs.link.survey import survey
from gcs.link.upload import Change, restore
from gcs.plan.trajectory import Plan


async def go_or_no_go(
    screen: Screen, fleet: Fleet, sessions: Mapping[int, VehicleSession], plan: Plan, limits: PreflightLimits
) -> tuple[Check, ...]:
    """Ask all vehicles, show the table. Raises `FlightError` for a no-go, `DuplicateSystemId`."""
    asked = ((sysid, survey(s, fleet.where(s.station.sysid))) for sysid, s in sessions.items())
    sysids, surveys = zip(*asked, strict=True)
    reports = dict(zip(sysids, await asyncio.gather(*surveys), strict=True))
    fleet.check()
    checks = preflight(plan, reports, limits)
    show_checks(screen, checks)
    refuse_no_go(checks)
    return checks


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


async def put_back(screen: Screen, sessions: Mapping[int, VehicleSession], changes: tuple[Change, ...]) -> None:
    """Parameters as they were before the upload; who does not answer is told, and the flight's own end stays."""
    if not changes:
        return
    try:
        await restore(sessions, changes)
    except GcsError as error:
        screen.say(f"parameters were not all put back: {error.message}")
    else:
        screen.say(f"{len(changes)} parameters are as they were")
