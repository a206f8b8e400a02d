"""`gcs returns`: returns of the whole formation for instants along a plan, verified and kept in the plan's file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gcs.cli.shared.console import BEGAN_S, Screen
from gcs.cli.shared.shared_options import LIMIT_S, DebugOption, JsonOption, LimitOption, PlanArgument, option

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan
    from gcs.plan.verification.verify import Report
    from gcs.types import JsonObject

_EVERY_S = 10.0


def returns(
    plan: PlanArgument,
    every: Annotated[
        float,
        option("Time between two returns: the longest wait for one.", metavar="SECONDS", limits=(1.0, 7200.0, "s")),
    ] = _EVERY_S,
    limit: LimitOption = LIMIT_S,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Plan returns of the whole formation for instants along a plan, verify them and keep them in its file.

    Each begins with the plan's state at its instant, flies home over the terrain and round zones, and lands on the
    pads; what the plan took from the batteries counts. The plan itself stays as it is. An instant from which there is
    no return has the reason in the table, also where the time given (--limit) was over. Exit status 5 when the plan
    failed verification.

    Example: gcs returns plans/simulation1.skein --every 20
    """
    screen = Screen(json=json)
    from gcs.cli.shared.plan_argument import Stopwatch
    from gcs.plan.plan_file import load_plan
    from gcs.plan.verification.verify import refusal
    from gcs.util.long_work import shown, within

    watch = Stopwatch(BEGAN_S)
    with shown(screen.say), within(limit):
        loaded, report = load_plan(plan, screen.warn)
    watch.lap("load and verify")
    if not report.ok:
        raise refusal(report)
    found = prepared_in(screen, loaded, report, plan, limit_s=limit - watch.total_s, every_s=every)
    watch.lap("returns")
    screen.say(f"time: {watch}")
    screen.say(f"plan: {plan}")
    screen.result({"ok": True, "plan": plan, "hash": loaded.hash, **found, "time_s": watch.laps_s})
    return screen.ended(None)


def prepared_in(
    screen: Screen, plan: Plan, report: Report, path: Path, *, limit_s: float, every_s: float = _EVERY_S
) -> JsonObject:
    """Prepare the returns of a plan, keep them in its file, print their table, and return what `--json` has of them.

    Those that are not planned in `limit_s` are left out, with a warning.
    """
    from rich.table import Table

    from gcs.plan.plan_file import save_plan
    from gcs.plan.prepared_returns import prepare_returns
    from gcs.plan.verification.verify import verify
    from gcs.util.long_work import left_s, shown, within

    with shown(screen.say), within(limit_s):
        prepared = prepare_returns(plan, every_s)
        is_over = left_s() < 0.0
    save_plan(plan, report, path, prepared)
    rows: list[JsonObject] = []
    table = Table("begins", "duration", "battery", "separation", "clearance", title="returns of the whole formation")
    for one in prepared.returns:
        row: JsonObject = {"begins_s": one.begins_s, "ok": one.plan is not None, "cpu_s": one.cpu_s}
        if one.plan is None:
            table.add_row(f"{one.begins_s:.1f} s", f"none: {one.why_not}", "", "", "")
            rows.append({**row, "why_not": one.why_not})
            continue
        proved, charge = verify(one.plan), float(one.charge.max())
        apart_m = proved.separation_min_m
        table.add_row(
            f"{one.begins_s:.1f} s",
            f"{one.duration_s:.0f} s",
            f"{charge:.0%}",
            "–" if apart_m is None else f"≥ {apart_m:.2f} m",
            f"≥ {proved.clearance_min_m:.2f} m",
        )
        figures = {"duration_s": one.duration_s, "charge": charge, "separation_min_m": apart_m}
        rows.append({**row, **figures, "clearance_min_m": proved.clearance_min_m})
    screen.show(table)
    good = sum(one.plan is not None for one in prepared.returns)
    cpu_s = sum(one.cpu_s for one in prepared.returns)
    screen.say(f"returns: {good} of {len(prepared.returns)} verified, {cpu_s:.0f} s of CPU time")
    if is_over:
        screen.warn("the time limit passed before all returns were planned. Give more (--limit), or fewer (--every).")
    return {"returns": rows}
