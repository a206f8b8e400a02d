"""Detects incidents during a flight and carries out the orders of the contingency policy."""

import asyncio
import itertools
import math
from collections.abc import Awaitable, Callable, Collection
from dataclasses import replace
from functools import partial

import numpy as np

from gcs.autopilots.columns import FailsafeCause
from gcs.errors import FlightError
from gcs.flight.contingency.choices import Choices, FlightMode
from gcs.flight.contingency.decisions import ContingencyPolicy
from gcs.flight.contingency.detection import Incident, IncidentKind, VehicleWatch
from gcs.flight.contingency.energy_choice import ChargeWatch, EnergyAdviser, EnergyChoice, SafePoint
from gcs.flight.contingency.manoeuvres import MotionReference, OrderedTracks, WayBack
from gcs.flight.contingency.order_book import StandingOrder
from gcs.flight.contingency.policy import AIRBORNE, IN_FORMATION, NOT_OBEYED_AFTER, Order, State
from gcs.flight.execution.operator_orders import OperatorOrders
from gcs.flight.execution.order_carrier import FlyingFleet, OrderCarrier, hurried
from gcs.flight.execution.position_checks import PositionChecks
from gcs.flight.execution.standstill import Standstill
from gcs.flight.execution.takeoff_landing import FlightVehicle
from gcs.flight.monitoring.progress import Action, AskedOrder, Event, OrderForecast
from gcs.link.wire.message import Message
from gcs.mission.returns.rtl_altitudes import ReturnPlan
from gcs.plan.trajectory.energy import BatteryModel
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import NoFlyZone
from gcs.types import Array

_PERIOD_S = 0.1  # of fleet time between two checks
_STAMPED_S = 0.005  # local time in which many messages get one stamp
_ALARMS = frozenset(
    {
        IncidentKind.ALARM,
        IncidentKind.OUTSIDE_VOLUME,
        IncidentKind.DOWN,
        IncidentKind.MOTORS_STOPPED,
        IncidentKind.BATTERY_LOW,
    }
    | {IncidentKind.BATTERY_CRITICAL}
)


class ContingencyExecutor:
    """Watches a flight from take-off to landing. `over` is set once no vehicle flies the plan any more.

    `charge` follows the batteries.
    """

    def __init__(
        self,
        fleet: FlyingFleet,
        carrier: OrderCarrier,
        returns: ReturnPlan,
        model: BatteryModel,
        on_event: Callable[[Event], None],
    ) -> None:
        plan, options = fleet.plan, fleet.options
        self.policy = ContingencyPolicy(
            plan.sysids,
            plan.sysids[plan.leader],
            Choices(options.on_loss, options.on_leader_loss, options.follow, options.mode is FlightMode.MISSION),
        )
        self.over = asyncio.Event()
        self._fleet = fleet
        self._options, self._vehicles = options, fleet.vehicles
        self._monitor, self._streamer, self._time = fleet.monitor, fleet.streamer, fleet.time
        self._loop = asyncio.get_running_loop()
        self._on_event = on_event
        self.positions = PositionChecks(fleet, self.policy)
        self._watches = {
            sysid: VehicleWatch(sysid, one.behaviour, options.limits, math.inf, self._plan_modes(one))
            for sysid, one in fleet.vehicles.items()
        }
        self._now_s = self._stamped_s = -math.inf  # fleet time, and the local time at which it was computed
        self._returning: dict[int, WayBack] = {}
        self._carrier = carrier
        self.charge = ChargeWatch(
            plan, EnergyAdviser(plan, model, returns, self._way_m, self._monitor.expected.profiles)
        )
        self._chosen: dict[int, EnergyChoice] = {}  # the last choice at a low battery
        self._tracks = OrderedTracks(plan, returns, self._chosen)
        self._heading: dict[int, SafePoint] = {}  # where returning vehicles fly to
        self._standstill = Standstill(fleet, self._tracks, self.policy, carrier)
        self.operator = OperatorOrders(fleet, self.policy, self._standstill, self.charge, self._watches)
        self._reported: set[tuple[int, IncidentKind]] = set()
        self._began_s = math.nan
        self._rests = False

    @property
    def _plan(self) -> Plan:
        return self._fleet.plan

    def follow(self, plan: Plan) -> None:
        """The vehicles fly another plan from an instant ahead on."""
        self.positions.follow(plan)
        self._tracks.follow(plan, self.charge.returns)

    def avoid(self, zones: tuple[NoFlyZone, ...]) -> None:
        """Zones that came up count for every way back from now on."""
        self._tracks.avoid(zones)

    def return_from(self, plan: Plan, returns: ReturnPlan, model: BatteryModel) -> None:
        """Use these returns and energy needs of the flown plan; computing them takes longer than planning."""
        self._tracks.follow(plan, returns)
        self.charge.follow(plan, model, returns)

    def _plan_modes(self, vehicle: FlightVehicle) -> frozenset[int]:
        m = vehicle.behaviour
        return frozenset({m.guided} if self._options.mode is FlightMode.STREAM else {m.mission, m.guided})

    def starts(self) -> None:
        """The vehicles take off: in trouble they land on their pads, and `run` raises FlightError."""
        self.policy.begin(starting=True)
        for vehicle in self._vehicles.values():
            m = vehicle.behaviour
            vehicle.view.stands_on(self._plan.pads_ned_m[vehicle.row])
            self._watches[vehicle.sysid].order(m.armed_in, m.guided, m.mission, *m.takeoff_modes)

    def flies(self) -> None:
        """T0 is known: from now on the vehicles fly the plan."""
        self.policy.begin(starting=False)
        for vehicle in self._vehicles.values():
            self._watches[vehicle.sysid].obey_only(self._plan_modes(vehicle))

    async def run(self) -> None:
        """Detect, decide and order until cancelled. Raises FlightError for trouble before T0."""
        self._time.hold()
        began_s = self._now_s = self._began_s = self._time.sure_s()
        stops = [
            vehicle.session.subscribe(self._listener(self._watches[vehicle.sysid]))
            for vehicle in self._vehicles.values()
        ]
        for sysid, watch in self._watches.items():
            watch.begin(began_s, self._vehicles[sysid].session.custom_mode)
        checked_s = began_s
        try:
            while True:
                await self._time.comes_to(-math.inf if self._standstill.open else checked_s + _PERIOD_S)
                now_s = self._stamp()
                starting = State.STARTING in self.policy.states.values()
                if self._rests:
                    await asyncio.Event().wait()  # until cancelled
                if self._standstill.reads(checked_s):
                    continue
                if now_s is not None and now_s - checked_s >= _PERIOD_S and (starting or self._t0_known):
                    checked_s = now_s
                    self._report_clocks(now_s)
                    self._check(now_s, self._plan_time_s(now_s))
                    if starting and (why := self._why_aborted()):
                        raise FlightError(
                            f"the start was aborted: {why}.",
                            hint="see events.jsonl in the flight's folder for incidents and orders",
                        )
        finally:
            for stop in stops:
                stop()

    def _why_aborted(self) -> str:
        troubles = self.policy.troubles
        return self.describe(troubles[0]) if troubles else self.operator.aborted

    def rest(self) -> None:
        """Detect and order nothing more: the flight ends early, and its guard lands the vehicles."""
        self._rests = True

    def never_heard(self, sysid: int) -> None:
        """A vehicle was lost before this process began: no order for it, and none for the others because of it."""
        self.policy.never_heard(sysid)
        self._watches[sysid].never_heard()

    def ask(self, order: AskedOrder, sysids: Collection[int], by: str) -> tuple[int, ...]:
        """Give an order of the operator. Raises FlightError where no vehicle would obey."""
        return self.operator.ask(order, sysids, by, self._time.sure_s(), self._on_event, self._carry_out)

    def ranks_stay_open(self) -> None:
        """No plan without a lost vehicle was found: the others are ordered what the policy says."""
        now_s = self._time.sure_s()
        for order in self.policy.ranks_stay_open(now_s):
            self._carry_out(order, self._plan_time_s(now_s))

    def forecast(self, order: AskedOrder, sysids: Collection[int]) -> OrderForecast:
        """Return what an order of the operator would do. Raises as `ask` does."""
        return self.operator.forecast(order, sysids, self._time.sure_s())

    @property
    def waits(self) -> bool:
        """Whether the plan waits: this program stood still, or the operator ordered all vehicles to hold."""
        held = State.WAITING in self.policy.states.values() and not self.policy.in_formation
        return self._standstill.open or held

    def landing(self) -> None:
        """The plan is over: from now on a landing mode is an ordered one."""
        self._standstill.land()
        self.positions.land()
        for vehicle in self._vehicles.values():
            self._watches[vehicle.sysid].order(vehicle.behaviour.land)

    @property
    def _t0_known(self) -> bool:
        return self._monitor.t0_unix_s is not None

    def _plan_time_s(self, unix_s: float) -> float:
        """Plan time; before T0 is known as if the take-off had begun on time."""
        if self._monitor.t0_unix_s is not None:
            return unix_s - self._monitor.t0_unix_s
        return self._plan.t_start_s + unix_s - self._began_s

    def describe(self, incident: Incident) -> str:
        """An incident in words: "vehicle 2 was lost (silent for 10.1 s) at t = 12.3 s"."""
        t_s = self._plan_time_s(incident.unix_s)
        detail = f" ({incident.detail})" if incident.detail else ""
        what = (
            "was lost" if incident.kind is IncidentKind.VEHICLE_LOST else f"left the formation: {incident.kind.value}"
        )
        return f"vehicle {incident.sysid} {what}{detail} at t = {t_s:.1f} s"

    def _listener(self, watch: VehicleWatch) -> Callable[[Message], None]:
        def receive(message: Message) -> None:
            if self._loop.time() >= self._stamped_s + _STAMPED_S:
                self._stamp()
            watch.receive(message, self._now_s)

        return receive

    def _stamp(self) -> float | None:
        """Return fleet time, and keep it as that of the next messages."""
        now_s = self._time.now_s()
        self._now_s = self._now_s if now_s is None else now_s
        self._stamped_s = self._loop.time()
        return now_s

    def _check(self, now_s: float, t_s: float) -> None:
        excused_s = self._standstill.end_reading(now_s)
        seen = self.positions.off_track(now_s), self.positions.outside_volumes(now_s), self.positions.down(now_s, t_s)
        for incident in itertools.chain(*seen):
            self._decide(incident, t_s)
        for sysid, watch in self._watches.items():
            watch.excuse(excused_s, now_s)
            if not (self._vehicles[sysid].session.armed or watch.alarms.stopped):
                continue  # no incidents on the ground
            ours = self._standstill.ours(now_s)
            self.charge.watch(sysid, now_s, watch.remaining_pct, self._flown_s(sysid, t_s))
            for incident in watch.look(
                now_s, usable=self.positions.usable(sysid), ours=ours, place=self.positions.place(sysid)
            ):
                if incident.kind is IncidentKind.MOTORS_STOPPED:
                    self.positions.falls(sysid, now_s)
                self._decide(self._with_energy(incident, t_s), t_s)
        for incident in self.positions.conflicts(now_s, t_s, gathers=self._standstill.gathers):
            self._decide(incident, t_s)
        if not self._t0_known:
            self._standstill.close()
            return
        t_s = self._standstill.end(now_s, t_s, self._on_event, self._carry_out)
        for order in self.policy.clear(now_s):
            self._carry_out(order, t_s)
        for sysid, way in list(self._returning.items()):
            view = self._monitor.views[sysid]
            if self._carrier.stands(sysid):
                continue
            if way.has_arrived(view, t_s):
                del self._returning[sysid]
                self._start(sysid, "land", partial(self._fleet.land, sysid))
            elif way.is_left(view, self._monitor.t0_s, t_s):
                track = self._track(way.order, self._vehicles[sysid], way.renewals + 1)
                if track is not None:
                    self._streamer.replace(sysid, track)
        formation = self.policy.in_formation
        self._monitor.watch_formation([i for i in formation if self.policy.states[i] is State.FLYING])
        if not formation and State.WAITING not in self.policy.states.values():
            self.over.set()
        for change in self._streamer.heed(formation, now_s):
            self._on_event(Event(now_s, t_s, change.sysid, change.what, change.rule))

    def _report_clocks(self, now_s: float) -> None:
        for change in self._time.changes():
            self._on_event(Event(now_s, self._plan_time_s(now_s), change.sysid, change.what, change.rule))

    def _flown_s(self, sysid: int, t_s: float) -> float | None:
        """The plan time that a vehicle flies; None if it does not fly the plan."""
        return t_s if self._t0_known and self.policy.states[sysid] in IN_FORMATION else None

    def _with_energy(self, incident: Incident, t_s: float) -> Incident:
        """The incident with what the vehicle's energy allows, if it is one of the battery."""
        kinds = IncidentKind.BATTERY_LOW, IncidentKind.BATTERY_CRITICAL
        of_battery = incident.cause is FailsafeCause.BATTERY
        sysid, state = incident.sysid, self.policy.states[incident.sysid]
        left_pct, view = self._watches[sysid].remaining_pct, self._monitor.views[sysid]
        if not (incident.kind in kinds or of_battery) or state not in AIRBORNE or left_pct is None:
            return incident
        if not np.isfinite(view.position_ned_m).all():
            return incident
        limits = self._options.limits
        low = incident.kind is IncidentKind.BATTERY_LOW
        reserve_pct = float(limits.battery_critical_pct) if low else limits.battery_reserve_pct
        flown_s = None if of_battery else self._flown_s(sysid, t_s)
        heading = None if of_battery or state is State.WAITING else self._heading.get(sysid)
        choice = self.charge.decide(view, left_pct, reserve_pct, flown_s, self._free_points(sysid), heading)
        same = sysid in self._chosen and self._chosen[sysid].chosen.outcome is choice.chosen.outcome
        self._chosen[sysid] = choice
        words = choice.short() if same else str(choice)
        detail = f"{incident.detail}; {words}" if of_battery else words
        return replace(incident, outcome=choice.chosen.outcome, detail=detail)

    def _way_m(self, start: Array, end: Array) -> float:
        """The length of a way round no-fly zones that begins now."""
        return self._tracks.routes.length_m(start, end, self._plan_time_s(self._now_s))

    def _free_points(self, sysid: int) -> list[SafePoint]:
        """Landing points of vehicles that are lost or have landed elsewhere, without any vehicle near them."""
        points, apart_m = [], self._plan.scenario.limits.separation_min_m
        for row, other in enumerate(self._plan.sysids):
            place = self._plan.landing_points_ned_m[row]
            gone = self.policy.states[other] is State.LOST or not self._vehicles[other].session.armed
            views = (view for i, view in self._monitor.views.items() if i != sysid)
            near = any(np.hypot(*(view.position_ned_m - place)[:2]) < apart_m for view in views)
            if other != sysid and gone and not near:
                points.append(SafePoint(f"landing point of vehicle {other}", place))
        return points

    def _decide(self, incident: Incident, t_s: float) -> None:
        battery = incident.kind in (IncidentKind.BATTERY_LOW, IncidentKind.BATTERY_CRITICAL)
        again = battery and (incident.sysid, incident.kind) in self._reported
        orders = self.policy.take(incident)
        if orders or not (again or incident.kind is IncidentKind.CONFLICT):
            choice = self._chosen.get(incident.sysid) if incident.outcome is not None else None
            data = None if choice is None else choice.data()
            alarm = incident.kind in _ALARMS
            what, rule = incident.kind.value, incident.detail
            self._on_event(Event(incident.unix_s, t_s, incident.sysid, what, rule, data, alarm))
        if battery:
            self._reported.add((incident.sysid, incident.kind))
        for order in orders:
            self._carry_out(order, t_s)

    def _carry_out(self, order: Order, t_s: float) -> None:
        what = "released" if order.action is Action.LEAVE else f"ordered to {order.action.value}"
        self._on_event(Event(self._time.sure_s(), t_s, order.sysid, what, order.rule, action=order.action))
        vehicle = self._vehicles[order.sysid]
        watch, m = self._watches[order.sysid], vehicle.behaviour
        self._returning.pop(order.sysid, None)
        begin_s = t_s + self._options.lead_s
        match order.action:
            case Action.OBEY:
                watch.order(m.guided)
                self._standstill.gather()
                self._start(order.sysid, order.action.value, partial(self._standstill.take_back, vehicle))
            case Action.LEAVE:
                self._carrier.end(order.sysid)
                self._streamer.leave(order.sysid)
            case Action.LAND:
                watch.order(m.land)
                self._start(order.sysid, order.action.value, partial(self._fleet.land, order.sysid))
            case Action.REJOIN:
                if self._options.mode is FlightMode.STREAM:
                    self._streamer.rejoin(vehicle, begin_s)
            case Action.PROMOTE:
                self._streamer.promote(order.sysid, begin_s)
            case Action.HOLD | Action.SPREAD | Action.RETURN | Action.DIVERT:
                watch.order(m.guided, m.land, m.returning)
                self._start(order.sysid, order.action.value, partial(self._take_over, order))

    async def _take_over(self, order: Order) -> None:
        vehicle = self._vehicles[order.sysid]
        track = self._track(order, vehicle)
        if track is not None:
            await self._streamer.take_over(hurried(vehicle), track)

    def _track(self, order: Order, vehicle: FlightVehicle, renewals: int = 0) -> MotionReference | None:
        """The reference of an order from now on. Without a way back the vehicle is ordered to land: None."""
        begin_s = self._plan_time_s(self._time.sure_s()) + self._options.lead_s
        track = self._tracks.reference(order, vehicle.view, vehicle.row, self._monitor.t0_s, begin_s)
        if track is None:
            rule = f"{order.rule}; no way back keeps out of no-fly zones and inside the fence"
            self._carry_out(Order(order.sysid, Action.LAND, rule), begin_s)
        elif order.action in (Action.RETURN, Action.DIVERT):
            self._returning[order.sysid] = WayBack(order, track, renewals)
            self._heading[order.sysid] = SafePoint("as ordered", self._tracks.end_ned_m(order, vehicle.row))
        return track

    def _start(self, sysid: int, what: str, work: Callable[[], Awaitable[None]]) -> None:
        self._carrier.start(sysid, what, work, self.report_failure)

    def report_failure(self, order: StandingOrder) -> None:
        """Tell an order that was refused or not answered; a vehicle that does not return is ordered to land."""
        now_s = self._time.now_s() or self._now_s
        t_s = self._plan_time_s(now_s)
        again = f"attempt {order.attempts}, repeated in {order.wait_s(self._loop.time()):.0f} s"
        self._on_event(Event(now_s, t_s, order.sysid, f"did not {order.what}", f"{order.reason} ({again})"))
        if order.attempts >= NOT_OBEYED_AFTER:
            for stronger in self.policy.not_obeyed(order.sysid, now_s):
                self._carry_out(stronger, t_s)
