"""`gcs replan`: plan the remaining flight again, from a state of the leader, around new no-fly disks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.shared.console import BEGAN_S, Screen
from gcs.cli.shared.shared_options import (
    LIMIT_S,
    DebugOption,
    JsonOption,
    LimitOption,
    PlanArgument,
    as_number,
    option,
    plan_file,
)
from gcs.errors import OutOfTime

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan
    from gcs.scenario.schema.scenario import NoFlyZone
    from gcs.types import Array

_LATEST_S = 7200.0
_LARGEST = 1e6  # m, m/s, degrees: larger numbers are a mistake
_PARTS = "NORTH,EAST,HEIGHT[,VNORTH,VEAST,VUP[,ROLL,PITCH,YAW[,rates]]]"


def replan(
    plan: PlanArgument,
    at: Annotated[float, option("Plan time, s after T0.", metavar="T", shown=False, limits=(0.0, _LATEST_S, "s"))],
    state: Annotated[
        str | None,
        option(
            f"State of the leader: {_PARTS}; m, m/s, degrees. Numbers left out are as planned.",
            metavar="NUMBERS",
            shown="as planned",
        ),
    ] = None,
    disk: Annotated[
        list[str] | None, option("A new no-fly disk, m. Repeat it for several.", metavar="NORTH,EAST,RADIUS")
    ] = None,
    to: Annotated[Path | None, plan_file("PLAN-at-T.skein")] = None,
    picture: Annotated[Path | None, option("Draw a map of the new plan.", "--picture", "-p", metavar="FILE")] = None,
    limit: LimitOption = LIMIT_S,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Plan the remaining flight again, from the leader's state at a time, around new no-fly disks; verify and write it.

    The new plan begins in the air. You can show, verify and export it (--format setpoints, history, kml and others
    without missions); `gcs fly` does not take it. Exit status 0 when the plan is verified, 5 when it failed
    verification.

    Example: gcs replan plans/simulation1.skein --at 100 --disk 560,480,30
    """
    screen = Screen(json=json)
    from gcs.cli.planning.plan import plan_data, show_plan
    from gcs.cli.planning.plan_tables import say_battery
    from gcs.cli.shared.plan_argument import Stopwatch, plan_path, solve_line
    from gcs.plan.plan_file import SUFFIX, load_plan, save_plan
    from gcs.plan.replanning.replanner import Replanner
    from gcs.plan.verification.verify import refusal, verify
    from gcs.util.long_work import shown, within

    watch = Stopwatch(BEGAN_S)
    try:
        with shown(screen.say), within(limit):
            old, old_report = load_plan(plan, screen.warn)
            if not old_report.ok:
                screen.warn(f"{plan}: the old plan fails verification: {old_report.failures[0]}")
            leader, disks = _state(state, old, at), tuple(_disk(text) for text in disk or ())
            watch.lap("load")
            replanner = Replanner(old, spare_disks=len(disks))
            watch.lap("build")
            made = replanner.replan(leader, at, disks, on_round=lambda done: screen.say(solve_line(done)))
            watch.lap("re-plan")
            report = verify(made)
            watch.lap("verify")
    except OutOfTime as over:
        raise OutOfTime(f"nothing is written: {over.reason}", hint="give more time (--limit)") from None
    path = plan_path(to, plan.with_name(f"{plan.stem}-at-{at:g}{SUFFIX}"))
    save_plan(made, report, path)
    if picture is not None:
        from gcs.flight.plots.overview_plot import save_overview

        save_overview(made.scenario, made, picture)
    watch.lap("write")
    show_plan(screen, made, report)
    if made.used_before:  # else what is left is not known
        say_battery(screen, made)
    screen.say(f"time: {watch}")
    screen.say(f"plan: {path}")
    screen.result(
        {
            **plan_data(made, report, path),
            "at_s": at,
            "iterations": [done.iterations for done in made.mesh_history],
            "time_s": watch.laps_s,
            **({"picture": picture} if picture else {}),
        }
    )
    return screen.ended(None if report.ok else refusal(report))


def _state(text: str | None, plan: Plan, at_s: float) -> Array:
    """The leader's state (12,): as planned, replaced by the numbers in `text`."""
    import numpy as np

    state = np.array(plan.leader_trajectory.state(min(max(at_s, plan.t_start_s), plan.t_end_s - 1e-6)))
    if text is None:
        return state
    given = _numbers("--state", text, (3, 6, 9, 12), _PARTS)
    units = np.array([1.0, 1.0, -1.0, 1.0, 1.0, -1.0, *[np.radians(1.0)] * 6])
    state[: len(given)] = given * units[: len(given)]
    return state


def _disk(text: str) -> NoFlyZone:
    from gcs.scenario.schema.scenario import NoFlyZone

    north_m, east_m, radius_m = _numbers("--disk", text, (3,), "NORTH,EAST,RADIUS")
    if radius_m <= 0.0:
        raise typer.BadParameter(f"{text}: the radius must be more than 0 m", param_hint="--disk")
    return NoFlyZone(north_m=north_m, east_m=east_m, radius_m=radius_m)


def _numbers(option: str, text: str, counts: tuple[int, ...], form: str) -> list[float]:
    numbers = list(map(as_number, text.split(",")))
    if len(numbers) not in counts or not all(abs(n) <= _LARGEST for n in numbers):
        raise typer.BadParameter(f"{text!r} is not {form}", param_hint=option)
    return numbers
