"""`gcs plan`: from a scenario to a verified plan on disk."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.console import BEGAN_S, Screen
from gcs.cli.shared_options import DebugOption, JsonOption, MissionArgument

if TYPE_CHECKING:
    from gcs.plan.formation.changes.timeline import Move
    from gcs.plan.trajectory.plan import Plan
    from gcs.plan.verification.verify import Report

_BAR = 20  # characters


def plan(
    mission: MissionArgument,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Plan file to write.", show_default="plans/NAME.skein")
    ] = None,
    alternatives: Annotated[
        bool, typer.Option("--alternatives", help="Optimise every way through the map and show what each costs.")
    ] = False,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Plan a mission, verify the plan and write it.

    A plan that does not hold is written too, so that it can be looked at, and refused by every later command.

    Example: gcs plan missions/simulation1
    """
    screen = Screen(json=json)
    from gcs.cli.plan_argument import Stopwatch, plan_for, refusal
    from gcs.plan.trajectory.plan_file import SUFFIX, save_plan

    watch = Stopwatch(BEGAN_S)
    watch.lap("start")
    made, report = plan_for(mission, screen, watch, unverified=True, every_way=alternatives, in_the_air=True)
    path = out or Path("plans") / f"{made.scenario.name}{SUFFIX}"
    save_plan(made, report, path)
    watch.lap("write")
    show_plan(screen, made, report)
    if alternatives:
        _show_alternatives(screen, made)
    screen.say(f"time: {watch}")
    screen.say(f"plan: {path}")
    screen.result(
        {
            "ok": report.ok,
            "plan": path,
            "hash": made.hash,
            "objective": made.objective,
            "clearance_min_m": report.clearance_min_m,
            "separation_min_m": report.separation_min_m,
            "window_error_max_m": report.window_error_max_m,
            "terminal_error_m": report.terminal_error_m,
            "failures": [str(c) for c in report.failures],
            "changes": [asdict(m) for m in made.moves],
            "information": _information(made),
            "alternatives": [asdict(a) for a in made.alternatives],
            "mesh": [asdict(r) for r in made.mesh_history],
            "time_s": watch.laps_s,
        }
    )
    if report.ok:
        return 0
    if json:
        return refusal(report).exit_code
    raise refusal(report)


def show_plan(screen: Screen, made: Plan, report: Report) -> None:
    """What a person wants to know about a plan, in a few lines."""
    scenario = made.scenario
    count = len(made.sysids)
    screen.say("")
    screen.say(f"{scenario.title or scenario.name}")
    screen.say(
        f"  {count} vehicle{'s' if count > 1 else ''}, {made.flight_s:g} s from T0 to the arrival, "
        f"{made.t_end_s - made.t_start_s:g} s from the {'ground' if made.begin_state is None else 'air'} to the ground"
    )
    for phase in made.phases:
        screen.say(f"  {phase.start_s:8.1f} s … {phase.end_s:6.1f} s  {phase.name}")
    _show_changes(screen, made)
    screen.say(f"verified: {'yes' if report.ok else 'NO'}, {len(report.checks)} checks")
    limits = scenario.limits
    screen.say(f"  clearance above ground at least {report.clearance_min_m:.3f} m (asked {limits.clearance_min_m:g} m)")
    if report.separation_min_m is not None:
        screen.say(f"  separation at least {report.separation_min_m:.3f} m (asked {limits.separation_min_m:g} m)")
    screen.say(f"  Eq. 1 integrated again over 5 s: within {report.window_error_max_m * 1e3:.2f} mm (asked 10 mm)")
    screen.say(f"  position at the arrival: within {report.terminal_error_m * 1e3:.3f} mm (asked 1 mm)")
    for check in report.failures:
        screen.say(f"  NOT HELD: {check}")


def _information(made: Plan) -> dict[str, list[int]]:
    """Whose state each vehicle needs at T0 when it follows telemetry (graph G of §2.2)."""
    sources = made.information_graph(0.0).sources
    return {
        str(sysid): [made.sysids[row] for row in rows] for sysid, rows in zip(made.sysids, sources, strict=True) if rows
    }


def _show_changes(screen: Screen, made: Plan) -> None:
    """Changes of shape on the flight's time line, with the paper's least time beside the flown one."""
    if not made.moves:
        return
    screen.say("changes of shape, with the paper's least time (Eqs. 8, 12, 14) beside the flown one")
    name = max(len(move.name) for move in made.moves)
    for move in made.moves:
        how = ", ".join(part for part in (move.trigger, move.way, f"limited by {move.limited_by}") if part)
        screen.say(
            f"  {move.start_s:8.1f} s … {move.end_s:6.1f} s  {_bar(move, made.flight_s)}  {move.name:<{name}}  "
            f"{move.paper_time_s:5.1f} s → {move.end_s - move.start_s:5.1f} s"
        )
        screen.say(f"  {'':29}{how}; vehicles at least {move.least_gap_m:.2f} m apart")


def _bar(move: Move, flight_s: float) -> str:
    """The flight as a line, the change as the thick part of it."""
    first = int(_BAR * move.start_s / flight_s)
    last = max(math.ceil(_BAR * move.end_s / flight_s), first + 1)
    return f"{'─' * first}{'━' * (last - first)}{'─' * (_BAR - last)}"


def _show_alternatives(screen: Screen, made: Plan) -> None:
    """Every way through the map, shortest first."""
    from rich.table import Table

    table = Table("way", "length", "cost", "verdict", title="ways through the map")
    for number, way in enumerate(made.alternatives, start=1):
        cost = "–" if way.objective is None else f"{way.objective:.4f}"
        table.add_row(str(number), f"{way.length_m:.0f} m", cost, way.verdict)
    screen.show(table)
