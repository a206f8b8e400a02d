"""One flight, from silent vehicles to landed ones: upload, read back, arm, take off, keep time together, land.

Knows: the order of things and what must be true before each. Does not know: sockets, screens, files, how vehicles
are found (`gcs.link.session.linked_fleet`) or judged (`gcs.flight.assessment.judge`), how each step is done
(`prologue`, `pilot`). Nothing arms before every vehicle holds its own mission of this plan, read back equal. Whatever
ends the flight early, vehicles in the air are told to land.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Coroutine, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from gcs.aio import LOOK_S, alongside, each, ended, insisted, until
from gcs.autopilots.flight_modes import autopilot_name, flight_behaviour
from gcs.autopilots.traits import Autopilot
from gcs.errors import FlightError, GcsError, PeerError
from gcs.flight.contingency.executor import ContingencyExecutor
from gcs.flight.contingency.policy import State
from gcs.flight.monitor import Monitor
from gcs.flight.offboard.streamer import Streamer
from gcs.flight.options import FlightMode, FlightOptions
from gcs.flight.progress import Event, FlightTimes, Snapshot, Step
from gcs.flight.sequence.fleet_time import FleetTime
from gcs.flight.sequence.resume import FADE_S, NEAR_M, Resume, where_in_plan
from gcs.flight.sequence.takeoff_landing import (
    FlightVehicle,
    ask_for_telemetry,
    set_mode,
    start_mission,
    take_off,
    until_hovering,
    until_landed,
    until_ready,
)
from gcs.flight.setup.build_loads import missions_only
from gcs.link.fleet_upload.upload_fleet import Holdings, upload_fleet
from gcs.link.fleet_upload.vehicle_load import VehicleLoad
from gcs.link.microservices.command import CommandSender
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message
from gcs.mavlink import MavCommand
from gcs.mission.failsafe.rtl_altitudes import ReturnPlan, plan_returns
from gcs.mission.model import SetpointStream, VehicleMission
from gcs.mission.waypoints.mission_items import starting_at
from gcs.plan.trajectory.plan import Plan

T = TypeVar("T")


class FlightSequence:
    """One plan flown once by the vehicles of `sessions` (by system id). Raises PeerError for unknown autopilots."""

    def __init__(
        self,
        plan: Plan,
        missions: Iterable[VehicleMission],
        stream: SetpointStream,
        sessions: dict[int, VehicleSession],
        options: FlightOptions,
        on_event: Callable[[Event], None] = lambda event: None,
        on_step: Callable[[Step, float | None], None] = lambda step, t0_unix_s: None,
        *,
        loads: Sequence[VehicleLoad] | None = None,
        on_ready: Callable[[], Awaitable[None]] | None = None,
    ) -> None:
        """`loads` bring fences, rally points and parameters along; `on_ready` may refuse to go on to the upload."""
        self.plan = plan
        self.missions = {m.sysid: m for m in missions}
        self.loads = tuple(loads or missions_only(self.missions.values()))
        self.held: Holdings | None = None
        self._on_ready = on_ready
        self.sessions = sessions
        self.options = options
        self.monitor = Monitor(plan)
        self.step = Step.READY
        self.crews = {
            sysid: FlightVehicle(
                sessions[sysid],
                flight_behaviour(sysid, sessions[sysid].autopilot),
                plan,
                row,
                self.monitor.views[sysid],
                options,
            )
            for row, sysid in enumerate(plan.sysids)
        }
        self.time = FleetTime(sessions)
        self.pilot = Streamer(plan, stream, self.crews, self.time, options)
        self._leaving_s = next(iter(self.missions.values())).leaves_s
        self._start_unix_s = 0
        self._on_event = on_event
        self._on_step = on_step

    async def run(self) -> FlightTimes:
        """Fly. Raises PeerError (refusals, silence), FlightError (lost in flight); vehicles aloft are landed first."""
        return await self._guarded(self._run())

    async def take_up(self, what: Resume, t0_unix_s: float | None) -> float | None:
        """Go on with a flight that another process began and left; returns T0. Raises as `run` does.

        `t0_unix_s` is that of the process that began, None if it had none yet.
        """
        return await self._guarded(self._take_up(what, t0_unix_s))

    async def _guarded(self, flying: Coroutine[Any, Any, T]) -> T:
        stops = [self.listen(crew) for crew in self.crews.values()]
        watch = asyncio.ensure_future(self._watch_links())
        work = asyncio.ensure_future(flying)
        try:
            done, _ = await asyncio.wait({watch, work}, return_when=asyncio.FIRST_COMPLETED)
            if watch in done:
                watch.result()
            return await work
        except (GcsError, asyncio.CancelledError):
            work.cancel()
            self._say_land()  # before an impatient second Ctrl-C can come in between
            await insisted(self._end_and_land(work))
            raise
        finally:
            await ended(watch)
            for stop in stops:
                stop()

    def snapshot(self) -> Snapshot:
        """The flight now, for people to see."""
        t_s = self.monitor.plan_time_s
        span = self.plan.t_end_s - self.plan.t_start_s
        progress = 0.0 if t_s is None else min(max((t_s - self.plan.t_start_s) / span, 0.0), 1.0)
        return Snapshot(
            self.step.value,
            1.0 if self.step is Step.DONE else progress,
            t_s,
            {sysid: view.error_m for sysid, view in self.monitor.views.items()},
            {sysid: s.heartbeat_age_s() for sysid, s in self.sessions.items()},
            {sysid: s.armed for sysid, s in self.sessions.items()},
            self.monitor.separation_m(),
            self.monitor.formation_error_m(),
        )

    async def _run(self) -> FlightTimes:
        self._check_mode()
        await self._each(ask_for_telemetry)
        self._enter(Step.READY)
        await self._each(until_ready)
        if self._on_ready is not None:
            await self._on_ready()
        self._enter(Step.UPLOAD)
        if self.options.mode is FlightMode.MISSION:
            self._set_common_start()
        loads = [replace(load, mission=self.missions[load.sysid]) for load in self.loads]
        self.held = await upload_fleet(self.sessions, loads, self.plan.hash)
        self.held.require(self.plan.hash, self.plan.sysids)
        self.contingency = await self._contingency()
        self._enter(Step.TAKEOFF)
        await self._each(take_off)
        await self._each(until_hovering)
        airborne_unix_s = self.time.sure_s()
        self._enter(Step.FLY)
        fly = self._fly_stream if self.options.mode is FlightMode.STREAM else self._fly_missions
        t0_unix_s = await fly()
        self._enter(Step.DONE)
        landing_unix_s = t0_unix_s + self.plan.phase("landing").start_s
        self._tell_troubles()
        return FlightTimes(airborne_unix_s, t0_unix_s, landing_unix_s)

    async def _take_up(self, what: Resume, t0_unix_s: float | None) -> float | None:
        await self._each(ask_for_telemetry)
        await self._each(until_ready)
        await until(self._everybody_told, self.options.find_timeout_s, "a position of every vehicle")
        self.contingency = await self._contingency()
        if what is Resume.LAND or (what is Resume.RESUME and not any(s.armed for s in self.sessions.values())):
            self._enter(Step.LAND)
            await self._each(self._land)
            await self._each(until_landed)
            self._enter(Step.DONE)
            return t0_unix_s
        if what is Resume.RESUME and self.options.mode is FlightMode.MISSION and t0_unix_s is not None:
            self.pilot.stand_by(t0_unix_s)
            go_on = [t0_unix_s]
        else:
            where = where_in_plan(self.plan, np.array([c.view.position_ned_m for c in self.crews.values()]))
            if what is Resume.RESUME and where.off_m > NEAR_M:
                raise FlightError(
                    f"the formation is not where the plan ever has it: at its nearest, t = {where.t_s:.0f} s, somebody"
                    f" is {where.off_m:.1f} m off.",
                    hint="let it --land or --return",
                )
            go_on = [self.pilot.go_on(where.t_s, FADE_S if what is Resume.RESUME else None)]
        async with alongside(self.pilot.run()):
            if what is Resume.RESUME and self.options.mode is FlightMode.STREAM:
                await self._each(self.pilot.obey)
            self._enter(Step.FLY)
            await self._watch_over(go_on[0], everybody_home=what is Resume.RETURN)
        self._enter(Step.DONE)
        if what is Resume.RESUME:
            self._tell_troubles()
        return go_on[0]

    def _everybody_told(self) -> bool:
        return all(np.isfinite(c.view.position_ned_m).all() for c in self.crews.values())

    def _enter(self, step: Step) -> None:
        self.step = step
        self._on_step(step, self.monitor.t0_unix_s)

    async def _contingency(self) -> ContingencyExecutor:
        returns = await self._returns()
        return ContingencyExecutor(
            self.plan, self.crews, self.monitor, self.pilot, self.time, returns, self.options, self._on_event
        )

    def _check_mode(self) -> None:
        late = [c.sysid for c in self.crews.values() if not c.behaviour.waits_for_time_of_day]
        if self.options.mode is FlightMode.MISSION and late:
            raise PeerError(
                f"missions on {autopilot_name(self.crews[late[0]].session.autopilot)} (vehicle {late[0]}) cannot start"
                " together: it cannot wait until a time of day.",
                hint="fly it with --mode stream",
            )

    async def _fly_stream(self) -> float:
        """Send every vehicle its setpoints, all timed from one T0; returns T0."""
        async with alongside(self.pilot.run()):
            t0_unix_s = await self.pilot.begin()
            await self._watch_over(t0_unix_s)
        return t0_unix_s

    async def _watch_over(self, t0_unix_s: float, *, everybody_home: bool = False) -> None:
        """From T0 known to everybody down, with eyes open; the pilot goes on beside it."""
        self.monitor.t0_unix_s = t0_unix_s
        self._enter(self.step)
        async with alongside(self.contingency.run()):
            if everybody_home:
                self.contingency.return_all()
            over = asyncio.ensure_future(self.contingency.over.wait())
            planned = asyncio.ensure_future(self.time.until(t0_unix_s + self.plan.phase("landing").start_s))
            try:
                await asyncio.wait({over, planned}, return_when=asyncio.FIRST_COMPLETED)
            finally:
                await ended(over)
                await ended(planned)
            self._enter(Step.LAND)
            self.contingency.landing()
            landing = [c for c in self.crews.values() if self.contingency.policy.states[c.sysid] is State.FLYING]
            if self.options.mode is FlightMode.STREAM:
                await each(landing, self._land)
            await each(landing, until_landed)
            await self._until_all_are_down()

    async def _land(self, crew: FlightVehicle) -> None:
        await set_mode(crew, crew.behaviour.land)
        self.pilot.leave(crew.sysid)

    async def _until_all_are_down(self) -> None:
        """Wait for those who left the formation as well, as long as they are heard and a return may take."""
        end_unix_s = self.time.sure_s() + self.contingency.longest_return_s()
        while any(
            c.session.armed and self.contingency.policy.states[c.sysid] not in (State.LOST, State.SILENT)
            for c in self.crews.values()
        ):
            if self.time.sure_s() > end_unix_s:
                break
            await asyncio.sleep(LOOK_S)

    def _tell_troubles(self) -> None:
        """Raises FlightError when somebody did not fly the plan to its end."""
        troubles = self.contingency.policy.troubles
        if troubles:
            words = "; ".join(self.contingency.words(incident) for incident in troubles)
            raise FlightError(
                f"not everybody flew the plan to its end: {words}.",
                hint="events.jsonl in the flight's folder says what was done",
            )

    def _set_common_start(self) -> None:
        """Missions leave the hover at one GNSS second, far enough ahead to upload, arm and take off before it."""
        takeoff = self.plan.phase("takeoff")
        ahead_s = self.options.start_after_takeoff_s + 2.0 * (takeoff.end_s - takeoff.start_s)
        self._start_unix_s = math.ceil(self.time.sure_s() + ahead_s)
        self.missions = {i: starting_at(m, self._start_unix_s) for i, m in self.missions.items()}

    async def _fly_missions(self) -> float:
        """Switch all to their missions, which wait in the hover for the common start; returns T0."""
        await self._each(start_mission)
        late_s = self.time.sure_s() - self._start_unix_s
        if late_s > 0:
            raise FlightError(
                f"the common start was missed by {late_s:.1f} s: not everyone was in the air and ready in time.",
                hint="start again; a slow link needs more time between upload and start",
            )
        t0_unix_s = self._start_unix_s - self._leaving_s
        self.pilot.stand_by(t0_unix_s)
        async with alongside(self.pilot.run()):
            await self._watch_over(t0_unix_s)
        return t0_unix_s

    async def _returns(self) -> ReturnPlan:
        """How everybody would come home: the same heights that the export verified."""
        firmware = Autopilot(next(iter(self.crews.values())).session.autopilot)
        return await asyncio.to_thread(plan_returns, self.plan, firmware)

    async def _each(self, action: Callable[[FlightVehicle], Awaitable[object]]) -> None:
        await each(self.crews.values(), action)

    def listen(self, crew: FlightVehicle) -> Callable[[], None]:
        """Take in what a vehicle tells of its place, until the result is called."""

        def receive(message: Message) -> None:
            if message.name == "LOCAL_POSITION_NED":
                self.monitor.receive(crew.row, message, crew.session.clock)
                self.pilot.wake()

        return crew.session.subscribe(receive)

    async def _watch_links(self) -> None:
        """Raises FlightError as soon as a vehicle, once the formation flies everybody, has been silent for too long."""
        while True:
            await asyncio.sleep(LOOK_S)
            silent = {s.sysid: s.heartbeat_age_s() for s in self.sessions.values()}
            lost = [sysid for sysid, silent_s in silent.items() if silent_s > self.options.lost_after_s]
            if self.step in (Step.FLY, Step.LAND) and len(lost) < len(silent):
                continue  # that is for the rules
            if lost:
                who = f"vehicle {lost[0]} was" if len(lost) == 1 else f"vehicles {', '.join(map(str, lost))} were"
                raise FlightError(
                    f"{who} lost ({self.step.value}): no heartbeat for {silent[lost[0]]:.1f} s.",
                    hint="the others were told to land; look for it where the last telemetry puts it",
                )

    def _perhaps_aloft(self) -> list[FlightVehicle]:
        """Who is not heard may still hear; who was told to arm may be in the air before its heartbeat says so."""
        return [c for c in self.crews.values() if c.session.armed or self.step is Step.TAKEOFF]

    def _say_land(self) -> None:
        """Once, at once, to everybody, without waiting for an answer."""
        now_s = asyncio.get_running_loop().time()
        for crew in self._perhaps_aloft():
            land = crew.behaviour.mode_parameters(crew.behaviour.land)
            command = CommandSender(MavCommand.DO_SET_MODE, land, crew.session.station, me=crew.session.me)
            for message in command.start(now_s):
                crew.session.send(message)

    async def _end_and_land(self, work: asyncio.Future[Any]) -> None:
        await ended(work)

        async def land(crew: FlightVehicle) -> None:
            with suppress(GcsError):
                await crew.session.command(MavCommand.DO_SET_MODE, *crew.behaviour.mode_parameters(crew.behaviour.land))

        await each(self._perhaps_aloft(), land)
