"""`gcs check`: any mission files, ours or not, held against each other, the ground and the autopilot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gcs.cli.console import Screen
from gcs.cli.missions.export import AUTOPILOTS
from gcs.cli.shared_options import DebugOption, JsonOption
from gcs.errors import UsageError
from gcs.mission.formats.registry import Content, suffixes_of

if TYPE_CHECKING:
    from gcs.mission.check.fleet_check import FleetReport
    from gcs.mission.check.flight_limits import FlightLimits
    from gcs.mission.formats.mission_file import MissionFile

FINDINGS = 11  # exit code: the files were read, and something in them is wrong
TIMINGS = {"planned": "at planned speeds", "autopilot": "as a model of the autopilot flies them"}
_MODELLED_MAX = 20  # missions flown by the model unasked: each takes a good part of a second


def check(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help=f"Missions ({suffixes_of(Content.MISSION)}), one vehicle per file; {suffixes_of(Content.FENCE)} and "
            f"{suffixes_of(Content.RALLY)} files go with the mission of the same name.",
            show_default=False,
        ),
    ],
    autopilot: Annotated[
        str | None,
        typer.Option(
            "--autopilot",
            help=f"The autopilot that flies them: {' or '.join(AUTOPILOTS)}.",
            show_default="what each file says",
        ),
    ] = None,
    terrain: Annotated[
        Path | None,
        typer.Option("--terrain", metavar="SCENARIO", help="Scenario whose ground and limits to check against."),
    ] = None,
    separation: Annotated[
        float | None,
        typer.Option(
            "--separation",
            metavar="METRES",
            help="Least distance of two vehicles.",
            show_default="what the export or the scenario asks, else 2",
        ),
    ] = None,
    timing: Annotated[
        str | None,
        typer.Option(
            "--timing",
            help="How flights are worked out: planned (by speeds and distances alone) or autopilot (by a model of it, "
            "which is early and late as it is).",
            show_default=f"autopilot, for more than {_MODELLED_MAX} missions planned",
        ),
    ] = None,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Check missions: separation in step, ground, fence, rally points, speeds, jumps, what the autopilot carries out.

    Exit status 0 when nothing was found, 11 when something was, 6 when a file cannot be read.

    Examples: gcs check out/*.plan --terrain missions/simulation1

    gcs check a.waypoints b.waypoints --autopilot px4 --separation 5
    """
    screen = Screen(json=json)
    if autopilot not in (None, *AUTOPILOTS):
        raise UsageError(f"--autopilot {autopilot}: there are {' and '.join(AUTOPILOTS)}")
    if separation is not None and not separation > 0:
        raise UsageError(f"--separation {separation:g}: give a distance above 0")
    if timing not in (None, *TIMINGS):
        raise UsageError(f"--timing {timing}: there are {' and '.join(TIMINGS)}")
    from gcs.autopilots.traits import Autopilot
    from gcs.mission.check.fleet_check import check_fleet
    from gcs.mission.check.flight_limits import OVERSPEED, FlightLimits, limits_of, surroundings_of
    from gcs.mission.export.provenance import exported_from
    from gcs.mission.formats.any_mission import load_missions
    from gcs.mission.predicted.autopilot_flight import AutopilotFlight
    from gcs.mission.predicted.planned_flight import fly, surroundings

    missions = load_missions(files, None if autopilot is None else Autopilot.named(autopilot))
    asked_m, changed = exported_from(missions)
    timing = timing or ("autopilot" if len(missions) <= _MODELLED_MAX else "planned")
    modelled = AutopilotFlight()
    if terrain is None:
        around = surroundings(missions)
        limits = FlightLimits(separation or asked_m or FlightLimits().separation_m)
    else:
        from gcs.scenario.load import load_scenario
        from gcs.scenario.si import quadrotor
        from gcs.scenario.vehicle_ability import ability_of

        scenario = load_scenario(terrain)
        around, limits = surroundings_of(scenario), limits_of(scenario, separation)
        modelled = AutopilotFlight(ability_of(quadrotor(scenario), scenario.limits))
        if timing == "autopilot":
            limits = replace(limits, overspeed=OVERSPEED)
    report = check_fleet(missions, around, limits, modelled if timing == "autopilot" else fly)
    findings = (*changed, *report.findings)
    for finding in findings:
        screen.say(str(finding))
    screen.say(f"{len(missions)} mission{'s' * (len(missions) > 1)}, {report.duration_s:.0f} s {TIMINGS[timing]}")
    _summary(screen, missions, report, limits)
    count = len(findings)
    screen.say("nothing found" if not count else f"{count} finding{'s' * (count > 1)}")
    ok = report.ok and not changed
    screen.result(_data(missions, report, limits, ok) | {"timing": timing, "findings": [f.data() for f in findings]})
    return 0 if ok else FINDINGS


def _summary(screen: Screen, missions: tuple[MissionFile, ...], report: FleetReport, limits: FlightLimits) -> None:
    """The closest calls, for people."""
    if report.closest is not None:
        least = report.closest
        first, second = (missions[row].source for row in least.pair)
        asked = f"(asked {limits.separation_m:g} m)"
        screen.say(f"  nearest: {least.distance_m:.2f} m at {least.t_s:.1f} s {asked}, {first} and {second}")
    if report.clearance_min_m is not None:
        row, low = min(
            ((row, low) for row, low in enumerate(report.lowest) if low is not None), key=lambda x: x[1].clearance_m
        )
        screen.say(
            f"  lowest: {low.clearance_m:.2f} m above the ground at {low.t_s:.1f} s (asked {limits.clearance_m:g} m), "
            f"{missions[row].source}"
        )


def _data(missions: tuple[MissionFile, ...], report: FleetReport, limits: FlightLimits, ok: bool) -> dict[str, Any]:
    closest = report.closest
    return {
        "ok": ok,
        "files": [m.source for m in missions],
        "duration_s": report.duration_s,
        "separation_asked_m": limits.separation_m,
        "separation_min_m": None if closest is None else closest.distance_m,
        "separation_at_s": None if closest is None else closest.t_s,
        "separation_files": None if closest is None else [missions[row].source for row in closest.pair],
        "clearance_asked_m": limits.clearance_m,
        "clearance_min_m": report.clearance_min_m,
    }
