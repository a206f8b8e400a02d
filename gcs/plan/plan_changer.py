"""What may be asked of a plan in flight, and the verified plan that answers: its rest from an instant ahead."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gcs.errors import Infeasible, PlanningError, UsageError
from gcs.plan.formation.shape import Shape, rigid
from gcs.plan.formation.shape import joined as joined_shapes
from gcs.plan.formation.timeline import lay
from gcs.plan.formation_return import plan_return
from gcs.plan.replanning.formation_rest import plan_of, rest_of
from gcs.plan.replanning.parametric_nlp import with_zones
from gcs.plan.replanning.plan_pieces import continued, jump_between
from gcs.plan.replanning.remaining_plan import shape_part, with_times_of_changes
from gcs.plan.replanning.replanner import Replanner
from gcs.plan.trajectory.ground_phases import shape_from_ground
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Report, refusal, verify
from gcs.scenario.schema.scenario import ChangeTable, NoFlyZone, Scenario
from gcs.scenario.values.si import landing_points_ned_m

ZONES_MAX = 4  # that may come up in one flight
_REHEARSED = 0.3  # of the mission: where a re-plan is rehearsed


@dataclass(frozen=True)
class Avoid:
    """A disk that no vehicle may enter from now on, m north and east of the origin."""

    north_m: float
    east_m: float
    radius_m: float

    @property
    def zone(self) -> NoFlyZone:
        """The same as a zone of a scenario."""
        return NoFlyZone(north_m=self.north_m, east_m=self.east_m, radius_m=self.radius_m)

    def __str__(self) -> str:
        return f"avoid {self.radius_m:g} m around ({self.north_m:g}, {self.east_m:g})"


@dataclass(frozen=True)
class Scale:
    """The shape grows or shrinks to this share of its size."""

    factor: float

    def __str__(self) -> str:
        return f"scale its shape by {self.factor:g}"


@dataclass(frozen=True)
class Reshape:
    """The formation takes the shape of this name of its scenario."""

    name: str

    def __str__(self) -> str:
        return f'take the shape "{self.name}"'


@dataclass(frozen=True)
class FlyHome:
    """The formation flies home together and lands on its pads."""

    def __str__(self) -> str:
        return "fly home together"


@dataclass(frozen=True)
class CloseRanks:
    """The vehicles `sysids` fly on without those that left the formation, which may be in `zones` from now on."""

    sysids: tuple[int, ...]
    zones: tuple[NoFlyZone, ...]

    def __str__(self) -> str:
        return f"close ranks and fly on with {len(self.sysids)} vehicle{'s' if len(self.sysids) > 1 else ''}"


PlanOrder = Avoid | Scale | Reshape | FlyHome | CloseRanks


@dataclass(frozen=True)
class Proposal:
    """A verified plan that answers an order, and the seconds that it took to make."""

    plan: Plan
    report: Report
    took_s: float


class PlanChanger:
    """Changes one plan as often as asked. `flown` is the plan as it is flown, with what was adopted."""

    def __init__(self, plan: Plan) -> None:
        self.flown = plan
        self._known = len(plan.scenario.no_fly)  # zones of the plan that the programs were built for
        self._base = plan
        self._rest: tuple[CloseRanks, Replanner] | None = None  # programs that an earlier attempt built
        self._way_home: Plan | None = None  # of an earlier instant: the next one is found sooner near it

    @cached_property
    def _replanner(self) -> Replanner:
        return Replanner(self._base, spare_disks=ZONES_MAX)

    def rehearse(self) -> float:
        """Build the programs, and return the seconds that a re-plan and its verification take. Raises PlanningError."""
        mission = self._base.phase(PhaseKind.MISSION)
        at_s = mission.start_s + _REHEARSED * mission.duration_s
        replanner, began_s = self._replanner, time.perf_counter()
        verify(replanner.replan(self._base.leader_trajectory.state(at_s), at_s))
        return time.perf_counter() - began_s

    def change(self, order: PlanOrder, at_s: float) -> Proposal:
        """The plan from `at_s` on that carries out an order. Raises PlanningError or UsageError with the reason.

        Its first state and shape are those of the flown plan; it is verified.
        """
        began_s = time.perf_counter()
        plan = self._answering(order, at_s)
        report = verify(plan)
        if not report.ok:
            raise PlanningError(f"the new plan failed verification: {refusal(report).message}", hint=_OTHERWISE)
        if not (jump := jump_between(self.flown, plan)).allowed:
            raise PlanningError(f"the new plan would begin with a jump of {jump}", hint=_OTHERWISE)
        return Proposal(plan, report, time.perf_counter() - began_s)

    def adopt(self, plan: Plan) -> None:
        """Go on from this plan: the vehicles fly it."""
        self._rest = None
        if plan.sysids != self.flown.sysids:
            self.flown = self._base = plan
            self._known, self._way_home = len(plan.scenario.no_fly), None
            self.__dict__.pop("_replanner", None)
            return
        self.flown = continued(self.flown, plan)
        if plan.moves != self._base.moves:  # the programs are for one schedule of shapes
            self._base, self._known = plan, len(plan.scenario.no_fly)
            self.__dict__.pop("_replanner", None)

    def _answering(self, order: PlanOrder, at_s: float) -> Plan:
        if isinstance(order, Avoid):
            return self._around(order, at_s)
        if isinstance(order, CloseRanks):
            return self._without_the_lost(order, at_s)
        if isinstance(order, FlyHome):
            self._way_home = plan_return(self.flown, at_s, self._way_home)
            return self._way_home
        return self._reshaped(order, at_s)

    def _around(self, order: Avoid, at_s: float) -> Plan:
        zones = (*self.flown.scenario.no_fly[self._known :], order.zone)
        if len(zones) > ZONES_MAX:
            raise UsageError(
                f"{len(zones)} zones came up in this flight; there is room for {ZONES_MAX}", hint=_OTHERWISE
            )
        return self._replanner.replan(self.flown.leader_trajectory.state(at_s), at_s, zones)

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


_OTHERWISE = "the old plan is flown on; order hold, return or land"


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
