"""Inflates no-fly zones by the safety margin.

Planner and re-planner avoid larger no-fly zones, and stay in smaller keep-in areas.

`limits.zone_margin_m` is a limit, which the verifier proves. Without it the planner aims for the navigation error: less
beside a zone that is near the ends of the flight, and none where no route keeps it.
"""

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from gcs.errors import PlanningError
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import Zone, narrowed, outside_m, widened, zones
from gcs.scenario.schema.scenario import KeepIn, NoFlyZone, Scenario
from gcs.scenario.values.navigation_error import planned_margin_m
from gcs.scenario.values.si import NED_FROM_UP, hover_start_ned_m, leader_index, offsets_ned_m
from gcs.types import Array

_SMALLER_SHARE = 0.5  # of the margin, where the whole margin leaves no way
_KEPT_FREE_M = 0.05  # between a widened zone and the places that a flight cannot avoid
_EVERY_S = 0.1
Found = TypeVar("Found")


def with_margin(scenario: Scenario, share: float = 1.0) -> Scenario:
    """The scenario with zones as the planner avoids them."""
    if scenario.limits.zone_margin_m is not None:
        return _widened(scenario, [scenario.limits.zone_margin_m] * len(zones(scenario)))
    ends = _ends(scenario)
    margins_m = [min(_free_m(zone, at_s, places) for at_s, places in ends) for zone in zones(scenario)]
    aim_m = share * planned_margin_m(scenario)
    return _widened(scenario, [float(np.clip(m, 0.0, aim_m)) for m in margins_m])


def without_margin(scenario: Scenario) -> Scenario:
    """The scenario with zones as near as a plan may pass them."""
    return with_margin(scenario, 0.0)


def first_with_margin(scenario: Scenario, found_in: Callable[[Scenario, bool], Found]) -> Found:
    """What `found_in` returns for the scenario with zones as large as may be.

    Where it raises PlanningError with the whole margin and without any, the margin is not what hinders. `found_in` is
    also told whether the user will read its failure, which then is worth an explanation.
    """
    inflated, bare = with_margin(scenario), without_margin(scenario)
    if zones(inflated) == zones(bare):
        return found_in(inflated, True)
    try:
        return found_in(inflated, False)
    except PlanningError:
        found = found_in(bare, True)
    try:
        return found_in(with_margin(scenario, _SMALLER_SHARE), False)
    except PlanningError:
        return found


def kept_margin(plan: Plan) -> Scenario:
    """The plan's scenario with zones as a re-plan avoids them.

    Each keeps the room that the plan leaves it, so that the old plan is a solution of the new problem.
    """
    scenario, times = plan.scenario, np.arange(plan.t_start_s, plan.t_end_s, _EVERY_S)
    if scenario.limits.zone_margin_m is not None or not zones(scenario):
        return with_margin(scenario)
    places, aim_m = plan.states(times)[..., :3], planned_margin_m(scenario)
    return _widened(scenario, [float(np.clip(_free_m(zone, times, places), 0.0, aim_m)) for zone in zones(scenario)])


def new_zone(scenario: Scenario, zone: NoFlyZone, t_s: float, places_ned_m: Array) -> NoFlyZone:
    """A new zone as a re-plan from places (V, 3) at `t_s` avoids it."""
    aim_m = planned_margin_m(scenario)
    if scenario.limits.zone_margin_m is not None:
        return widened(zone, aim_m)
    return widened(zone, float(np.clip(_free_m(zone, np.array([t_s]), places_ned_m[:, None]), 0.0, aim_m)))


def _widened(scenario: Scenario, margins_m: Sequence[float]) -> Scenario:
    north_m, east_m, _ = scenario.start.position_m
    each = list(zip(zones(scenario), margins_m, strict=True))
    changed = {
        "keep_in": tuple(narrowed(z, m, (north_m, east_m)) for z, m in each if isinstance(z, KeepIn)),
        "no_fly": tuple(widened(z, m) for z, m in each if isinstance(z, NoFlyZone)),
    }
    is_same = changed == {key: getattr(scenario, key) for key in changed}
    return scenario if is_same else scenario.model_copy(update=changed)


def _ends(scenario: Scenario) -> list[tuple[Array, Array]]:
    """Times (1,) and places (V, 1, 3) that every plan of the scenario has."""
    start = np.array(scenario.start.position_m) * NED_FROM_UP + offsets_ned_m(scenario)
    end = np.array(scenario.end.position_m) * NED_FROM_UP + offsets_ned_m(scenario)
    if not scenario.formation.ends_in_start_shape:
        end = end[[leader_index(scenario)]]
    first_s, last_s = np.array([0.0]), np.array([scenario.time.flight_s])
    return [(first_s, places[:, None]) for places in (start, hover_start_ned_m(scenario))] + [(last_s, end[:, None])]


def _free_m(zone: Zone, t_s: Array, places_ned_m: Array) -> float:
    """How far the zone may be widened beside places (V, N, 3) at times (N,)."""
    return float(outside_m(zone, t_s, places_ned_m[..., 0], places_ned_m[..., 1]).min()) - _KEPT_FREE_M
