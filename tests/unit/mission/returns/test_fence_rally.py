"""The fence around a plan, and the places to return to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import shapely

from gcs.autopilots.traits import Autopilot
from gcs.frames import geodetic_to_ned
from gcs.mission.geofence import GeoPoint
from gcs.mission.returns.fence_areas import INCLUSION_MARGIN_M, inclusion_corners
from gcs.mission.returns.fence_rally import EXCLUSION_SLACK_M, build_fence, build_rally, build_safety, with_room
from gcs.mission.returns.rtl_altitudes import plan_returns
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.si import local_origin
from gcs.types import Array


def flat(places: tuple[GeoPoint, ...], plan: Plan) -> Array:
    origin = local_origin(plan.scenario)
    lat, lon = np.array([(p.lat_degE7 / 1e7, p.lon_degE7 / 1e7) for p in places]).T
    return geodetic_to_ned(lat, lon, origin.alt_amsl_m, origin)[:, :2]


@pytest.mark.parametrize("name", ["simulation1/scenario.toml", "field/scenario.toml"])
def test_everyone_stays_inside_with_a_margin(plan_of: Callable[[str], Plan], name: str) -> None:
    plan = plan_of(name)
    fence = build_fence(plan).geofence
    (polygon,) = fence.polygons
    assert polygon.inclusion
    assert 3 <= len(polygon.points) <= 32
    area = shapely.Polygon(flat(polygon.points, plan))
    assert area.is_valid
    assert area.convex_hull.area == pytest.approx(area.area, rel=1e-6)
    t_s = np.linspace(plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf), 3000)
    tracks = plan.states(t_s)[..., POSITION][..., :2].reshape(-1, 2)
    places = np.concatenate([tracks, plan.pads_ned_m[:, :2], plan.landing_points_ned_m[:, :2]])
    inside_m = shapely.distance(area.exterior, shapely.points(places))
    assert shapely.contains_properly(area, shapely.points(places)).all()
    assert inside_m.min() >= INCLUSION_MARGIN_M - 0.02
    assert inside_m.min() <= INCLUSION_MARGIN_M + 1.0


def test_closed_areas_are_fenced_where_the_plan_leaves_room(plan_of: Callable[[str], Plan]) -> None:
    """The plan flies along the edge of both: there the fence stands a little inside, and never outside the zone."""
    plan = plan_of("field/scenario.toml")
    fence = build_fence(plan)
    t_s = np.linspace(plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf), 3000)
    tracks = plan.states(t_s)[..., POSITION][..., :2].reshape(-1, 2)
    for zone, circle, disk in zip(fence.zones, fence.geofence.circles, plan.scenario.no_fly, strict=True):
        center = flat((circle.center,), plan)[0]
        assert center == pytest.approx([disk.north_m, disk.east_m], abs=0.01)
        assert not circle.inclusion
        areas = [np.pi * radius_m**2 for radius_m in (disk.radius_m, circle.radius_m)]
        assert [zone.area_m2, zone.fence_area_m2] == pytest.approx(areas)
        nearest_m = np.linalg.norm(tracks - center, axis=1).min()
        assert circle.radius_m <= disk.radius_m
        assert circle.radius_m == pytest.approx(min(disk.radius_m, nearest_m - EXCLUSION_SLACK_M), abs=0.05)


@pytest.mark.parametrize("name", ["field/scenario.toml", pytest.param("circuit/scenario.toml", marks=pytest.mark.slow)])
def test_a_flight_whose_plan_may_change_has_a_fence_around_all_that_its_limits_allow(
    plan_of: Callable[[str], Plan], name: str
) -> None:
    plan = plan_of(name)
    limits, keep_in = plan.scenario.limits, [one.area for one in plan.scenario.keep_in]
    fence = build_fence(plan, may_change=True)
    area = shapely.Polygon(flat(next(one.points for one in fence.geofence.polygons if one.inclusion), plan))
    box = shapely.box(limits.north_m[0], limits.east_m[0], limits.north_m[1], limits.east_m[1])
    allowed = shapely.intersection_all([box, *keep_in])
    assert shapely.distance(area.exterior, allowed.exterior) >= EXCLUSION_SLACK_M - 0.02
    assert area.contains(allowed)
    assert area.contains(shapely.Polygon(flat(build_fence(plan).geofence.polygons[0].points, plan)).buffer(-0.02))
    for circle, disk in zip(fence.geofence.circles, plan.scenario.no_fly, strict=True):
        assert circle.radius_m <= disk.radius_m - EXCLUSION_SLACK_M + 0.01


def test_the_top_of_that_fence_is_above_the_ceiling_of_the_limits(plan_of: Callable[[str], Plan]) -> None:
    plan = plan_of("field/scenario.toml")
    scenario = plan.scenario.model_copy(
        update={"limits": plan.scenario.limits.model_copy(update={"height_m": (0.0, 95.0)})}
    )
    high = replace(plan, scenario=scenario)
    firmware = (Autopilot.ARDUPILOT, Autopilot.PX4) * 3
    usual = build_safety(plan, firmware)
    roomy = with_room(high, usual, firmware)
    for names, rows in zip(roomy.parameters, usual.parameters, strict=True):
        now, before = dict(names), dict(rows)
        top = next(name for name in ("FENCE_ALT_MAX", "GF_MAX_VER_DIST") if name in now)
        assert now.pop(top) > 95.0 > before.pop(top)
        assert now == before


def test_a_fence_with_many_corners_is_made_simpler_and_keeps_the_margin() -> None:
    round_trip = 50.0 * np.stack([np.cos(a := np.linspace(0, 2 * np.pi, 400)), np.sin(a)], axis=1)
    corners = inclusion_corners(round_trip)
    assert len(corners) <= 32
    area = shapely.Polygon(corners)
    assert shapely.distance(area.exterior, shapely.points(round_trip)).min() >= INCLUSION_MARGIN_M - 1e-9
    assert area.area < np.pi * (50 + INCLUSION_MARGIN_M + 8) ** 2


def test_without_zones_rally_points_are_landing_points(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    altitudes = (10.0, 11.0, 12.0, 13.0, 14.0, 15.0)
    returns = replace(plan_returns(plan, Autopilot.ARDUPILOT), altitudes_m=altitudes)
    (ardupilot,) = zip(*build_rally(plan, Autopilot.ARDUPILOT, returns), strict=True)
    (px4,) = zip(*build_rally(plan, Autopilot.PX4, returns), strict=True)
    assert [p.place for p in ardupilot] == [p.place for p in px4]
    assert flat(tuple(p.place for p in px4), plan) == pytest.approx(plan.landing_points_ned_m[:, :2], abs=0.01)
    assert tuple(p.alt_m for p in ardupilot) == altitudes
    ground = plan.pads_ned_m[:, 2] - plan.landing_points_ned_m[:, 2]
    assert [p.alt_m for p in px4] == pytest.approx(ground, abs=0.006)
