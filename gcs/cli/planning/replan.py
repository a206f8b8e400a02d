"""`gcs replan`: a plan that goes on from where the formation is, round what is new."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.console import BEGAN_S, Screen
from gcs.cli.shared_options import DebugOption, JsonOption

if TYPE_CHECKING:
    from gcs.physics.quadrotor import Array
    from gcs.plan.trajectory.plan import MeshRound, Plan
    from gcs.scenario.schema.scenario import NoFlyZone

_PARTS = "NORTH,EAST,HEIGHT[,VNORTH,VEAST,VUP[,ROLL,PITCH,YAW[,their rates]]]"


def replan(
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="Plan file (.skein).", show_default=False)],
    at: Annotated[float, typer.Option("--at", metavar="T", help="Time of the plan, s after T0.", show_default=False)],
    state: Annotated[
        str | None,
        typer.Option(
            metavar="NUMBERS",
            help=f"Where the leader is: {_PARTS}; m, m/s, degrees. What is not said is as planned.",
            show_default="as planned",
        ),
    ] = None,
    disk: Annotated[
        list[str] | None,
        typer.Option("--disk", metavar="NORTH,EAST,RADIUS", help="A new no-fly disk, m; as often as there are."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Plan file to write.", show_default="PLAN-at-T.skein")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option("--picture", "-p", metavar="FILE", help="Draw a map of the new plan.")
    ] = None,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Plan the rest of a flight anew, from where the leader is at a time, round new no-fly disks; verify and write it.

    The new plan begins in the air. It can be looked at, verified and exported (setpoints, histories, maps).

    Example: gcs replan plans/simulation1.skein --at 100 --disk 560,480,30
    """
    screen = Screen(json=json)
    from gcs.cli.plan_argument import Stopwatch, refusal
    from gcs.cli.planning.plan import show_plan
    from gcs.plan.replanning.replanner import Replanner
    from gcs.plan.trajectory.plan_file import SUFFIX, load_plan, save_plan
    from gcs.plan.verification.verify import verify

    watch = Stopwatch(BEGAN_S)
    old, _ = load_plan(plan)
    leader, disks = _state(state, old, at), tuple(_disk(text) for text in disk or ())
    watch.lap("load")
    replanner = Replanner(old, spare_disks=len(disks))
    watch.lap("build")
    made = replanner.replan(leader, at, disks, on_round=lambda done: screen.say(_line(done)))
    watch.lap("re-plan")
    report = verify(made)
    watch.lap("verify")
    path = out or plan.with_name(f"{plan.stem}-at-{at:g}{SUFFIX}")
    save_plan(made, report, path)
    if picture is not None:
        from gcs.flight.assessment.overview_plot import save_overview

        save_overview(made.scenario, made, picture)
    watch.lap("write")
    show_plan(screen, made, report)
    screen.say(f"time: {watch}")
    screen.say(f"plan: {path}")
    screen.result(
        {
            "ok": report.ok,
            "plan": path,
            "hash": made.hash,
            "at_s": at,
            "objective": made.objective,
            "clearance_min_m": report.clearance_min_m,
            "separation_min_m": report.separation_min_m,
            "failures": [str(c) for c in report.failures],
            "iterations": [done.iterations for done in made.mesh_history],
            "time_s": watch.laps_s,
            **({"picture": picture} if picture else {}),
        }
    )
    if report.ok:
        return 0
    if json:
        return refusal(report).exit_code
    raise refusal(report)


def _line(done: MeshRound) -> str:
    verdict = done.complaints[0] if done.complaints else "holds between nodes"
    return f"{done.unknowns} unknowns, {done.iterations} iterations, {done.seconds:.2f} s: {verdict}"


def _state(text: str | None, plan: Plan, at_s: float) -> Array:
    """The leader's state (12,) as planned, with the numbers that were given."""
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
        raise typer.BadParameter(f"{text}: the radius must be larger than 0", param_hint="--disk")
    return NoFlyZone(north_m=north_m, east_m=east_m, radius_m=radius_m)


def _numbers(option: str, text: str, counts: tuple[int, ...], form: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not all(map(math.isfinite, numbers)):
        raise typer.BadParameter(f"{text!r} is not {form}", param_hint=option)
    return numbers
