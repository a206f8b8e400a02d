"""`gcs show`: the content of a scenario or a plan, as text and as a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gcs.cli.planning.pad_tables import pads_of, refuse_no_csv, say_pads, write_pads
from gcs.cli.planning.plan_tables import route_data, route_table, say_coverage, say_rest, shown
from gcs.cli.shared.console import BEGAN_S, Screen
from gcs.cli.shared.page_option import PageOption, TilesOption, refuse_tiles, show_page
from gcs.cli.shared.shared_options import DebugOption, JsonOption, MissionArgument, option
from gcs.errors import UsageError
from gcs.page.page_feed import refuse_without_nicegui

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan
    from gcs.plan.verification.verify import Report
    from gcs.scenario.schema.scenario import Scenario
    from gcs.types import JsonObject

STEP_S = 0.2
# Of keys of `--json` that text names otherwise.
_LABELS = {"way": "leader", "closed": "no-fly zones", "keep_in": "keep-in areas"}


def show(
    mission: MissionArgument,
    picture: Annotated[
        Path | None,
        option("Draw a map of ground, no-fly zones, tracks and clearances.", "--picture", "-p", metavar="FILE"),
    ] = None,
    pads: Annotated[Path | None, option("Write the pads of all vehicles as CSV, for the crew.", metavar="FILE")] = None,
    coverage: Annotated[Path | None, option("Draw the coverage of a survey's area.", metavar="FILE")] = None,
    page: PageOption = False,
    tiles: TilesOption = "",
    json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Show the content of a scenario or plan: vehicles, start, end, limits, pads.

    A terminal shows 20 vehicles; a pipe or a file gets all.

    Examples: gcs show plans/simulation1.skein --picture map.png

    gcs show plans/simulation1.skein --pads pads.csv

    gcs show plans/meadow.skein --coverage meadow.png

    gcs show plans/gap.skein --page
    """
    screen = Screen(json=json)
    if pads is not None:
        refuse_no_csv(pads)
    refuse_tiles(tiles, page=page)
    if page:
        refuse_without_nicegui()
    from gcs.plan.verification.navigation_margins import thin_margins
    from gcs.scenario.environment.no_fly import zone_sentences
    from gcs.scenario.sources.load import load_scenario
    from gcs.scenario.validation.unit_guesses import doubts

    plan, report = _loaded(mission, screen, plans=page)
    scenario = plan.scenario if plan else load_scenario(mission)
    for question in doubts(scenario):
        screen.warn(question)
    found = {**_scenario(scenario), **(_plan(plan, report) if plan and report else {})}
    if plan and report:
        for sentence in thin_margins(plan, report):
            screen.warn(sentence)
    screen.say(scenario.title or scenario.name)
    width = max(len(_LABELS.get(name, name)) for name in found)
    for name, text in found.items():
        screen.say(f"  {_LABELS.get(name, name):<{width}}  {text}")
    places = pads_of(scenario)
    for sentence in zone_sentences(scenario):
        screen.say(sentence)
    say_pads(screen, places)
    if plan is not None and plan.passages:
        screen.show(route_table(plan))
        found["route_points"] = route_data(plan)
    motion = [] if plan is None else _greatest_motion(screen, plan)
    surveyed = {} if plan is None else say_coverage(screen, plan)
    if picture is not None:
        from gcs.flight.plots.overview_plot import save_overview

        save_overview(scenario, plan, picture)
        screen.say(f"picture: {picture}")
    if coverage is not None:
        if plan is None:
            raise UsageError("--coverage needs a plan.", hint=f"plan it first: gcs plan {mission}")
        from gcs.flight.plots.coverage_plot import save_coverage

        save_coverage(plan, coverage)
        screen.say(f"coverage: {coverage}")
    if pads is not None:
        write_pads(places, pads)
        screen.say(f"pads: {pads}")
    ends = _ends(scenario)
    files = {"picture": picture, "pads_file": pads, "coverage_picture": coverage}
    data = {
        "name": scenario.name,
        **found,
        **ends,
        "geozones": list(zone_sentences(scenario)),
        "pads": places,
        "greatest_motion": motion,
    }
    data |= surveyed | {name: file for name, file in files.items() if file is not None}
    if page and plan is not None:
        from gcs.flight.scene.plan_scene import scene_of_plan

        show_page(screen, scene_of_plan(plan), data, tiles)
    else:
        screen.result(data)


def _loaded(mission: Path, screen: Screen, *, plans: bool) -> tuple[Plan, Report] | tuple[None, None]:
    """A plan file's plan; none of a scenario, unless `plans` has it planned, whatever its verdict is."""
    from gcs.plan.plan_file import is_plan_file, load_plan

    if is_plan_file(mission):
        return load_plan(mission, screen.warn)
    if not plans:
        return None, None
    from gcs.cli.shared.plan_argument import Accepts, Stopwatch, plan_for

    return plan_for(mission, screen, Stopwatch(BEGAN_S), Accepts(unverified=True))


def _scenario(scenario: Scenario) -> JsonObject:
    from gcs.plan.verification.navigation_margins import navigation_in_words
    from gcs.scenario.validation.vehicle_rules import hover_share
    from gcs.scenario.values.si import quadrotor, sysids

    origin, limits, terrain, body = scenario.origin, scenario.limits, scenario.terrain, quadrotor(scenario)
    ids = sysids(scenario)
    ends = (" ".join(f"{x:g}" for x in b.position_m) for b in (scenario.start, scenario.end))
    ground = "level"
    if terrain.relief is not None and terrain.dem is not None:
        ground = f"{terrain.dem.file}, pixels of {terrain.relief.spacing_m:.1f} m"
    elif terrain.ripple or terrain.mountains.height_m:
        ground = f"{len(terrain.mountains.height_m)} mountains{', ripple' if terrain.ripple else ''}"
    changes = [f"{change.kind}{' (auto)' if change.auto else ''}" for change in scenario.formation.change]
    areas = [f"{len(each.polygon_m)} corners, {each.area.area / 1e4:.2f} ha" for each in scenario.keep_in]
    return {
        "vehicles": f"{len(ids)}, {scenario.vehicle.name}, {body.mass_kg:g} kg, hover at "
        f"{100.0 * hover_share(body):.0f} % of their thrust; leader {scenario.formation.leader}",
        "origin": f"{origin.lat_deg:.6f}, {origin.lon_deg:.6f}, {origin.alt_amsl_m:g} m above the sea",
        "way": "{} to {} (north east height, m) in {:g} s".format(*ends, scenario.time.flight_s),
        **({"route": _route(scenario)} if scenario.route else {}),
        "box": f"north {limits.north_m[0]:g} to {limits.north_m[1]:g}, east {limits.east_m[0]:g} to "
        f"{limits.east_m[1]:g}, height {limits.height_m[0]:g} to {limits.height_m[1]:g} m",
        "ground": f"{ground}; clearance at least {limits.clearance_min_m:g} m",
        "wind": "none"
        if scenario.wind is None
        else "{speed_mps:g} m/s from {from_deg:g} degrees at {height_m:g} m height; "
        "power law of height with exponent {shear:g}".format(**scenario.wind.model_dump()),
        "closed": f"{len(scenario.no_fly)}, of which {sum(bool(zone.moves) for zone in scenario.no_fly)} move"
        + _margin(scenario),
        **({"keep_in": "; ".join(areas)} if areas else {}),
        "navigation error": navigation_in_words(scenario),
        "speeds": "north {:g}, east {:g}, vertical {:g} m/s".format(*limits.speed_ned_mps),
        "changes": ", ".join(changes) or _unchanged(scenario),
        "autopilot": _autopilots(scenario),
    }


def _route(scenario: Scenario) -> str:
    rounds = "" if scenario.loops == 1 else f", {scenario.loops} times"
    holds = sum(point.hold_s is not None for point in scenario.route)
    return f"{len(scenario.route)} points{rounds}" + (f", {holds} with a hold" if holds else "")


def _unchanged(scenario: Scenario) -> str:
    formation = scenario.formation
    if formation.frame == "course":
        return f"none, but it turns with the leader's course, within {formation.course_tolerance_deg:g} degrees"
    return "none: the formation is rigid"


def _margin(scenario: Scenario) -> str:
    from gcs.scenario.values.navigation_error import planned_margin_m

    if not scenario.no_fly and not scenario.keep_in:
        return ""
    given = scenario.limits.zone_margin_m is not None
    return f"; margin {'at least' if given else 'where there is room'} {planned_margin_m(scenario):g} m"


def _autopilots(scenario: Scenario) -> str:
    from gcs.scenario.values.si import autopilots, sysids

    rows = list(zip(sysids(scenario), autopilots(scenario), strict=True))
    kinds = dict.fromkeys(known for _, known in rows)
    if len(kinds) == 1:
        return rows[0][1].key
    return "; ".join(f"{kind.key}: {', '.join(str(sysid) for sysid, k in rows if k is kind)}" for kind in kinds)


def _plan(plan: Plan, report: Report) -> JsonObject:
    from gcs.plan.cost_terms import cost_terms
    from gcs.plan.trajectory.energy import drag_energy_J, energy_Wh
    from gcs.scenario.environment.no_fly import in_words

    taken_Wh, power = energy_Wh(plan), plan.scenario.vehicle.power
    battery = "unknown: the scenario has no [vehicle.power]"
    if taken_Wh is not None and power is not None:
        most_Wh = float(taken_Wh.max())
        battery = f"at most {most_Wh:.1f} of {power.battery_Wh:g} Wh ({most_Wh / power.battery_Wh:.0%})"
    separation = "" if report.separation_min_m is None else f", separation {report.separation_min_m:.2f} m"
    near = report.nearest_zone
    zones = "" if near is None else f", {in_words(plan.scenario)} {near.distance_m:.2f} m away"
    terms = " + ".join(f"{term.weight:g} x {term.value:.4f} {term.name}" for term in cost_terms(plan))
    return {
        "plan": f"{plan.t_end_s - plan.t_start_s:g} s from ground to ground, cost {plan.objective:.4f}",
        **({"terms of the cost": f"{terms} (Eq. 35)"} if terms else {}),
        "battery": battery,
        "energy against drag": f"{float(drag_energy_J(plan).sum()):.0f} J for all vehicles (Eqs. 30-32)",
        "verified": f"{'yes' if report.ok else 'NO'}: clearance {report.clearance_min_m:.2f} m{separation}{zones}",
    }


def _ends(scenario: Scenario) -> dict[str, dict[str, float]]:
    import numpy as np

    from gcs.frames import ned_to_geodetic
    from gcs.scenario.values.si import NED_FROM_UP, local_origin

    ends = {"start": scenario.start.position_m, "end": scenario.end.position_m}
    lat_deg, lon_deg, alt_m = ned_to_geodetic(np.array(list(ends.values())) * NED_FROM_UP, local_origin(scenario))
    return {
        name: {
            "lat_deg": round(float(lat_deg[row]), 7),
            "lon_deg": round(float(lon_deg[row]), 7),
            "alt_amsl_m": round(float(alt_m[row]), 3),
            **dict(zip(("north_m", "east_m", "height_m"), (round(value, 3) for value in ends[name]), strict=True)),
        }
        for row, name in enumerate(ends)
    }


def _greatest_motion(screen: Screen, plan: Plan) -> list[dict[str, float]]:
    from rich.table import Table

    from gcs.plan.trajectory.greatest_motion import greatest_motion

    limits = plan.scenario.limits
    rows = greatest_motion(plan).by_vehicle(plan.sysids)
    kinds = (
        ("speed", (("horizontal", "speed_horizontal_max_mps", "m/s"), ("vertical", "speed_vertical_max_mps", "m/s"))),
        ("acceleration and jerk", (("acceleration", "accel_max_mps2", "m/s²"), ("jerk", "jerk_max_mps3", "m/s³"))),
    )
    for title, columns in kinds:
        heads = (head for name, _, _ in columns for head in (name, "at"))
        table = Table("vehicle", *heads, title=f"greatest {title}")
        for row in rows[: shown(screen)]:
            cells = [
                cell
                for _, key, unit in columns
                for cell in (f"{row[key]:.2f} {unit}", f"{row[key.rpartition('_')[0] + '_t_s']:.1f} s")
            ]
            table.add_row(f"{row['sysid']:g}", *cells)
        screen.show(table)
    most = (
        "no limit" if limit is None else f"at most {limit:g} {unit}"
        for limit, unit in ((limits.accel_max_mps2, "m/s²"), (limits.jerk_max_mps3, "m/s³"))
    )
    screen.say("limits: acceleration {}, jerk {}".format(*most))
    say_rest(screen, len(rows), "--json has all")
    return rows
