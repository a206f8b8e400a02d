"""Tables of plans and scenarios for an operator, and their rows for `--json`: route, battery, coverage of a survey."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from gcs.cli.shared.console import Screen
from gcs.errors import counted

if TYPE_CHECKING:
    from rich.table import Table

    from gcs.flight.assessment.route_passing import PointPassed
    from gcs.plan.trajectory.plan import Plan
    from gcs.types import JsonObject

_NAMED = 5  # places that are not covered
_SQUARE_M_PER_HA = 10_000.0
SHOWN = 20  # vehicles of a table on a terminal; a pipe or a file gets all
_EASY = 0.7  # of the speed limit: in the mean, with corners


def route_data(plan: Plan) -> list[JsonObject]:
    """The route points ahead, with time, place and speed of the leader at each."""
    import numpy as np

    from gcs.physics.states import POSITION, VELOCITY

    rows = []
    for passage in plan.passages:
        state = plan.leader_trajectory.state(passage.arrives_s)
        north_m, east_m, down_m = (round(float(metres), 3) + 0.0 for metres in state[POSITION])
        rows.append(
            {
                "point": passage.number,
                "name": passage.point.name,
                "arrives_s": passage.arrives_s,
                "leaves_s": passage.leaves_s,
                "north_m": north_m,
                "east_m": east_m,
                "height_m": -down_m + 0.0,
                "speed_mps": round(float(np.linalg.norm(state[VELOCITY])), 3),
            }
        )
    return rows


def route_table(plan: Plan) -> Table:
    """The same as a table."""
    from rich.markup import escape
    from rich.table import Table

    title = "route points: the leader's time, place (north, east, height) and speed"
    table = Table("point", "arrival", "hold", "place", "speed", title=title)
    for passage, row in zip(plan.passages, route_data(plan), strict=True):
        hold = "" if passage.point.hold_s is None else f"{passage.point.hold_s:g} s"
        place = f"{row['north_m']:.1f}, {row['east_m']:.1f}, {row['height_m']:.1f} m"
        table.add_row(
            escape(passage.title.short), f"{passage.arrives_s:.1f} s", hold, place, f"{row['speed_mps'] or 0.0:.2f} m/s"
        )
    return table


def say_lines(screen: Screen, plan: Plan) -> None:
    """Print how near the leader keeps to the drawn lines, and warn of legs that leave a line that was drawn."""
    import numpy as np

    from gcs.plan.trajectory.leg_lines import leg_lines

    parts = []
    for what, limits_m in (
        ("beside", [line.limits.corridor_m for line in plan.lines]),
        ("in height", [line.limits.height_m for line in plan.lines]),
    ):
        if kept := [m for m in limits_m if np.isfinite(m)]:
            spread = f"{min(kept):g}" if min(kept) == max(kept) else f"{min(kept):g} to {max(kept):g}"
            parts.append(f"{spread} m {what} (on {counted(len(kept), 'leg')} of {len(limits_m)})")
    above = sum(line.ground is not None for line in plan.lines)
    over = f"; {counted(above, 'line')} at a height above the ground" if above else ""
    screen.say(f"lines between the points: the leader keeps within {', '.join(parts) or 'no limit'}{over}")
    drawn = leg_lines(plan.scenario)
    drawn = drawn[len(drawn) - len(plan.lines) + (plan.begin_state is not None) :]
    for key, what in (("corridor_m", "sideways"), ("height_m", "in height")):
        kept_lines = {line.number: getattr(line.limits, key) for line in plan.lines}
        left = [str(d.number) for d in drawn if getattr(d.limits, key) < kept_lines[d.number]]
        if left:
            screen.warn(
                f"leg{'s' * (len(left) > 1)} {', '.join(left)}: the leader leaves the drawn line {what}, because a "
                "zone, the ground or the time requires it; draw round it, or give more time"
            )


def say_gates(screen: Screen, plan: Plan) -> None:
    """Print the gates that a route passes on one side, and the key that buys their middle."""
    from gcs.plan.search.gate_centring import DEFAULT_PERCENT
    from gcs.plan.trajectory.gates import gates_of

    asked = plan.scenario.objective.gate_cost_percent
    for gate, near_m, far_m in gates_of(plan):
        screen.say(
            f"between no-fly zones {gate.zone + 1} and {gate.far_zone + 1} the vehicles pass {near_m:.2f} m from the "
            f"one and {far_m:.2f} m from the other: [objective] gate_cost_percent = "
            f"{DEFAULT_PERCENT if asked is None else asked:g} pays for no more; a greater one for up to "
            f"{gate.aside_m:.1f} m more room"
        )


def flown_table(plan: Plan, passed: tuple[PointPassed, ...], source: str) -> Table:
    """The passing of every route point, from true states or from telemetry."""
    from rich.markup import escape
    from rich.table import Table

    from gcs.flight.assessment.route_passing import counted_s

    leader = plan.sysids[plan.leader]
    title = f"route points, from {source}: least distance from the place there within {counted_s(plan):g} s"
    table = Table("point", "planned", "leader late", "leader", "farthest vehicle", title=title)
    for each in passed:
        late_s, metres = each.late_s[leader], each.distance_m[leader]
        table.add_row(
            escape(each.passage.title.short),
            f"t = {each.passage.arrives_s:.1f} s",
            "–" if math.isnan(late_s) else f"{late_s:+.1f} s",
            "–" if math.isnan(metres) else f"{metres:.2f} m",
            "–" if each.farthest is None else f"{each.farthest[1]:.2f} m (vehicle {each.farthest[0]})",
        )
    return table


def say_battery(screen: Screen, plan: Plan) -> None:
    """Print what the flight takes from a full battery; and what would fit, where that is too much."""
    import numpy as np

    from gcs.plan.trajectory.energy import charge_needed

    power, reserve = plan.scenario.vehicle.power, plan.scenario.preflight.reserve
    needed = charge_needed(plan) + (np.array(plan.used_before) if plan.used_before else 0.0)
    row = int(np.argmax(needed))
    most, usable = float(needed[row]), 1.0 - reserve
    of = (
        f"{power.battery_Wh:.4g} Wh" if power else f"{plan.scenario.preflight.endurance_s / 60:g} min of hover, assumed"
    )
    screen.say(f"battery: at most {most:.0%} used of {of} (vehicle {plan.sysids[row]}), {reserve:.0%} of it in reserve")
    if most <= usable or plan.begin_state is not None:
        return
    whole_s = plan.t_end_s - plan.t_start_s
    ground_s = whole_s - plan.flight_s
    fits_s = math.floor(whole_s * usable / most - ground_s)  # of flight: the power is nearly that of hover at any speed
    # Rounded so that it does fit.
    ways = [f"a battery of {math.ceil(most / usable * power.battery_Wh)} Wh ([vehicle.power])" if power else ""]
    if fits_s > 0:
        mean_mps = _length_m(plan) / fits_s
        ways.append(f"{math.ceil(plan.flight_s / fits_s)} sorties of {fits_s} s")
        if mean_mps < _EASY * math.hypot(*plan.scenario.limits.speed_ned_mps[:2]):
            ways.append(f"[time] flight_s = {fits_s}, {mean_mps:.1f} m/s in the mean")
        if plan.scenario.survey is not None:
            ways.append("more vehicles, or a wider swath or less overlap, for fewer passes")
    screen.warn(f"the flight needs {most:.0%} of a full battery, {usable:.0%} may be used. This would fit:")
    for way in filter(None, ways):
        screen.warn(f"  {way}")


def _length_m(plan: Plan) -> float:
    """The length of the leader's track from T0 to the arrival, m."""
    import numpy as np

    from gcs.physics.states import POSITION

    places = plan.leader_trajectory.state(np.linspace(0.0, plan.flight_s, 1000))[:, POSITION]
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def say_coverage(screen: Screen, plan: Plan) -> JsonObject:
    """Print the coverage of a plan's survey, and return it for `--json`; nothing where there is no survey."""
    from gcs.plan.verification.coverage import coverage
    from gcs.scenario.schema.scenario import Terrain

    found = coverage(plan)
    if found is None:
        return {}
    gaps = found.gaps()
    area_ha = float(found.area.area) / _SQUARE_M_PER_HA
    # Cut, not rounded: 99.96 % is not all of it.
    percent = int(1e3 * found.share) / 10.0
    height = plan.scenario.survey and plan.scenario.survey.height_above_ground_m
    seen = f" (swath by the height flown, {found.swath_m:g} m from {height:g} m)" if height else ""
    if not height and plan.scenario.terrain != Terrain():
        seen = f" ({found.swath_m:g} m from every height; [survey] height_above_ground_m has the height flown count)"
    screen.say(
        f"coverage{seen}: {percent:g} % of {area_ha:.2f} ha proved, {found.overlap:.0%} of it flown over more than "
        f"once; {found.ha_per_battery:.2f} ha per battery, {found.reserve:.0%} of it in reserve"
    )
    if gaps:
        missed_m2 = sum(gap.area_m2 for gap in gaps)
        screen.warn(f"{missed_m2:.3g} m² of the survey are not covered, in {counted(len(gaps), 'place')}:")
        for gap in gaps[:_NAMED]:
            screen.warn(f"  {gap.area_m2:.3g} m² at north {gap.north_m:.1f} m, east {gap.east_m:.1f} m")
    return {
        "coverage": {
            "share": found.share,
            "area_m2": float(found.area.area),
            "uncovered": [vars(gap) for gap in gaps],
            "overlap": found.overlap,
            "slack_m": found.slack_m,
            "battery_share_max": float(found.used.max()),
            "ha_per_battery": found.ha_per_battery,
        }
    }


def shown(screen: Screen) -> int | None:
    """How many vehicles a table has; None for all."""
    return SHOWN if screen.console.is_terminal else None


def say_rest(screen: Screen, count: int, how: str) -> None:
    """Print how many vehicles a table leaves out, and how to see them."""
    if shown(screen) is not None and count > SHOWN:
        screen.say(f"and {count - SHOWN} more: {how}")
