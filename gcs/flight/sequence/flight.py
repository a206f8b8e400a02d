"""The sequence of one flight: upload, read back, arm, take off, fly from a common T0, land.

No vehicle is armed before all of them have their own mission of this plan, read back equal. If the flight ends early,
for whatever reason, the vehicles in the air are ordered to land.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from gcs.aio import alongside, each, ended, insisted, until
from gcs.autopilots.flight_modes import autopilot_name, flight_behaviour
from gcs.autopilots.traits import Autopilot
from gcs.errors import FlightError, GcsError, PeerError, ProtocolMisuse
from gcs.flight.contingency.executor import ContingencyExecutor
from gcs.flight.contingency.policy import State
from gcs.flight.expected_motion import landing_profiles
from gcs.flight.monitor import Monitor
from gcs.flight.offboard.streamer import Streamer
from gcs.flight.options import FlightMode, FlightOptions
from gcs.flight.orders.fleet_landing import FleetLanding
from gcs.flight.orders.order_book import StandingOrder
from gcs.flight.progress import Event, FlightTimes, Snapshot, Step
from gcs.flight.sequence.common_start import CommonStart
from gcs.flight.sequence.fleet_time import FleetTime
from gcs.flight.sequence.link_watch import watch_links
from gcs.flight.sequence.resume import FADE_S, NEAR_M, Resume, where_in_plan
from gcs.flight.sequence.takeoff_landing import (
    FlightVehicle,
    expected_landings,
    request_telemetry,
    start_mission,
    take_off,
    until_hovering,
    until_ready,
)
from gcs.flight.sequence.text_watch import TextWatch
from gcs.flight.setup.preflight_check import MESSAGES
from gcs.link.fleet_upload.upload_fleet import Holdings, upload_fleet
from gcs.link.fleet_upload.vehicle_load import VehicleLoad
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message
from gcs.mission.failsafe.rtl_altitudes import ReturnPlan, plan_returns
from gcs.mission.model import SetpointStream
from gcs.own_process import in_own_process
from gcs.plan.trajectory.energy import BatteryModel, battery_model
from gcs.plan.trajectory.plan import Plan

T = TypeVar("T")
_FEW = 12  # vehicles


def _ignore(*_: object) -> None:
    pass


@dataclass(frozen=True)
class FlightHooks:
    """What is called during a flight. `on_ready` may raise to stop it before the upload."""

    on_event: Callable[[Event], None] = _ignore
    on_step: Callable[[Step, float | None], None] = _ignore  # the step begun, and T0 once it is known
    on_ready: Callable[[], Awaitable[None]] | None = None


class FlightSequence:
    """One plan flown once by the vehicles of `sessions` (by system id). Raises PeerError for unknown autopilots."""

    def __init__(
        self,
        plan: Plan,
        sessions: dict[int, VehicleSession],
        options: FlightOptions,
        *,
        loads: Sequence[VehicleLoad],
        stream: SetpointStream,
        returns: ReturnPlan | None = None,
        hooks: FlightHooks | None = None,
    ) -> None:
        """`returns`: those of the export for the vehicles' autopilot; None: they are planned before take-off."""
        self.plan = plan
        self.loads = tuple(loads)
        self.held: Holdings | None = None
        self._returns = returns
        self._hooks = hooks or FlightHooks()
        self.sessions = sessions
        self.options = options
        self.monitor = Monitor(plan, landing_profiles({sysid: s.autopilot for sysid, s in sessions.items()}))
        self.step = Step.READY
        self.vehicles = {
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
        self._texts = TextWatch(sessions, self.monitor, self._hooks.on_event)
        self.streamer = Streamer(plan, stream, self.vehicles, self.time, options)
        self._leaving_s = self.loads[0].mission.leaves_s
        self._start: CommonStart | None = None
        self._contingency: ContingencyExecutor | None = None
        self.landing = FleetLanding(
            self.vehicles,
            self.streamer,
            options,
            lambda: self._contingency.policy.states if self._contingency else {},
            self._tell_failure,
            self._tell,
        )

    @property
    def contingency(self) -> ContingencyExecutor:
        """The contingency policy at work; it exists from the upload on."""
        assert self._contingency is not None
        return self._contingency

    async def run(self) -> FlightTimes:
        """Fly. Raises PeerError (refusals, silence), FlightError (lost in flight), after ordering vehicles to land."""
        return await self._guarded(self._run())

    async def resume(self, what: Resume, t0_unix_s: float | None) -> float | None:
        """Continue a flight that another process began and left; return T0. Raises as `run` does.

        `t0_unix_s` is the T0 of that process, None if it had none yet.
        """
        return await self._guarded(self._resume(what, t0_unix_s))

    async def _guarded(self, flying: Coroutine[Any, Any, T]) -> T:
        stops = [self._texts.start(), *(self.listen(vehicle) for vehicle in self.vehicles.values())]
        watch = asyncio.ensure_future(watch_links(self.sessions, lambda: self.step, self.options.lost_after_s))
        work = asyncio.ensure_future(flying)
        try:
            done, _ = await asyncio.wait({watch, work}, return_when=asyncio.FIRST_COMPLETED)
            if watch in done:
                watch.result()
            return await work
        except (GcsError, asyncio.CancelledError) as stopped:
            work.cancel()
            self.landing.send_once(arming=self.step is Step.TAKEOFF)  # before a second Ctrl-C can come in between
            await insisted(self._end_and_land(work))
            self.landing.raise_failed_orders(stopped)
            raise
        finally:
            await ended(watch)
            await self.landing.orders.close()
            for stop in stops:
                stop()

    def snapshot(self) -> Snapshot:
        """Return how the flight stands now, for display."""
        t_s = self.monitor.plan_time_s
        span = self.plan.t_end_s - self.plan.t_start_s
        progress = 0.0 if t_s is None else min(max((t_s - self.plan.t_start_s) / span, 0.0), 1.0)
        return Snapshot(
            self.step.value,
            1.0 if self.step is Step.DONE else progress,
            t_s,
            self.monitor.errors_m,
            {sysid: s.heartbeat_age_s() for sysid, s in self.sessions.items()},
            {sysid: s.armed for sysid, s in self.sessions.items()},
            self.monitor.separation_m(),
            self.monitor.formation_error_m(),
        )

    async def _run(self) -> FlightTimes:
        self._check_mode()
        await self._each(request_telemetry)
        self._enter(Step.READY)
        await self._each(until_ready)
        if self._hooks.on_ready is not None:
            await self._hooks.on_ready()
        self._enter(Step.UPLOAD)
        if self.options.mode is FlightMode.MISSION:
            ahead_s = self.options.start_after_takeoff_s + 2.0 * self.plan.phase("takeoff").duration_s
            self._start = CommonStart(self.sessions, self.time, self.loads, ahead_s)
            self.loads = self._start.loads
        self.held = await upload_fleet(self.sessions, self.loads, self.plan.hash)
        self.held.require(self.plan.hash, self.plan.sysids)
        self.monitor.expect_landings(await expected_landings(self.vehicles.values()))
        texts_end_unix_s = self.time.sure_s() + self.options.texts_after_upload_s
        self._contingency = await self._make_contingency()
        await self.time.until(texts_end_unix_s)
        self._refuse_critical_texts()
        self._enter(Step.TAKEOFF)
        self.contingency.starts()
        async with alongside(self.contingency.run()):
            await self._each(lambda vehicle: take_off(vehicle, self._refuse_critical_texts))
            await self._each(until_hovering)
            airborne_unix_s = self.time.sure_s()
            self._enter(Step.FLY)
            fly = self._fly_stream if self.options.mode is FlightMode.STREAM else self._fly_missions
            t0_unix_s = await fly()
        self._enter_done()
        landing_unix_s = t0_unix_s + self.plan.phase("landing").start_s
        self._raise_troubles()
        return FlightTimes(airborne_unix_s, t0_unix_s, landing_unix_s)

    def _refuse_critical_texts(self, sysid: int | None = None) -> None:
        if MESSAGES not in self.options.waived:
            self._texts.refuse(sysid)

    async def _resume(self, what: Resume, t0_unix_s: float | None) -> float | None:
        await self._each(request_telemetry)
        await self._each(until_ready)
        await until(self._all_positions_known, self.options.find_timeout_s, "a position of every vehicle")
        self._contingency = await self._make_contingency()
        if what is Resume.LAND or (what is Resume.RESUME and not any(s.armed for s in self.sessions.values())):
            self._enter(Step.LAND)
            await self.landing.land_all()
            self._enter_done()
            self.landing.raise_failed_orders()
            return t0_unix_s
        if what is Resume.RESUME and self.options.mode is FlightMode.MISSION and t0_unix_s is not None:
            self.streamer.stand_by(t0_unix_s)
            t0_new_s = t0_unix_s
        else:
            where = where_in_plan(self.plan, np.array([v.view.position_ned_m for v in self.vehicles.values()]))
            if what is Resume.RESUME and where.off_m > NEAR_M:
                raise FlightError(
                    f"the vehicles are too far from the plan: at t = {where.t_s:.0f} s, the nearest instant, one is "
                    f"{where.off_m:.1f} m off (limit {NEAR_M:g} m).",
                    hint="attach with --land or --return",
                )
            t0_new_s = self.streamer.continue_plan(where.t_s, FADE_S if what is Resume.RESUME else None)
        async with alongside(self.streamer.run()):
            if what is Resume.RESUME and self.options.mode is FlightMode.STREAM:
                await self._each(self.streamer.obey)
            self._enter(Step.FLY)
            async with alongside(self.contingency.run()):
                await self._watch_over(t0_new_s, return_all=what is Resume.RETURN)
        self._enter_done()
        self.landing.raise_failed_orders()
        if what is Resume.RESUME:
            self._raise_troubles()
        return t0_new_s

    def _all_positions_known(self) -> bool:
        return all(np.isfinite(v.view.position_ned_m).all() for v in self.vehicles.values())

    def _enter(self, step: Step) -> None:
        self.step = step
        self._hooks.on_step(step, self.monitor.t0_unix_s)

    def _enter_done(self) -> None:
        """The flight is over. Only vehicles that said so count as landed."""
        if not self.landing.not_landed():
            self._enter(Step.DONE)

    async def _make_contingency(self) -> ContingencyExecutor:
        returns = self._returns
        if returns is None:
            each = tuple(Autopilot(self.vehicles[sysid].session.autopilot) for sysid in self.plan.sysids)
            returns = await in_own_process(plan_returns, self.plan, each)
        return ContingencyExecutor(
            plan=self.plan,
            vehicles=self.vehicles,
            monitor=self.monitor,
            streamer=self.streamer,
            time=self.time,
            returns=returns,
            model=await self._battery_model(),
            carrier=self.landing.orders,
            options=self.options,
            on_event=self._hooks.on_event,
        )

    async def _battery_model(self) -> BatteryModel:
        """A large fleet's takes seconds, in which heartbeats would wait."""
        if len(self.plan.sysids) > _FEW:
            return await in_own_process(battery_model, self.plan)
        return battery_model(self.plan)

    def _check_mode(self) -> None:
        late = [v for v in self.vehicles.values() if not v.behaviour.waits_for_time_of_day]
        if self.options.mode is FlightMode.MISSION and late:
            named = ", ".join(f"vehicle {v.sysid} ({autopilot_name(v.session.autopilot)})" for v in late)
            raise PeerError(
                f"missions cannot start together: a mission cannot wait until a time of day on {named}.",
                hint="fly with --mode stream, which keeps all vehicles on time",
            )

    async def _fly_stream(self) -> float:
        """Stream setpoints to all vehicles from one T0; return T0."""
        async with alongside(self.streamer.run()):
            t0_unix_s = await self.streamer.begin()
            await self._watch_over(t0_unix_s)
        return t0_unix_s

    async def _watch_over(self, t0_unix_s: float, *, return_all: bool = False) -> None:
        """Watch the flight from T0 until all vehicles have landed; the streamer runs beside it."""
        self.monitor.t0_unix_s = t0_unix_s
        self.contingency.flies()
        self._enter(self.step)
        if return_all:
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
        if self.options.mode is FlightMode.STREAM:
            for vehicle in self.vehicles.values():
                if self.contingency.policy.states[vehicle.sysid] is State.FLYING:
                    self.landing.order(vehicle, planned=True)
        await self.landing.until_landed()

    def _tell_failure(self, order: StandingOrder) -> None:
        if self._contingency is not None:
            self._contingency.tell_failure(order)
            return
        self._tell(order.sysid, f"did not {order.what}", order.reason)

    def _tell(self, sysid: int, what: str, rule: str) -> None:
        now_s = self.time.now_s() or 0.0
        self._hooks.on_event(Event(now_s, now_s - (self.monitor.t0_unix_s or now_s), sysid, what, rule))

    def _raise_troubles(self) -> None:
        """Raises FlightError if a vehicle did not fly the plan to its end."""
        self.landing.raise_failed_orders()
        troubles = self.contingency.policy.troubles
        if troubles:
            words = "; ".join(self.contingency.describe(incident) for incident in troubles)
            raise FlightError(
                f"the flight did not complete the plan: {words}.",
                hint="see events.jsonl in the flight's folder for incidents and orders",
            )

    async def _fly_missions(self) -> float:
        """Agree on a start, switch all vehicles to their missions, which wait in the hover for it; return T0."""
        start, held = self._start, self.held
        if start is None or held is None:
            raise ProtocolMisuse("missions were to be flown before they were uploaded.")
        said: list[str] = []
        self.held = held = await start.bring_forward(held, said.append)
        self.loads = start.loads
        held.require(self.plan.hash, self.plan.sysids)
        t0_unix_s = start.unix_s - self._leaving_s
        now_s = self.time.sure_s()
        for what in said:
            self._hooks.on_event(Event(now_s, now_s - t0_unix_s, 0, what))
        await self._each(start_mission)
        late_s = self.time.sure_s() - start.unix_s
        if late_s > 0:
            raise FlightError(
                f"the common start was missed by {late_s:.1f} s: not all vehicles were airborne in time.",
                hint="fly again; a slow link needs more time between upload and start",
            )
        self.streamer.stand_by(t0_unix_s)
        async with alongside(self.streamer.run()):
            await self._watch_over(t0_unix_s)
        return t0_unix_s

    async def _each(self, action: Callable[[FlightVehicle], Awaitable[object]]) -> None:
        await each(self.vehicles.values(), action)

    def listen(self, vehicle: FlightVehicle) -> Callable[[], None]:
        """Monitor a vehicle's position reports until the returned function is called."""

        def receive(message: Message) -> None:
            if message.name == "LOCAL_POSITION_NED":
                self.monitor.receive(vehicle.row, message, vehicle.session.clock)
                self.streamer.wake()

        return vehicle.session.subscribe(receive)

    async def _end_and_land(self, work: asyncio.Future[Any]) -> None:
        await ended(work)
        await self.landing.land_all(arming=self.step is Step.TAKEOFF)
