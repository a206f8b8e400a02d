"""`gcs fly`: plan, verify, export, upload, read back, fly, judge."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.console import BEGAN_S, Screen
from gcs.cli.shared_options import (
    GATES,
    AlsoToOption,
    DebugOption,
    JsonOption,
    KeyOption,
    LinkOption,
    MapOption,
    MissionArgument,
    TransferOption,
    UnverifiedOption,
    connection,
    one_of,
    unknown_choice,
    watchers,
    within,
)
from gcs.errors import UsageError

if TYPE_CHECKING:
    from gcs.scenario.schema.scenario import Scenario

SPEEDUPS = (0.01, 10_000.0)  # least and most, in multiples of real time
LARGEST_SEED = 2**53
LARGEST_SYSID = 254  # 255 is the ground station


def fly(
    mission: MissionArgument,
    sim: Annotated[bool, typer.Option("--sim", help="Start emulated vehicles for this flight, and fly them.")] = False,
    link: LinkOption = None,
    systems: MapOption = None,
    signing_key_file: KeyOption = None,
    transfer: TransferOption = "auto",
    missions_only: Annotated[
        bool, typer.Option("--missions-only", help="With --link: do not change fences, rally points and parameters.")
    ] = False,
    mode: Annotated[
        str,
        typer.Option(
            "--mode",
            help="stream: setpoint stream; mission: waypoint missions on board.",
            autocompletion=one_of("stream", "mission"),
        ),
    ] = "stream",
    speedup: Annotated[
        str, typer.Option("--speedup", help="With --sim: speed in multiples of real time, or max.")
    ] = "10",
    seed: Annotated[
        int, typer.Option("--seed", help="With --sim: seed of the noise of sensors, and of the gusts.")
    ] = 0,
    fault: Annotated[
        list[str] | None,
        typer.Option("--fault", help="With --sim: inject a fault, e.g. 3:die@60; see sim-bridge --help."),
    ] = None,
    wind: Annotated[
        str | None,
        typer.Option(
            "--wind", metavar="SPEED@FROM", help="With --sim: wind in m/s and degrees; 3@270 comes from the west."
        ),
    ] = None,
    gusts: Annotated[
        str | None,
        typer.Option(
            "--gusts",
            help="With --sim: gusts: light (0.5 m/s), moderate (1 m/s), severe (2 m/s), "
            "or another standard deviation in m/s.",
            autocompletion=one_of("light", "moderate", "severe"),
        ),
    ] = None,
    follow: Annotated[
        bool,
        typer.Option("--follow", help="With --mode stream: followers use the leader's telemetry instead of its plan."),
    ] = False,
    on_loss: Annotated[
        str,
        typer.Option(
            "--on-loss",
            help="What the other vehicles do when one is lost: land, return or continue.",
            autocompletion=one_of("land", "return", "continue"),
        ),
    ] = "land",
    on_leader_loss: Annotated[
        str,
        typer.Option(
            "--on-leader-loss",
            help="With --follow, when the leader is lost: promote (the next vehicle leads) or return.",
            autocompletion=one_of("promote", "return"),
        ),
    ] = "promote",
    nav: Annotated[
        str,
        typer.Option(
            "--nav",
            help="With --sim --mode mission: waypoint navigator of the emulated vehicles. own: that of the autopilot; "
            "ideal: it keeps the plan's times; auto: own where it is predicted to meet the table `judge`, else ideal.",
            autocompletion=one_of("auto", "own", "ideal"),
        ),
    ] = "auto",
    gates: Annotated[
        int,
        typer.Option(
            "--gates",
            metavar="N",
            help="With --mode mission: number of points where all vehicles wait for a common time.",
        ),
    ] = 0,
    reserve: Annotated[
        str | None,
        typer.Option(
            "--reserve",
            metavar="SHARE",
            help="With --link: least charge left after the flight, of a full battery; default: `reserve` of the table "
            "`preflight`.",
        ),
    ] = None,
    waive: Annotated[
        list[str] | None,
        typer.Option(
            "--waive",
            metavar="CHECK",
            help="With --link: fly although this pre-flight check fails, by its name; the flight's folder records it. "
            "Give it once for each check.",
        ),
    ] = None,
    to: Annotated[Path, typer.Option("--to", help="Folder for the folders of flights.")] = Path("flights"),
    also_to: AlsoToOption = None,
    yes_arm: Annotated[bool, typer.Option("--yes-arm", help="With --link: arm without confirmation.")] = False,
    unverified: UnverifiedOption = False,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Plan a mission, upload it to every vehicle, read it back, fly it and judge the flight.

    Exit status 0 when the flight met every criterion of the scenario's table `judge`, 10 when it did not, 9 when it was
    aborted.

    Examples: gcs fly missions/simulation1 --sim

    gcs fly missions/simulation1 --sim --mode mission --speedup max

    gcs fly missions/simulation1 --sim --speedup 1 --also-to udpout:127.0.0.1:14550
    """
    screen = Screen(json=json)
    _check(sim, bool(link), mode, speedup, seed)
    _check_choices(follow, mode, on_loss, on_leader_loss)
    _check_missions(mode, nav, gates)
    share = _reserve(reserve, sim)
    if waive and sim:
        raise UsageError("--waive applies to vehicles on a --link only", hint="leave --waive out with --sim")
    known = connection(link, systems, signing_key_file, transfer) if link else None
    watched_at = watchers(also_to, known.links if known else None)
    from gcs.cli.flights.fly_view import fly_and_judge
    from gcs.cli.plan_argument import Stopwatch, plan_for
    from gcs.flight.contingency.policy import OnLeaderLoss, OnLoss
    from gcs.flight.options import FlightMode, FlightOptions
    from gcs.flight.run import Emulated, FlightRun, refuse_late_starts
    from gcs.flight.setup.mission_choice import TimeKeeping
    from gcs.flight.setup.preflight_check import known_checks
    from gcs.flight.setup.simulator_process import refuse_wrong_options

    waived = known_checks(waive or ())
    watch = Stopwatch(BEGAN_S)
    watch.lap("start")

    def refuse(scenario: Scenario) -> None:
        _refuse_large(scenario)
        if mode == "mission":
            refuse_late_starts(scenario)
        if sim and (fault or wind is not None or gusts is not None):
            refuse_wrong_options(scenario, tuple(fault or ()), wind, gusts)

    plan, report = plan_for(mission, screen, watch, unverified=unverified, refuse=refuse)
    limits = plan.scenario.preflight
    if share is not None:
        limits = limits.model_copy(update={"reserve": share})
    choices = FlightOptions(
        follow=follow, on_loss=OnLoss(on_loss), on_leader_loss=OnLeaderLoss(on_leader_loss), waived=waived
    )
    emulated = Emulated(speedup, seed, tuple(fault or ()), wind, gusts)
    keeping = TimeKeeping(FlightMode(mode), sim, nav, gates)
    safety = not missions_only
    run = FlightRun(
        plan, report, keeping, known, emulated, to, choices, safety=safety, limits=limits, also_to=watched_at
    )
    return fly_and_judge(run, screen, watch, asks=not yes_arm)


def _refuse_large(scenario: Scenario) -> None:
    count = len(scenario.formation.sysids)
    if max(scenario.formation.sysids) > LARGEST_SYSID:
        raise UsageError(
            f"{count} vehicles: one MAVLink network has at most {LARGEST_SYSID} system ids",
            hint="fly a smaller formation; `gcs export` writes files for all vehicles",
        )


def _check(sim: bool, link: bool, mode: str, speedup: str, seed: int) -> None:
    """Refuse wrong options before heavy imports. Raises `UsageError`."""
    if sim == link:
        raise UsageError(
            "give --sim for emulated vehicles, or --link for vehicles on a link, and not both",
            hint="for example `gcs fly missions/simulation1 --sim`",
        )
    if mode not in ("stream", "mission"):
        raise unknown_choice("--mode", mode, ("stream", "mission"))
    if speedup != "max":
        try:
            rate = float(speedup)
        except ValueError:
            rate = 0.0
        if not SPEEDUPS[0] <= rate <= SPEEDUPS[1]:
            raise UsageError(
                f"--speedup {speedup[:40]}: not a speed",
                hint=f"give a number from {SPEEDUPS[0]:g} to {SPEEDUPS[1]:g}, or max",
            )
    within("--seed", seed, 0, LARGEST_SEED)


def _check_choices(follow: bool, mode: str, on_loss: str, on_leader_loss: str) -> None:
    """Refuse unknown values of --on-loss and --on-leader-loss, and --follow without a setpoint stream."""
    if follow and mode != "stream":
        raise UsageError("--follow needs a setpoint stream", hint="give --mode stream")
    for name, word, known in (
        ("--on-loss", on_loss, ("land", "return", "continue")),
        ("--on-leader-loss", on_leader_loss, ("promote", "return")),
    ):
        if word not in known:
            raise unknown_choice(name, word, known)


def _check_missions(mode: str, nav: str, gates: int) -> None:
    if nav not in ("auto", "own", "ideal"):
        raise unknown_choice("--nav", nav, ("auto", "own", "ideal"))
    within("--gates", gates, *GATES)
    if gates and (mode != "mission" or nav == "ideal"):
        raise UsageError(
            "--gates needs waypoint missions and the autopilot's own navigator",
            hint="add --mode mission and leave --nav ideal out",
        )


def _reserve(text: str | None, sim: bool) -> float | None:
    """The share of `30%` or `0.3`. Raises `UsageError`."""
    if text is None:
        return None
    if sim:
        raise UsageError("--reserve applies to vehicles on a --link only", hint="leave --reserve out with --sim")
    number, percent, rest = text.partition("%")
    try:
        share = float(number) / (100.0 if percent else 1.0)
    except ValueError:
        share = -1.0
    if rest or not 0.0 <= share < 1.0:
        raise UsageError(f"--reserve {text}: not a share", hint="give a share of a full battery: 30% or 0.3")
    return share
