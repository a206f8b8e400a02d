"""`gcs attach` at work: open the flight's folder and links, show its vehicles, land, return or resume them."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from gcs.cli.shared.console import Screen
from gcs.cli.shared.shared_options import connection
from gcs.errors import FileFormatError, FlightError, GcsError, PeerError, UsageError
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.execution.flight import FlightSequence
from gcs.flight.execution.resume import Resume, resume_flight, where_in_plan
from gcs.flight.execution.takeoff_landing import FlightVehicle, request_telemetry, until_placed
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.flight.monitoring.progress import FlightHooks
from gcs.flight.monitoring.volume_watch import VOLUMES, FlownVolumes
from gcs.flight.recording.flight_folder import BEFORE, PREDICTED, later_plans
from gcs.flight.recording.flight_record import FlightJournal
from gcs.flight.recording.flight_state import FlightState, held_folder, read_flight_state
from gcs.flight.setup.build_loads import PreparedFlight, missions_only
from gcs.flight.setup.order_socket import taking_orders
from gcs.flight.setup.telemetry_budget import telemetry_share
from gcs.link.session.connection import Connection
from gcs.mission.export.setpoint_stream import build_stream
from gcs.mission.waypoints.mission_items import build_missions
from gcs.plan.plan_file import load_plan, read_plan
from gcs.plan.replanning.plan_pieces import continued
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import refusal
from gcs.util.aio import Stoppable, each

if TYPE_CHECKING:
    from gcs.types import JsonObject

_SETTLE_S = 4.0  # from the first vehicle that is heard to the last; HEARTBEAT comes once a second


@dataclass(frozen=True)
class AttachRequest:
    """The folder of a flight, what to do with it, and its links."""

    folder: Path
    what: Resume
    links: tuple[str, ...]
    key_file: Path | None
    screen: Screen
    also_to: tuple[str, ...] = ()


def take_up(request: AttachRequest) -> int:
    """Carry out the request and return the exit status. Raises GcsError."""
    plan, book = _plan_and_state(request)
    links = request.links or book.links
    if not links:
        raise UsageError(
            f"the vehicles of {request.folder} were emulated and ended with their flight.", hint="name another flight"
        )
    known = connection(links, key_file=request.key_file, radio_baud=book.radio_baud)
    known = replace(known, systems=book.systems, also_to=request.also_to)
    prepared = PreparedFlight(  # before the links are open: they would have to wait
        missions_only(build_missions(plan)),
        build_stream(plan, plan.scenario.mission.setpoint_rate_hz),
        tracks=_predicted(request, FlightMode(book.mode)),
        folder=request.folder,
    )
    ctrl_c = Stoppable()
    with held_folder(request.folder), request.screen.without_waiting():
        found = ctrl_c.run(_take_up(request, book, plan, known, prepared, ctrl_c))
    request.screen.result(found)
    return 0


def _plan_and_state(request: AttachRequest) -> tuple[Plan, FlightState]:
    """Raises GcsError. Vehicles land and return without `flight.json` too, if their links are named."""
    folder = request.folder
    try:
        book = read_flight_state(folder)
    except FileFormatError as problem:
        if not request.links or request.what is Resume.RESUME:
            hint = "name the vehicles' links with --link; then --land and --return need only plan.skein"
            raise FileFormatError(problem.message, hint=hint) from None
        request.screen.warn(f"{problem.message} The vehicles have the system ids of the plan.")
        plan = _plan_of(request, None, request.links)
        stream = FlightMode.STREAM.value
        return plan, FlightState(plan.scenario.name, plan.hash, (), {}, stream, False, "not known", None, 0)
    with held_folder(folder):  # before anything else is read or said
        pass
    return _plan_of(request, book, request.links or book.links), book


def _plan_of(request: AttachRequest, book: FlightState | None, links: Sequence[str]) -> Plan:
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
    if book is not None and plan.hash != book.plan_hash:
        doubt = FlightError(f"{path} is not the plan of this flight.", hint="put the original file back, or land")
    if doubt is not None and request.what is Resume.RESUME:
        raise doubt
    if doubt is not None:
        request.screen.warn(doubt.message)
    return _changed(request, plan)


def _changed(request: AttachRequest, plan: Plan) -> Plan:
    """The plan with what orders changed in flight; to resume, the last change is verified again."""
    for path in later_plans(request.folder):
        if request.what is Resume.RESUME:
            later, report = load_plan(path, request.screen.warn)
            if not report.ok:
                raise refusal(report)
        else:
            later, _ = read_plan(path)
        plan = continued(plan, later)
    return plan


async def _take_up(
    request: AttachRequest,
    book: FlightState,
    plan: Plan,
    known: Connection,
    prepared: PreparedFlight,
    ctrl_c: Stoppable,
) -> JsonObject:
    mode, rate_hz = FlightMode(book.mode), plan.scenario.mission.setpoint_rate_hz
    options = FlightOptions(
        mode=mode,
        follow=book.follow,
        telemetry_share=telemetry_share(known.slowest_baud, len(plan.sysids), mode, rate_hz),
        watched_elsewhere=bool(request.also_to),
        volumes=_volumes(request, plan),
    )
    folder, screen = request.folder, request.screen
    async with AsyncExitStack() as stack:
        state = replace(book, links=known.links, pid=os.getpid())
        journal = FlightJournal(folder, state, screen.say, screen.warn, f"telemetry-{datetime.now():%H%M%S}.tlog")
        stack.enter_context(journal.record)
        fleet = await stack.enter_async_context(
            known.open(journal.on_frame, vehicles=plan.sysids, on_notice=journal.on_notice)
        )
        kinds = {sysid: int(kind) for sysid, kind in zip(plan.sysids, plan.autopilots, strict=True)}
        sessions = await fleet.vehicles_left(kinds, options.find_timeout_s, settle_s=_SETTLE_S, systems=known.systems)
        fleet.freeze()
        hooks = FlightHooks(journal.on_event, journal.on_step)
        flight = FlightSequence(plan, sessions, options, prepared, hooks)
        journal.keep_time(flight.time)
        ctrl_c.again_calls(flight.landing.report_airborne)
        shown = await _show(flight, book, screen, asks=request.what is not Resume.LAND)
        if request.what is not Resume.SHOW:
            async with taking_orders(flight, folder, screen.say):
                await resume_flight(flight, request.what, book.t0_unix_s)
            screen.say(flight.landing.words())
            if (folder / BEFORE).exists():
                screen.say(f"to give back what was on board before the flight: gcs restore {folder}")
            if flight.landing.not_landed():
                raise FlightError(
                    f"{flight.landing.words()}.",
                    hint="search for them at their last position; run `gcs attach --land` again when they are heard",
                )
        return {"folder": folder, "was": book.step, "vehicles": shown, "done": request.what.value}


def _predicted(request: AttachRequest, mode: FlightMode) -> PredictedTracks | None:
    """The tracks by which the flight watched its missions on board. Without them it goes on, with a warning."""
    if mode is FlightMode.STREAM or request.what is not Resume.RESUME:
        return None
    try:
        return PredictedTracks.load(request.folder / PREDICTED)
    except FileFormatError as problem:
        request.screen.warn(f"{problem.message} Vehicles that are late or off their tracks are not detected.")
        return None


def _volumes(request: AttachRequest, plan: Plan) -> FlownVolumes | None:
    """The volumes that the flight was begun with, if there were any. If they are damaged it goes on, with a warning."""
    file = request.folder / VOLUMES
    if request.what is Resume.SHOW or not file.exists():
        return None
    try:
        return FlownVolumes.load(file, plan)
    except FileFormatError as problem:
        request.screen.warn(f"{problem.message} Vehicles that leave their volumes are not detected.")
        return None


async def _show(flight: FlightSequence, book: FlightState, screen: Screen, *, asks: bool) -> list[JsonObject]:
    """Show a table of the vehicles, and return its rows as data. Without `asks` no answer is waited for."""
    stops = [flight.listen(vehicle) for vehicle in flight.vehicles.values()]
    try:
        if asks:
            heard = [vehicle for vehicle in flight.vehicles.values() if vehicle.session.heard]
            await each(heard, _ask)
    finally:
        for stop in stops:
            stop()
    views = flight.monitor.views
    table = Table("vehicle", "armed", "mode", "north", "east", "up", "speed", title=f"{book.mission}: was {book.step}")
    rows = []
    for sysid, vehicle in flight.vehicles.items():
        session, place = vehicle.session, views[sysid].position_ned_m.tolist()
        known = all(map(math.isfinite, place))
        if session.heard:
            armed, mode = "yes" if session.armed else "no", vehicle.behaviour.mode_name(session.custom_mode)
        else:
            armed, mode = "not heard", ""
        metres = [f"{value:.1f} m" for value in (place[0], place[1], -place[2])] if known else ["", "", ""]
        speed_mps = float(np.linalg.norm(views[sysid].velocity_ned_mps))
        table.add_row(str(sysid), armed, mode, *metres, f"{speed_mps:.1f} m/s" if known else "")
        rows.append(
            {
                "sysid": sysid,
                "heard": session.heard,
                "armed": session.armed if session.heard else None,
                "mode": mode,
                "position_ned_m": place if known else None,
            }
        )
    screen.show(table)
    if any(row["position_ned_m"] is not None for row in rows):
        where = where_in_plan(flight.plan, np.array([view.position_ned_m for view in views.values()]))
        them = (
            "all vehicles" if all(row["position_ned_m"] is not None for row in rows) else "the vehicles shown with one"
        )
        screen.say(f"nearest plan time: t = {where.t_s:.1f} s; {them} are within {where.off_m:.1f} m of the plan there")
    return rows


async def _ask(vehicle: FlightVehicle) -> None:
    """Ask a vehicle for its position; one that does not answer is shown without it."""
    with suppress(PeerError):
        await request_telemetry(vehicle)
        await until_placed(vehicle)
