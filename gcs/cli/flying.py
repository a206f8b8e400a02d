"""One flight from the command line: its folder, its vehicles, its display, its verdict.

Knows: what to open and close around a flight, and how to show it. Does not know: how it is flown or judged.
"""

from __future__ import annotations

import asyncio
import math
import os
from collections.abc import Callable
from contextlib import AsyncExitStack, nullcontext
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

import numpy as np
from rich.live import Live
from rich.table import Table

from gcs.autopilot import Autopilot
from gcs.cli.console import Screen
from gcs.cli.going import go_or_no_go, put_back
from gcs.cli.link_options import Connection
from gcs.cli.missions_flown import TimeKeeping, export_for_flight
from gcs.cli.planning import Stopwatch
from gcs.errors import JudgementError, PeerError
from gcs.flight.events import Event
from gcs.flight.fly import Flight
from gcs.flight.journal import EventLog, TelemetryLog, asked, new_folder, report_data, write_report
from gcs.flight.judge import Verdict, judge
from gcs.flight.lateness import skew_s
from gcs.flight.loading import build_loads
from gcs.flight.logbook import Logbook, write_logbook
from gcs.flight.options import FlightMode, FlightOptions
from gcs.flight.preflight import PreflightLimits
from gcs.flight.simulator import SimulatorOptions, simulator
from gcs.flight.stages import FlightTimes, Snapshot, Step
from gcs.flight.truth import Truth, load_truth
from gcs.link.fleet import Direction, Fleet
from gcs.link.session import VehicleSession
from gcs.mission.model import SetpointStream, VehicleMission
from gcs.mission.setpoints import build_stream
from gcs.plan.store import save_plan
from gcs.plan.trajectory import Plan
from gcs.plan.verify import Report
from gcs.quadrotor import POSITION

SIM_LINK = "udpin:127.0.0.1:0"
SIM_LEAD_S = 0.2
_REFRESH_S = 0.25
_LINE_EVERY_S = 5.0


@dataclass(frozen=True)
class FlyRequest:
    """Everything one flight needs to know."""

    plan: Plan
    report: Report
    keeping: TimeKeeping
    link: Connection | None  # None: emulated vehicles
    speedup: str
    seed: int
    faults: tuple[str, ...]
    root: Path
    screen: Screen
    watch: Stopwatch
    options: FlightOptions = field(default_factory=FlightOptions)
    safety: bool = True  # with a link: fences, rally points and parameters go along


def fly_and_judge(request: FlyRequest) -> int:
    """Fly, judge from the truth, leave the folder; raises JudgementError when the flight does not hold."""
    plan, screen, watch = request.plan, request.screen, request.watch
    folder = new_folder(request.root, plan.scenario.name, datetime.now())
    save_plan(plan, request.report, folder / "plan.skein")
    index, navigator = export_for_flight(plan, folder / "export", request.keeping, screen)
    screen.say(f"plan verified; exported {len(index.sha256)} files to {folder / 'export'}")
    watch.lap("export")
    times, late_s = asyncio.run(_fly(request, folder, index.missions, navigator))
    watch.lap("fly")
    if request.link is not None:
        screen.say(f"landed. Telemetry: {folder / 'telemetry.tlog'}")
        if (said := _together(late_s)) is not None:
            screen.say(f"apart in time by their own clocks: {said}")
        screen.result({"folder": folder, "judged": False, **_skew(late_s)})
        return 0
    truth = load_truth(folder / "truth.npz")
    verdict = judge(plan, truth, times)
    watch.lap("judge")
    _draw(plan, truth, times, folder)
    watch.lap("pictures")
    extra = {"mode": request.keeping.mode.value, "folder": str(folder), "time_s": watch.laps_s, **_skew(late_s)}
    data = report_data(plan.scenario.name, plan.hash, times, verdict, extra)
    write_report(folder, data, verdict)
    _show(screen, verdict, late_s, folder)
    screen.say(f"time: {watch}")
    screen.result(data)
    if verdict.ok:
        return 0
    broken = "; ".join(f"{c.name} {c.value:.3f} {c.unit}, {asked(c)}" for c in verdict.criteria if not c.ok)
    failure = JudgementError(f"the flight did not hold: {broken}", hint=f"see {folder / 'report.md'} and its pictures")
    if screen.json:
        return failure.exit_code
    raise failure


async def _fly(
    request: FlyRequest, folder: Path, missions: tuple[VehicleMission, ...], navigator: str
) -> tuple[FlightTimes, dict[int, float]]:
    """Fly; returns when what happened, and how late each vehicle flew the plan."""
    plan = request.plan
    lead_s = SIM_LEAD_S if request.link is None else 0.0
    options = replace(request.options, mode=request.keeping.mode, lead_s=lead_s)
    loop = asyncio.get_running_loop()
    fleet: Fleet | None = None

    def vehicles_time_s() -> float | None:
        if fleet is None:
            return None
        now_s = loop.time()
        return max((t for s in fleet.sessions.values() if (t := s.clock.now_unix_s(now_s)) is not None), default=None)

    async with AsyncExitStack() as stack:
        log = stack.enter_context(TelemetryLog(folder / "telemetry.tlog", vehicles_time_s))

        def note(direction: Direction, frame: bytes) -> None:
            log.write(direction, frame)

        known = request.link or Connection((SIM_LINK,))
        fleet = await stack.enter_async_context(known.open(on_frame=note))
        if request.link is None:
            simulated = _simulator_options(request, folder, fleet.local_address[1], navigator)
            await stack.enter_async_context(simulator(simulated))
        sessions = await fleet.vehicles(plan.sysids, options.find_timeout_s, systems=known.systems)
        stream = build_stream(plan, plan.scenario.mission.setpoint_rate_hz)
        events = stack.enter_context(EventLog(folder / "events.jsonl"))

        def tell(event: Event) -> None:
            events.write(event)
            request.screen.say(str(event))

        def log_step(step: Step, t0_unix_s: float | None) -> None:
            book = Logbook(
                mission=plan.scenario.name,
                plan_hash=plan.hash,
                links=() if request.link is None else request.link.links,
                systems=known.systems,
                mode=request.keeping.mode.value,
                follow=options.follow,
                step=step.value,
                t0_unix_s=t0_unix_s,
                pid=os.getpid(),
            )
            write_logbook(folder, book)

        flight = _flight(request, missions, stream, fleet, sessions, options, tell, log_step)
        showing = asyncio.ensure_future(_show_live(request.screen, flight))
        try:
            times = await flight.run()
            return times, flight.monitor.late_s
        finally:
            showing.cancel()
            await asyncio.gather(showing, return_exceptions=True)
            if flight.held is not None:
                await put_back(request.screen, sessions, flight.held.changes)


def _flight(
    request: FlyRequest,
    missions: tuple[VehicleMission, ...],
    stream: SetpointStream,
    fleet: Fleet,
    sessions: dict[int, VehicleSession],
    options: FlightOptions,
    tell: Callable[[Event], None],
    log_step: Callable[[Step, float | None], None],
) -> Flight:
    """Emulated vehicles get their missions; others everything that is exported, once they have been looked at."""
    plan = request.plan
    if request.link is None:
        return Flight(plan, missions, stream, sessions, options, tell, log_step)
    autopilots = {sysid: session.autopilot for sysid, session in sessions.items()}
    loads = build_loads(plan, autopilots, timed=False, safety=request.safety)
    if request.keeping.mode is FlightMode.MISSION:
        _refuse_others(plan, autopilots)
        loads = tuple(replace(load, mission=mission) for load, mission in zip(loads, missions, strict=True))

    async def look() -> None:
        await go_or_no_go(request.screen, fleet, sessions, plan, PreflightLimits())

    held = [load.mission for load in loads]
    return Flight(plan, held, stream, sessions, options, tell, log_step, loads=loads, on_ready=look)


def _refuse_others(plan: Plan, autopilots: dict[int, int]) -> None:
    """Missions are timed for the scenario's autopilot. Raises `PeerError` where a vehicle has another."""
    firmware = Autopilot.named(plan.scenario.mission.autopilot)
    for sysid, autopilot in autopilots.items():
        if autopilot != firmware:
            raise PeerError(
                f"vehicle {sysid} does not run {firmware.title}, for which the missions were timed.",
                hint="name its autopilot in the scenario (mission.autopilot), or fly the setpoint stream",
            )


def _simulator_options(request: FlyRequest, folder: Path, port: int, navigator: str) -> SimulatorOptions:
    """The emulated vehicles get the scenario the plan was made from, not what the file says by now."""
    scenario = folder / "scenario.json"
    scenario.write_text(request.plan.scenario.model_dump_json(indent=2))
    return SimulatorOptions(
        scenario,
        port,
        request.speedup,
        request.seed,
        log=folder / "simulator.log",
        truth=folder / "truth.npz",
        faults=request.faults,
        navigator=navigator,
    )


async def _show_live(screen: Screen, flight: Flight) -> None:
    """A table that redraws where somebody watches, else a line now and then."""
    live = Live(console=screen.console, refresh_per_second=4, transient=True) if screen.is_watched else None
    with live or nullcontext():
        last_line = ""
        due_s = 0.0
        while True:
            snapshot = flight.snapshot()
            if live is not None:
                live.update(_table(snapshot))
            else:
                now_s = asyncio.get_running_loop().time()
                if snapshot.phase != last_line or now_s >= due_s:
                    last_line, due_s = snapshot.phase, now_s + _LINE_EVERY_S
                    screen.say(_line(snapshot))
            await asyncio.sleep(_REFRESH_S)


def _line(snapshot: Snapshot) -> str:
    if snapshot.plan_time_s is None:
        return snapshot.phase
    worst = max((e for e in snapshot.errors_m.values() if not math.isnan(e)), default=math.nan)
    figures = (
        ("position error at most", worst),
        ("shape off by", snapshot.formation_error_m),
        ("separation", snapshot.separation_m),
    )
    known = (f"{name} {metres:.2f} m" for name, metres in figures if not math.isnan(metres))
    return ", ".join((f"{snapshot.phase}: t = {snapshot.plan_time_s:.0f} s ({snapshot.progress:.0%})", *known))


def _table(snapshot: Snapshot) -> Table:
    bar = "█" * round(30 * snapshot.progress)
    time_text = "" if snapshot.plan_time_s is None else f"  t = {snapshot.plan_time_s:.0f} s"
    separation = "" if math.isnan(snapshot.separation_m) else f"  separation {snapshot.separation_m:.2f} m"
    off = "" if math.isnan(snapshot.formation_error_m) else f"  shape off by {snapshot.formation_error_m:.2f} m"
    table = Table("vehicle", "armed", "position error", "link", title=f"{snapshot.phase}{time_text}{separation}{off}")
    table.caption = f"{bar:░<30} {snapshot.progress:.0%}"
    for sysid, error in snapshot.errors_m.items():
        error_text = "–" if math.isnan(error) else f"{error:.3f} m"
        age = snapshot.link_age_s[sysid]
        table.add_row(str(sysid), "yes" if snapshot.armed[sysid] else "no", error_text, f"{age:.1f} s ago")
    return table


def _skew(late_s: dict[int, float]) -> dict[str, object]:
    """How far apart in time they started, and how late each flew the plan, in seconds; null for who never flew it."""
    skew = skew_s(late_s.values())
    late = {str(sysid): late if math.isfinite(late) else None for sysid, late in late_s.items()}
    return {"skew_s": skew if math.isfinite(skew) else None, "late_s": late}


def _together(late_s: dict[int, float]) -> str | None:
    """The skew for people: "0.004 s (vehicles 2 and 3)"; None for a lone vehicle, or where nobody flew."""
    known = {sysid: late for sysid, late in late_s.items() if math.isfinite(late)}
    if len(known) < 2:
        return None
    first, last = sorted((min(known, key=known.__getitem__), max(known, key=known.__getitem__)))
    return f"{skew_s(known.values()):.3f} s (vehicles {first} and {last})"


def _show(screen: Screen, verdict: Verdict, late_s: dict[int, float], folder: Path) -> None:
    table = Table("criterion", "flown", "asked", "holds", title="judged from the true states")
    for c in verdict.criteria:
        who = "" if c.sysid is None else f" (vehicle {c.sysid})"
        table.add_row(c.name, f"{c.value:.3f} {c.unit}{who}", asked(c), "yes" if c.ok else "NO")
    if (said := _together(late_s)) is not None:
        table.add_row("apart in time, as told", said, "–", "–")
    screen.show(table)
    screen.say(f"formation's shape off by at most {verdict.formation_error_m:.3f} m (Definition 1)")
    screen.say(f"flight {'held' if verdict.ok else 'NOT held'}. Report and pictures: {folder}")


def _draw(plan: Plan, truth: Truth, times: FlightTimes, folder: Path) -> None:
    from gcs.flight.pictures import draw_all

    rows = [truth.sysids.index(sysid) for sysid in plan.sysids]
    step = max(1, round(0.2 / float(np.median(np.diff(truth.unix_s)))))
    tracks = truth.states[rows, ::step, POSITION]
    draw_all(plan.scenario, plan.sysids, truth.unix_s[::step] - times.t0_unix_s, tracks, folder)
