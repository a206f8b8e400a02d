"""What the operator may order in flight, from wherever: said in numbers beforehand, then decided by the policy."""

import asyncio
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np

from gcs.errors import FlightError
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.contingency.common_rejoin import Rejoin
from gcs.flight.contingency.decisions import ContingencyPolicy
from gcs.flight.contingency.detection import VehicleWatch
from gcs.flight.contingency.energy_choice import ChargeWatch, EnergyOption, Outcome
from gcs.flight.contingency.policy import IN_FORMATION, Order, State
from gcs.flight.execution.order_carrier import FlyingFleet
from gcs.flight.execution.standstill import Standstill
from gcs.flight.monitoring.progress import ALL_VEHICLES, AskedOrder, Event, OrderForecast

_WHO = 80  # characters of who asked


def vehicles_named(sysids: Collection[int]) -> str:
    """Vehicles in words: "vehicle 2", "vehicles 1, 3", and beyond six their number."""
    if len(sysids) > 6:
        return f"{len(sysids)} vehicles"
    return f"vehicle{'s' if len(sysids) > 1 else ''} {', '.join(map(str, sysids))}"


@dataclass(frozen=True)
class FlownForecast(OrderForecast):
    """A forecast with the way on which all continue."""

    way: Rejoin | None = None


class OperatorOrders:
    """The operator's orders in one flight, from the take-off on.

    `ended` says which orders took vehicles off the plan, `aborted` which of them ended the start.
    """

    def __init__(
        self,
        fleet: FlyingFleet,
        policy: ContingencyPolicy,
        standstill: Standstill,
        charge: ChargeWatch,
        watches: Mapping[int, VehicleWatch],
    ) -> None:
        self._fleet, self._policy, self._standstill = fleet, policy, standstill
        self._charge, self._watches = charge, watches
        self._blocked = ""  # why the plan must not be gone on with
        self._held_from_s = math.nan  # fleet time since which a vehicle waits
        self.ended: list[str] = []
        self.aborted = ""
        self._may_start = asyncio.Event()
        self._may_start.set()
        self._starts = False

    def block(self, why: str) -> None:
        """The plan must not be continued, for this reason; empty: it may be."""
        self._blocked = why

    async def until_start(self) -> None:
        """Wait, with all vehicles in the hover, while the operator holds the start. From then on it is not held."""
        await self._may_start.wait()
        self._starts = True

    def forecast(self, order: AskedOrder, sysids: Collection[int], now_s: float) -> FlownForecast:
        """Return what an order would do. Raises FlightError, with the reason, where no vehicle would obey."""
        known = self._policy.states
        asked = tuple(i for i in known if i in sysids) if sysids else tuple(known)
        if strangers := set(sysids) - set(known):
            raise FlightError(
                f"no {vehicles_named(sorted(strangers))} in this flight.",
                hint=f"it has {vehicles_named(sorted(known))}",
            )
        if self._fleet.monitor.t0_unix_s is None:
            return self._forecast_of_start(order, asked)
        asked = tuple(i for i in asked if self._fleet.vehicles[i].session.armed) or asked
        way = self._way(asked, now_s) if order is AskedOrder.CONTINUE else ""
        obey = self._policy.asked(order, asked, usable=not isinstance(way, str))
        if not obey:
            raise FlightError(f"no vehicle would {order.value}: {way or self._states(asked)}.", hint=_HINTS[order])
        if isinstance(way, Rejoin):
            return FlownForecast(obey, f"{vehicles_named(obey)}: {way}", way)
        return FlownForecast(obey, self._words(order, obey))

    def ask(
        self,
        order: AskedOrder,
        sysids: Collection[int],
        by: str,
        now_s: float,
        on_event: Callable[[Event], None],
        carry_out: Callable[[Order, float], None],
    ) -> tuple[int, ...]:
        """Give an order, and return the vehicles that it goes to. Raises FlightError as `forecast` does."""
        t_s = now_s - (self._fleet.monitor.t0_unix_s or math.nan)
        data = {"order": order.value, "vehicles": sorted(sysids), "by": by[:_WHO]}
        what = f"were asked to {order.value} by {by[:_WHO]}"
        try:
            found = self.forecast(order, sysids, now_s)
        except FlightError as refusal:
            on_event(Event(now_s, t_s, ALL_VEHICLES, what, f"refused: {refusal.message}", data))
            raise
        on_event(Event(now_s, t_s, ALL_VEHICLES, what, found.words, data))
        if self._fleet.monitor.t0_unix_s is None:
            self._order_start(order, by[:_WHO])
            return found.vehicles
        before = {i for i, state in self._policy.states.items() if state in IN_FORMATION | {State.WAITING}}
        if State.WAITING not in self._policy.states.values():
            self._held_from_s = now_s
        orders = self._policy.ask(order, found.vehicles, now_s, usable=found.way is not None)
        if found.way is not None:
            on_event(self._standstill.go_on(orders, found.way, now_s, self._held_from_s))
        else:
            for one in orders:
                carry_out(one, t_s)
        if order in (AskedOrder.LAND, AskedOrder.RETURN) and (left := sorted(before & set(found.vehicles))):
            self.ended.append(f"{vehicles_named(left)}: {order.value} ordered by {by[:_WHO]} at t = {t_s:.1f} s")
        return found.vehicles

    def _forecast_of_start(self, order: AskedOrder, asked: tuple[int, ...]) -> FlownForecast:
        """Before T0 all vehicles start together, hover on, or land: an order to some would leave no formation."""
        known, who = tuple(self._policy.states), vehicles_named(self._policy.states)
        if State.STARTING not in self._policy.states.values():
            raise FlightError("before the take-off no order is taken.", hint="Ctrl-C ends the flight")
        if asked != known:
            raise FlightError("before T0 an order is for all vehicles.", hint="name none of them, or land all")
        if order in (AskedOrder.LAND, AskedOrder.RETURN):
            return FlownForecast(known, f"the start is aborted: {self._words(AskedOrder.LAND, known)}")
        held = not self._may_start.is_set()
        if order is AskedOrder.CONTINUE:
            if not held:
                raise FlightError("no vehicle would continue: the start is not held.", hint=_HINTS[order])
            return FlownForecast(known, f"the start goes on: T0 follows once {who} hover")
        if self._fleet.options.mode is not FlightMode.STREAM:
            raise FlightError(
                "no vehicle would hold: missions on board start at a fixed time.", hint="order land to abort the start"
            )
        if held or self._starts:
            why = "the start is held already" if held else "T0 is being fixed"
            raise FlightError(f"no vehicle would hold: {why}.", hint="order it again after T0, or land")
        return FlownForecast(known, f"the start waits: {self._words(order, known)}")

    def _order_start(self, order: AskedOrder, by: str) -> None:
        if order is AskedOrder.HOLD:
            self._may_start.clear()
        elif order is AskedOrder.CONTINUE:
            self._may_start.set()
        else:
            self.aborted = f"{order.value} ordered by {by}"

    def _way(self, sysids: tuple[int, ...], now_s: float) -> Rejoin | str:
        states = self._policy.states
        if self._fleet.options.mode is not FlightMode.STREAM:
            return "missions on board keep the times of the plan, which have passed"
        if self._blocked:
            return self._blocked
        waiting = [i for i in sysids if states[i] is State.WAITING]
        if not waiting:
            return "none of them waits for it"
        if flying := [i for i, state in states.items() if state in IN_FORMATION]:
            return f"the plan has not waited: flown by {vehicles_named(flying)}"
        return self._standstill.way_back(waiting, now_s, self._held_from_s)

    def _states(self, sysids: tuple[int, ...]) -> str:
        if not sysids:
            return "none of them is in the air"
        return ", ".join(f"vehicle {i} is {self._policy.states[i].value}" for i in sysids)

    def _words(self, order: AskedOrder, sysids: tuple[int, ...]) -> str:
        who, s = vehicles_named(sysids), "s" if len(sysids) == 1 else ""
        rows = {one.sysid: one.row for one in self._fleet.vehicles.values()}
        left_pct = [left for i in sysids if (left := self._watches[i].remaining_pct) is not None]
        has = f"; the lowest has {min(left_pct)} %" if left_pct else ""
        if order is AskedOrder.HOLD:
            minute_pct = 100.0 * 60.0 * self._charge.model.hover_per_s
            return f"{who} brake{s} and hold{s} until the next order; a minute takes {minute_pct:.1f} % battery{has}"
        outcome = Outcome.LAND if order is AskedOrder.LAND else Outcome.RETURN
        needs = [one for i in sysids if (one := self._need(i, outcome)) is not None]
        figures = "position not known"
        if needs:
            longest_s, most_pct = max(n.duration_s for n in needs), max(n.need_pct for n in needs)
            figures = f"{longest_s:.0f} s, {most_pct:.0f} % battery"
        if order is AskedOrder.LAND:
            return f"{who} land{s} in place, {figures}{has}"
        heights_m = np.array([self._charge.returns.altitudes_m[rows[i]] for i in sysids])
        low_m, high_m = float(heights_m.min()), float(heights_m.max())
        staggered = f"at {low_m:.0f} m" if len(sysids) == 1 else f"staggered {low_m:.0f}–{high_m:.0f} m"
        return f"{who} return{s}, {staggered}, {figures}{has}"

    def _need(self, sysid: int, outcome: Outcome) -> EnergyOption | None:
        """What a vehicle needs to return or to land; None where that is not known, or there is no way."""
        view = self._fleet.monitor.views[sysid]
        if not np.isfinite(view.position_ned_m).all():
            return None
        found = next(one for one in self._charge.needs(view) if one.outcome is outcome)
        return found if math.isfinite(found.duration_s) else None


_HINTS = {
    AskedOrder.HOLD: "vehicles hold that fly the plan, return or yielded",
    AskedOrder.LAND: "vehicles land that are in the air, heard, and flown by no pilot",
    AskedOrder.RETURN: "vehicles return that are in the air, heard, and flown by no pilot",
    AskedOrder.CONTINUE: "vehicles continue that were ordered to hold, all together; else order return or land",
}
