"""The passages of a plan: when the leader is at each point of its route that lies ahead."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gcs.plan.trajectory.constraint_id import PointName
from gcs.scenario.schema.scenario import RoutePoint, Scenario
from gcs.scenario.values.si import NED_FROM_UP, route_points
from gcs.types import Array


@dataclass(frozen=True)
class Passage:
    """A route point, and the plan times at which the leader is there; the two differ where it holds."""

    number: int  # 1 is the first point of the first round
    point: RoutePoint
    arrives_s: float
    leaves_s: float

    @property
    def title(self) -> PointName:
        """The point's number, and its name if it has one."""
        return PointName(self.number, self.point.name or "")

    @property
    def position_ned_m(self) -> Array:
        """The point itself (3,); the leader may pass beside it, within the point's radius."""
        return np.asarray(np.array(self.point.position_m) * NED_FROM_UP)

    @property
    def times_s(self) -> tuple[float, ...]:
        """Arrival, and departure where the leader holds."""
        return (self.arrives_s,) if self.point.hold_s is None else (self.arrives_s, self.leaves_s)


def passages(scenario: Scenario, route_s: tuple[float, ...]) -> tuple[Passage, ...]:
    """The last points of the route, one for each time, in order: a plan that begins in the air has the rest only.

    Raises ValueError for more times than points.
    """
    points = route_points(scenario)
    first = len(points) - len(route_s)
    if first < 0:
        raise ValueError(f"{len(route_s)} times for {len(points)} route points")
    return tuple(
        Passage(first + n + 1, points[first + n], t_s, t_s + (points[first + n].hold_s or 0.0))
        for n, t_s in enumerate(route_s)
    )


def passages_contradiction(
    scenario: Scenario, route_s: tuple[float, ...], span_s: tuple[float, float], *, in_the_air: bool
) -> str:
    """The first contradiction between arrival times `route_s` and the span of the mission (s), in words; empty if none.

    In a plan that begins in the air, the first hold may have begun before the span.
    """
    count = len(route_points(scenario))
    if len(route_s) > count or (len(route_s) < count and not in_the_air):
        return f"it has {len(route_s)} times for {count} route points"
    made = passages(scenario, route_s)
    for passage in made:
        begins_s = passage.leaves_s if in_the_air and passage is made[0] else passage.arrives_s
        if not (span_s[0] <= begins_s and passage.leaves_s <= span_s[1]):
            return f"the time of {passage.title}, {passage.arrives_s:g} s, is not within its flight"
    for before, after in pairwise(made):
        if not before.leaves_s < after.arrives_s:
            return f"the leader would be at {after.title} before it leaves {before.title}"
    return ""
