"""`gcs check-events`: whether the orders that answer the events of a scenario have plans, seen before the take-off."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from gcs.cli.shared.console import BEGAN_S, Screen
from gcs.cli.shared.shared_options import LIMIT_S, DebugOption, JsonOption, LimitOption, PlanArgument, option

if TYPE_CHECKING:
    from gcs.scenario.schema.scenario import Scenario
    from gcs.types import JsonObject

_EVERY_S = 10.0
FEWER = "give more time (--limit), or look at fewer instants (--every)"


def check_events(
    plan: PlanArgument,
    every: Annotated[
        float, option("Time between two instants of the plan.", metavar="SECONDS", limits=(1.0, 7200.0, "s"))
    ] = _EVERY_S,
    limit: LimitOption = LIMIT_S,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Plan the answers to a scenario's events from instants along its plan, and verify them.

    For each event whose order plans the rest of the flight anew: what would be flown if it happened then. Land and
    return need no plan, resume depends on what came before. Exit status 4 when an order has no plan from an instant,
    and no other order beside it (`otherwise`; for hold: each vehicle brakes by itself), or when not all were planned in
    the time given (--limit).

    Example: gcs check-events plans/simulation1.skein --every 5
    """
    screen = Screen(json=json)
    from rich.table import Table

    from gcs.cli.shared.plan_argument import Accepts, Stopwatch, plan_for
    from gcs.errors import OutOfTime, PlanningError, UsageError
    from gcs.plan.event_plans import other_order, plan_events
    from gcs.util.long_work import shown, within

    def refuse(scenario: Scenario) -> None:
        if not scenario.on:
            raise UsageError(f"{plan}: its scenario has no events", hint="write [[on]] into it, and plan it again")

    watch = Stopwatch(BEGAN_S)
    loaded, _ = plan_for(plan, screen, watch, Accepts(refuse=refuse), limit_s=limit)
    with shown(screen.say), within(limit - watch.total_s):
        found = plan_events(loaded, every)
    watch.lap("events")
    events = loaded.scenario.on
    table = Table("row", "order", "at", "plan", "planned in", title="answers to events")
    rows: list[JsonObject] = []
    for one in found:
        text, took, row = one.why_not, "", one.row + 1
        known: JsonObject = {"row": row, "order": str(one.order), "at_s": one.at_s, "ok": one.proposal is not None}
        if one.proposal is None:
            rows.append({**known, "why_not": one.why_not, "otherwise": other_order(events[one.row])})
        else:
            made = one.proposal
            text, took = f"verified, lands at t = {made.plan.t_end_s:.0f} s", f"{made.took_s:.2f} s"
            rows.append({**known, "lands_s": made.plan.t_end_s, "took_s": made.took_s})
        table.add_row(str(row), str(one.order), f"{one.at_s:.1f} s", text, took)
    screen.show(table)
    without = [one for one in found if one.proposal is None]
    bare = [one for one in without if other_order(events[one.row]) is None]
    screen.say(f"events: {len(found) - len(without)} of {len(found)} answers verified, {len(events)} rows")
    screen.say(f"time: {watch}")
    late = [one for one in found if not one.in_time]
    ok = not bare and not late
    screen.result({"ok": ok, "plan": plan, "hash": loaded.hash, "answers": rows, "time_s": watch.laps_s})
    if late:
        text = f"{len(late)} of {len(found)} answers were not planned in time: {late[0].why_not}"
        return screen.ended(OutOfTime(text, hint=FEWER))
    if bare:
        first = bare[0]
        return screen.ended(
            PlanningError(
                f"row {first.row + 1} of [[on]], {first.order}, has no plan at t = {first.at_s:.1f} s: {first.why_not}",
                hint='give the row otherwise = "hold", "land" or "return", or another order',
            )
        )
    return screen.ended(None)
