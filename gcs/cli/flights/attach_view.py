"""`gcs attach` at work: open the flight's folder and links, show its vehicles, land, return or resume them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from gcs.aio import Stoppable, each, until
from gcs.cli.console import Screen
from gcs.cli.shared_options import connection
from gcs.errors import FileFormatError, FlightError, GcsError, UsageError
from gcs.flight.hooks import FlightHooks, spared
from gcs.flight.options import FlightMode, FlightOptions
from gcs.flight.progress import Event, Step
from gcs.flight.recording.flight_state import FlightState, read_flight_state
from gcs.flight.recording.writing.flight_record import FlightRecord
from gcs.flight.sequence.flight import FlightSequence
from gcs.flight.sequence.resume import Resume, resume_flight, where_in_plan
from gcs.flight.sequence.takeoff_landing import request_telemetry
from gcs.flight.setup.build_loads import missions_only
from gcs.link.connection import Connection
from gcs.link.fleet_upload.vehicle_load import VehicleLoad
from gcs.mission.model import SetpointStream
from gcs.mission.setpoints.setpoint_stream import build_stream
from gcs.mission.waypoints.mission_items import build_missions
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.plan_file import load_plan, read_plan
from gcs.plan.verification.verify import refusal


@dataclass(frozen=True)
class AttachRequest:
    """The folder of a flight, what to do with it, and its links."""

    folder: Path
    what: Resume
    links: tuple[str, ...]
    key_file: Path | None
    screen: Screen


def take_up(request: AttachRequest) -> int:
    """The exit status after the request is done. Raises GcsError."""
    book = read_flight_state(request.folder)
    if book.flown_by_another:
        raise UsageError(
            f"the flight in {request.folder} is still flown by process {book.pid}.",
            hint="stop that process with Ctrl-C; its vehicles then land",
        )
    links = request.links or book.links
    if not links:
        raise UsageError(
            f"the vehicles of {request.folder} were emulated and ended with their flight.", hint="name another flight"
        )
    plan = _plan_of(request, book, links)
    known = replace(connection(links, key_file=request.key_file), systems=book.systems)
    loads = missions_only(build_missions(plan))  # before the links are open: they would have to wait
    stream = build_stream(plan, plan.scenario.mission.setpoint_rate_hz)
    ctrl_c = Stoppable()
    with request.screen.without_waiting():
        found = ctrl_c.run(_take_up(request, book, plan, known, loads, stream, ctrl_c))
    request.screen.result(found)
    return 0


def _plan_of(request: AttachRequest, book: FlightState, links: Sequence[str]) -> Plan:
    """The flight's plan. One in doubt is never resumed. It lands and returns vehicles, with a warning: they are aloft.

    To show and to land needs nothing of its tracks, so it is verified again only to resume and to return.
    """
    path = request.folder / "plan.skein"
    doubt: GcsError | None = None
    try:
        if request.what in (Resume.RESUME, Resume.RETURN):
            plan, report = load_plan(path, request.screen.warn)
            doubt = None if report.ok else refusal(report)
        else:
            plan, _ = read_plan(path)
    except FileFormatError as error:
        named = " ".join(f"--link {link}" for link in links)
        raise FileFormatError(error.message, hint=f"land the vehicles without it: gcs tell land {named}") from error
    if plan.hash != book.plan_hash:
        doubt = FlightError(f"{path} is not the plan of this flight.", hint="put the original file back, or land")
    if doubt is not None and request.what is Resume.RESUME:
        raise doubt
    if doubt is not None:
        request.screen.warn(doubt.message)
    return plan


async def _take_up(
    request: AttachRequest,
    book: FlightState,
    plan: Plan,
    known: Connection,
    loads: Sequence[VehicleLoad],
    stream: SetpointStream,
    ctrl_c: Stoppable,
) -> dict[str, Any]:
    options = FlightOptions(mode=FlightMode(book.mode), follow=book.follow)
    folder, screen = request.folder, request.screen
    async with AsyncExitStack() as stack:
        flight: FlightSequence | None = None
        record = FlightRecord(
            folder,
            screen.warn,
            lambda: flight.time.now_s() if flight else None,
            f"telemetry-{datetime.now():%H%M%S}.tlog",
        )
        stack.enter_context(record)
        on_frame = spared(record.write_frame, "telemetry", screen.warn)
        fleet = await stack.enter_async_context(known.open(on_frame=on_frame))
        sessions = await fleet.vehicles(plan.sysids, options.find_timeout_s, systems=known.systems)

        def tell(event: Event) -> None:
            record.write_event(event)
            screen.say(str(event))

        def log_step(step: Step, t0_unix_s: float | None) -> None:
            record.write_state(
                replace(
                    book, links=known.links, step=step.value, t0_unix_s=t0_unix_s or book.t0_unix_s, pid=os.getpid()
                ),
            )

        hooks = FlightHooks(tell, log_step)
        flight = FlightSequence(plan, sessions, options, loads=loads, stream=stream, hooks=hooks)
        ctrl_c.on_again = flight.landing.tell_aloft
        shown = await _show(flight, book, screen)
        if request.what is not Resume.SHOW:
            await resume_flight(flight, request.what, book.t0_unix_s)
            screen.say(flight.landing.words())
        return {"folder": folder, "was": book.step, "vehicles": shown, "done": request.what.value}


async def _show(flight: FlightSequence, book: FlightState, screen: Screen) -> list[dict[str, Any]]:
    """Show a table of the vehicles, and return its rows as data."""
    stops = [flight.listen(crew) for crew in flight.vehicles.values()]
    try:
        await each(flight.vehicles.values(), request_telemetry)
        views = flight.monitor.views
        await until(
            lambda: all(np.isfinite(v.position_ned_m).all() for v in views.values()),
            flight.options.find_timeout_s,
            "a position of every vehicle",
        )
    finally:
        for stop in stops:
            stop()
    where = where_in_plan(flight.plan, np.array([v.position_ned_m for v in views.values()]))
    table = Table("vehicle", "armed", "mode", "north", "east", "up", "speed", title=f"{book.mission}: was {book.step}")
    rows = []
    for sysid, crew in flight.vehicles.items():
        north_m, east_m, down_m = views[sysid].position_ned_m.tolist()
        mode = crew.behaviour.mode_name(crew.session.custom_mode)
        speed_mps = float(np.linalg.norm(views[sysid].velocity_ned_mps))
        place = f"{north_m:.1f} m", f"{east_m:.1f} m", f"{-down_m:.1f} m"
        table.add_row(str(sysid), "yes" if crew.session.armed else "no", mode, *place, f"{speed_mps:.1f} m/s")
        rows.append(
            {"sysid": sysid, "armed": crew.session.armed, "mode": mode, "position_ned_m": [north_m, east_m, down_m]}
        )
    screen.show(table)
    screen.say(
        f"nearest plan time: t = {where.t_s:.1f} s; all vehicles are within {where.off_m:.1f} m of the plan there"
    )
    return rows
