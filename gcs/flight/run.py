"""One flight from verification to verdict: export, vehicles, flight, folder, judgement."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Mapping, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import partial
from pathlib import Path

import numpy as np

from gcs.errors import UsageError, VerificationError
from gcs.flight.assessment.judge import Tracks, Verdict, judge, judge_reports, load_truth, reported_tracks
from gcs.flight.contingency.choices import FlightMode, NavigatorChoice, TimeKeeping
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.execution.flight import FlightSequence
from gcs.flight.monitoring.fleet_time import FleetTime
from gcs.flight.monitoring.lateness import lateness_data
from gcs.flight.monitoring.monitor import Monitor
from gcs.flight.monitoring.own_battery import ChargeRule
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.flight.monitoring.preflight_check import PreflightCheck, checks_data
from gcs.flight.monitoring.progress import FlightHooks, FlightTimes, NearestPair, Step, Watcher, flown_plan_time
from gcs.flight.recording.emulation_record import EmulationRecord, write_emulation
from gcs.flight.recording.flight_folder import (
    BEFORE,
    EVENTS,
    PLAN,
    PREDICTED,
    REPORTS,
    SCENARIO,
    TRUE_STATES,
    nearest_data,
    new_folder,
    read_events,
    report_data,
)
from gcs.flight.recording.flight_record import FlightJournal
from gcs.flight.recording.flight_report import REPEAT, emulation_data, write_report
from gcs.flight.recording.flight_state import FlightState, held_folder
from gcs.flight.recording.record_gaps import needed_bytes, refuse_without_room, refusing_unwritable
from gcs.flight.recording.record_table import write_record
from gcs.flight.setup.board_before import BoardBefore
from gcs.flight.setup.build_loads import (
    PreparedFlight,
    export_for_flight,
    loads_built_aside,
    missions_only,
    refuse_other_autopilots,
    refuse_without_timed_start,
)
from gcs.flight.setup.order_socket import taking_orders
from gcs.flight.setup.preflight import confirmed_event, go_or_no_go, waived_events
from gcs.flight.setup.simulator_process import Emulated, SimulatorOptions, simulator
from gcs.flight.setup.telemetry_budget import telemetry_share
from gcs.link.protocols.mission.strategy import SentAs, sent_data, sent_words
from gcs.link.session.connection import Connection
from gcs.link.session.linked_fleet import LinkedFleet
from gcs.link.session.upload_fleet import Holdings
from gcs.link.session.vehicle_load import VehicleLoad
from gcs.link.session.vehicle_session import VehicleSession
from gcs.mission.export.index import ExportIndex
from gcs.mission.export.setpoint_stream import build_stream
from gcs.mission.model import SetpointStream
from gcs.physics.states import POSITION
from gcs.plan.plan_file import StoredReturns, write_plan
from gcs.plan.prepared_returns import PreparedReturns
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Report, verify
from gcs.plan.verification.wind_envelope import proved_everywhere
from gcs.scenario.schema.scenario import PreflightTable, Scenario
from gcs.scenario.values import si
from gcs.types import JsonObject
from gcs.util.aio import Stoppable, ended, insisted
from gcs.util.long_work import shown

Exported = tuple[ExportIndex, NavigatorChoice]
SIM_LINK = "udpin:127.0.0.1:0"
SIM_LEAD_S = 0.2
_DRAWN_S = 0.2
MIXED_FOLLOWING = (
    "the vehicles run different autopilots, whose tracking errors differ: --follow brings them no closer together. "
    "Leave --follow out"
)


@dataclass(frozen=True)
class FlightRun:
    """What is flown, how, and with which vehicles."""

    plan: Plan
    report: Report
    keeping: TimeKeeping
    link: Connection | None = None  # None: emulated vehicles
    emulated: Emulated = field(default_factory=Emulated)
    root: Path = Path("flights")
    options: FlightOptions = field(default_factory=FlightOptions)
    safety: bool = True  # with a link: fences, rally points and parameters go along
    limits: PreflightTable | None = None  # None: the scenario's
    also_to: tuple[str, ...] = ()  # `udpout:HOST:PORT` of other ground stations that watch
    exported: Exported | None = None  # of many flights of one plan: nothing is exported into the folder
    pictures: bool = True
    returns: PreparedReturns | StoredReturns | None = None  # of the plan, for an order to fly home together


@dataclass(frozen=True)
class Flown:
    """A completed flight: its folder, times and verdict."""

    folder: Path
    times: FlightTimes
    late_s: dict[int, float]  # delay of each vehicle behind the plan, by its own clock
    verdict: Verdict | None  # from true states, or from reports; None without telemetry
    data: JsonObject  # report.json
    nearest: tuple[NearestPair, ...] = ()  # as reported: the least separation before T0, on the plan and in the landing


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
    also_to: Sequence[str] = (),
    returns: PreparedReturns | None = None,
) -> Flown:
    """Verify a plan, export it, upload it, read it back, fly it, and judge the flight from true states or reports.

    Without a `link` the vehicles are emulated. With one, `confirmed` is the operator's permission to arm them. `mode`
    is stream (timed setpoints) or mission (the uploaded waypoints). The flight's folder is made under `to`. What the
    vehicles send is copied to each `udpout:HOST:PORT` of `also_to`. `returns` are those that `gcs.FlyHome` begins.
    Raises `UsageError` without confirmation, `VerificationError` for a plan that failed verification, and the errors of
    links, vehicles and flights. It runs its own event loop: call it in a thread where one runs already.
    """
    if link is not None and not confirmed:
        raise UsageError("vehicles on a link are not armed without confirmation.", hint="pass confirmed=True")
    if not (report := verify(plan)).ok:
        raise VerificationError("the plan failed verification and is not flown.", hint="see gcs.verify(plan).failures")
    order = FlightRun(
        plan,
        report,
        TimeKeeping(FlightMode(mode), emulated=link is None),
        link,
        emulated or Emulated(),
        Path(to),
        FlightOptions(follow=follow),
        also_to=tuple(also_to),
        returns=returns,
    )
    return fly_run(order, watcher or Watcher())


def fly_run(order: FlightRun, watcher: Watcher) -> Flown:
    """Fly, judge by true states (emulated vehicles) or reports (on a link), and write the folder. Raises as `fly`."""
    plan, how = order.plan, order.options
    if order.keeping.mode is FlightMode.MISSION:
        refuse_late_starts(plan.scenario)
    if (share := _telemetry_share(order)) < 1.0:
        watcher.say(
            f"telemetry at {share:.0%} of its full rate: what {len(plan.sysids)} vehicles may send over one radio"
        )
    with refusing_unwritable(order.root):
        folder = new_folder(order.root, plan.scenario.name, datetime.now())
        refuse_without_room(folder, needed_bytes(plan, emulated=order.link is None))
        write_plan(plan, order.report, folder / PLAN, order.returns)
        how.keep(folder)
        with shown(watcher.say):
            index, navigator = order.exported or export_for_flight(
                plan, order.report, folder / "export", order.keeping, watcher.say
            )
        if order.link is None:  # the emulated vehicles get the scenario that the plan was made from
            kept = EmulationRecord(order.keeping, order.emulated, how.follow, how.on_loss, how.on_leader_loss)
            write_emulation(folder, kept)
            (folder / SCENARIO).write_text(plan.scenario.model_dump_json(indent=2))
    if order.exported is None:
        watcher.say(f"plan verified; exported {len(index.sha256)} files to {folder / 'export'}")
        # Once for all checks before the flight, and before the link: it takes a second.
        watcher.say(f"wind: the plan stays proved {proved_everywhere(plan)}")
    watcher.lap("export")
    stream = build_stream(plan, plan.scenario.mission.setpoint_rate_hz)
    ctrl_c = Stoppable()
    with held_folder(folder):
        now = _LinkedFlight(order, watcher, folder, index, navigator, stream)
        flew, monitor = ctrl_c.run(now.run(ctrl_c))
    watcher.lap("fly")
    times = replace(flew, clock=flown_plan_time(flew.t0_unix_s, read_events(folder / EVENTS)))
    plan = monitor.plan  # as flown: orders may have changed it
    found = _judged_truth(now, plan, times) if order.link is None else _judged_reports(now, plan, times, watcher)
    verdict, tracks, extra = found
    extra |= {} if order.link is None else {"preflight": checks_data(now.checks)}
    watcher.lap("judge")
    gaps, late_s, nearest = now.journal.record.gaps, monitor.late_s, tuple(monitor.nearest.values())
    if tracks is not None and order.pictures:
        watcher.say("drawing the flight")
        with gaps.kept("map.png"):
            _draw(plan, tracks, folder)
    watcher.lap("pictures")
    extra |= {"mode": order.keeping.mode.value, "folder": str(folder), "missions": sent_data(now.sent)}
    extra |= {"time_s": watcher.laps_s, **lateness_data(late_s), **nearest_data(nearest, times)}
    data = report_data(plan.scenario.name, order.plan.hash, times, verdict, extra | {"incomplete": gaps.data()})
    if verdict is not None:
        with gaps.kept("report.md"):
            write_report(folder, data, verdict)
    return Flown(folder, times, late_s, verdict, data | {"incomplete": gaps.data()}, nearest)


def _telemetry_share(order: FlightRun) -> float:
    if order.link is None:
        return 1.0
    rate_hz = order.plan.scenario.mission.setpoint_rate_hz
    return telemetry_share(order.link.slowest_baud, len(order.plan.sysids), order.keeping.mode, rate_hz)


def _judged_truth(now: _LinkedFlight, plan: Plan, times: FlightTimes) -> tuple[Verdict, Tracks, JsonObject]:
    order = now.order
    truth = load_truth(now.folder / "truth.npz")
    rows = [truth.sysids.index(sysid) for sysid in plan.sysids]
    tracks = Tracks(times.plan_time.t_s(truth.unix_s), truth.states[rows][..., POSITION])
    flew = now.navigator if order.keeping.mode is FlightMode.MISSION else None  # a stream needs none
    emulation = emulation_data(plan.scenario, order.emulated)
    extra = {"judged": TRUE_STATES, "navigator": flew, "emulation": emulation, "repeat": REPEAT}
    return judge(plan, truth, times), tracks, extra


def _judged_reports(
    now: _LinkedFlight, plan: Plan, times: FlightTimes, watcher: Watcher
) -> tuple[Verdict | None, Tracks | None, JsonObject]:
    link = now.order.link
    record = write_record(now.folder, plan, times.plan_time, link.systems if link is not None else {}, watcher.say)
    tracks = reported_tracks(plan, record, times.plan_time)
    verdict = None if tracks is None else judge_reports(plan, tracks)
    return verdict, tracks, {"judged": REPORTS}


def refuse_late_starts(scenario: Scenario) -> None:
    """Raise `UsageError` for missions on board that cannot start together: known before anything is planned."""
    refuse_without_timed_start(zip(si.sysids(scenario), si.autopilots(scenario), strict=True))


class _LinkedFlight:
    """One flight whose folder and files are made. After it, `checks` are its pre-flight, `sent` how missions went."""

    def __init__(
        self,
        order: FlightRun,
        watcher: Watcher,
        folder: Path,
        exported: ExportIndex,
        navigator: NavigatorChoice,
        stream: SetpointStream,
    ) -> None:
        self.order, self._plan, self._watcher = order, order.plan, watcher
        self.folder, self._exported, self.navigator, self._stream = folder, exported, navigator, stream
        self._known = replace(order.link or Connection((SIM_LINK,)), also_to=order.also_to)
        state = FlightState(
            mission=self._plan.scenario.name,
            plan_hash=self._plan.hash,
            links=() if order.link is None else order.link.links,
            systems=self._known.systems,
            mode=order.keeping.mode.value,
            follow=order.options.follow,
            step=Step.READY.value,
            t0_unix_s=None,
            pid=os.getpid(),
            waived=tuple(sorted(order.options.waived)),
            radio_baud=self._known.radio_baud,
        )
        self.journal = FlightJournal(folder, state, watcher.say, watcher.warn, note=watcher.event)
        self.checks: tuple[PreflightCheck, ...] = ()
        self.sent: Mapping[int, SentAs] = {}
        self._loaded: tuple[VehicleLoad, ...] = ()
        kept, say = self.journal.record.gaps.kept, self.journal.say
        self._before = BoardBefore(folder / BEFORE, self._plan.hash, kept, say)

    async def run(self, ctrl_c: Stoppable) -> tuple[FlightTimes, Monitor]:
        """Fly, and restore what was changed on board, however the flight ends."""
        plan, order, journal, systems = self._plan, self.order, self.journal, self._known.systems
        async with AsyncExitStack() as stack:
            stack.enter_context(journal.record)
            emulated = simulator(self._simulated()) if order.link is None else None
            fleet = await stack.enter_async_context(
                self._known.open(journal.on_frame, vehicles=plan.sysids, on_notice=journal.on_notice, emulated=emulated)
            )
            journal.keep_time(FleetTime(fleet.sessions, [systems.get(sysid, sysid) for sysid in plan.sysids]))
            sessions = await fleet.vehicles(plan.sysids, order.options.find_timeout_s, systems=systems)
            flight = await self._flight(fleet, sessions)
            ctrl_c.again_calls(flight.landing.report_airborne)
            await stack.enter_async_context(taking_orders(flight, self.folder, journal.say))
            showing = asyncio.ensure_future(self._show(flight))
            try:
                times = await flight.run()
                return times, flight.monitor
            finally:
                await ended(showing)
                if flight.held is not None:
                    await insisted(self._before.give_back(sessions))
                elif flight.step is Step.UPLOAD:
                    self._before.say_how_to_restore()

    def _simulated(self) -> SimulatorOptions:
        log, truth = self.folder / "simulator.log", self.folder / "truth.npz"
        return SimulatorOptions(self.folder / SCENARIO, self.order.emulated, log, truth, self.navigator)

    async def _show(self, flight: FlightSequence) -> None:
        try:
            await self._watcher.follow(flight)
        except Exception as failure:
            self.journal.say(f"WARNING: the flight goes on without its display: {type(failure).__name__}: {failure}")

    def _note_sent(self, held: Holdings) -> None:
        self.sent = held.sent_as
        self._before.uploaded(held)
        self.journal.on_sent(held.sent_as)
        self.journal.say(f"missions read back and equal; {sent_words(held.sent_as)}")

    async def _flight(self, fleet: LinkedFleet, sessions: dict[int, VehicleSession]) -> FlightSequence:
        """The flight of emulated vehicles with their missions, or of vehicles on a link with all their loads."""
        order, plan, exported = self.order, self._plan, self._exported
        autopilots = {sysid: session.autopilot for sysid, session in sessions.items()}
        if order.options.follow and len(set(autopilots.values())) > 1:
            self._watcher.warn(MIXED_FOLLOWING)
        self._loaded = missions_only(exported.missions) if order.link is None else await self._loads(autopilots)
        flown = replace(
            order.options,
            mode=order.keeping.mode,
            lead_s=SIM_LEAD_S if order.link is None else 0.0,
            telemetry_share=_telemetry_share(order),
            watched_elsewhere=bool(order.also_to),
        )
        prepared = PreparedFlight(
            self._loaded,
            self._stream,
            exported.safety.returns if exported.autopilots == tuple(map(autopilots.get, plan.sysids)) else None,
            self._noted_tracks(),
            self.folder,
        )
        hooks = FlightHooks(
            self.journal.on_event, self.journal.on_step, partial(self._get_ready, fleet, sessions), self._note_sent
        )
        return FlightSequence(plan, sessions, flown, prepared, hooks)

    def _noted_tracks(self) -> PredictedTracks | None:
        tracks = self._tracks()
        if tracks is not None:
            with self.journal.record.gaps.kept(PREDICTED):
                tracks.save(self.folder / PREDICTED)
        return tracks

    def _tracks(self) -> PredictedTracks | None:
        """The tracks of missions on board: by the model of the autopilot, or the plan's own; None: not predicted."""
        exported = self._exported
        if self.order.keeping.mode is FlightMode.STREAM:
            return None
        if self.navigator is NavigatorChoice.IDEAL:
            return PredictedTracks.of_plan(self._plan)
        if exported.report is None or exported.timing is None:
            return None
        return PredictedTracks.of_missions(self._plan, exported.missions, exported.report)

    async def _loads(self, autopilots: Mapping[int, int]) -> tuple[VehicleLoad, ...]:
        order, plan = self.order, self._plan
        if order.keeping.mode is FlightMode.MISSION:
            rows = [(sysid, autopilots[sysid]) for sysid in plan.sysids]
            refuse_without_timed_start(rows)  # first: the scenario may name no autopilot, and has the default then
            refuse_other_autopilots(plan, (number for _, number in rows))
        warn, exported = self._watcher.warn, self._exported
        stream = order.keeping.mode is FlightMode.STREAM
        return await loads_built_aside(
            plan, autopilots, timed=False, safety=order.safety, warn=warn, exported=exported, stream=stream
        )

    async def _get_ready(self, fleet: LinkedFleet, sessions: dict[int, VehicleSession]) -> ChargeRule | None:
        order, plan, watcher, charge = self.order, self._plan, self._watcher, None
        if order.link is not None:
            limits, waived = order.limits or plan.scenario.preflight, order.options.waived
            timed = self._loaded if order.keeping.mode is FlightMode.MISSION else ()
            self.checks, charge = await go_or_no_go(fleet, sessions, plan, limits, watcher, waived, timed)
            for event in waived_events(self.checks, sessions):
                self.journal.on_event(event)
            await self._before.read(sessions, self._loaded)
            self.journal.on_event(confirmed_event(await watcher.confirm(), sessions))
        fleet.check()
        fleet.freeze()
        return charge


def _draw(plan: Plan, tracks: Tracks, folder: Path) -> None:
    from gcs.flight.plots.flight_plot import draw_all  # noqa: PLC0415 (matplotlib takes long to load)

    step = max(1, round(_DRAWN_S / float(np.median(np.diff(tracks.t_s)))))
    draw_all(plan, tracks.t_s[::step], tracks.ned_m[:, ::step], folder)
