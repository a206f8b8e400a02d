"""The route of a plan in the output of commands: a table for an operator, rows for `--json`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

    from gcs.flight.assessment.route_passing import PointPassed
    from gcs.plan.trajectory.plan import Plan


def route_data(plan: Plan) -> list[dict[str, Any]]:
    """The route points ahead, with time, place and speed of the leader at each."""
    import numpy as np

    from gcs.physics.quadrotor import POSITION, VELOCITY

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
    from rich.table import Table

    title = "route points: the leader's time, place (north, east, height) and speed"
    table = Table("point", "arrival", "hold", "place", "speed", title=title)
    for passage, row in zip(plan.passages, route_data(plan), strict=True):
        hold = "" if passage.point.hold_s is None else f"{passage.point.hold_s:g} s"
        place = f"{row['north_m']:.1f}, {row['east_m']:.1f}, {row['height_m']:.1f} m"
        table.add_row(
            _short(passage.title), f"{passage.arrives_s:.1f} s", hold, place, f"{row['speed_mps'] or 0.0:.2f} m/s"
        )
    return table


def flown_table(plan: Plan, passed: tuple[PointPassed, ...], source: str) -> Table:
    """The passing of every route point, from true states or from telemetry."""
    from rich.table import Table

    from gcs.flight.assessment.route_passing import counted_s

    leader = plan.sysids[plan.leader]
    title = f"route points, from {source}: least distance from the place there within {counted_s(plan):g} s"
    table = Table("point", "planned", "leader late", "leader", "farthest vehicle", title=title)
    for each in passed:
        late_s, metres = each.late_s[leader], each.distance_m[leader]
        table.add_row(
            _short(each.passage.title),
            f"t = {each.passage.arrives_s:.1f} s",
            "–" if math.isnan(late_s) else f"{late_s:+.1f} s",
            "–" if math.isnan(metres) else f"{metres:.2f} m",
            "–" if each.farthest is None else f"{each.farthest[1]:.2f} m (vehicle {each.farthest[0]})",
        )
    return table


def _short(title: str) -> str:
    from rich.markup import escape

    return escape(title.removeprefix("point "))
