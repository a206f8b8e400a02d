"""What people should know before everybody returns at once, in sentences.

Knows: how high and how near vehicles return, what the plan allows. Does not know: how that was found, screens.
"""

from __future__ import annotations

from collections.abc import Iterator

from gcs.mission.return_heights import ReturnPlan
from gcs.plan.trajectory.trajectory import Plan


def return_warnings(plan: Plan, returns: ReturnPlan) -> Iterator[str]:
    """Returns nearer to each other than the judge asks, above the plan's ceiling, or through closed areas."""
    worst, asked_m = returns.worst, plan.scenario.judge.separation_min_m
    if worst is not None and worst.distance_m < asked_m:
        first, second = worst.sysids
        yield (
            f"vehicles {first} and {second} return within {worst.distance_m:.2f} m of each other ({asked_m:g} m are "
            "asked); do not let all return at once"
        )
    ceiling_m = plan.scenario.limits.height_m[1]
    if returns.top_m > ceiling_m:
        yield f"returns are up to {returns.top_m:.1f} m high, above the plan's ceiling of {ceiling_m:g} m"
    for crossing in returns.crossings:
        where = "home" if crossing.ends == "home" else "to the nearer of home and rally point"
        yield (
            f"straight {where} leads through no-fly zone {crossing.zone} from {crossing.from_s:.1f} s to "
            f"{crossing.to_s:.1f} s"
        )
