"""One flight with everything around it: its folder, its vehicles, its log, its verdict.

Knows: what to open and close around a flight, what is left in its folder. Does not know: how it is flown (`fly`) or
judged (`judge`), who watches (a `Watcher` is told), command lines.
"""

from __future__ import annotations

import asyncio
import math
import os
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerError, UsageError, VerificationError
from gcs.flight.assessment.judge import Truth, Verdict, judge, load_truth
from gcs.flight.lateness import skew_s
from gcs.flight.options import FlightMode, FlightOptions
from gcs.flight.progress import Event, FlightTimes, Step, Watcher
from gcs.flight.recording.flight_folder import EventLog, TelemetryLog, new_folder, report_data, write_report
from gcs.flight.recording.flight_state import FlightState, write_flight_state
from gcs.flight.sequence.flight import FlightSequence
from gcs.flight.setup.build_loads import build_loads
from gcs.flight.setup.mission_choice import TimeKeeping, export_for_flight
from gcs.flight.setup.preflight import PreflightLimits, go_or_no_go, put_back
from gcs.flight.setup.simulator_process import SimulatorOptions, simulator
from gcs.link.connection import Connection
from gcs.link.session.linked_fleet import LinkedFleet
from gcs.link.session.vehicle_session import VehicleSession
from gcs.mission.model import SetpointStream, VehicleMission
from gcs.mission.setpoints.setpoint_stream import build_stream
from gcs.physics.quadrotor import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.plan_file import save_plan
from gcs.plan.verification.verify import Report, verify

SIM_LINK = "udpin:127.0.0.1:0"
SIM_LEAD_S = 0.2


@dataclass(frozen=True)
class Emulated:
    """How vehicles are emulated, where none are out there: the options of `sim-bridge`."""

    speedup: str = "10"
    seed: int = 0
    faults: tuple[str, ...] = ()
    wind: str | None = None  # None: the scenario's
    gusts: str | None = None


@dataclass(frozen=True)
class FlightRun:
    """Everything one flight needs to know."""

    plan: Plan
    report: Report
    keeping: TimeKeeping
    link: Connection | None = None  # None: emulated vehicles
    emulated: Emulated = field(default_factory=Emulated)
    root: Path = Path("flights")
    options: FlightOptions = field(default_factory=FlightOptions)
    safety: bool = True  # with a link: fences, rally points and parameters go along
    limits: PreflightLimits = field(default_factory=PreflightLimits)


@dataclass(frozen=True)
class Flown:
    """A flight that came to its end: what it left where, and how it was."""

    folder: Path
    times: FlightTimes
    late_s: dict[int, float]  # of each vehicle behind the plan, by its own clock
    verdict: Verdict | None  # None where nobody knows the truth
    data: dict[str, Any]  # report.json


def fly(
    plan: Plan,
    *,
    link: Connection | None = None,
    confirmed: bool = False,
    mode: str = "stream",
    follow: bool = False,
    emulated: Emulated | None = None,
    to: Path | str = "flights",
    watcher: Watcher | None = None,
) -> Flown:
    """Verify a plan, export it, upload it, read it back, fly it, and judge the flight where the truth is known.

    Vehicles are emulated unless there is a `link`; then `confirmed` says that somebody wants them armed. `mode` is
    stream (timed setpoints) or mission (the waypoints uploaded). The folder of the flight is made under `to`. Raises
    `UsageError` without confirmation, `VerificationError` for a plan that does not hold, and the errors of links,
    vehicles and flights. It runs an event loop of its own: call it in a thread where one runs already.
    """
    if link is not None and not confirmed:
        raise UsageError("vehicles on a link are armed only when somebody says so", hint="pass confirmed=True")
    report = verify(plan)
    if not report.ok:
        raise VerificationError("the plan does not hold, and is not flown.", hint="see gcs.verify(plan).failures")
    sortie = FlightRun(
        plan,
        report,
        TimeKeeping(FlightMode(mode), emulated=link is None),
        link,
        emulated or Emulated(),
        Path(to),
        FlightOptions(follow=follow),
    )
    return fly_run(sortie, watcher or Watcher())


def fly_run(sortie: FlightRun, watcher: Watcher) -> Flown:
    """Fly, judge from the truth where vehicles are emulated, and leave the folder. Raises as `fly`."""
    plan = sortie.plan
    folder = new_folder(sortie.root, plan.scenario.name, datetime.now())
    save_plan(plan, sortie.report, folder / "plan.skein")
    index, navigator = export_for_flight(plan, folder / "export", sortie.keeping, watcher.say)
    watcher.say(f"plan verified; exported {len(index.sha256)} files to {folder / 'export'}")
    watcher.lap("export")
    times, late_s = asyncio.run(_fly(sortie, watcher, folder, index.missions, navigator))
    watcher.lap("fly")
    if sortie.link is not None:
        data = {"folder": str(folder), "judged": False, **_skew(late_s)}
        return Flown(folder, times, late_s, None, data)
    truth = load_truth(folder / "truth.npz")
    verdict = judge(plan, truth, times)
    watcher.lap("judge")
    _draw(plan, truth, times, folder)
    watcher.lap("pictures")
    extra = {"mode": sortie.keeping.mode.value, "folder": str(folder), "time_s": watcher.laps_s, **_skew(late_s)}
    data = report_data(plan.scenario.name, plan.hash, times, verdict, extra)
    write_report(folder, data, verdict)
    return Flown(folder, times, late_s, verdict, data)


async def _fly(
    sortie: FlightRun, watcher: Watcher, folder: Path, missions: tuple[VehicleMission, ...], navigator: str
) -> tuple[FlightTimes, dict[int, float]]:
    """Fly; returns when what happened, and how late each vehicle flew the plan."""
    plan = sortie.plan
    lead_s = SIM_LEAD_S if sortie.link is None else 0.0
    options = replace(sortie.options, mode=sortie.keeping.mode, lead_s=lead_s)
    loop = asyncio.get_running_loop()
    fleet: LinkedFleet | None = None

    def vehicles_time_s() -> float | None:
        if fleet is None:
            return None
        now_s = loop.time()
        return max((t for s in fleet.sessions.values() if (t := s.clock.now_unix_s(now_s)) is not None), default=None)

    async with AsyncExitStack() as stack:
        log = stack.enter_context(TelemetryLog(folder / "telemetry.tlog", vehicles_time_s))
        known = sortie.link or Connection((SIM_LINK,))
        fleet = await stack.enter_async_context(known.open(on_frame=log.write))
        if sortie.link is None:
            simulated = _simulator_options(sortie, folder, fleet.local_address[1], navigator)
            await stack.enter_async_context(simulator(simulated))
        sessions = await fleet.vehicles(plan.sysids, options.find_timeout_s, systems=known.systems)
        stream = build_stream(plan, plan.scenario.mission.setpoint_rate_hz)
        events = stack.enter_context(EventLog(folder / "events.jsonl"))

        def tell(event: Event) -> None:
            events.write(event)
            watcher.say(str(event))

        def log_step(step: Step, t0_unix_s: float | None) -> None:
            book = FlightState(
                mission=plan.scenario.name,
                plan_hash=plan.hash,
                links=() if sortie.link is None else sortie.link.links,
                systems=known.systems,
                mode=sortie.keeping.mode.value,
                follow=options.follow,
                step=step.value,
                t0_unix_s=t0_unix_s,
                pid=os.getpid(),
            )
            write_flight_state(folder, book)

        flight = _flight(sortie, watcher, missions, stream, fleet, sessions, options, tell, log_step)
        showing = asyncio.ensure_future(watcher.follow(flight))
        try:
            times = await flight.run()
            return times, flight.monitor.late_s
        finally:
            showing.cancel()
            await asyncio.gather(showing, return_exceptions=True)
            if flight.held is not None:
                await put_back(sessions, flight.held.changes, watcher.say)


def _flight(
    sortie: FlightRun,
    watcher: Watcher,
    missions: tuple[VehicleMission, ...],
    stream: SetpointStream,
    fleet: LinkedFleet,
    sessions: dict[int, VehicleSession],
    options: FlightOptions,
    tell: Callable[[Event], None],
    log_step: Callable[[Step, float | None], None],
) -> FlightSequence:
    """Emulated vehicles get their missions; others everything that is exported, once they have been looked at."""
    plan = sortie.plan
    if sortie.link is None:
        return FlightSequence(plan, missions, stream, sessions, options, tell, log_step)
    autopilots = {sysid: session.autopilot for sysid, session in sessions.items()}
    loads = build_loads(plan, autopilots, timed=False, safety=sortie.safety, warn=watcher.warn)
    if sortie.keeping.mode is FlightMode.MISSION:
        _refuse_others(plan, autopilots)
        loads = tuple(replace(load, mission=mission) for load, mission in zip(loads, missions, strict=True))

    async def look() -> None:
        await go_or_no_go(fleet, sessions, plan, sortie.limits, watcher.checks)
        await watcher.confirm()

    held = [load.mission for load in loads]
    return FlightSequence(plan, held, stream, sessions, options, tell, log_step, loads=loads, on_ready=look)


def _refuse_others(plan: Plan, autopilots: dict[int, int]) -> None:
    """Missions are timed for the scenario's autopilot. Raises `PeerError` where a vehicle has another."""
    firmware = Autopilot.named(plan.scenario.mission.autopilot)
    for sysid, autopilot in autopilots.items():
        if autopilot != firmware:
            raise PeerError(
                f"vehicle {sysid} does not run {firmware.title}, for which the missions were timed.",
                hint="name its autopilot in the scenario (mission.autopilot), or fly the setpoint stream",
            )


def _simulator_options(sortie: FlightRun, folder: Path, port: int, navigator: str) -> SimulatorOptions:
    """The emulated vehicles get the scenario the plan was made from, not what the file says by now."""
    scenario = folder / "scenario.json"
    scenario.write_text(sortie.plan.scenario.model_dump_json(indent=2))
    emulated = sortie.emulated
    return SimulatorOptions(
        scenario,
        port,
        emulated.speedup,
        emulated.seed,
        log=folder / "simulator.log",
        truth=folder / "truth.npz",
        faults=emulated.faults,
        navigator=navigator,
        wind=emulated.wind,
        gusts=emulated.gusts,
    )


def _skew(late_s: dict[int, float]) -> dict[str, object]:
    """How far apart in time they started, and how late each flew the plan, in seconds; null for who never flew it."""
    skew = skew_s(late_s.values())
    late = {str(sysid): late if math.isfinite(late) else None for sysid, late in late_s.items()}
    return {"skew_s": skew if math.isfinite(skew) else None, "late_s": late}


def _draw(plan: Plan, truth: Truth, times: FlightTimes, folder: Path) -> None:
    from gcs.flight.assessment.flight_plot import draw_all  # noqa: PLC0415 (matplotlib takes long to load)

    rows = [truth.sysids.index(sysid) for sysid in plan.sysids]
    step = max(1, round(0.2 / float(np.median(np.diff(truth.unix_s)))))
    tracks = truth.states[rows, ::step, POSITION]
    draw_all(plan.scenario, plan.sysids, truth.unix_s[::step] - times.t0_unix_s, tracks, folder)
