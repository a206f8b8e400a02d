"""Recovery after a process pause: all vehicles are led back together.

Messages that waited are read before anything is judged by them or sent. Vehicles that still follow setpoints go back to
the plan at once. If an autopilot has left its mode for want of setpoints, all stop where they are until all follow
setpoints again; then they go on together. Time is an argument, but for the ages of messages.
"""

import asyncio
import math
from collections.abc import Callable

import numpy as np

from gcs.flight.contingency.choices import FlightMode
from gcs.flight.contingency.common_rejoin import Rejoin, Stranded, common_rejoin
from gcs.flight.contingency.decisions import ContingencyPolicy
from gcs.flight.contingency.detection import Incident, IncidentKind
from gcs.flight.contingency.manoeuvres import MotionReference, OrderedTracks, hold_reference, predicted_start
from gcs.flight.contingency.policy import Order, State
from gcs.flight.execution.order_carrier import FlyingFleet, OrderCarrier, hurried
from gcs.flight.execution.takeoff_landing import FlightVehicle
from gcs.flight.monitoring.progress import ALL_VEHICLES, OFF_PLAN, Action, Event
from gcs.util.steady_loop import host_s, stalls_of

READ_S, UNREAD_S = 0.2, 1.4  # local time at least, and at most, until what waited has been read
EMULATED_UNREAD_S = 0.4  # ... by emulated vehicles that wait for setpoints: they send nothing new before
MISSING_S = 0.5  # vehicle time without setpoints that vehicles do not leave the plan in
OURS_S = 6.0  # vehicle time after a standstill: a failsafe then is a consequence of it
# Until all vehicles stand and follow setpoints: vehicle time, but local time too if that is longer.
GATHER_S, GATHER_LOCAL_S = 20.0, 15.0
SLOW_MPS = 0.5
BEGIN_S = 0.05  # vehicle time from the choice of a rejoin to its first setpoint


class Standstill:
    """The standstills of this program in one flight."""

    def __init__(
        self, fleet: FlyingFleet, tracks: OrderedTracks, policy: ContingencyPolicy, carrier: OrderCarrier
    ) -> None:
        self._options, self._vehicles = fleet.options, fleet.vehicles
        self._monitor, self._streamer, self._time = fleet.monitor, fleet.streamer, fleet.time
        self._tracks, self._policy, self._carrier = tracks, policy, carrier
        self._loop = asyncio.get_running_loop()
        self._stalls = stalls_of(self._loop)
        self._seen = self._stalls.count
        self._woke_s = -math.inf  # loop time
        self._reads = self._stranded = self.gathers = False
        self._before_s = math.nan  # fleet time of the last check before the last one
        self._excused_from_s = math.nan
        self._until_s = self._gathers_until_s = -math.inf  # fleet and loop time until which vehicles gather
        self._ours_until_s = -math.inf
        self._held: set[int] = set()
        self._lands = False

    @property
    def open(self) -> bool:
        """Whether a standstill is not dealt with yet: the plan's time means nothing then."""
        return self._stalls.count > self._seen or self._reads or self._stranded or self.gathers

    def land(self) -> None:
        """The plan is over: nobody is led back to it."""
        self._lands = True

    def reads(self, checked_s: float) -> bool:
        """Whether messages that waited in a standstill are still being read; `checked_s` was the last check."""
        if self._stalls.count > self._seen:
            self._seen = self._stalls.count
            self._woke_s = self._loop.time()
            if not (self._reads or self._stranded or self.gathers):
                self._before_s = checked_s
            self._reads = True
            self._streamer.pause_if_stalled()
        unread_s = EMULATED_UNREAD_S if self._options.lead_s > 0.0 else UNREAD_S
        if self._reads and (self._loop.time() - self._woke_s > unread_s or all(map(self._is_read, self._heard()))):
            self._reads = False
            self._stranded = self._streamer.missing_s(self._time.sure_s()) > MISSING_S
            if not self._stranded:
                self._streamer.resume()
            self._excused_from_s = checked_s
        return self._reads

    def ours(self, now_s: float) -> bool:
        """Whether a failsafe that shows at `now_s` is a consequence of a standstill."""
        return now_s <= self._ours_until_s

    def end_reading(self, now_s: float) -> float:
        """Return the fleet time since the last check, in which this program did not listen; 0 without a standstill."""
        if math.isnan(self._excused_from_s):
            return 0.0
        from_s, self._excused_from_s = self._excused_from_s, math.nan
        self._ours_until_s = now_s + OURS_S
        return max(now_s - from_s, 0.0)

    def end(
        self, now_s: float, t_s: float, on_event: Callable[[Event], None], carry_out: Callable[[Order, float], None]
    ) -> float:
        """Lead the vehicles back to the plan, or home, once it is known which; return the plan time."""
        if self._lands or self._options.mode is not FlightMode.STREAM:
            self.close()
            return t_s
        how = self.step(now_s, lambda sysid: not self._carrier.stands(sysid))
        if how is None:
            return t_s
        on_event(Event(now_s, t_s, ALL_VEHICLES, "stayed without setpoints", str(how)))
        orders = [order for incident in self.incidents(how, now_s) for order in self._policy.take(incident)]
        back = [order for order in orders if order.action is Action.REJOIN]
        for order in orders:
            if order not in back:
                carry_out(order, t_s)
        if back and isinstance(how, Rejoin):
            on_event(self.go_on(back, how, now_s, self._before_s))
        return now_s - self._monitor.t0_s

    def go_on(self, orders: list[Order], how: Rejoin, now_s: float, before_s: float) -> Event:
        """Lead the ordered vehicles back, which were on the plan until `before_s`; return the event of it."""
        t0_unix_s = self._monitor.t0_s
        words = self.lead_back([order.sysid for order in orders], how, now_s)
        waits_s = t0_unix_s + now_s - self._monitor.t0_s  # when the plan was where it goes on now
        off_plan = {OFF_PLAN: (min(before_s, waits_s), self._begins_s(now_s) + how.fade_s)}
        return Event(now_s, now_s - self._monitor.t0_s, ALL_VEHICLES, words, orders[0].rule, off_plan)

    def way_back(self, sysids: list[int], now_s: float, before_s: float) -> Rejoin | str:
        """Return how vehicles that hold go on together, or why they cannot. They held from fleet time `before_s` on."""
        vehicles = [self._vehicles[i] for i in sysids]
        if self._lands:
            return "the plan is over"
        if self.open:
            return "this program stood still, and the vehicles gather"
        if busy := [v.sysid for v in vehicles if self._carrier.stands(v.sysid)]:
            return f"the last order to vehicle {busy[0]} is not carried out yet"
        if away := [v.sysid for v in vehicles if v.session.custom_mode != v.behaviour.guided]:
            return f"vehicle {away[0]} does not follow setpoints"
        return self._choose(vehicles, now_s, before_s - self._monitor.t0_s)

    def incidents(self, how: Rejoin | str, now_s: float) -> list[Incident]:
        """Return the incident of every vehicle of the formation; a silent one is judged when it is heard again."""
        found = []
        for sysid, state in self._policy.states.items():
            vehicle = self._vehicles[sysid]
            obeys = vehicle.session.custom_mode == vehicle.behaviour.guided
            safe = isinstance(how, Rejoin) and obeys
            if state is State.FLYING or (state is State.SILENT and isinstance(how, str)):
                why = str(how) if obeys else "it does not follow setpoints"
                found.append(Incident(IncidentKind.STRANDED, sysid, now_s, why, usable=safe))
        return found

    def step(self, now_s: float, is_taken_back: Callable[[int], bool]) -> Rejoin | str | None:
        """Return how the vehicles go on, or why they cannot; None without a standstill, and while they gather.

        `is_taken_back`: whether no order to a vehicle is under way.
        """
        if not (self._stranded or self.gathers):
            return None
        states = self._policy.states
        flying = [v for v in self._vehicles.values() if states[v.sysid] is State.FLYING and v.session.armed]
        obey = [v for v in flying if v.session.custom_mode == v.behaviour.guided and is_taken_back(v.sysid)]
        if self._stranded:
            self._stranded = False
            self.gathers = len(obey) < len(flying)
            self._until_s, self._gathers_until_s = now_s + GATHER_S, self._loop.time() + GATHER_LOCAL_S
            self._held.clear()
        if self.gathers:
            self._hold([v for v in obey if v.sysid not in self._held], now_s)
            self._streamer.resume()
            slow = all(float(np.linalg.norm(v.view.velocity_ned_mps)) < SLOW_MPS for v in flying)
            in_time = now_s < self._until_s or self._loop.time() < self._gathers_until_s
            if not (slow and len(obey) == len(flying)) and in_time:
                return None
        before_s = self._before_s - self._monitor.t0_s
        self.close()
        return self._choose(obey, now_s, before_s) if obey else "no vehicle follows setpoints"

    def lead_back(self, sysids: list[int], how: Rejoin, now_s: float) -> str:
        """Carry out a rejoin; return it in words: by how much later than planned the flight goes on."""
        begin_s, before_s = self._begins_s(now_s), self._monitor.t0_s
        keeps_t0 = abs(how.t_s - (begin_s - before_s)) < 1e-6
        t0_unix_s = before_s if keeps_t0 else begin_s - how.t_s
        later_s = t0_unix_s - before_s
        self._streamer.rejoin_together(
            [self._vehicles[i] for i in sysids], t0_unix_s, begin_s - t0_unix_s, how.fade_s, self._policy.leader
        )
        if not keeps_t0:
            self._monitor.set_t0(t0_unix_s)
        return "are led back to the plan" + (f", which goes on {later_s:.1f} s later" if later_s else "")

    def _begins_s(self, now_s: float) -> float:
        return now_s + self._options.lead_s + BEGIN_S

    def close(self) -> None:
        """Nothing is left to be done: also before T0, in a landing, with missions on board."""
        self._reads = self._stranded = self.gathers = False
        self._held.clear()
        self._streamer.resume()

    async def take_back(self, vehicle: FlightVehicle) -> None:
        """Have a vehicle follow setpoints again, at rest where it is. Raises as switching modes does."""
        if self._monitor.t0_unix_s is None:
            await self._streamer.enter_setpoint_mode(hurried(vehicle))
            return
        self._held.add(vehicle.sysid)
        self._streamer.resume()
        await self._streamer.take_over(hurried(vehicle), self._hold_at(vehicle, self._time.sure_s()))

    def gather(self) -> None:
        """A vehicle has shown only now that it left its mode: all stop again until it follows setpoints."""
        if not self.gathers:
            self._stranded = True

    def _heard(self) -> list[FlightVehicle]:
        states, unheard = self._policy.states, (State.SILENT, State.LOST)
        return [v for v in self._vehicles.values() if v.session.armed and states[v.sysid] not in unheard]

    def _is_read(self, vehicle: FlightVehicle) -> bool:
        """Whether what this vehicle sent in the standstill has been read, and its mode of now is known."""
        session, arrived_s = vehicle.session, vehicle.session.latest_s
        read_s = self._woke_s + READ_S
        if session.clock.is_behind(host_s(self._loop)) or arrived_s.get("LOCAL_POSITION_NED", 0.0) <= read_s:
            return False
        return not vehicle.behaviour.stream_first_s or arrived_s["HEARTBEAT"] > read_s

    def _hold(self, vehicles: list[FlightVehicle], now_s: float) -> None:
        for vehicle in vehicles:
            self._held.add(vehicle.sysid)
            self._streamer.follow(vehicle, self._hold_at(vehicle, now_s))

    def _hold_at(self, vehicle: FlightVehicle, now_s: float) -> MotionReference:
        t0_s = self._monitor.t0_s
        begin_s = now_s + self._options.lead_s - t0_s
        return hold_reference(predicted_start(self._monitor.plan, vehicle.view, t0_s, begin_s), self._tracks.routes)

    def _choose(self, vehicles: list[FlightVehicle], now_s: float, before_s: float) -> Rejoin | str:
        begin_s = self._begins_s(now_s)
        seen = [vehicle.view.predicted(begin_s) for vehicle in vehicles]
        if not all(np.isfinite(place).all() for place, _ in seen):
            return "the position of a vehicle is not known"
        places, rates = np.array([place for place, _ in seen]), np.array([rate for _, rate in seen])
        here = Stranded(tuple(vehicle.row for vehicle in vehicles), places, rates)
        return common_rejoin(self._monitor.plan, self._tracks.routes, here, begin_s - self._monitor.t0_s, before_s)
