"""Orders that change the plan of the whole formation: which is being planned, from which instant, and what was found.

A machine without clocks: times are arguments, plan times by the vehicles' clocks. The new plan begins at an instant of
the setpoint grid, as far ahead as planning took before, and a margin. An answer that comes too late is planned again
from a later instant, then refused. The formation brakes before a new zone that the plan would enter, unless a plan
round it comes first: while it is planned as well as after a refusal.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gcs.errors import FlightError
from gcs.physics.states import VELOCITY
from gcs.plan.formation_orders import PACED, Avoid, CloseRanks, GoTo, Hold, PlanOrder
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import nearest_zone_m
from gcs.scenario.schema.scenario import NoFlyZone
from gcs.scenario.values.navigation_error import navigation_error

MARGIN_S = 0.25  # between an answer and the first setpoint of the new plan, beside the lead of setpoints
SLOWER = 1.3  # than the slowest of the last plans, the next one may be made
ATTEMPTS = 3
_LAST = 3  # plans whose time counts
_BRAKE_MPS2, _CALM_S = 1.5, 2.0  # how vehicles brake, and how much earlier they begin
_STEP_S = 0.1


@dataclass(frozen=True)
class Planning:
    """An order that is being planned: what begins at plan time `begin_s`, and when it was asked and begun."""

    order: PlanOrder
    by: str
    asked_s: float
    tried_s: float
    begin_s: float
    attempt: int = 1


class PlanChange:
    """The order under way, if there is one, and where the formation has to brake."""

    def __init__(self, rate_hz: float, lead_s: float, plans_s: float = 0.0) -> None:
        """`rate_hz`: of setpoints, which are sent `lead_s` ahead; `plans_s`: how long a re-plan takes, as rehearsed."""
        self._rate_hz, self._lead_s = rate_hz, lead_s
        self._took_s = {False: [plans_s], True: [0.0]}  # with and without an optimiser
        self.pending: Planning | None = None
        # Zones that came up and that no plan was made for, with the plan time at which each was given.
        self._not_avoided: dict[Avoid, float] = {}
        self._last: tuple[PlanOrder, float] | None = None  # the order that the last new plan answers, and its begin
        self.brakes_at_s = math.inf  # plan time at which the formation has to brake
        self.blocked = ""  # why the old plan must not be gone on with, in words

    def rehearsed(self, took_s: Mapping[bool, float]) -> None:
        """A re-plan takes so long: of orders that need an optimiser (False) and of those that need none."""
        self._took_s.update({paced: [one_s] for paced, one_s in took_s.items()})

    def ask(self, order: PlanOrder, by: str, now_s: float, plan: Plan) -> Planning:
        """Begin an order to a formation that flies `plan`. Raises FlightError while another one is being planned.

        A zone counts from now on in any case: the formation brakes before it.
        """
        self.note(order, now_s, plan)
        if self.pending is not None:
            raise FlightError(
                f"the formation would not {order}: it is still being asked to {self.pending.order}.",
                hint="wait for its answer in the events",
            )
        self.pending = Planning(order, by, now_s, now_s, self._begin_s(order, now_s))
        return self.pending

    def note(self, order: PlanOrder, now_s: float, plan: Plan) -> None:
        """Watch a zone from now on, whether a plan round it can be made or not; `plan` may be one round it already."""
        if isinstance(order, Avoid) and order.zone not in plan.scenario.no_fly:
            self._not_avoided.setdefault(order, now_s)
            self.watch(plan, now_s)

    def would_begin_s(self, order: PlanOrder, now_s: float) -> float:
        """From when on an order would be flown. Raises FlightError while another one is being planned."""
        if self.pending is not None:
            raise FlightError(
                f"whether the formation would {order} is not known: it is being asked to {self.pending.order}.",
                hint="wait for its answer in the events",
            )
        return self._begin_s(order, now_s)

    def begin(self, now_s: float) -> None:
        """Planning begins now: an order may have waited for what the planner did before."""
        if self.pending is not None:
            self.pending = replace(self.pending, tried_s=now_s, begin_s=self._begin_s(self.pending.order, now_s))

    def in_time(self, now_s: float) -> bool:
        """Take in that the plan was made now. Without time to send it, `pending` begins again later, or it is too late.

        The order has ended if this returns true, or `pending` is None.
        """
        planning = self.pending
        assert planning is not None
        paced = isinstance(planning.order, PACED)
        self._took_s[paced] = [*self._took_s[paced], now_s - planning.tried_s][-_LAST:]
        if self.can_begin(planning.begin_s, now_s):
            self.pending = None
            return True
        if planning.attempt == ATTEMPTS:
            self.pending = None
        else:
            begin_s = self._begin_s(planning.order, now_s)
            self.pending = replace(planning, tried_s=now_s, begin_s=begin_s, attempt=planning.attempt + 1)
        return False

    def prepared(self) -> None:
        """The pending order is answered by a plan that was made before it."""
        self.pending = None

    def refused(self, order: PlanOrder, plan: Plan, now_s: float) -> str:
        """Take in that an order came to nothing; return in words what the formation does instead."""
        self.pending = None
        if not isinstance(order, Avoid):
            return "the old plan is flown on"
        if self.has_braked:
            return f"all have braked: {self.blocked}"
        if math.isinf(enters_at_s(plan, order, now_s)):
            if self._last is not None and isinstance(self._last[0], Hold) and self._last[0].zones:
                return f"all brake as one, from t = {self._last[1]:.1f} s on, and hover for the next order"
            return "the old plan is flown on, it does not enter the zone"
        self.watch(plan, now_s)
        return self.instead

    @property
    def zones(self) -> tuple[NoFlyZone, ...]:
        """Zones that came up and that the flown plan enters, or may enter."""
        return tuple(zone.zone for zone in self._not_avoided)

    @property
    def given(self) -> tuple[tuple[NoFlyZone, float], ...]:
        """The same, with the plan times at which they were given."""
        return tuple((zone.zone, given_s) for zone, given_s in self._not_avoided.items())

    @property
    def instead(self) -> str:
        """What the formation does before a zone that is not avoided, in words; empty where it enters none."""
        return (
            "" if not self.blocked or self.has_braked else f"all brake at t = {self.brakes_at_s:.1f} s: {self.blocked}"
        )

    @property
    def has_braked(self) -> bool:
        """Whether the time to brake has come, and no plan that enters no zone is flown since."""
        return bool(self.blocked) and math.isinf(self.brakes_at_s)

    def brakes(self, now_s: float) -> bool:
        """Whether the formation has to brake now; once."""
        due = now_s >= self.brakes_at_s
        if due:
            self.brakes_at_s = math.inf
        return due

    def changed(self, order: PlanOrder, plan: Plan, begins_s: float, now_s: float) -> None:
        """The formation flies this plan, from `begins_s` on anew; it may lead round what blocked the old one."""
        self._last = order, begins_s
        known = plan.scenario.no_fly  # verified with them: it may pass them nearer than an old plan is let
        self._not_avoided = {
            zone: given_s for zone, given_s in self._not_avoided.items() if zone != order and zone.zone not in known
        }
        self.watch(plan, now_s)

    def watch(self, plan: Plan, now_s: float) -> None:
        """Brake before the first zone that this plan enters."""
        self.brakes_at_s, self.blocked = math.inf, ""
        enters_s = min((enters_at_s(plan, zone, now_s) for zone in self._not_avoided), default=math.inf)
        if math.isinf(enters_s):
            return
        speed_mps = float(np.linalg.norm(plan.states(np.array([enters_s]))[:, 0, VELOCITY], axis=1).max())
        self.brakes_at_s = max(enters_s - speed_mps / _BRAKE_MPS2 - _CALM_S, now_s)
        self.blocked = f"the plan enters the new no-fly zone at t = {enters_s:.1f} s"

    def would_be_late(self, now_s: float) -> bool:
        """Whether all attempts at a plan round a zone may not be made before the formation has to brake."""
        made_s = now_s + ATTEMPTS * SLOWER * max(self._took_s[False]) + self._lead_s
        return max(made_s, self._not_before_s(paced=False)) > self.brakes_at_s

    def brake_begins_s(self, now_s: float) -> float:
        """From when on the formation brakes as one before the zones that came up: the plan is flown on until then."""
        return self._on_grid(max(self.soonest_s(now_s), self.brakes_at_s - 1.0 / self._rate_hz))

    def soonest_s(self, now_s: float) -> float:
        """From when on a plan without an optimiser can be flown."""
        return now_s + SLOWER * max(self._took_s[True]) + self._lead_s + MARGIN_S

    def can_begin(self, begin_s: float, now_s: float) -> bool:
        """Whether a plan that is ready now can be flown from an instant on."""
        return now_s + self._lead_s + MARGIN_S / 2.0 <= begin_s

    def _begin_s(self, order: PlanOrder, now_s: float) -> float:
        least_s = self._lead_s + MARGIN_S
        soonest_s = SLOWER * max(self._took_s[isinstance(order, PACED)]) + least_s
        ahead_s = max(min(soonest_s, self.brakes_at_s - now_s), least_s)
        return self._on_grid(max(now_s + ahead_s, self._not_before_s(paced=isinstance(order, PACED))))

    def _not_before_s(self, *, paced: bool) -> float:
        """Until when an order has to wait for the last new plan to begin: its programs know nothing before that.

        Tracks that are flown at another pace have none, but know a formation that became smaller only from then on. A
        plan that the formation leaves to hold keeps its programs.
        """
        if self._last is None:
            return -math.inf
        last, begins_s = self._last
        waits = isinstance(last, CloseRanks) or not (paced or isinstance(last, Hold | GoTo))
        return begins_s if waits else -math.inf

    def _on_grid(self, t_s: float) -> float:
        return math.ceil(t_s * self._rate_hz) / self._rate_hz


def enters_at_s(plan: Plan, order: Avoid, from_s: float) -> float:
    """When a vehicle of the plan first is in a zone, or as near as it may be off its place; infinite if never."""
    t_s = np.arange(from_s, plan.landing_s, _STEP_S)
    if not len(t_s):
        return math.inf
    places = plan.states(t_s)
    away_m = nearest_zone_m((order.zone,), t_s, places[..., 0], places[..., 1]).min(axis=0)
    inside = np.flatnonzero(away_m < navigation_error(plan.scenario).horizontal_m)
    return float(t_s[inside[0]]) if len(inside) else math.inf
