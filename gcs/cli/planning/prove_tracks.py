"""`gcs prove`: prove trajectories of any planner at every instant."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.shared.console import Screen
from gcs.cli.shared.shared_options import PLAN, DebugOption, JsonOption, argument, missions, option
from gcs.errors import UsageError, counted

if TYPE_CHECKING:
    from gcs.mission.proving.track_formats import ReadTracks
    from gcs.mission.proving.track_report import TrackCheck, UnsafeSpan
    from gcs.plan.trajectory.plan import Plan
    from gcs.scenario.schema.scenario import Scenario
    from gcs.types import JsonObject

_LENGTH = (1e-3, 1e6, "m")


def prove(
    files: Annotated[
        list[Path],
        argument(
            "Trajectories: CSV of timed samples, CSV of polynomial pieces (uav_trajectories, Crazyswarm), .setpoints, "
            "shows (.skyc), missions (.plan, .waypoints); or one plan (.skein) or scenario of Skein's own.",
            "FILE...",
        ),
    ],
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="SCENARIO",
            help="Scenario or plan file with the ground, the no-fly zones and the limits that are not stated.",
            autocompletion=missions,
        ),
    ] = None,
    separation: Annotated[
        float | None,
        option("Least distance of two vehicles.", metavar="METRES", shown="the scenario's", limits=_LENGTH),
    ] = None,
    vertical_scale: Annotated[
        float,
        option(
            "A metre of height counts as 1 / SCALE of the distance: above 1 vehicles keep farther apart in height, for "
            "the downwash.",
            metavar="SCALE",
            limits=(1e-3, 1e3, ""),
        ),
    ] = 1.0,
    speed: Annotated[
        float | None, option("Largest speed.", metavar="M/S", shown="not checked", limits=(1e-3, 1e4, "m/s"))
    ] = None,
    acceleration: Annotated[
        float | None,
        option("Largest acceleration.", metavar="M/S2", shown="not checked", limits=(1e-3, 1e5, "m/s²")),
    ] = None,
    jerk: Annotated[
        float | None, option("Largest jerk.", metavar="M/S3", shown="not checked", limits=(1e-3, 1e6, "m/s³"))
    ] = None,
    vehicle: Annotated[
        str | None,
        option(
            "Vehicle whose thrust and tilt to check, in the scenario's wind: quad500, f150, or a vehicle file.",
            metavar="TYPE",
            shown="neither is checked",
        ),
    ] = None,
    thrust: Annotated[
        tuple[float, float] | None,
        option("Least and largest thrust of the rotors together.", metavar="LOW HIGH", shown="the vehicle's, N"),
    ] = None,
    tilt: Annotated[
        float | None,
        option("Largest tilt.", metavar="DEG", shown="the vehicle's", limits=(1e-3, 180.0, "degrees")),
    ] = None,
    height: Annotated[
        tuple[float, float] | None,
        option(
            "Least and largest height above height 0, at all times.",
            metavar="LOW HIGH",
            shown="the scenario's largest",
        ),
    ] = None,
    clearance: Annotated[
        float | None,
        option(
            "Least distance to the scenario's ground, from take-off to landing.",
            metavar="METRES",
            shown="the scenario's",
            limits=_LENGTH,
        ),
    ] = None,
    fence: Annotated[
        Path | None,
        option(
            "Fence whose areas to keep, at all heights: a .fence, a .plan, or MAVProxy's list of points.",
            metavar="FILE",
            shown="none",
        ),
    ] = None,
    frame: Annotated[
        str | None,
        option(
            "Frame of x, y, z: enu (east, north, up), ned (north, east, down) or nwu (north, west, up).",
            shown="that of the columns' names; enu for polynomial pieces, nwu for shows",
            metavar="FRAME",
            words=("enu", "ned", "nwu"),
        ),
    ] = None,
    start: Annotated[
        float,
        option(
            "Time of the scenario at which the files' time is 0; where zones move, it matters.",
            metavar="SECONDS",
            limits=(-1e6, 1e6, "s"),
        ),
    ] = 0.0,
    abort: Annotated[
        str | None,
        option(
            "Prove too that all vehicles may break off at any instant, together: brake straight on and hold, or land; "
            "or return, of a plan, as the ground station returns its vehicles.",
            metavar="WAY",
            shown="not checked",
            words=("hold", "land", "return"),
        ),
    ] = None,
    brake: Annotated[
        float,
        option("Deceleration of vehicles that break off.", metavar="M/S2", limits=(0.01, 1e3, "m/s²")),
    ] = 1.5,
    sink: Annotated[
        float,
        option("Largest speed of descent of vehicles that land.", metavar="M/S", limits=(0.01, 1e3, "m/s")),
    ] = 1.5,
    time_limit: Annotated[
        float | None,
        option(
            "Longest time for each criterion, and for each search for instants at which the flight must not be broken "
            "off: what is not settled then is undecided.",
            "--time-limit",
            metavar="SECONDS",
            shown="none",
            limits=(0.01, 1e6, "s"),
        ),
    ] = None,
    picture: Annotated[
        Path | None, option("Draw the tracks and their nearest calls.", "--picture", "-p", metavar="FILE")
    ] = None,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Prove trajectories of any planner at every instant: separation, motion, thrust, heights, ground, zones.

    Exit status 0 when every check is proved, 5 when one is violated or undecided, 6 when a file cannot be read.

    Examples: gcs prove cf1.csv cf2.csv --separation 0.3 --vertical-scale 2

    gcs prove out/*.setpoints --scenario simulation1

    gcs prove simulation1 --abort land
    """
    screen = Screen(json=json)
    from rich.markup import escape
    from rich.table import Table

    from gcs.mission.proving.break_off import MANOEUVRES, BreakOff
    from gcs.mission.proving.fence_zones import within_fence
    from gcs.mission.proving.prove import TrackLimits
    from gcs.mission.proving.prove import prove as proved
    from gcs.plan.plan_file import is_plan_file, read_plan
    from gcs.plan.verification.proof.verdict import ProofVerdict
    from gcs.scenario.sources.load import load_scenario

    if picture is not None:
        from gcs.flight.plots.figure_file import refuse_kind

        refuse_kind(picture)
    limits = TrackLimits(separation, vertical_scale, speed, acceleration, height, clearance, jerk, thrust, tilt)
    place = None
    if scenario is not None:
        place = read_plan(scenario)[0].scenario if is_plan_file(scenario) else load_scenario(scenario)
    read, plan = _read(files, screen, frame, place, start)
    if place is None and plan is not None:
        place = plan.scenario
    if fence is not None:
        if place is None:
            raise UsageError("a fence is a place on Earth", hint="give the scenario, whose origin is place 0")
        place = within_fence(place, fence)
    how = next((BreakOff(way, brake, sink) for way in MANOEUVRES if way == abort), None)
    report = proved(read.tracks, limits, place, vehicle, how, plan, time_limit)
    for line in read.account:
        screen.say(line)
    table = Table("criterion", "value", "limit", "verdict", "nearest at")
    for check in report.checks:
        sign = "≤" if check.most else "≥"
        value = f"{sign} {check.proved:.4g}" if check.verdict is ProofVerdict.PROVED else f"{check.seen:.4g}"
        where = f"{check.t_s:.3f} s, {escape(' and '.join(check.vehicles))}"
        verdict = check.verdict if check.ok else check.verdict.upper()
        table.add_row(check.name, f"{value} {check.unit}", f"{sign} {check.limit:.4g} {check.unit}", verdict, where)
    screen.show(table)
    if report.unsafe:
        screen.say("the flight must not be broken off from")
        for span in report.unsafe:
            screen.say(f"  {span}")
    if report.unchecked:
        screen.say(f"not checked, because no limit is stated: {', '.join(report.unchecked)}")
    held = f"{counted(len(report.vehicles), 'vehicle')} from {report.t_start_s:g} s to {report.t_end_s:g} s"
    screen.say(f"proved: {'yes' if report.ok else 'NO'}, {held}, {len(report.checks)} checks")
    screen.result(
        {
            "ok": report.ok,
            "files": list(read.account),
            "vehicles": list(report.vehicles),
            "checks": [
                _data(check) | {"limit": check.limit, "proved": _finite(check.proved)} for check in report.checks
            ],
            "unsafe": [_data(span) | {"start_s": span.start_s, "end_s": span.end_s} for span in report.unsafe],
            "unchecked": list(report.unchecked),
        }
    )
    if picture is not None:
        from gcs.flight.plots.proof_plot import save_proof

        save_proof(read.tracks, report, place, picture)
        screen.say(f"picture: {picture}")
    return screen.ended(report.refusal())


def _read(
    files: list[Path], screen: Screen, frame: str | None, place: Scenario | None, start_s: float
) -> tuple[ReadTracks, Plan | None]:
    """The tracks of files, or those of one plan or scenario and the plan."""
    from gcs.mission.proving.plan_tracks import plan_tracks
    from gcs.mission.proving.track_formats import ReadTracks, read_tracks
    from gcs.scenario.sources.bundled_missions import bundled_mission

    own = [
        path
        for path in files
        if path.suffix in (PLAN, ".toml") or path.is_dir() or (bundled_mission(path) and not path.exists())
    ]
    if not own:
        return read_tracks(files, frame=frame, scenario=place, start_s=start_s), None
    if len(files) > 1 or frame is not None or start_s:
        text = f"{own[0]} is a whole fleet in the frame and the time of its own scenario"
        raise UsageError(text, hint="give it alone, without --frame and --start")
    from gcs.cli.shared.plan_argument import Accepts, Stopwatch, plan_for

    accepts = Accepts(unverified=True, from_the_air=True)
    plan, _ = plan_for(own[0], screen, Stopwatch(time.perf_counter()), accepts)
    tracks = plan_tracks(plan)
    return ReadTracks(tracks, (f"{own[0]}: plan of {counted(len(tracks), 'vehicle')}",)), plan


def _data(found: TrackCheck | UnsafeSpan) -> JsonObject:
    return {
        "name": found.name,
        "verdict": found.verdict,
        "unit": found.unit,
        "seen": _finite(found.seen),
        "vehicles": list(found.vehicles),
        "t_s": found.t_s,
    }


def _finite(value: float) -> float | None:
    """A number that JSON knows; None of a bound that was not found."""
    return value if math.isfinite(value) else None
