"""Plans for the events of a scenario, made before the take-off: is there one, whenever the event happens?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gcs.errors import OutOfTime, PlanningError, UsageError
from gcs.plan.formation_orders import FlyHome, GoOn, GoTo, Hold, PlanOrder, Reshape, Scale, Slower
from gcs.plan.plan_changer import PlanChanger, Proposal
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import EventTable
from gcs.util.long_work import report

EVERY_S = 10.0
_LATEST_S = 1.0  # before the end of the mission


@dataclass(frozen=True)
class EventPlan:
    """The plan for one event at one instant, or the reason why there is none."""

    row: int  # of `[[on]]`; the first is 0
    order: PlanOrder
    at_s: float  # plan time
    proposal: Proposal | None
    why_not: str = ""
    in_time: bool = True  # False: the time limit passed before it was known whether there is a plan


def planned_order(row: EventTable) -> PlanOrder | None:
    """The order of a row that is answered by a new plan; None for one that each vehicle carries out by itself."""
    match row.order:
        case "scale" | "slower":
            assert row.factor is not None
            return Scale(row.factor) if row.order == "scale" else Slower(row.factor)
        case "shape":
            assert row.shape is not None
            return Reshape(row.shape)
        case "go":
            assert row.position_m is not None
            return GoTo(*row.position_m)
        case "hold":  # as one; a vehicle that is not heard gets no new plan
            return Hold() if row.silent_for_s is None else None
        case "home":
            return FlyHome()
        case "resume":
            return GoOn()
    return None


def other_order(row: EventTable) -> Literal["hold", "land", "return"] | None:
    """The order, to each vehicle by itself, of a row whose order has no plan; None: the old plan is flown on."""
    return "hold" if row.order == "hold" else row.otherwise


def plan_events(
    plan: Plan, every_s: float = EVERY_S, on_plan: Callable[[EventPlan], None] = lambda _: None
) -> tuple[EventPlan, ...]:
    """Plan and verify the answer to each event of a plan's scenario, for every `every_s` seconds of its mission.

    A row with `at_s` is planned for that instant alone. `on_plan` is called after each. Raises UsageError for a step
    that is not above 0.
    """
    if not every_s > 0.0:
        raise UsageError(f"every {every_s:g} s is no time between two instants", hint="give seconds above 0, as 10")
    mission = plan.phase(PhaseKind.MISSION)
    instants = np.arange(mission.start_s + every_s / 2.0, mission.end_s - _LATEST_S, every_s).tolist()
    found: list[EventPlan] = []
    for number, row in enumerate(plan.scenario.on):
        order, changer = planned_order(row), PlanChanger(plan)
        if order is None or isinstance(order, GoOn):  # with what, depends on what was left before
            continue
        for at_s in instants if row.at_s is None else [row.at_s]:
            try:
                report(f"planning the answer to row {number + 1}, {order}, at t = {at_s:.0f} s")
                one = EventPlan(number, order, at_s, changer.change(order, at_s))
            except OutOfTime as over:
                one = EventPlan(number, order, at_s, None, over.reason.rstrip("."), in_time=False)
            except (PlanningError, UsageError) as failure:
                one = EventPlan(number, order, at_s, None, failure.reason.rstrip("."))
            found.append(one)
            on_plan(one)
    return tuple(found)
