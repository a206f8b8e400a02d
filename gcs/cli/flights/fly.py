"""`gcs fly`: plan, verify, export, upload, read back, fly, judge."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.console import BEGAN_S, Screen
from gcs.cli.shared_options import (
    DebugOption,
    JsonOption,
    KeyOption,
    LinkOption,
    MapOption,
    MissionArgument,
    TransferOption,
    UnverifiedOption,
    connection,
)
from gcs.errors import UsageError

LARGEST_SYSID = 254  # 255 is the ground station


def fly(
    mission: MissionArgument,
    sim: Annotated[bool, typer.Option("--sim", help="Fly emulated vehicles, started for this flight.")] = False,
    link: LinkOption = None,
    systems: MapOption = None,
    signing_key_file: KeyOption = None,
    transfer: TransferOption = "auto",
    missions_only: Annotated[
        bool,
        typer.Option("--missions-only", help="With --link: leave fences, rally points and parameters as they are."),
    ] = False,
    mode: Annotated[
        str, typer.Option("--mode", help="stream: timed setpoints; mission: the waypoints uploaded.")
    ] = "stream",
    speedup: Annotated[str, typer.Option("--speedup", help="With --sim: times real time, or max.")] = "10",
    seed: Annotated[int, typer.Option("--seed", help="With --sim: of every sensor's noise.")] = 0,
    fault: Annotated[
        list[str] | None, typer.Option("--fault", help="With --sim: a fault, e.g. 3:die@60; see sim-bridge --help.")
    ] = None,
    wind: Annotated[
        str | None,
        typer.Option("--wind", metavar="SPEED@FROM", help="With --sim: m/s and degrees, 3@270 from the west."),
    ] = None,
    gusts: Annotated[
        str | None, typer.Option("--gusts", help="With --sim: light, moderate, severe, or their deviation in m/s.")
    ] = None,
    follow: Annotated[
        bool, typer.Option("--follow", help="Stream mode: followers fly where their leader is, not where it should be.")
    ] = False,
    on_loss: Annotated[
        str, typer.Option("--on-loss", help="What the others do when a vehicle is lost: land, return or continue.")
    ] = "land",
    on_leader_loss: Annotated[
        str, typer.Option("--on-leader-loss", help="With --follow: promote (the next one leads) or return.")
    ] = "promote",
    nav: Annotated[
        str,
        typer.Option(
            "--nav",
            help="With --sim --mode mission: who flies waypoints, the autopilot's own navigator (own), one that keeps "
            "the plan's times (ideal), or own where the scenario's judge would be content (auto).",
        ),
    ] = "auto",
    gates: Annotated[
        int,
        typer.Option("--gates", metavar="N", help="With --mode mission: points where all wait for their common time."),
    ] = 0,
    reserve: Annotated[
        str | None,
        typer.Option("--reserve", metavar="SHARE", help="With --link: what is left of a full battery; default 25%."),
    ] = None,
    to: Annotated[Path, typer.Option("--to", help="Where flights leave their folders.")] = Path("flights"),
    yes_arm: Annotated[bool, typer.Option("--yes-arm", help="With --link: arm without asking.")] = False,
    unverified: UnverifiedOption = False,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Plan a mission, upload it to every vehicle, read it back, fly it and judge the flight.

    Exit status 0 only if the flight held everything the scenario asks.

    Examples: gcs fly missions/simulation1 --sim

    gcs fly missions/simulation1 --sim --mode mission --speedup max
    """
    screen = Screen(json=json)
    _check(sim, bool(link), mode, speedup)
    _check_choices(follow, mode, on_loss, on_leader_loss)
    _check_missions(mode, nav, gates)
    kept = _reserve(reserve, sim)
    known = connection(link, systems, signing_key_file, transfer) if link else None
    from gcs.cli.flights.fly_view import fly_and_judge
    from gcs.cli.plan_argument import Stopwatch, plan_for
    from gcs.flight.contingency.policy import OnLeaderLoss, OnLoss
    from gcs.flight.options import FlightMode, FlightOptions
    from gcs.flight.run import Emulated, FlightRun
    from gcs.flight.setup.mission_choice import TimeKeeping
    from gcs.flight.setup.preflight import PreflightLimits

    watch = Stopwatch(BEGAN_S)
    watch.lap("start")
    plan, report = plan_for(mission, screen, watch, unverified=unverified)
    if max(plan.sysids) > LARGEST_SYSID:
        raise UsageError(
            f"{len(plan.sysids)} vehicles do not fit on one MAVLink network: system ids end at {LARGEST_SYSID}",
            hint="`gcs export` writes files for all of them; fly smaller formations",
        )
    limits = PreflightLimits() if kept is None else PreflightLimits(reserve=kept)
    choices = FlightOptions(follow=follow, on_loss=OnLoss(on_loss), on_leader_loss=OnLeaderLoss(on_leader_loss))
    emulated = Emulated(speedup, seed, tuple(fault or ()), wind, gusts)
    keeping = TimeKeeping(FlightMode(mode), sim, nav, gates)
    safety = not missions_only
    sortie = FlightRun(plan, report, keeping, known, emulated, to, choices, safety=safety, limits=limits)
    return fly_and_judge(sortie, screen, watch, asks=not yes_arm)


def _check(sim: bool, link: bool, mode: str, speedup: str) -> None:
    """Refuse what cannot be meant before anything heavy starts."""
    if sim == link:
        raise UsageError(
            "say what to fly: --sim for emulated vehicles, or --link for vehicles that are out there",
            hint="for example `gcs fly missions/simulation1 --sim`",
        )
    if mode not in ("stream", "mission"):
        raise UsageError(f"--mode {mode}: there are stream and mission")
    if speedup != "max":
        try:
            positive = float(speedup) > 0
        except ValueError:
            positive = False
        if not positive:
            raise UsageError(f"--speedup {speedup}: give a number above 0, or max")


def _check_choices(follow: bool, mode: str, on_loss: str, on_leader_loss: str) -> None:
    """The words there are for what is to happen when things fail."""
    if follow and mode != "stream":
        raise UsageError("--follow sends setpoints all the time: it needs --mode stream")
    for name, word, known in (
        ("--on-loss", on_loss, ("land", "return", "continue")),
        ("--on-leader-loss", on_leader_loss, ("promote", "return")),
    ):
        if word not in known:
            raise UsageError(f"{name} {word}: there are {', '.join(known)}")


def _check_missions(mode: str, nav: str, gates: int) -> None:
    if nav not in ("auto", "own", "ideal"):
        raise UsageError(f"--nav {nav}: there are auto, own and ideal")
    if gates < 0:
        raise UsageError(f"--gates {gates}: give a number, 0 or more")
    if gates and (mode != "mission" or nav == "ideal"):
        raise UsageError("gates are for missions that fly themselves", hint="add --mode mission, leave --nav ideal out")


def _reserve(text: str | None, sim: bool) -> float | None:
    """`30%` or `0.3` as a share. Raises `UsageError`."""
    if text is None:
        return None
    if sim:
        raise UsageError("--reserve is asked of vehicles on a --link; emulated ones are not looked at before")
    number, percent, rest = text.partition("%")
    try:
        share = float(number) / (100.0 if percent else 1.0)
    except ValueError:
        share = -1.0
    if rest or not 0.0 <= share < 1.0:
        raise UsageError(f"--reserve {text}: give a share of a full battery, 30% or 0.3")
    return share
