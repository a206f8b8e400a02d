"""`gcs refly`: fly an emulated flight again, and compare the true states."""

from __future__ import annotations

from typing import Annotated

from gcs.cli.shared import shared_options as shared
from gcs.cli.shared.console import BEGAN_S, Screen


def refly(
    folder: shared.FlightArgument,
    speedup: Annotated[
        str | None,
        shared.option("Speed in multiples of real time, or max.", shown="that of the flight"),
    ] = None,
    json: shared.JsonOption = False,
    debug: shared.DebugOption = False,
) -> int:
    """Fly an emulated flight again, and say whether the true states are the same to the last bit.

    The plan, seed, wind, faults and choices are those of the flight's folder; the new flight's folder is made in
    `again` below it. Orders that you gave during the flight are not given again.

    Exit status 0 when both flights are the same, 10 when they differ.

    Example: gcs refly flights/2026-01-31-120000-simulation1 --speedup max
    """
    screen = Screen(json=json)
    if speedup:
        shared.as_rate("--speedup", speedup)
    from dataclasses import replace
    from importlib.metadata import version
    from pathlib import Path

    from gcs.cli.flights.fly_view import FlightView
    from gcs.cli.shared.plan_argument import Stopwatch
    from gcs.errors import GcsError, JudgementError, counted
    from gcs.flight.contingency.options import FlightOptions
    from gcs.flight.recording.emulation_record import first_difference_s, read_emulation
    from gcs.flight.recording.flight_folder import PLAN, later_plans
    from gcs.flight.run import FlightRun, fly_run
    from gcs.plan.plan_file import load_plan

    record = read_emulation(folder)
    if record.skein != version("skein-gcs"):
        screen.warn(f"the flight was flown with Skein {record.skein}, this is {version('skein-gcs')}")
    plan, report = load_plan(folder / PLAN, screen.warn)
    if changes := later_plans(folder):
        words = counted(len(changes), "order")
        screen.warn(f"{words} that changed the plan in flight, given by hand, will not be given again")
    emulated = replace(record.emulated, speedup=speedup) if speedup else record.emulated
    options = FlightOptions(follow=record.follow, on_loss=record.on_loss, on_leader_loss=record.on_leader_loss)
    run = FlightRun(plan, report, record.keeping, emulated=emulated, root=folder / "again", options=options)
    try:
        again = fly_run(run, FlightView(screen, Stopwatch(BEGAN_S), "")).folder
    except GcsError as failure:  # as the first one may have ended, too
        if failure.folder is None:
            raise
        screen.say(f"the flight ended early: {failure.message}")
        again = Path(failure.folder)
    differs_s = first_difference_s(folder, again)
    if differs_s is None:
        screen.say(f"the same flight to the last bit of the true states: {again}")
    screen.result({"ok": differs_s is None, "folder": str(again), "differs_from_s": differs_s})
    if differs_s is None:
        return 0
    return screen.ended(
        JudgementError(
            f"not the same flight: the true states differ from {differs_s:.2f} s of emulated time on.",
            hint=f"compare {folder} and {again}; another version, processor or order in flight makes another flight",
        )
    )
