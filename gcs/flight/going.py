"""Before and after a flight of vehicles on a link: all are asked and judged; their parameters are put back.

Knows: the order of things. Does not know: what is good enough (`preflight`), flying, screens.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from gcs.errors import GcsError
from gcs.flight.preflight import Check, PreflightLimits, preflight, refuse_no_go
from gcs.link.fleet_upload.upload_fleet import Change, restore
from gcs.link.session.linked_fleet import Fleet
from gcs.link.session.status_report import survey
from gcs.link.session.vehicle_session import VehicleSession
from gcs.plan.trajectory.trajectory import Plan


async def go_or_no_go(
    fleet: Fleet,
    sessions: Mapping[int, VehicleSession],
    plan: Plan,
    limits: PreflightLimits,
    show: Callable[[tuple[Check, ...]], None],
) -> tuple[Check, ...]:
    """Ask all vehicles, show what was found. Raises `FlightError` for a no-go, `DuplicateSystemId`."""
    asked = ((sysid, survey(s, fleet.where(s.station.sysid))) for sysid, s in sessions.items())
    sysids, surveys = zip(*asked, strict=True)
    reports = dict(zip(sysids, await asyncio.gather(*surveys), strict=True))
    fleet.check()
    checks = preflight(plan, reports, limits)
    show(checks)
    refuse_no_go(checks)
    return checks


async def put_back(
    sessions: Mapping[int, VehicleSession], changes: tuple[Change, ...], say: Callable[[str], None]
) -> None:
    """Parameters as they were before the upload; who does not answer is told, and the flight's own end stays."""
    if not changes:
        return
    try:
        await restore(sessions, changes)
    except GcsError as error:
        say(f"parameters were not all put back: {error.message}")
    else:
        say(f"{len(changes)} parameters are as they were")
