"""Go or no-go of a fleet: reports of all vehicles, their checks, waived ones, and the refusal."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

from gcs.autopilots.traits import link_behaviour
from gcs.errors import GcsError, PeerError, counted
from gcs.flight.clocks.fleet_clock import differences_s
from gcs.flight.setup.preflight import preflight
from gcs.flight.setup.preflight_check import PreflightCheck, refuse_no_go, waive
from gcs.link.fleet_upload.upload_fleet import ParameterChange, restore
from gcs.link.session.linked_fleet import LinkedFleet
from gcs.link.session.status_report import VehicleReport, status_report
from gcs.link.session.vehicle_session import VehicleSession
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.preflight_table import PreflightTable
from gcs.steady_loop import host_s


async def go_or_no_go(
    fleet: LinkedFleet,
    sessions: Mapping[int, VehicleSession],
    plan: Plan,
    limits: PreflightTable,
    show: Callable[[tuple[PreflightCheck, ...]], None],
    waived: Collection[str] = (),
) -> tuple[PreflightCheck, ...]:
    """Return the checks of all vehicles, after `show`; failed ones named in `waived` do not stop the flight.

    Raises `FlightError` for a no-go, `DuplicateSystemId`.
    """
    requests = ((sysid, preflight_report(s, fleet.where(s.station.sysid))) for sysid, s in sessions.items())
    sysids, surveys = zip(*requests, strict=True)
    reports = dict(zip(sysids, await asyncio.gather(*surveys), strict=True))
    fleet.check()
    clocks = {sysid: session.clock for sysid, session in sessions.items()}
    for sysid, off_s in differences_s(clocks, host_s(asyncio.get_running_loop())).items():
        reports[sysid] = replace(reports[sysid], gnss_off_s=off_s)
    checks = waive(preflight(plan, reports, limits), waived)
    show(checks)
    refuse_no_go(checks)
    return checks


async def preflight_report(session: VehicleSession, where: str = "") -> VehicleReport:
    """Return the status report of a vehicle, with the battery capacity that it is set to."""
    name = link_behaviour(session.autopilot).capacity_parameter
    report = await status_report(session, where)
    if name is None:
        return report
    try:
        capacity_mAh = (await session.read_parameters([name]))[name].value
    except PeerError:
        return replace(report, capacity_parameter=name)
    return replace(report, capacity_parameter=name, capacity_mAh=float(capacity_mAh))


async def restore_parameters(
    sessions: Mapping[int, VehicleSession], changes: tuple[ParameterChange, ...], say: Callable[[str], None]
) -> None:
    """Restore the parameters from before the upload. A failure is reported by `say`, not raised: the flight is over."""
    if not changes:
        return
    try:
        await restore(sessions, changes)
    except GcsError as error:
        say(f"WARNING: not all parameters were restored: {error.message}")
    else:
        say(f"{counted(len(changes), 'parameter')} restored")
