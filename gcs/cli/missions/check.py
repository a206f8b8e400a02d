"""`gcs check`: check mission files of any origin against each other, the ground and the autopilot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from gcs.cli.missions.export import AUTOPILOTS
from gcs.cli.shared.console import Screen
from gcs.cli.shared.shared_options import DebugOption, JsonOption, argument, missions, option
from gcs.mission.formats.registry import Content, suffixes_of

if TYPE_CHECKING:
    from gcs.mission.check.fleet_check import FleetReport
    from gcs.mission.flight_limits import FlightLimits
    from gcs.mission.formats.mission_file import MissionFile
    from gcs.types import JsonObject

FINDINGS = 11  # exit code: the files were read, and there are findings
TIMINGS = {"planned": "at planned speeds", "autopilot": "as a model of the autopilot flies them"}
_MODELLED_MAX = 20  # missions for which `autopilot` is the default: each takes a good part of a second


def check(
    files: Annotated[
        list[Path],
        argument(
            f"Missions ({suffixes_of(Content.MISSION)}, .mission), one vehicle per file. A "
            f"{suffixes_of(Content.FENCE)} or {suffixes_of(Content.RALLY)} file, or a list of points of MAVProxy, "
            "belongs to the mission of the same name.",
            "FILE...",
        ),
    ],
    autopilot: Annotated[
        str | None, option(f"Autopilot: {' or '.join(AUTOPILOTS)}.", shown="that of each file", words=AUTOPILOTS)
    ] = None,
    terrain: Annotated[
        Path | None,
        typer.Option(
            metavar="SCENARIO",
            help="Scenario or plan file whose ground, zones and limits to check against.",
            autocompletion=missions,
        ),
    ] = None,
    separation: Annotated[
        float | None,
        option(
            "Least distance of two vehicles.",
            metavar="METRES",
            shown="that of the export or the scenario, else 2",
            limits=(1e-3, 1e6, "m"),
        ),
    ] = None,
    timing: Annotated[
        str | None,
        option(
            "How flights are computed: planned (from speeds and distances alone) or autopilot (with a model of its "
            "navigator and its delays).",
            shown=f"autopilot; planned for more than {_MODELLED_MAX} missions",
            words=tuple(TIMINGS),
        ),
    ] = None,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Check missions: separation at equal time, ground, fence, rally points, speeds, jumps, unsupported commands.

    Exit status 0 without findings, 11 with findings, 6 when a file cannot be read.

    Examples: gcs check out/*.plan --terrain simulation1

    gcs check a.waypoints b.waypoints --autopilot px4 --separation 5
    """
    screen = Screen(json=json)
    from gcs.autopilots.traits import Autopilot
    from gcs.mission.check.fleet_check import check_apart, check_fleet
    from gcs.mission.export.atomic_folder import exported_from
    from gcs.mission.flight_limits import OVERSPEED, FlightLimits, limits_of, surroundings_of
    from gcs.mission.formats.any_mission import load_missions
    from gcs.mission.predicted.arrival_spread import spread_in_words
    from gcs.mission.predicted.autopilot_flight import AutopilotFlight
    from gcs.mission.predicted.planned_flight import fly, surroundings

    missions = load_missions(files, None if autopilot is None else Autopilot.named(autopilot))
    exported_m, changed = exported_from(missions)
    timing = timing or ("autopilot" if len(missions) <= _MODELLED_MAX else "planned")
    modelled = AutopilotFlight()
    if terrain is None:
        around = surroundings(missions)
        limits = FlightLimits(separation or exported_m or FlightLimits().separation_m)
    else:
        from gcs.plan.plan_file import is_plan_file, read_plan
        from gcs.scenario.sources.load import load_scenario
        from gcs.scenario.values.si import ability_of, quadrotor

        scenario = read_plan(terrain)[0].scenario if is_plan_file(terrain) else load_scenario(terrain)
        around, limits = surroundings_of(scenario), limits_of(scenario, separation)
        modelled = AutopilotFlight(ability_of(quadrotor(scenario), scenario.limits))
        if timing == "autopilot":
            limits = replace(limits, overspeed=OVERSPEED)
    flown = (modelled, modelled.others) if timing == "autopilot" else (fly, ())
    report = check_fleet(missions, around, limits, *flown)
    findings = (*changed, *report.findings)
    if timing == "autopilot":
        findings += tuple(check_apart(missions, report, limits))
    for finding in findings:
        screen.say(str(finding))
    screen.say(f"{len(missions)} mission{'s' * (len(missions) > 1)}, {report.duration_s:.0f} s {TIMINGS[timing]}")
    if timing == "autopilot":
        screen.say(spread_in_words(report.spread_s, [mission.firmware for mission in missions]))
    _summary(screen, missions, report, limits)
    count = len(findings)
    screen.say(f"{count or 'no'} finding{'s' * (count != 1)}")
    ok = report.ok and len(findings) == len(report.findings)
    screen.result(_data(missions, report, limits, ok) | {"timing": timing, "findings": [f.data() for f in findings]})
    return 0 if ok else FINDINGS


def _summary(screen: Screen, missions: tuple[MissionFile, ...], report: FleetReport, limits: FlightLimits) -> None:
    from gcs.mission.check.flight_checks import LENGTH_TOLERANCE_M, highest_m
    from gcs.scenario.environment.no_fly import in_words

    table = Table("criterion", "measured", "proved", "limit", "verdict", "where")
    if report.closest is not None:
        least = report.closest
        first, second = (Path(missions[row].source).name for row in least.pair)
        where = f"{first} and {second} at {least.t_s:.1f} s"
        limit = f"≥ {limits.separation_m:g} m{_planned(limits.planned_separation_m, limits.separation_m)}"
        _add(table, "separation", least.distance_m, least.proved_m, limits.separation_m, where, limit)
    if report.clearance_min_m is not None:
        row, low = min(
            ((row, low) for row, low in enumerate(report.lowest) if low is not None), key=lambda x: x[1].clearance_m
        )
        where = f"{Path(missions[row].source).name} at {low.t_s:.1f} s"
        proved_m = min(low.proved_m for low in report.lowest if low is not None)
        limit = f"≥ {limits.clearance_m:g} m{_planned(limits.planned_clearance_m, limits.clearance_m)}"
        _add(table, "clearance above ground", low.clearance_m, proved_m, limits.clearance_m, where, limit)
    beside = [(zone, row) for row, zone in enumerate(report.zones) if zone is not None]
    if beside:
        zone, row = min(beside, key=lambda found: found[0].distance_m)
        required_m = limits.zone_margin_m - limits.tolerance_m
        named = zone.zone.edge if zone.zone.keep_in else f"zone {zone.zone.number}"
        where = f"{named}, {Path(missions[row].source).name} at {zone.t_s:.1f} s"
        proved_m = min(found.proved_m for found, _ in beside)
        limit = f"≥ {required_m:g} m{_planned(limits.zone_margin_m, required_m)}"
        _add(table, f"distance to {in_words(limits)}", zone.distance_m, proved_m, required_m, where, limit)
    tops = [(top, row) for row, flight in enumerate(report.flights) if (top := highest_m(flight)) is not None]
    if limits.height_max_m is not None and tops:
        (top_m, t_s), row = max(tops)
        most_m = limits.height_max_m
        limit = f"≤ {most_m:g} m{_planned(most_m - limits.tolerance_m, most_m)}"
        verdict = "ok" if top_m <= most_m + LENGTH_TOLERANCE_M else "FAILED"
        where = f"{Path(missions[row].source).name} at {t_s:.1f} s"
        table.add_row("height", f"{top_m:.3f} m", "–", limit, verdict, where)
    if table.row_count:
        screen.show(table)


def _planned(plan_m: float | None, limit_m: float) -> str:
    return "" if plan_m is None or plan_m == limit_m else f" (plan: {plan_m:g} m)"


def _add(table: Table, criterion: str, least_m: float, proved_m: float, limit_m: float, where: str, limit: str) -> None:
    from gcs.mission.check.flight_checks import LENGTH_TOLERANCE_M
    from gcs.mission.machine_independent import rounded_down

    verdict = "ok" if least_m >= limit_m and proved_m >= limit_m - LENGTH_TOLERANCE_M else "FAILED"
    proved = f"{rounded_down(proved_m, 3):.3f} m"
    table.add_row(criterion, f"{least_m:.3f} m", proved, limit, verdict, where)


def _data(missions: tuple[MissionFile, ...], report: FleetReport, limits: FlightLimits, ok: bool) -> JsonObject:
    closest = report.closest
    return {
        "ok": ok,
        "files": [m.source for m in missions],
        "duration_s": report.duration_s,
        "separation_asked_m": limits.separation_m,
        "separation_planned_m": limits.planned_separation_m,
        "separation_min_m": None if closest is None else closest.distance_m,
        "separation_proved_m": None if closest is None else closest.proved_m,
        "separation_at_s": None if closest is None else closest.t_s,
        "separation_files": None if closest is None else [missions[row].source for row in closest.pair],
        "clearance_asked_m": limits.clearance_m,
        "clearance_min_m": report.clearance_min_m,
        "clearance_proved_m": report.clearance_proved_m,
        "zone_asked_m": limits.zone_margin_m - limits.tolerance_m,
        "zone_min_m": min((zone.distance_m for zone in report.zones if zone is not None), default=None),
    }
