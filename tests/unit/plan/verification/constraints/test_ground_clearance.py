"""The distance to the ground in any direction, against planes, needles and walls worked by hand."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints.ground_clearance import CLEARANCE as CLEARANCE_ROW
from gcs.plan.verification.constraints.ground_clearance import PAD_FREE_M, PAD_SHARE, GroundClearance
from gcs.plan.verification.constraints.position_limits import enclosed_places
from gcs.plan.verification.proof.subdivision import plain_cells
from gcs.plan.verification.proof.vehicle_tree import vehicle_tree
from gcs.scenario.schema.heightmap import Relief, packed
from tests.unit.plan.problems import changed
from tests.unit.plan.verification.constraints.even_flights import assert_margin, check_of, even

CLEARANCE, BESIDE = "clearance above ground", "distance to the ground beside the pad"


def over(plan: Plan, terrain: dict[str, Any], up_m: float, speed_mps: float = 2.0) -> Plan:
    """All vehicles on one straight line north, above east = 1 m (of the leader)."""
    flown = even(plan, (0.0, 1.0, -up_m), (speed_mps, 0.0, 0.0))
    return replace(flown, scenario=changed(flown.scenario, terrain={"mountains": {}, **terrain}))


def clearance_m(plan: Plan) -> float:
    """The limit, which a margin does not count."""
    return plan.scenario.limits.clearance_min_m


def lowest_m(plan: Plan) -> float:
    """The least height of a vehicle of the shape above the leader's."""
    return float(-plan.shape.at(0.0)[:, 2].max())


def test_over_level_ground_it_is_the_height(meadow_plan: Plan) -> None:
    plan = over(meadow_plan, {}, 4.0)
    assert_margin(check_of(plan, CLEARANCE), 4.0 + lowest_m(plan) - clearance_m(plan))


def test_over_level_ground_one_look_at_all_vehicles_and_the_whole_time_is_enough(meadow_plan: Plan) -> None:
    """The way out of level ground is straight up, however far vehicles are spread over it."""
    plan = over(meadow_plan, {}, 4.0)
    no_pads_m = np.zeros((len(plan.phases), len(plan.sysids)))
    tree, whole_fleet = vehicle_tree(plan.shape), np.zeros((1, 1), dtype=np.intp)
    places = partial(enclosed_places, plan, tree)
    flies = np.zeros(1, dtype=np.intp)
    family = GroundClearance(places, tree, plan.scenario.terrain, clearance_m(plan), flies, no_pads_m)
    cells = plain_cells(whole_fleet, np.array([0.0]), np.array([20.0]))
    (low_m,), _ = (margins[CLEARANCE_ROW] for margins in family.bounds(family.around(cells)))
    margin_m = 4.0 + lowest_m(plan) - clearance_m(plan)
    spread_m = float(np.ptp(plan.shape.at(0.0)[:, 2]))
    assert margin_m - spread_m - 1e-9 <= low_m <= margin_m + 1e-9


def slope(rise: float, bend_m: float = 0.0) -> Relief:
    """A plane that rises to the east: between its pixels it is exact. With `bend_m`, a ridge in the middle."""
    east = np.arange(-60.0, 61.0, 2.0)
    row, column = np.zeros(10), np.zeros(10)
    row[:2], column[[0, 2]] = (30.0, 60.0), (30.0, 60.0)
    heights = np.tile(30.0 + rise * east + bend_m * (east == 0.0), (61, 1))
    return Relief(
        rows=61,
        columns=61,
        heights=packed(heights),
        centre_m=(20.0, 0.0),
        reach_m=120.0,
        row=tuple(row.tolist()),
        column=tuple(column.tolist()),
        spacing_m=2.0,
        north_m=(-95.0, 135.0),
        east_m=(-55.0, 55.0),
    )


@pytest.mark.parametrize("rise", [0.25, 0.5])
def test_over_a_slope_it_is_the_height_times_the_cosine(meadow_plan: Plan, rise: float) -> None:
    plan = over(meadow_plan, {"relief": slope(rise).model_dump()}, 40.0)
    offsets = plan.shape.at(0.0)
    above = 40.0 - offsets[:, 2] - (30.0 + rise * (1.0 + offsets[:, 1]))
    assert_margin(check_of(plan, CLEARANCE), float(above.min()) / np.hypot(1.0, rise) - clearance_m(plan))


@pytest.mark.parametrize("aside_m", [0.58, 0.8, 1.7])
def test_beside_a_needle_it_is_the_distance_to_its_side(meadow_plan: Plan, aside_m: float) -> None:
    """It stands beside the westernmost vehicle, ten times higher than the flight; 15 cm wide at that height."""
    west = float(meadow_plan.shape.at(0.0)[:, 1].min()) + 1.0
    spread = 0.05
    needle = dict(zip(("north_m", "east_m", "height_m"), ([20.0], [west - aside_m], [40.0]), strict=True))
    needle |= {"spread_north_m": [spread], "spread_east_m": [spread]}
    plan = over(meadow_plan, {"mountains": needle}, 4.0)
    found = check_of(plan, CLEARANCE)
    width = spread * float(np.sqrt(np.log(40.0 / 4.0)))
    assert_margin(found, aside_m - width - clearance_m(plan), exact_m=1e-4)  # its side is not quite upright
    assert found.t_s == pytest.approx(10.0, abs=2.0)


def test_below_the_ground_it_is_negative(meadow_plan: Plan) -> None:
    plan = over(meadow_plan, {}, 4.0)
    sunk = even(plan, (0.0, 1.0, 0.7), (2.0, 0.0, 0.0))
    found = check_of(sunk, CLEARANCE)
    assert found.worst == pytest.approx(lowest_m(plan) - 0.7 - clearance_m(plan), abs=2e-3)
    assert found.verdict == "violated"


def test_on_a_pad_nothing_is_required_and_above_it_a_share_of_the_height(meadow_plan: Plan) -> None:
    """The vehicles stand still 1.25 m above level ground, which is their pads': a quarter of a metre is required."""
    plan = over(meadow_plan, {}, 1.25, speed_mps=0.0)
    required = PAD_SHARE * min(1.25 - PAD_FREE_M, clearance_m(plan))
    found = check_of(plan, BESIDE, "takeoff")
    assert found.verdict == "proved"
    assert found.worst == pytest.approx(1.25 + lowest_m(plan) - required, abs=1e-2)
    standing = over(meadow_plan, {}, -lowest_m(plan), speed_mps=0.0)
    assert check_of(standing, BESIDE, "takeoff").verdict == "proved"
    assert check_of(standing, "height above ground", "takeoff").worst == pytest.approx(0.0, abs=1e-9)


def test_a_needle_beside_the_pad_of_any_vehicle_is_too_near(meadow_plan: Plan) -> None:
    """All stand still 1.25 m above their pads, and the needle's side is 0.1 m from one; 0.25 m are required."""
    needle = {"height_m": [40.0], "spread_north_m": [0.05], "spread_east_m": [0.05]}
    width_m = 0.05 * float(np.sqrt(np.log(40.0 / 1.25)))
    for north_m, east_m, _ in meadow_plan.shape.at(0.0):
        place = {"north_m": [float(north_m)], "east_m": [float(east_m) + 1.0 + width_m + 0.1]}
        plan = over(meadow_plan, {"mountains": needle | place}, 1.25, speed_mps=0.0)
        assert check_of(plan, BESIDE, "takeoff").verdict == "violated"
