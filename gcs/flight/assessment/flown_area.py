"""The criteria of a flight about no-fly zones, keep-in areas, the fence and the ceiling, from true positions."""

from __future__ import annotations

import numpy as np

from gcs.flight.assessment.criterion import Criterion
from gcs.mission.failsafe.fence_areas import inclusion_corners, inside_m, planned_places_m
from gcs.physics.quadrotor import Array
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import nearest_zone_m
from gcs.scenario.navigation_error import navigation_error

ZONES, KEEP_IN, FENCE, HEIGHT = "outside no-fly zones", "inside keep-in areas", "inside the fence", "height"
Flight = tuple[Array, Array]  # plan times (N,), true positions (V, N, 3), NED


def area_criteria(plan: Plan, everywhere: Flight, airborne: Flight) -> list[Criterion]:
    """The criteria that apply to a plan: zones and fence from pad to pad, the height between the hovers.

    A vehicle must be outside every no-fly zone and inside every keep-in area: there the plan has left room for the
    navigation error. The ceiling is a limit of the plan alone, which may touch it: the flight may exceed it by the
    navigation error.
    """
    found, scenario = [], plan.scenario
    t_s, places = everywhere
    for name, zones in ((ZONES, scenario.no_fly), (KEEP_IN, scenario.keep_in)):
        if zones:
            away_m = nearest_zone_m(zones, t_s, places[..., 0], places[..., 1])
            found.append(_least(plan, name, away_m, t_s, 0.0, scenario.limits.zone_margin_m))
    found.append(_least(plan, FENCE, inside_m(inclusion_corners(planned_places_m(plan)), places), t_s, 0.0))
    ceiling_m = scenario.limits.height_m[1]
    t_s, places = airborne
    row, instant = np.unravel_index(int(np.argmax(-places[..., 2])), places.shape[:2])
    limit_m = round(ceiling_m + navigation_error(scenario).vertical_m, 3)
    highest_m, sysid = float(-places[row, instant, 2]), plan.sysids[row]
    found.append(Criterion(HEIGHT, "m", highest_m, limit_m, False, sysid, float(t_s[instant]), planned=ceiling_m))
    return found


def _least(
    plan: Plan, name: str, margin_m: Array, t_s: Array, limit_m: float, planned: float | None = None
) -> Criterion:
    row, instant = np.unravel_index(int(np.argmin(margin_m)), margin_m.shape)
    least_m, sysid = float(margin_m[row, instant]), plan.sysids[row]
    return Criterion(name, "m", least_m, limit_m, True, sysid, float(t_s[instant]), planned=planned)
