"""`gcs plan`: plan a mission, verify the plan and write it. `gcs verify`: verify it again, from its polynomials."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gcs.cli.planning.plan_tables import route_data, route_table, say_gates, say_lines
from gcs.cli.shared.console import BEGAN_S, Screen
from gcs.cli.shared.shared_options import DebugOption, JsonOption, MissionArgument, PlanArgument, option, plan_file

if TYPE_CHECKING:
    from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
    from gcs.plan.trajectory.plan import Plan
    from gcs.plan.verification.verify import Report
    from gcs.types import JsonObject

_BAR = 20  # characters
_WINDS_AT_ONCE = 60  # vehicles: the wind envelope of more takes longer than a tenth of the planning


def plan(
    mission: MissionArgument,
    to: Annotated[Path | None, plan_file("plans/NAME.skein")] = None,
    alternatives: Annotated[
        bool, option("Optimise every route class through the map and show its cost.", "--alternatives")
    ] = False,
    returns: Annotated[
        bool, option("Prepare returns of the whole formation too, as `gcs returns` does.", "--returns")
    ] = False,
    limit: Annotated[
        float,
        option(
            "Longest time of planning, all routes and returns together.",
            metavar="SECONDS",
            limits=(1.0, 86_400.0, "s"),
        ),
    ] = 1800.0,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Plan a mission, verify the plan and write it.

    A plan that failed verification is written too, for inspection; every later command refuses it. Exit status 0 when
    the plan is verified, 5 when it failed verification.

    Example: gcs plan simulation1
    """
    screen = Screen(json=json)
    from gcs.cli.planning.plan_tables import say_battery, say_coverage
    from gcs.cli.planning.wind_table import say_winds
    from gcs.cli.shared.plan_argument import Accepts, Stopwatch, plan_for, plan_path
    from gcs.plan.plan_file import SUFFIX, save_plan
    from gcs.plan.trajectory.greatest_motion import greatest_motion
    from gcs.plan.verification.verify import refusal
    from gcs.scenario.values.navigation_error import navigation_error

    watch = Stopwatch(BEGAN_S)
    watch.lap("start")
    made, report = plan_for(
        mission, screen, watch, Accepts(unverified=True, from_the_air=True), alternatives=alternatives, limit_s=limit
    )
    path = plan_path(to, Path("plans") / f"{made.scenario.name}{SUFFIX}")
    save_plan(made, report, path)
    watch.lap("write")
    show_plan(screen, made, report)
    say_battery(screen, made)
    surveyed = say_coverage(screen, made)
    winds: JsonObject = {}
    if len(made.sysids) > _WINDS_AT_ONCE:
        screen.say(f"wind: not looked at here, for more than {_WINDS_AT_ONCE} vehicles; gcs verify {path} does")
    elif report.ok:
        winds = say_winds(screen, made)
    if alternatives:
        from rich.table import Table

        table = Table("route", "length", "cost", "verdict", title="route classes through the map")
        for number, route in enumerate(made.alternatives, start=1):
            cost = "–" if route.objective is None else f"{route.objective:.4f}"
            table.add_row(str(number), f"{route.length_m:.0f} m", cost, route.verdict)
        screen.show(table)
    prepared: JsonObject = {}
    if returns and report.ok:
        from gcs.cli.planning.prepare_returns import prepared_in

        prepared = prepared_in(screen, made, report, path, limit_s=limit - watch.total_s)
        watch.lap("returns")
    screen.say(f"time: {watch}")
    screen.say(f"plan: {path}")
    sources = made.information_graph(0.0).sources
    screen.result(
        {
            **plan_data(made, report, path),
            "nearest_zone": None if report.nearest_zone is None else asdict(report.nearest_zone),
            "navigation_error": asdict(navigation_error(made.scenario)),
            "window_error_max_m": report.window_error_max_m,
            "terminal_error_m": report.terminal_error_m,
            "greatest_motion": greatest_motion(made).by_vehicle(made.sysids),
            "changes": [asdict(m) for m in made.moves],
            **({"route_points": route_data(made)} if made.passages else {}),
            "information": {
                str(sysid): [made.sysids[row] for row in rows]
                for sysid, rows in zip(made.sysids, sources, strict=True)
                if rows
            },
            "alternatives": [asdict(a) for a in made.alternatives],
            "mesh": [asdict(r) for r in made.mesh_history],
            "time_s": watch.laps_s,
        }
        | surveyed
        | winds
        | prepared
    )
    return screen.ended(None if report.ok else refusal(report))


def plan_data(made: Plan, report: Report, path: Path) -> JsonObject:
    """What `--json` has of every plan that is written."""
    return {
        "ok": report.ok,
        "plan": path,
        "hash": made.hash,
        "objective": made.objective,
        "clearance_min_m": report.clearance_min_m,
        "separation_min_m": report.separation_min_m,
        "failures": [str(c) for c in report.failures],
    }


def show_plan(screen: Screen, made: Plan, report: Report) -> None:
    """Print a plan's vehicles, times, phases and changes, and the table of its verification."""
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
    if made.passages:
        screen.show(route_table(made))
        say_lines(screen, made)
        say_gates(screen, made)
    _show_changes(screen, made)
    from gcs.plan.trajectory.greatest_motion import greatest_motion

    found, limits = greatest_motion(made), made.scenario.limits
    north_mps, east_mps, vertical_mps = limits.speed_ned_mps
    sideways = f"{north_mps:g} north, {east_mps:g} east"
    parts = []
    for way, speeds, times, allowed in (
        ("horizontal speed", found.speed_horizontal_mps, found.speed_horizontal_t_s, sideways),
        ("vertical", found.speed_vertical_mps, found.speed_vertical_t_s, f"{vertical_mps:g}"),
    ):
        row = int(speeds.argmax())
        where = f"vehicle {made.sysids[row]}, t = {times[row]:.1f} s"
        parts.append(f"{way} {speeds[row]:.2f} m/s ({where}; limit {allowed})")
    screen.say(f"greatest {', '.join(parts)}")
    parts = []
    for name, unit, sizes, times, most in (
        ("acceleration", "m/s²", found.accel_mps2, found.accel_t_s, limits.accel_max_mps2),
        ("jerk", "m/s³", found.jerk_mps3, found.jerk_t_s, limits.jerk_max_mps3),
    ):
        row = int(sizes.argmax())
        limit = "no limit" if most is None else f"limit {most:g}"
        parts.append(f"{name} {sizes[row]:.2f} {unit} (vehicle {made.sysids[row]}, t = {times[row]:.1f} s; {limit})")
    screen.say(f"greatest {', '.join(parts)}")
    _show_verdict(screen, made, report)
    for check in report.failures:
        screen.say(f"  FAILED: {check}")
    warn_of_position_errors(screen, made, report)


def warn_of_position_errors(screen: Screen, made: Plan, report: Report) -> None:
    """Print the navigation error, and warn if distances to zones, ground or other vehicles leave less than that."""
    from gcs.plan.verification.navigation_margins import navigation_in_words, thin_margins
    from gcs.plan.verification.position_errors import separation_left
    from gcs.scenario.values.navigation_error import judged_separation_m

    screen.say(f"navigation error: {navigation_in_words(made.scenario)}")
    for sentence in thin_margins(made, report):
        screen.warn(sentence)

    left, required_m = separation_left(made), judged_separation_m(made.scenario)
    if left is not None and left.left_m < required_m:
        first, second = left.pair
        screen.warn(
            f"vehicles {first} and {second} are planned {left.planned_m:.2f} m apart at t = {left.t_s:.0f} s. Position "
            f"errors of {made.scenario.sensors.grade} sensors leave {max(left.left_m, 0.0):.2f} m; [judge] requires "
            f"{required_m:g} m. Plan them farther apart, or fly better sensors."
        )


def _show_verdict(screen: Screen, made: Plan, report: Report) -> None:
    from rich.table import Table

    from gcs.cli.shared.plan_argument import verdict_word
    from gcs.plan.trajectory.constraint_id import Kind
    from gcs.scenario.environment.no_fly import in_words

    limits, failures = made.scenario.limits, [check.constraint for check in report.failures]
    failed = {constraint.kind for constraint in failures}
    title = f"verified: {'yes' if report.ok else 'NO'}, {len(report.checks)} checks, {len(report.failures)} failed"
    table = Table("criterion", "proved", "limit", "verdict", title=title)

    def row(kind: Kind, measured: str, limit: str, title: str = "") -> tuple[str, str, str, str]:
        return title or kind.value, measured, limit, verdict_word(kind not in failed)

    rows = [
        row(Kind.CLEARANCE, f"≥ {report.clearance_min_m:.3f} m", f"≥ {limits.clearance_min_m:g} m"),
        row(Kind.DRIFT, f"≤ {report.window_error_max_m * 1e3:.2f} mm", "≤ 10 mm"),
        row(Kind.END_POSITION, f"{report.terminal_error_m * 1e3:.3f} mm", "≤ 0.8 mm"),
    ]
    if report.separation_min_m is not None:
        rows.insert(1, row(Kind.SEPARATION, f"≥ {report.separation_min_m:.3f} m", f"≥ {limits.separation_min_m:g} m"))
    if (nearest := report.nearest_zone) is not None:
        measured, limit = f"≥ {nearest.distance_m:.3f} m", f"≥ {limits.zone_margin_m or 0.0:g} m"
        rows.insert(1, row(Kind.ZONE, measured, limit, f"distance to {in_words(made.scenario)}"))
    if made.passages:
        passed = f"{len(made.passages)} of {len(made.passages)}"
        as_asked = verdict_word(not any(constraint.is_of_route for constraint in failures))
        rows.append(("route points", passed, "every one, as it asks", as_asked))
    for cells in rows:
        table.add_row(*cells)
    screen.show(table)


def _show_changes(screen: Screen, made: Plan) -> None:
    if not made.moves:
        return
    screen.say("changes of shape: the paper's least time (Eqs. 8, 12, 14) → the planned time")
    name = max(len(move.name) for move in made.moves)
    for move in made.moves:
        how = ", ".join(part for part in (move.trigger, move.way, f"limited by {move.limited_by}") if part)
        first = int(_BAR * move.start_s / made.flight_s)
        last = max(math.ceil(_BAR * move.end_s / made.flight_s), first + 1)
        bar = "─" * first + "━" * (last - first) + "─" * (_BAR - last)  # its thick part is the change
        screen.say(
            f"  {move.start_s:8.1f} s … {move.end_s:6.1f} s  {bar}  {move.name:<{name}}  "
            f"{move.paper_time_s:5.1f} s → {move.end_s - move.start_s:5.1f} s"
        )
        screen.say(f"  {'':29}{how}; vehicles at least {move.least_gap_m:.2f} m apart")


def verify(
    plan: PlanArgument,
    gust_share: Annotated[
        float,
        option(
            "Gusts of the wind envelope, as a share of the steady wind: 0.5 is half as strong again.",
            metavar="SHARE",
            limits=(0.0, 5.0, ""),
        ),
    ] = 0.0,
    winds: Annotated[
        Path | None, option("Draw the winds in which the plan stays proved, a polar picture.", metavar="FILE")
    ] = None,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Prove a plan again and list the least margin of every criterion, and the greatest wind by direction.

    Exit status 0 when the plan is verified, 5 when it failed verification.

    Examples: gcs verify plans/simulation1.skein

    gcs verify plans/simulation1.skein --gust-share 0.5 --winds winds.png
    """
    screen = Screen(json=json)
    from rich.table import Table

    from gcs.cli.planning.wind_table import say_winds
    from gcs.plan.plan_file import load_plan
    from gcs.plan.verification.verify import ProofVerdict, refusal

    loaded, report = load_plan(plan, screen.warn)
    shown: set[ConstraintId] = set()
    table = Table("criterion", "margin", "limit", "verdict", "least at")
    for check in sorted(report.checks, key=lambda c: c.worst):
        if check.constraint in shown and check.ok:
            continue
        shown.add(check.constraint)
        when = "" if check.t_s is None else f" {check.t_s:.2f} s"
        vehicle = "" if check.sysid is None else f", {check.sysid}"
        # Where the limit is violated, the violation that was found says more than the bound.
        proved = check.proved is not None and check.verdict is not ProofVerdict.VIOLATED
        bound = check.proved if proved and check.proved is not None else check.worst
        margin = f"{'≥ ' if proved else ''}{(bound if abs(bound) > 1e-9 else 0.0):.3g} {check.unit}"
        limit = f"≥ {-check.tolerance:g}" if check.tolerance else "≥ 0"
        verdict = check.verdict if check.ok else check.verdict.upper()
        table.add_row(check.name, margin, limit, verdict, f"{check.phase}{when}{vehicle}")
    screen.show(table)
    warn_of_position_errors(screen, loaded, report)
    screen.say(f"verified: {'yes' if report.ok else 'NO'}, {len(report.checks)} checks, {len(report.failures)} failed")
    if report.sampled:
        screen.say(f"sampled, not proved between instants: {', '.join(report.sampled)}")
    winded = say_winds(screen, loaded, gust_share, whole=True) if report.ok else {}
    if winds is not None and report.ok:
        from gcs.flight.plots.wind_plot import save_winds

        save_winds(loaded, winds, gust_share)
        screen.say(f"winds: {winds}")
    screen.result(
        {
            "ok": report.ok,
            "failures": [str(c) for c in report.failures],
            "checks": len(report.checks),
            "sampled": list(report.sampled),
        }
        | winded
    )
    return screen.ended(None if report.ok else refusal(report))
