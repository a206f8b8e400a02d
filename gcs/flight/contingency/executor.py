"""Detects incidents during a flight and carries out the orders of the contingency policy."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from gcs.aio import ended
from gcs.errors import GcsError
from gcs.flight.contingency.conflict_prediction import SeparationWatch
from gcs.flight.contingency.decisions import ContingencyPolicy
from gcs.flight.contingency.detection import Incident, IncidentKind, VehicleWatch
from gcs.flight.contingency.manoeuvres import (
    LegsReference,
    ReturnReference,
    hold_reference,
    return_reference,
    spread_reference,
)
from gcs.flight.contingency.policy import IN_FORMATION, SPREAD_M, USABLE_M, Action, Choices, Order, State
from gcs.flight.monitor import Monitor, VehicleView
from gcs.flight.offboard.streamer import Streamer
from gcs.flight.options import FlightMode, FlightOptions
from gcs.flight.progress import Event
from gcs.flight.sequence.fleet_time import FleetTime
from gcs.flight.sequence.takeoff_landing import FlightVehicle, set_mode
from gcs.link.wire.message import Message
from gcs.mission.failsafe.return_routes import ReturnRoutes
from gcs.mission.failsafe.rtl_altitudes import ReturnPlan
from gcs.plan.trajectory.plan import Plan

_PERIOD_S = 0.1  # of fleet time between two checks
_SLEEP_S = 0.005
_REJOIN_S = 8.0
_TRIES = 3
_HOVER_M = 1.0  # over the pad, before the landing


class ContingencyExecutor:
    """Watches a flight from the start of the stream. `over` is set once no vehicle flies the plan any more."""

    def __init__(
        self,
        *,
        plan: Plan,
        vehicles: Mapping[int, FlightVehicle],
        monitor: Monitor,
        streamer: Streamer,
        time: FleetTime,
        returns: ReturnPlan,
        options: FlightOptions,
        on_event: Callable[[Event], None],
    ) -> None:
        self.policy = ContingencyPolicy(
            plan.sysids,
            plan.sysids[plan.leader],
            Choices(options.on_loss, options.on_leader_loss, options.follow),
        )
        self.over = asyncio.Event()
        self.events: list[Event] = []
        self._plan = plan
        self._vehicles = vehicles
        self._monitor = monitor
        self._streamer = streamer
        self._time = time
        self.returns = returns
        self._options = options
        self._on_event = on_event
        self._separation = SeparationWatch(plan, plan.scenario.judge.separation_min_m)
        self._watches = {sysid: self._watch(vehicle) for sysid, vehicle in vehicles.items()}
        self._now_s = -math.inf  # fleet time, computed once for many messages
        self._routes = ReturnRoutes(plan)
        self._returning: dict[int, LegsReference | ReturnReference] = {}
        self._tasks: dict[int, asyncio.Future[None]] = {}

    def _watch(self, vehicle: FlightVehicle) -> VehicleWatch:
        m = vehicle.behaviour
        modes = {m.guided} if self._options.mode is FlightMode.STREAM else {m.mission, m.guided}
        return VehicleWatch(vehicle.sysid, m, self._options.limits, math.inf, frozenset(modes))

    async def run(self) -> None:
        """Detect, decide and order until cancelled."""
        began_s = self._now_s = self._time.sure_s()
        stops = [
            vehicle.session.subscribe(self._listener(self._watches[vehicle.sysid]))
            for vehicle in self._vehicles.values()
        ]
        for watch in self._watches.values():
            watch.begin(began_s)
        checked_s = began_s
        try:
            while True:
                await asyncio.sleep(_SLEEP_S)
                now_s = self._time.now_s()
                self._now_s = self._now_s if now_s is None else now_s
                if now_s is not None and now_s - checked_s >= _PERIOD_S and self._monitor.t0_unix_s is not None:
                    checked_s = now_s
                    self._check(now_s, self._monitor.t0_unix_s)
        finally:
            for stop in stops:
                stop()
            for task in self._tasks.values():
                await ended(task)

    def return_all(self) -> None:
        """Order all vehicles in the formation to return, as the operator requested."""
        t_s = self._time.sure_s() - (self._monitor.t0_unix_s or 0.0)
        for order in self.policy.return_all(self._time.sure_s()):
            self._carry_out(order, t_s)

    def landing(self) -> None:
        """The plan is over: from now on a landing mode is an ordered one."""
        for vehicle in self._vehicles.values():
            self._watches[vehicle.sysid].obeys |= {vehicle.behaviour.land}

    def longest_return_s(self) -> float:
        """The fleet time, in seconds, within which every returning vehicle should have landed."""
        speeds = self.returns.speeds
        plan = self._plan
        span_m = np.linalg.norm(np.ptp([*plan.pads_ned_m[:, :2], *plan.landing_points_ned_m[:, :2]], axis=0))
        return float(120.0 + 2.0 * span_m / speeds.cruise_mps + 4.0 * self.returns.top_m / speeds.sink_mps)

    def describe(self, incident: Incident) -> str:
        """An incident in words: "vehicle 2 was lost (silent for 10.1 s) at t = 12.3 s"."""
        t_s = incident.unix_s - (self._monitor.t0_unix_s or 0.0)
        detail = f" ({incident.detail})" if incident.detail else ""
        what = (
            "was lost" if incident.kind is IncidentKind.VEHICLE_LOST else f"left the formation: {incident.kind.value}"
        )
        return f"vehicle {incident.sysid} {what}{detail} at t = {t_s:.1f} s"

    def _listener(self, watch: VehicleWatch) -> Callable[[Message], None]:
        def receive(message: Message) -> None:
            watch.receive(message, self._now_s)

        return receive

    def _check(self, now_s: float, t0_unix_s: float) -> None:
        t_s = now_s - t0_unix_s
        for sysid, watch in self._watches.items():
            if not self._vehicles[sysid].session.armed:
                continue  # no incidents on the ground
            error_m = self._monitor.views[sysid].error_m
            watch.usable = not error_m > USABLE_M
            for incident in watch.look(now_s):
                self._decide(incident, t_s)
        self._check_separation(now_s, t_s)
        for order in self.policy.clear(now_s):
            self._carry_out(order, t_s)
        for sysid, track in list(self._returning.items()):
            if t_s > track.end_s:
                del self._returning[sysid]
                self._start(
                    sysid, partial(self._change_mode, self._vehicles[sysid], self._vehicles[sysid].behaviour.land)
                )
        formation = self.policy.in_formation
        self._monitor.in_formation = [i for i in formation if self.policy.states[i] is State.FLYING]
        if not formation:
            self.over.set()

    def _check_separation(self, now_s: float, t_s: float) -> None:
        states = self.policy.states
        airborne = [i for i, s in states.items() if s is not State.LOST and self._vehicles[i].session.armed]
        self._monitor.aloft = airborne
        on_plan = [i for i in airborne if states[i] in IN_FORMATION]
        views = self._monitor.views
        for conflict in self._separation.look(views, t_s, now_s, on_plan, airborne):
            farther, other = sorted(conflict.pair, key=lambda i: -np.nan_to_num(views[i].error_m))
            higher = bool(views[farther].position_ned_m[2] <= views[other].position_ned_m[2])
            distance = f"{conflict.distance_m:.2f} m"
            incident = Incident(IncidentKind.CONFLICT, farther, now_s, distance, other=other, in_s=conflict.in_s)
            self._decide(incident, t_s, higher=higher)

    def _decide(self, incident: Incident, t_s: float, *, higher: bool = True) -> None:
        orders = self.policy.take(incident, higher=higher)
        if incident.kind is not IncidentKind.CONFLICT or orders:
            self._note(incident.unix_s, t_s, incident.sysid, incident.kind.value, incident.detail)
        for order in orders:
            self._carry_out(order, t_s)

    def _note(self, unix_s: float, t_s: float, sysid: int, what: str, rule: str) -> None:
        event = Event(unix_s, t_s, sysid, what, rule)
        self.events.append(event)
        self._on_event(event)

    def _carry_out(self, order: Order, t_s: float) -> None:
        self._note(self._time.sure_s(), t_s, order.sysid, _event_words(order.action), order.rule)
        vehicle = self._vehicles[order.sysid]
        watch, m, view = self._watches[order.sysid], vehicle.behaviour, vehicle.view
        self._returning.pop(order.sysid, None)
        begin_s = t_s + self._options.lead_s
        match order.action:
            case Action.LEAVE:
                self._streamer.leave(order.sysid)
            case Action.LAND:
                watch.obeys = frozenset({*watch.obeys, m.land})
                self._start(order.sysid, partial(self._change_mode, vehicle, m.land))
            case Action.REJOIN:
                if self._options.mode is FlightMode.STREAM:
                    self._streamer.rejoin(vehicle, view, begin_s, _REJOIN_S)
            case Action.PROMOTE:
                self._streamer.promote(order.sysid, begin_s, _REJOIN_S)
            case Action.HOLD | Action.SPREAD | Action.RETURN:
                watch.obeys = frozenset({*watch.obeys, m.guided, m.land, m.returning})
                track = self._reference(order, view, vehicle.row, begin_s)
                if track is None:
                    rule = f"{order.rule}; no way back keeps out of no-fly zones and inside the fence"
                    self._carry_out(Order(order.sysid, Action.LAND, rule), t_s)
                    return
                if order.action is Action.RETURN:
                    self._returning[order.sysid] = track
                self._start(order.sysid, partial(self._streamer.take_over, vehicle, track))

    def _reference(
        self, order: Order, view: VehicleView, row: int, begin_s: float
    ) -> LegsReference | ReturnReference | None:
        """The reference trajectory of an order, from the vehicle's predicted position at plan time `begin_s`.

        None: a return without a way.
        """
        assert self._monitor.t0_unix_s is not None
        ahead_s = min(max(begin_s - (view.unix_s - self._monitor.t0_unix_s), 0.0), 1.0)
        position, velocity = view.position_ned_m + view.velocity_ned_mps * ahead_s, view.velocity_ned_mps
        at = np.clip(np.array([begin_s]), self._plan.t_start_s, np.nextafter(self._plan.t_end_s, -np.inf))
        yaw = float(self._plan.leader_trajectory.state(at)[0, 8])
        if order.action is Action.HOLD:
            return hold_reference(position, velocity, yaw, begin_s)
        if order.action is Action.SPREAD:
            return spread_reference(position, velocity, yaw, begin_s, SPREAD_M)
        home = self._plan.pads_ned_m[row]
        top_down_m = float(home[2]) - self.returns.altitudes_m[row]
        speeds = self.returns.speeds
        return return_reference(position, velocity, yaw, begin_s, self._routes, home, top_down_m, speeds, _HOVER_M)

    async def _change_mode(self, vehicle: FlightVehicle, mode: int) -> None:
        await set_mode(vehicle, mode)
        self._streamer.leave(vehicle.sysid)

    def _start(self, sysid: int, work: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """Start a task for a vehicle in place of the one before: the newest order counts."""
        if (before := self._tasks.pop(sysid, None)) is not None:
            before.cancel()

        async def guarded() -> None:
            for _ in range(_TRIES):  # orders after an incident often go over bad links
                with suppress(GcsError):
                    await work()
                    return

        self._tasks[sysid] = asyncio.ensure_future(guarded())


def _event_words(action: Action) -> str:
    """The words of an event: a released vehicle gets no order."""
    return "released" if action is Action.LEAVE else f"ordered to {action.value}"
