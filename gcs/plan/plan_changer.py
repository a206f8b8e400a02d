"""What may be asked of a plan in flight, and the verified plan that answers: its rest from an instant ahead."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gcs.errors import Infeasible, PlanningError, UsageError
from gcs.plan.formation.shape import Shape, rigid
from gcs.plan.formation.shape import joined as joined_shapes
from gcs.plan.formation.timeline import lay
from gcs.plan.formation_orders import (
    Avoid,
    CloseRanks,
    FlyHome,
    GoOn,
    GoTo,
    Hold,
    PlanOrder,
    Reshape,
    Scale,
    Slower,
)
from gcs.plan.formation_return import plan_return
from gcs.plan.paced_plan import PUSHES_MPS2, Left, gone_on, slowed, stopped
from gcs.plan.prepared_returns import PreparedReturn, begun_from
from gcs.plan.replanning.formation_rest import plan_of, rest_of
from gcs.plan.replanning.parametric_nlp import with_zones
from gcs.plan.replanning.plan_pieces import continued, jump_between
from gcs.plan.replanning.remaining_plan import shape_part, with_times_of_changes
from gcs.plan.replanning.replanner import Replanner
from gcs.plan.trajectory.constraint_id import Kind
from gcs.plan.trajectory.ground_phases import shape_from_ground
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Report, refusal, verify
from gcs.scenario.environment.no_fly import ZoneName
from gcs.scenario.schema.scenario import ChangeTable, NoFlyZone, Scenario
from gcs.scenario.values.si import landing_points_ned_m

ZONES_MAX = 4  # that may come up in one flight
HOVERS_S = 300.0, 120.0, 40.0  # for how long a formation holds; the longest that its batteries last
ROUND_RATES = 0.7, 0.5  # of speeds, after a hold, where a zone came up in the way
_LOOK_S = 0.5
_REHEARSED = 0.3  # of the mission: where a re-plan is rehearsed


@dataclass(frozen=True)
class Proposal:
    """A verified plan that answers an order, and the seconds that it took to make."""

    plan: Plan
    report: Report
    took_s: float
    left: Left | None = None  # the plan that `GoOn` would go on with
    pace: float = 1.0  # speeds over those of the first plan, by `Slower`


class PlanChanger:
    """Changes one plan as often as asked. `flown` is the plan as it is flown, with what was adopted."""

    def __init__(self, plan: Plan, left: Left | None = None, pace: float = 1.0) -> None:
        """`left` and `pace` are those of the proposal that led to this plan, if it is not the first."""
        self.flown = plan
        self._known = len(plan.scenario.no_fly)  # zones of the plan that the programs were built for
        self._base = plan
        self._left, self._pace = left, pace
        self._rest: tuple[CloseRanks, Replanner] | None = None  # programs that an earlier attempt built
        self._way_home: Plan | None = None  # of an earlier instant: the next one is found sooner near it

    @cached_property
    def _replanner(self) -> Replanner:
        return Replanner(self._base, spare_disks=ZONES_MAX)

    def rehearse(self) -> dict[bool, float]:
        """Build the programs; return the seconds that a plan by the optimiser takes (False), and one without it (True).

        A route has no programs to build, and a formation that holds needs none: what they take is not known then.
        """
        mission, found = self._base.phase(PhaseKind.MISSION), {}
        at_s, began_s = mission.start_s + _REHEARSED * mission.duration_s, time.perf_counter()
        with suppress(PlanningError):
            verify(stopped(self._base, at_s, None, None, HOVERS_S[0], PUSHES_MPS2[0])[0])
            found[True] = time.perf_counter() - began_s
        if self._left is None and not self._base.scenario.route:
            with suppress(PlanningError):
                replanner, began_s = self._replanner, time.perf_counter()
                verify(replanner.replan(self._base.leader_trajectory.state(at_s), at_s))
                found[False] = time.perf_counter() - began_s
        return found

    def change(self, order: PlanOrder, at_s: float) -> Proposal:
        """The plan from `at_s` on that carries out an order. Raises PlanningError or UsageError with the reason.

        Its first state and shape are those of the flown plan; it is verified.
        """
        began_s = time.perf_counter()
        return self._verified(*self._answering(order, at_s), began_s)

    def begin_return(self, prepared: PreparedReturn, zones: tuple[NoFlyZone, ...] = ()) -> Proposal:
        """A prepared return, if it still continues the flown plan, and keeps out of `zones` that came up since.

        Raises PlanningError with the reason where not.
        """
        began_s = time.perf_counter()
        if prepared.plan is None or prepared.plan.sysids != self.flown.sysids:
            raise PlanningError("it is not one of the vehicles that fly", hint=_OTHERWISE)
        return self._verified(begun_from(self._keeping_out(zones), prepared), None, 1.0, began_s)

    def _verified(self, plan: Plan, left: Left | None, rate: float, began_s: float) -> Proposal:
        if not (jump := jump_between(self.flown, plan)).allowed:
            raise PlanningError(f"the new plan would begin with a jump of {jump}", hint=_OTHERWISE)
        report = verify(plan)
        if not report.ok:
            raise PlanningError(f"the new plan failed verification: {refusal(report).reason}", hint=_OTHERWISE)
        return Proposal(plan, report, time.perf_counter() - began_s, left, rate)

    def adopt(self, found: Proposal) -> None:
        """Go on from this plan: the vehicles fly it."""
        plan, self._rest, self._pace = found.plan, None, found.pace
        was, self._left = self._left, found.left
        others = plan.sysids != self.flown.sysids
        self.flown = plan if others else continued(self.flown, plan)
        # The programs are for one end, one schedule of shapes and some vehicles; those of a plan that was left stay.
        known = self._base.moves, self._base.scenario.end, self._base.flight_s
        if others or (found.left is None and (was or known != (plan.moves, plan.scenario.end, plan.flight_s))):
            self._base, self._known, self._way_home = plan, len(plan.scenario.no_fly), None
            self.__dict__.pop("_replanner", None)

    def _answering(self, order: PlanOrder, at_s: float) -> tuple[Plan, Left | None, float]:
        """The plan, what it leaves, and its pace."""
        left, rate = self._left, self._pace
        match order:
            case Avoid():
                return *self._round(order, at_s), rate
            case CloseRanks():
                if left is not None:
                    left = replace(left, plan=plan_of(left.plan, order.sysids, left.at_s))
                return self._without_the_lost(order, at_s), left, rate
            case FlyHome():
                self._way_home = plan_return(self._keeping_out(order.zones), at_s, self._way_home)
                return self._way_home, None, 1.0
            case Hold() | GoTo():
                return *self._stopped(order, at_s), rate
            case Slower():
                return self._at(at_s, order.factor), None, rate * order.factor
            case GoOn() if left is not None:
                return self._gone_on(left, at_s, ()), None, rate
            case GoOn():
                if rate == 1.0:
                    raise UsageError("the formation flies its plan", hint="it goes on after hold, go or slower")
                return self._at(at_s, 1.0 / rate), None, 1.0
            case _:
                return self._reshaped(order, at_s), left, rate

    def _keeping_out(self, zones: tuple[NoFlyZone, ...]) -> Plan:
        """The flown plan with zones that it was not planned for: it may lead through them."""
        known = self.flown.scenario.no_fly
        more = tuple(zone for zone in zones if zone not in known)
        return replace(self.flown, scenario=with_zones(self.flown.scenario, (*known, *more))) if more else self.flown

    def _at(self, at_s: float, factor: float) -> Plan:
        if self._left is not None:
            raise UsageError("the formation holds", hint="order resume, then slower")
        return _first_verified(slowed(self.flown, at_s, factor, push) for push in PUSHES_MPS2)

    def _stopped(self, order: Hold | GoTo, at_s: float) -> tuple[Plan, Left]:
        old, place = self.flown, None
        zones = order.zones if isinstance(order, Hold) else ()
        if isinstance(order, GoTo):
            _refuse_outside(order, old.scenario)
            place = np.array([order.north_m, order.east_m, -order.height_m])
        known = tuple(zone for zone in old.scenario.no_fly if zone not in zones)
        kept: list[Left] = []

        def attempts() -> Iterator[Plan]:
            for push in PUSHES_MPS2:
                for hover_s in HOVERS_S:
                    plan, left = stopped(old, at_s, self._left, place, hover_s, push)
                    kept.append(replace(left, before_zone=bool(zones)))
                    plan = replace(plan, scenario=with_zones(plan.scenario, (*known, *zones)))
                    yield plan
                    if any(check.constraint.kind is not Kind.BATTERY for check in verify(plan).failures):
                        break  # a shorter hover needs less charge, and nothing else

        return _first_verified(attempts()), kept[-1]

    def _gone_on(self, left: Left, at_s: float, zones: tuple[NoFlyZone, ...]) -> Plan:
        """The plan that was left, from `at_s` on; where a zone that came up is in its way, round it."""
        came_up = [zone for zone in self.flown.scenario.no_fly if zone not in left.plan.scenario.no_fly]
        came_up += [zone for zone in zones if zone not in came_up]
        known = left.plan.scenario.no_fly

        def attempts() -> Iterator[Plan]:
            for push in PUSHES_MPS2:
                plan = gone_on(self.flown, at_s, left, push)
                plan = replace(plan, scenario=with_zones(plan.scenario, (*known, *came_up)))
                yield plan
                if any(isinstance(check.constraint.of, ZoneName) for check in verify(plan).failures):
                    return  # at any pace

        plan = _first_verified(attempts())
        if not came_up or verify(plan).ok:
            return plan
        # A way round is longer, and from rest it takes time to come up to speed: the rest is flown more slowly.
        state = self.flown.leader_trajectory.state(at_s)
        for rate in ROUND_RATES:
            slow = gone_on(self.flown, at_s, left, PUSHES_MPS2[0], rate)
            slow = replace(slow, scenario=with_zones(slow.scenario, known))
            plan = Replanner(slow, spare_disks=len(came_up)).replan(state, at_s, came_up)
            if jump_between(self.flown, plan).allowed:
                break
        return plan

    def _round(self, order: Avoid, at_s: float) -> tuple[Plan, Left | None]:
        left, zone = self._left, order.zone
        if left is None or not left.before_zone:
            kept = _with_zone(self.flown, at_s, zone)
            t_s = np.arange(at_s, kept.t_end_s, _LOOK_S)
            if left is not None or (kept.zone_distances_m(t_s).min() > 0.0 and verify(kept).ok):
                return kept, left
        elif at_s > left.from_s:
            return self._gone_on(left, at_s, (zone,)), None
        zones = self.flown.scenario.no_fly[self._known :]
        zones = zones if zone in zones else (*zones, zone)
        if len(zones) > ZONES_MAX:
            raise UsageError(
                f"{len(zones)} zones came up in this flight; there is room for {ZONES_MAX}", hint=_OTHERWISE
            )
        return self._replanner.replan(self.flown.leader_trajectory.state(at_s), at_s, zones), None

    def _without_the_lost(self, order: CloseRanks, at_s: float) -> Plan:
        """The same track for those that remain; where one of them would meet one that left, another track."""
        rest = plan_of(self.flown, order.sysids, at_s)
        every = (*rest.scenario.no_fly, *order.zones)
        kept = replace(rest, scenario=with_zones(rest.scenario, every))
        if verify(kept).ok:
            return kept
        if self._rest is None or self._rest[0] != order:
            self._rest = order, Replanner(rest, spare_disks=len(order.zones))
        return self._rest[1].replan(rest.leader_trajectory.state(at_s), at_s, order.zones)

    def _reshaped(self, order: Scale | Reshape, at_s: float) -> Plan:
        """The same track in another shape from `at_s` on; where it cannot be flown so, another track."""
        old, formation = self.flown, self.flown.scenario.formation
        if formation.frame == "course" or any(change.auto for change in formation.change):
            raise Infeasible("the shape of this formation changes by itself all the time", hint=_OTHERWISE)
        table = (
            ChangeTable(kind="shrink", scale=order.factor, at_s=at_s)
            if isinstance(order, Scale)
            else ChangeTable(kind="reshape", to=order.name, at_s=at_s)
        )
        scenario = _with_change(with_times_of_changes(old.scenario, old), table, at_s)
        mission = old.phase(PhaseKind.MISSION)
        starts_s = tuple(sorted([*(move.start_s for move in old.scheduled_moves), at_s]))
        laid = lay(scenario, starts_s, mission.start_s, mission.end_s)
        plan = replace(
            rest_of(old, at_s),
            scenario=scenario,
            shape=_to_ground(old, shape_part(laid.shape, at_s, mission.end_s), mission.end_s),
            moves=laid.moves,
        )
        if verify(plan).ok:
            return plan
        return Replanner(plan, spare_disks=0).replan(old.leader_trajectory.state(at_s), at_s)


def _refuse_outside(order: GoTo, scenario: Scenario) -> None:
    """Raises Infeasible for a place where the leader may not be, before anything is planned."""
    for key in ("north_m", "east_m", "height_m"):
        wanted_m, (low_m, high_m) = getattr(order, key), getattr(scenario.limits, key)
        if not low_m <= wanted_m <= high_m:
            raise Infeasible.because(
                f"{key} = {wanted_m:g} is outside of [limits], {low_m:g} to {high_m:g} m", hint="go to a place inside"
            )


_OTHERWISE = "the old plan is flown on; order hold, return or land"


def _with_zone(plan: Plan, at_s: float, zone: NoFlyZone) -> Plan:
    """The rest of a plan as it is, with one more zone."""
    rest = rest_of(plan, at_s)
    others = tuple(one for one in rest.scenario.no_fly if one != zone)
    return replace(rest, scenario=with_zones(rest.scenario, (*others, zone)))


def _first_verified(plans: Iterator[Plan]) -> Plan:
    """The first plan that is verified; the last one, or what it raised, where none is."""
    last: Plan | None = None
    try:
        for last in plans:
            if verify(last).ok:
                return last
    except Infeasible:
        if last is None:
            raise
    assert last is not None
    return last


def _with_change(scenario: Scenario, table: ChangeTable, at_s: float) -> Scenario:
    """The scenario with one more change among those of its schedule."""
    changes = scenario.formation.change
    earlier = sum((change.at_s or 0.0) <= at_s for change in changes)
    formation = scenario.formation.model_copy(update={"change": (*changes[:earlier], table, *changes[earlier:])})
    return Scenario.model_validate(scenario.model_copy(update={"formation": formation}).model_dump())


def _to_ground(old: Plan, flight: Shape, end_s: float) -> Shape:
    """The shape of a flight, kept until the landing, and onto the ground below it."""
    last, landing = flight.at(np.nextafter(end_s, -np.inf)), old.phases[-1]
    parts = [flight] if end_s == landing.start_s else [flight, rigid(last, end_s, landing.start_s)]
    ground = landing_points_ned_m(old.scenario, last)
    return joined_shapes([*parts, shape_from_ground(landing.end_s, landing.start_s, ground, last, old.scenario)])
