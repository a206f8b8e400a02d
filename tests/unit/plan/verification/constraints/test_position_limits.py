"""Box, heights and zones of a straight flight, against distances worked by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from tests.unit.plan.problems import alone, changed
from tests.unit.plan.verification.constraints.even_flights import assert_margin, check_of, even

NORTH = (2.0, 0.0, 0.0)


def single(plan: Plan, **tables: Any) -> Plan:
    """The leader alone."""
    row = slice(plan.leader, plan.leader + 1)
    shape = replace(plan.shape, basis_ned_m=plan.shape.basis_ned_m[:, row])
    return replace(plan, scenario=changed(alone(plan.scenario), **tables), shape=shape)


@pytest.fixture(scope="module")
def north(meadow_plan: Plan) -> Plan:
    """2 m/s north along east = 1 m, 4 m up; at north = 0 m at T0."""
    return even(single(meadow_plan), (0.0, 1.0, -4.0), NORTH)


def with_zone(plan: Plan, **zone: Any) -> Plan:
    return replace(plan, scenario=changed(plan.scenario, no_fly=[zone]))


@pytest.mark.parametrize(("aside_m", "radius_m"), [(7.3, 7.0), (7.3, 7.3), (7.3, 8.0), (-30.0, 10.0)])
def test_beside_a_disk(north: Plan, aside_m: float, radius_m: float) -> None:
    zoned = with_zone(north, north_m=20.0, east_m=1.0 + aside_m, radius_m=radius_m)
    assert_margin(check_of(zoned, "no-fly zone 1"), abs(aside_m) - radius_m)


def test_a_disk_that_flies_across_ahead(north: Plan) -> None:
    """It moves 3 m/s east: seen from it the vehicle flies (2, -3), and passes at the distance from a straight line."""
    zoned = with_zone(north, north_m=20.0, east_m=-9.0, radius_m=1.0, moves=[[0, 0, 0], [20, 0, 60]])
    start, way = np.array([-20.0, 10.0]), np.array([2.0, -3.0])
    distance = abs(start[0] * way[1] - start[1] * way[0]) / np.hypot(*way)
    assert_margin(check_of(zoned, "no-fly zone 1"), distance - 1.0)


def test_before_a_zone_turns_back_it_is_nearest(north: Plan) -> None:
    """Nearest in one instant at which it turns around, between the joints of the plan."""
    zoned = with_zone(
        north, north_m=20.0, east_m=41.0, radius_m=1.0, moves=[[9.99, 0, 0], [10.003, 0, -38.0], [10.02, 0, 0]]
    )
    assert_margin(check_of(zoned, "no-fly zone 1"), float(np.hypot(2.0, 0.006)) - 1.0, close=6e-2)


def test_past_the_corner_of_a_polygon(north: Plan) -> None:
    corners = [[20.0, 1.5], [25.0, 6.5], [15.0, 6.5]]
    zoned = check_of(with_zone(north, polygon_m=corners), "no-fly zone 1")
    assert zoned.verdict == "proved"
    assert zoned.proved is not None
    assert 0.0 < zoned.proved <= 0.5  # of the edges' lines, which are nearer than the corner
    cut = check_of(with_zone(north, polygon_m=[[20.0, 0.5], [25.0, 5.5], [15.0, 5.5]]), "no-fly zone 1")
    assert cut.verdict == "violated"
    assert cut.worst == pytest.approx(-0.5 * np.sqrt(0.5), abs=2e-3)
    assert cut.t_s == pytest.approx(10.0, abs=0.01)


@pytest.mark.parametrize(("high_m", "verdict"), [(4.001, "proved"), (3.9993, "proved"), (3.9990, "violated")])
def test_the_height_is_a_length_with_a_tolerance_of_a_length(north: Plan, high_m: float, verdict: str) -> None:
    low = replace(north, scenario=changed(north.scenario, limits={"height_m": [0.0, high_m]}))
    found = check_of(low, "height")
    assert found.verdict == verdict
    assert found.worst == pytest.approx(high_m - 4.0, abs=1e-9)


def test_the_box_holds_in_the_mission_and_around_the_pads_elsewhere(north: Plan) -> None:
    """It flies from north = 2 t_start to 2 t_end; the box is crossed within the mission, pads lie beyond it."""
    limits = {"north_m": [-1.0, 39.0], "east_m": [0.75, 50.0]}
    boxed = replace(north, scenario=changed(north.scenario, limits=limits))
    assert_margin(check_of(boxed, "north position"), 39.0 - 2.0 * north.flight_s)
    assert_margin(check_of(boxed, "east position"), 0.25)
    end = check_of(boxed, "north position", "landing")
    pads = np.concatenate([boxed.pads_ned_m, boxed.landing_points_ned_m])
    assert_margin(end, max(39.0, float(pads[:, 0].max())) - 2.0 * boxed.t_end_s)


def test_inside_a_keep_in_area(north: Plan) -> None:
    """5 m to the nearest edge along the way; an area with a notch into the way is left, and only that is reported."""

    def kept(*corners: tuple[float, float]) -> Plan:
        return replace(north, scenario=changed(north.scenario, keep_in=[{"polygon_m": corners}]))

    yard = ((-50.0, -30.0), (150.0, -30.0), (150.0, 6.0), (-50.0, 6.0))
    assert_margin(check_of(kept(*yard), "keep-in area 1"), 5.0)
    notched = check_of(kept(*yard[:3], (20.0, 6.0), (15.0, 0.5), (10.0, 6.0), yard[3]), "keep-in area 1")
    assert notched.verdict == "violated"
    assert notched.worst == pytest.approx(-0.5 / np.hypot(5.0, 5.5) * 5.0, abs=2e-3)
    assert notched.t_s == pytest.approx(7.5, abs=0.3)


def test_names_of_zones_count_by_kind(north: Plan) -> None:
    areas = [{"polygon_m": [[-50.0, -50.0 - n], [150.0, -50.0], [150.0, 50.0], [-50.0, 50.0]]} for n in range(2)]
    zoned = with_zone(
        replace(north, scenario=changed(north.scenario, keep_in=areas)), north_m=0, east_m=40, radius_m=20
    )
    report = verify(zoned)
    named = {check.name for check in report.checks if "area" in check.name or "zone" in check.name}
    assert named == {"keep-in area 1", "keep-in area 2", "no-fly zone 1"}
    assert report.nearest_zone is not None
    assert str(report.nearest_zone.name) == "no-fly zone 1"
