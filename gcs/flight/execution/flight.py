"""The sequence of one flight: upload, read back, arm, take off, fly from a common T0, land.

No vehicle is armed before all of them have their own mission of this plan, read back equal. If the flight ends early,
for whatever reason, the vehicles in the air are ordered to land.
"""

import asyncio
import math
from collections.abc import Callable, Collection
from functools import partial

from gcs.autopilots.traits import Autopilot, flight_behaviour
from gcs.errors import FlightError, PeerError, ProtocolMisuse
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.contingency.order_book import StandingOrder
from gcs.flight.contingency.policy import State
from gcs.flight.execution.common_start import CommonStart
from gcs.flight.execution.executor import ContingencyExecutor
from gcs.flight.execution.fleet_arming import arm_all, climb_to_hover
from gcs.flight.execution.fleet_landing import FleetLanding, named
from gcs.flight.execution.flight_guard import FlightGuard
from gcs.flight.execution.hover_charge import check_hover, model_of
from gcs.flight.execution.order_carrier import FlyingFleet
from gcs.flight.execution.parameter_watch import watch_parameters
from gcs.flight.execution.plan_orders import PlanOrders
from gcs.flight.execution.scenario_events import ScenarioEvents
from gcs.flight.execution.streamer import Streamer
from gcs.flight.execution.takeoff_landing import (
    FlightVehicle,
    expected_landings,
    lacks,
    request_telemetry,
    start_mission,
    until_ready,
)
from gcs.flight.execution.telemetry_watch import TelemetryWatch
from gcs.flight.execution.text_watch import TextWatch
from gcs.flight.monitoring.completion import Completion
from gcs.flight.monitoring.fleet_time import FleetTime
from gcs.flight.monitoring.monitor import Monitor
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.flight.monitoring.preflight_check import CheckName
from gcs.flight.monitoring.progress import (
    ALL_VEHICLES,
    Action,
    AskedOrder,
    Event,
    FlightHooks,
    FlightTimes,
    OrderForecast,
    PlanForecast,
    Snapshot,
    Step,
    VehicleNow,
)
from gcs.flight.monitoring.reported_now import ReportedNow
from gcs.flight.setup.build_loads import PreparedFlight, refuse_without_timed_start
from gcs.flight.setup.own_process import in_own_process
from gcs.link.session.upload_fleet import Holdings, upload_fleet
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message
from gcs.mission.returns.rtl_altitudes import plan_returns
from gcs.plan.formation_orders import PlanOrder
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.util.aio import T, Work, alongside, each, ended

_HEARD_S = 2.0  # since its last HEARTBEAT: what it reports is new


class FlightSequence:
    """One plan flown once by the vehicles of `sessions` (by system id). Raises PeerError for unknown autopilots."""

    def __init__(
        self,
        plan: Plan,
        sessions: dict[int, VehicleSession],
        options: FlightOptions,
        prepared: PreparedFlight,
        hooks: FlightHooks | None = None,
    ) -> None:
        self.loads = prepared.loads
        self.held: Holdings | None = None
        self._prepared = prepared
        self._hooks = (hooks or FlightHooks()).spared()
        self.sessions, self.options = sessions, options
        self.monitor = Monitor(plan, autopilots={sysid: session.autopilot for sysid, session in sessions.items()})
        self.completion, self.step = Completion(plan), Step.READY
        views = self.monitor.views
        kinds = {i: flight_behaviour(i, sessions[i].autopilot, sessions[i].kind) for i in plan.sysids}
        self.vehicles = {
            i: FlightVehicle(sessions[i], kinds[i], plan, row, views[i], options) for row, i in enumerate(plan.sysids)
        }
        self._reported = ReportedNow(sessions, self.monitor)
        self.time = FleetTime(sessions)
        self._texts = TextWatch(sessions, self.monitor, self._hooks.on_event)
        self.streamer = Streamer(plan, prepared.stream, self.vehicles, self.time, options)
        self._leaving_s = self.loads[0].mission.leaves_s
        self._start: CommonStart | None = None
        self._contingency: ContingencyExecutor | None = None
        self._changes: PlanOrders | None = None
        self._fleet = FlyingFleet(self.vehicles, self.monitor, self.streamer, self.time, options, prepared.tracks)
        self.landing = FleetLanding(
            self._fleet,
            lambda: self._contingency.policy.states if self._contingency else {},
            self._report_failure,
            self._report,
        )
        self._telemetry = TelemetryWatch(self.vehicles, self.landing.custody, self._report)
        self._guard = FlightGuard(
            sessions, self.landing, lambda: self.step, options.lost_after_s, self._report, self._ends_early
        )

    @property
    def plan(self) -> Plan:
        """The plan as it is flown; an order may change it."""
        return self.monitor.plan

    @property
    def predicted(self) -> PredictedTracks | None:
        """The predicted tracks of missions on board; None: nothing is predicted."""
        return self._prepared.tracks

    @property
    def contingency(self) -> ContingencyExecutor:
        """The contingency policy at work; it exists from the upload on."""
        assert self._contingency is not None
        return self._contingency

    async def run(self) -> FlightTimes:
        """Fly. Raises PeerError (refusals, silence), FlightError (lost in flight), after ordering vehicles to land."""
        return await self.guarded(self._run())

    async def guarded(self, flying: Work[T]) -> T:
        """Return what `flying` returns; if it fails, the vehicles land first."""
        stops = [self._texts.start(), watch_parameters(self.sessions, self.loads, self._report)]
        stops += map(self.listen, self.vehicles.values())
        try:
            return await self._guard.run(self._watched(flying))
        finally:
            for stop in stops:
                stop()

    async def _watched(self, flying: Work[T]) -> T:
        async with alongside(self._telemetry.run()):
            return await flying

    def snapshot(self) -> Snapshot:
        """Return how the flight stands now, for display."""
        left = self.landing.of_pilots() if self.step is Step.LAND else []
        lack = {sysid: lacks(session) for sysid, session in self.sessions.items()} if self.step is Step.READY else {}
        words = f"{named(left)} flown by a pilot" if left else self.step.value
        return self._reported.snapshot(words, self.time.now_s(), lack, is_done=self.step is Step.DONE)

    def vehicles_now(self) -> tuple[VehicleNow, ...]:
        """Return every vehicle as it reports itself now, for display."""
        return self._reported.vehicles(None if self._contingency is None else self._contingency.positions.in_band)

    def ground_margins_m(self, sysids: Collection[int]) -> dict[int, float]:
        """Return the distance of vehicles to the ground in any direction, up to `GROUND_REACH_M`; NaN if not known."""
        return self._reported.ground_margins_m(sysids)

    def ask(
        self, order: AskedOrder | PlanOrder, vehicles: Collection[int] = (), *, by: str = "the program"
    ) -> tuple[int, ...]:
        """Give an order of the operator to vehicles; none named: to all. Return those that obey; `events.jsonl` has it.

        The policy decides as on incidents. A `PlanOrder` is for all, and planned from now on: `answer` returns what
        came of it. Raises FlightError with the reason where no vehicle would obey.
        """
        if isinstance(order, AskedOrder):
            return self._asked().ask(order, vehicles, by)
        if vehicles:
            raise FlightError("a new plan is for the whole formation.", hint="name no vehicles")
        return self._changing().ask(order, by)

    async def answer(self) -> str:
        """Return what came of the last `PlanOrder`, in words. Raises FlightError for a refused one."""
        return await self._changing().answer()

    async def propose(self, order: PlanOrder) -> PlanForecast:
        """Return what an order that changes the plan would lead to; nobody flies it. Raises as `ask` and `answer`."""
        return await self._changing().propose(order)

    def _changing(self) -> PlanOrders:
        if self._changes is None:
            raise FlightError("the plan changes between T0 and the landing only.", hint="order hold, return or land")
        return self._changes

    def forecast(self, order: AskedOrder, vehicles: Collection[int] = ()) -> OrderForecast:
        """Return what an order would do now. Raises as `ask` does."""
        return self._asked().forecast(order, vehicles)

    def _asked(self) -> ContingencyExecutor:
        if self._contingency is None:
            raise FlightError("before the take-off no order is taken.", hint="Ctrl-C ends the flight")
        return self._contingency

    def listen(self, vehicle: FlightVehicle) -> Callable[[], None]:
        """Monitor a vehicle's position reports until the returned function is called."""

        def receive(message: Message) -> None:
            if message.name == "LOCAL_POSITION_NED":
                self.completion.receive(vehicle.sysid, message.fields["time_boot_ms"], armed=vehicle.session.armed)
                self.monitor.receive(vehicle.row, message, vehicle.session.clock)
                self.streamer.wake()

        return vehicle.session.subscribe(receive)

    async def _run(self) -> FlightTimes:
        if self.options.mode is FlightMode.MISSION:
            refuse_without_timed_start(((sysid, v.session.autopilot) for sysid, v in self.vehicles.items()), PeerError)
        await each(self.vehicles.values(), request_telemetry)
        self.enter(Step.READY)
        await each(self.vehicles.values(), until_ready)
        self._telemetry.refuse_reboots()
        charge = None if self._hooks.on_ready is None else await self._hooks.on_ready()
        self.landing.custody.refuse_armed()
        self.enter(Step.UPLOAD)
        if self.options.mode is FlightMode.MISSION:
            ahead_s = self.options.start_after_takeoff_s + 2.0 * self.plan.phase(PhaseKind.TAKEOFF).duration_s
            self._start = CommonStart(self.sessions, self.time, self.loads, ahead_s)
            self.loads = self._start.loads
        self.held = await upload_fleet(self.sessions, self.loads, self.plan.hash)
        self.held.require(self.plan.hash, self.plan.sysids)
        self.monitor.expect_landings(await expected_landings(self.vehicles.values()))
        texts_end_unix_s = self.time.sure_s() + self.options.texts_after_upload_s
        await self.prepare_contingency()
        await self.time.until(texts_end_unix_s)
        self._refuse_critical_texts()
        if self.options.mode is FlightMode.MISSION or CheckName.CLOCK not in self.options.waived:
            await self.time.agree()
        self.landing.custody.refuse_armed()
        self._hooks.on_read_back(self.held)
        self.enter(Step.TAKEOFF)
        self.contingency.starts()
        async with alongside(self.contingency.run()):
            await arm_all(self.vehicles, self.landing.custody, self._refuse_arming)
            await each(self.vehicles.values(), partial(climb_to_hover, landing=self.landing))
            await self.contingency.operator.until_start()
            if charge is not None:
                await check_hover(self._fleet, self.contingency.charge, charge, self._report)
            airborne_unix_s = self.time.sure_s()
            self.enter(Step.FLY)
            t0_unix_s = await (self._fly_stream if self.options.mode is FlightMode.STREAM else self._fly_missions)()
        self.enter_done()
        landing_unix_s = t0_unix_s + self.plan.landing_s
        self.raise_troubles()
        return FlightTimes(airborne_unix_s, t0_unix_s, landing_unix_s)

    def _refuse_arming(self) -> None:
        self._refuse_critical_texts()
        self._telemetry.refuse_stale()

    def _refuse_critical_texts(self) -> None:
        if CheckName.MESSAGES not in self.options.waived:
            self._texts.refuse()

    def resume_in_air(self) -> None:
        """Another process brought the vehicles into the air: a silent one does not end the flight."""
        self.step = Step.FLY

    def enter(self, step: Step) -> None:
        """A step of the flight begins."""
        self.step = step
        self._hooks.on_step(step, self.monitor.t0_unix_s)

    def enter_done(self) -> None:
        """The flight is over. Only vehicles that said so count as landed."""
        if not self.landing.not_landed():
            self.enter(Step.DONE)

    async def prepare_contingency(self) -> None:
        """Make the contingency policy ready, once the vehicles' clocks and autopilots are known."""
        returns = self._prepared.returns
        if returns is None:
            kinds = tuple(Autopilot(self.vehicles[sysid].session.autopilot) for sysid in self.plan.sysids)
            returns = await in_own_process(plan_returns, self.plan, kinds)
        model = await model_of(self.plan)
        self._contingency = ContingencyExecutor(self._fleet, self.landing.orders, returns, model, self._hooks.on_event)

    async def _fly_stream(self) -> float:
        async with alongside(self.streamer.run()):
            t0_unix_s = await self.streamer.begin()
            await self.watch_over(t0_unix_s)
        return t0_unix_s if self.monitor.t0_unix_s is None else self.monitor.t0_unix_s

    async def watch_over(self, t0_unix_s: float, *, return_all: bool = False) -> None:
        """Watch the flight from T0 until all vehicles have landed; the streamer runs beside it."""
        self.monitor.set_t0(t0_unix_s)
        self.contingency.flies()
        self.completion.begins(self.time.sure_s() - t0_unix_s)
        self.enter(self.step)
        if return_all:
            self.ask(AskedOrder.RETURN, by="gcs attach")
        self._changes = PlanOrders(
            self._fleet, self.contingency, self._prepared.folder, self._hooks.on_event, self._follow
        )
        async with alongside(self._changes.run()), alongside(ScenarioEvents(self, self.sessions).run()):
            broke_off = await self._fly_to_landing()
        self._changes = None
        heard = [i for i in self._on_plan() if self.sessions[i].silent_s() < _HEARD_S]
        self.completion.lands(heard, broke_off=broke_off)
        self.enter(Step.LAND)
        self.contingency.landing()
        if self.options.mode is FlightMode.STREAM:
            for sysid in self._on_plan():
                self.landing.order(self.vehicles[sysid], planned=True)
        await self.landing.until_landed()

    def _follow(self, plan: Plan) -> None:
        """The vehicles fly another plan from an instant ahead on; until then it is the same."""
        self.monitor.follow(plan)
        self.completion.follow(plan)
        self.contingency.follow(plan)

    async def _fly_to_landing(self) -> bool:
        """Wait until the plan's landing; return whether no vehicle flew it so far."""
        over = asyncio.ensure_future(self.contingency.over.wait())
        planned = asyncio.ensure_future(self._until_landing())
        try:
            await asyncio.wait({over, planned}, return_when=asyncio.FIRST_COMPLETED)
            for done in (over, planned):
                if done.done():
                    done.result()
            return not planned.done()
        finally:
            await ended(over, planned)

    def _on_plan(self) -> list[int]:
        return [i for i, state in self.contingency.policy.states.items() if state is State.FLYING]

    async def _until_landing(self) -> None:
        """Wait until the plan's landing; T0 may move, and the plan waits while vehicles are led back to it."""
        t0_unix_s = self.monitor.t0_s
        while self.contingency.waits or self.time.sure_s() < self.monitor.t0_s + self.plan.landing_s:
            if self.monitor.t0_s != t0_unix_s:
                t0_unix_s = self.monitor.t0_s
                self.enter(self.step)
            await self.time.comes_to(t0_unix_s + self.plan.landing_s)

    def _report_failure(self, order: StandingOrder) -> None:
        if self._contingency is not None:
            self._contingency.report_failure(order)
            return
        self._report(order.sysid, f"did not {order.what}", order.reason)

    def _report(self, sysid: int, what: str, rule: str, action: Action | None = None, *, alarm: bool = False) -> None:
        try:
            now_s = self.time.now_s() or 0.0
        except Exception:  # the reports of a landing must not need the clocks
            now_s = 0.0
        t_s = now_s - (self.monitor.t0_unix_s or math.nan)
        self._hooks.on_event(Event(now_s, t_s, sysid, what, rule, action=action, alarm=alarm))

    def _ends_early(self, reason: str) -> None:
        if self._contingency is not None:
            self._contingency.rest()
        self.monitor.watch_formation(())  # nobody flies the plan any more
        self.enter(Step.LAND)
        self._report(ALL_VEHICLES, "ordered to land where they are", reason, Action.LAND)

    def raise_troubles(self) -> None:
        """Raises FlightError if a vehicle did not fly the plan to its end."""
        self.landing.raise_failed_orders()
        words = [self.contingency.describe(incident) for incident in self.contingency.policy.troubles]
        words += self.contingency.operator.ended
        words = words or self.completion.missing({i: self.monitor.views[i] for i in self._on_plan()})
        if words:
            raise FlightError(
                f"the flight did not complete the plan: {'; '.join(words)}.",
                hint="see events.jsonl in the flight's folder for incidents and orders",
            )

    async def _fly_missions(self) -> float:
        """Agree on a start, switch all vehicles to their missions, which wait in the hover for it; return T0."""
        start, held = self._start, self.held
        if start is None or held is None:
            raise ProtocolMisuse("missions were to be flown before they were uploaded.")
        self.held, what = await start.bring_forward(held)
        self.loads = start.loads
        self.held.require(self.plan.hash, self.plan.sysids)
        t0_unix_s = start.unix_s - self._leaving_s
        now_s = self.time.sure_s()
        self._hooks.on_event(Event(now_s, now_s - t0_unix_s, ALL_VEHICLES, what))
        async with alongside(self.time.watch_start(start.unix_s)):
            await each(self.vehicles.values(), start_mission)
            start.refuse_missed()
            self.streamer.stand_by(t0_unix_s)
            async with alongside(self.streamer.run()):
                await self.watch_over(t0_unix_s)
        return t0_unix_s
