"""`gcs export`: write a plan as files for other ground stations."""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from gcs.autopilots.traits import Autopilot, titles
from gcs.cli.shared import shared_options as shared
from gcs.cli.shared.console import BEGAN_S, Screen
from gcs.errors import NotWritten, OutOfTime, UsageError
from gcs.mission.formats.registry import ALL, DEFAULT, FORMATS, Content, select_formats

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from gcs.mission.export.index import ExportIndex
    from gcs.mission.export.separations import Separation
    from gcs.plan.trajectory.plan import Plan
    from gcs.scenario.schema.scenario import Scenario

AUTOPILOTS = tuple(known.key for known in Autopilot)
_SHOWN = 20  # vehicles


def export(
    mission: shared.MissionArgument,
    to: Annotated[Path, shared.option("Folder to write. An older export in it is replaced as a whole.")],
    formats: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            metavar="NAME",
            help="What to write; several with commas, or repeat it: "
            f"{', '.join(row.name for row in FORMATS)}, or {ALL}.",
            show_default=", ".join(row.name for row in DEFAULT),
            autocompletion=shared.one_of(*(row.name for row in FORMATS), ALL),
        ),
    ] = None,
    autopilot: Annotated[
        str | None,
        shared.option(
            f"Autopilot of all vehicles: {' or '.join(AUTOPILOTS)}.", shown="those of the scenario", words=AUTOPILOTS
        ),
    ] = None,
    altitude: Annotated[
        str,
        shared.option(
            "Reference of the altitudes: relative (the vehicle's home), amsl (mean sea level) or terrain (the ground "
            "under the vehicle).",
            words=("relative", "amsl", "terrain"),
        ),
    ] = "relative",
    smooth: Annotated[
        float | None,
        shared.option(
            "Smooth the setpoints with a B-spline, at most this far from the plan.",
            metavar="METRES",
            limits=(1e-3, 1e3, "m"),
        ),
    ] = None,
    untimed: shared.UntimedOption = False,
    gates: Annotated[
        int,
        shared.option(
            "Number of points where all vehicles wait for a common time; ArduPilot only.",
            metavar="N",
            limits=shared.GATES,
        ),
    ] = 0,
    start: Annotated[
        str | None,
        shared.option(
            "Time of day (UTC) at which all vehicles leave the hover after take-off; gates count from it. ArduPilot "
            "only.",
            metavar="HH:MM:SS",
            shown="the end of the take-off",
        ),
    ] = None,
    takeoff: Annotated[
        str | None,
        shared.option(
            "Instant (UTC) at which the take-off begins, for the volumes of f3548.",
            metavar="YYYY-MM-DDTHH:MM:SSZ",
            shown="no volumes",
        ),
    ] = None,
    geoid: Annotated[
        float | None,
        shared.option(
            "Height of mean sea level above the WGS-84 ellipsoid at the flight, for the volumes of f3548.",
            metavar="METRES",
            limits=(-110, 110, "m"),
        ),
    ] = None,
    volumes: Annotated[
        int,
        shared.option("Largest number of volumes of f3548: more are tighter.", metavar="N", limits=(1, 100, "")),
    ] = 10,
    late: Annotated[
        float,
        shared.option(
            "The volumes of f3548 also hold a flight that is up to so much late.",
            metavar="SECONDS",
            limits=(0.0, 3600.0, "s"),
        ),
    ] = 0.0,
    unverified: shared.UnverifiedOption = False,
    limit: Annotated[
        float,
        shared.option(
            "Longest time of planning and exporting together.", metavar="SECONDS", limits=(1.0, 86_400.0, "s")
        ),
    ] = 1800.0,
    json: shared.JsonOption = False,
    debug: shared.DebugOption = False,
) -> int:
    """Write missions, setpoints and maps of every vehicle, for other ground stations.

    Exit status 13 when requested missions are not fit to fly; the other files are written. Missions are requested by
    default, but not with --untimed or --format setpoints.

    Examples: gcs export simulation1 --to out

    gcs export field --to out --format plan --format kml

    gcs export field --to out --gates 3 --start 10:30:00

    gcs export field --to out --format f3548 --takeoff 2026-11-28T10:30:00Z --geoid 47.9
    """
    screen = Screen(json=json)
    start_s = None if start is None else _seconds_of_day(start)
    begins = None if takeoff is None else _instant(takeoff)
    from gcs.cli.shared.plan_argument import Accepts, Stopwatch, plan_for
    from gcs.mission.export.atomic_folder import refuse_foreign
    from gcs.mission.export.export import ExportOptions, prepared
    from gcs.mission.export.flight_volumes import VolumeOrder
    from gcs.mission.model import Altitude
    from gcs.scenario.values.si import autopilots
    from gcs.util.long_work import shown, within

    names = [name for given in formats or () for name in given.replace(",", " ").split()]
    options = ExportOptions(
        select_formats(names) if formats else None,
        None if autopilot is None else Autopilot.named(autopilot),
        Altitude(altitude),
        smooth_m=smooth,
        timed=not untimed,
        gates=gates,
        start_s=start_s,
        volumes=None if begins is None or geoid is None else VolumeOrder(begins, geoid, volumes, late),
    )

    def refuse(scenario: Scenario) -> None:
        options.order(options.firmware or autopilots(scenario))
        refuse_foreign(to.resolve())
        options.refuse_unordered()
        has_volumes = any(row.content is Content.VOLUMES for row in options.wanted)
        if (takeoff is not None or geoid is not None) and not has_volumes:
            raise UsageError("--takeoff and --geoid are for the format f3548", hint="add --format f3548")

    watch = Stopwatch(BEGAN_S)
    watch.lap("start")
    try:
        with within(limit):
            accepts = Accepts(unverified, from_the_air=True, refuse=refuse)
            plan, report = plan_for(mission, screen, watch, accepts, limit_s=limit)
            with shown(screen.say):
                ready = prepared(plan, options, report)
            _say_facts(screen, ready.index, plan)
            with shown(screen.say):
                index = ready.write(to)
    except OutOfTime as over:
        hint = "give more time (--limit); --untimed and --format setpoints take less"
        raise OutOfTime(f"nothing is written: {over.reason}", hint=hint) from None
    watch.lap("export")
    for line in listed_files(list(index.sha256)):
        screen.say(f"  {to}/{line}")
    screen.say(f"time: {watch}")
    screen.result(
        {
            "folder": to,
            "files": index.sha256,
            "plan_hash": index.plan_hash,
            "firmware": index.firmware_data(plan.sysids),
            "altitude": index.altitude,
            "waypoints": index.waypoints,
            "timing": None if index.timing is None else index.timing.data(),
            "separations": [row.data() for row in index.separations],
            "ok": not index.refused,
            "refused": index.refused or None,
            "findings": [] if index.report is None else [f.data() for f in index.report.findings],
            "returns": asdict(index.safety.returns),
            "volumes": None if index.volumes is None else index.volumes.data(),
            "smoothing": None if index.smoothing is None else asdict(index.smoothing),
        }
    )
    return screen.ended(_not_written(index, plan, to) if index.refused else None)


def listed_files(names: list[str]) -> list[str]:
    """A line for each file; many of one kind, which differ in their number, have one line together."""
    kinds: dict[str, list[str]] = {}
    for name in names:
        kinds.setdefault(re.sub(r"\d+", "#", name), []).append(name)
    lines: list[str] = []
    for files in kinds.values():
        if len(files) <= _SHOWN:
            lines += files
            continue
        ends = sorted(files, key=lambda file: [int(number) for number in re.findall(r"\d+", file)])
        lines.append(f"{ends[0]} to {ends[-1]}, {len(files)} files")
    return lines


def _say_facts(screen: Screen, index: ExportIndex, plan: Plan) -> None:
    """What holds for the files, before any is written."""
    _say_separations(screen, index.separations)
    if index.report is not None:
        screen.say(
            f"{index.waypoints} waypoints per vehicle; the polyline is at most {index.deviation.path_m:.3f} m from the "
            f"plan, and at most {index.deviation.time_m:.3f} m at equal time"
        )
    if index.smoothing is not None:
        screen.say(
            f"smoothed setpoints keep the plan's limits within 1 %: at most {index.smoothing.deviation_m:.3f} m and "
            f"{index.smoothing.yaw_deviation_deg:.2f} degrees of yaw from the plan, at least "
            f"{index.smoothing.clearance_min_m:.3f} m above ground (knots every {index.smoothing.knots_every_s:g} s)"
        )
    if index.volumes is not None:
        screen.say(str(index.volumes))
    _say_verified(screen, index)
    _say_timing(screen, index)
    _say_returns(screen, index, plan)


def _not_written(index: ExportIndex, plan: Plan, to: Path) -> NotWritten:
    """The error for missions that were asked for, by --format or its default, and are left out."""
    hint = "to write the setpoint stream alone, give --format setpoints"
    if plan.begin_state is None:
        hint += "; --untimed writes missions at the plan's own speeds"
    written = f"{to} has no missions, and {len(index.sha256)} other files"
    return NotWritten(f"{written}: {index.refused}", hint=hint)


def _say_separations(screen: Screen, rows: Sequence[Separation]) -> None:
    """One table, and the least of what the export has: nothing else that an export says is about separations."""
    from gcs.mission.export.separations import GroundReturns, least

    if not rows:
        return
    table = Table("separation", "least", "", "required", "vehicles", "when", "")
    for row in rows:
        first, second = row.sysids
        held = row.given or isinstance(row, GroundReturns)
        verdict = "left out" if not held else "ok" if row.kept else "too near"
        sure, required = "proved" if row.proved else "seen", f"{row.required_m:g} m"
        table.add_row(row.what, row.figure, sure, required, f"{first}, {second}", f"{row.t_s:.1f} s", verdict)
    screen.show(table)
    worst = least(rows)
    if worst is not None:
        first, second = worst.sysids
        screen.say(f"nearest of all: {worst.figure}, vehicles {first} and {second} at {worst.t_s:.1f} s ({worst.what})")


def _say_verified(screen: Screen, index: ExportIndex) -> None:
    from gcs.mission.machine_independent import rounded_down

    report = index.report
    if report is None:
        return
    how = "at the planned speeds" if index.timing is None else f"as a model of {titles(index.autopilots)} flies them"
    text = f"missions, read back and computed {how}"
    if report.clearance_proved_m is not None:
        text += f": at least {rounded_down(report.clearance_proved_m, 3):.3f} m above ground, proved"
    screen.say(text)


def _say_timing(screen: Screen, index: ExportIndex) -> None:
    from gcs.mission.predicted.arrival_spread import spread_in_words

    timing = index.timing
    if timing is None:
        return
    title = f"predicted for {titles(index.autopilots)}"
    table = Table("vehicle", "largest delay", "largest distance from plan", "RMS distance", title=title)
    for one in timing.vehicles[:_SHOWN]:
        late = f"{one.late_s:+.2f} s at {one.late_at_s:.0f} s"
        off = f"{one.error_max_m:.2f} m at {one.error_at_s:.0f} s"
        table.add_row(str(one.sysid), late, off, f"{one.error_rms_m:.2f} m")
    screen.show(table)
    if len(timing.vehicles) > _SHOWN:
        screen.say(f"  and {len(timing.vehicles) - _SHOWN} more; largest delay {timing.late_s:+.2f} s")
    screen.say(spread_in_words(timing.may_differ_s, index.autopilots))
    for number, early_s in enumerate(timing.gates_early_s, start=1):
        screen.say(f"gate {number}: all vehicles arrive {early_s:.1f} s before it opens")


def _say_returns(screen: Screen, index: ExportIndex, plan: Plan) -> None:
    from gcs.mission.export.separations import GroundReturns
    from gcs.mission.returns.rtl_altitudes import LAND_INSTEAD, NO_RETURNS, place_warnings

    returns = index.safety.returns
    low, high = min(returns.altitudes_m), max(returns.altitudes_m)
    if returns.separated:
        screen.say(f"return altitudes: {low:.2f} to {high:.2f} m above home, at {returns.speeds.cruise_mps:g} m/s")
    else:
        screen.warn(NO_RETURNS)
    if any(isinstance(row, GroundReturns) and not row.given for row in index.separations):
        screen.warn(LAND_INSTEAD)
    for text in place_warnings(plan, returns, index.autopilots):
        screen.warn(text)


def _instant(text: str) -> datetime:
    """An instant with its time zone. Raises `UsageError`."""
    from gcs.scenario.sources.geozones import utc_of

    try:
        return utc_of(text)
    except ValueError as error:
        raise UsageError(f"--takeoff {text}: {error}", hint="give 2026-11-28T10:30:00Z, for example") from None


def _seconds_of_day(text: str) -> int:
    """Seconds since midnight. Raises `UsageError` for anything but HH:MM:SS."""
    found = re.fullmatch(r"([01]\d|2[0-3]):([0-5]\d):([0-5]\d)", text)
    if not found:
        raise UsageError(f"--start {text}: not a time of day", hint="give HH:MM:SS in UTC")
    hour, minute, second = map(int, found.groups())
    return 3600 * hour + 60 * minute + second
