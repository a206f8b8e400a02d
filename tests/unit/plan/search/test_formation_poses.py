"""What the formation may look like somewhere: all shapes of the schedule, the mildest first, few standing for many."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

from gcs.plan.ocp.problem import flight_problem
from gcs.plan.search.formation_poses import REPRESENTATIVES, floor_m, poses, representatives
from gcs.scenario.environment.terrain import ground_envelope_m
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import offsets_ned_m
from tests.unit.plan.formations import SHRINK, TO_FILE, TURN, at, auto, block, fleet


def test_without_coordinates_there_is_a_pose_for_every_stop_of_the_schedule(simulation1: Scenario) -> None:
    scenario = fleet(simulation1, 5, "row", (at(TURN, 2.0), at(SHRINK, 20.0)))
    start = offsets_ned_m(scenario)
    turned = start[:, [1, 0, 2]] * [-1.0, 1.0, 1.0]
    found = poses(flight_problem(scenario))
    for pose, wanted in zip(found, (start, turned, 0.5 * turned), strict=True):
        np.testing.assert_allclose(pose.offsets_ned_m, wanted, atol=1e-12)
        assert pose.cost == 0.0


def test_the_mildest_pose_comes_first_and_costs_nothing(simulation1: Scenario) -> None:
    problem = flight_problem(fleet(simulation1, 5, "row", (auto(SHRINK), auto(TURN), auto(TO_FILE))))
    found = poses(problem)
    assert found[0].values == {"scale": 1.0, "heading": 0.0, "blend": 0.0}
    assert found[0].cost == 0.0
    costs = [pose.cost for pose in found]
    assert costs == sorted(costs)
    assert costs[1] > 0.0
    least = min(found, key=lambda pose: (pose.values["scale"], abs(pose.values["heading"]), abs(pose.values["blend"])))
    np.testing.assert_allclose(least.offsets_ned_m, 0.5 * offsets_ned_m(problem.scenario), atol=1e-12)
    assert least.cost == 0.3  # fully changed: the weight itself


def test_a_few_stand_for_all_and_nobody_is_far_from_one_of_them(simulation1: Scenario) -> None:
    many = offsets_ned_m(block(simulation1))
    rows = representatives(many)
    assert len(rows) == len(set(rows.tolist())) == REPRESENTATIVES
    assert rows[0] == 0  # the leader, in whose place the map is drawn
    apart = cdist(many[rows], many[rows])
    np.fill_diagonal(apart, np.inf)
    assert cdist(many, many[rows]).min(axis=1).max() <= apart.min() + 1e-9
    for axis in (0, 1):  # the outermost are among them
        assert many[rows, axis].max() == many[:, axis].max()
        assert many[rows, axis].min() == many[:, axis].min()
    np.testing.assert_array_equal(representatives(many[:5]), np.arange(5))


def test_the_floor_is_that_of_the_vehicle_that_needs_most(simulation1: Scenario) -> None:
    problem = flight_problem(block(simulation1))
    scenario = problem.scenario
    offsets = np.array([[0.0, 0.0, 0.0], [-6.0, 4.0, 1.5], [0.0, -9.0, -2.0]])
    random = np.random.default_rng(2)
    north, east = random.uniform(20.0, 90.0, 300), random.uniform(-40.0, 40.0, 300)
    found = floor_m(problem, offsets, north, east)
    (disk,) = scenario.no_fly
    for n, e, floor in zip(north, east, found, strict=True):
        places = offsets + np.array([n, e, 0.0])
        inside = np.hypot(places[:, 0] - disk.north_m, places[:, 1] - disk.east_m) < disk.radius_m
        ground = ground_envelope_m(scenario.terrain, places[:, 0], places[:, 1])
        needed = (ground + scenario.limits.clearance_min_m + offsets[:, 2]).max()  # a lower vehicle needs more
        if inside.any():
            assert floor == np.inf
            continue
        # Beside steep hills the clearance requires more height than it measures.
        assert needed <= floor <= needed + 1.5 * scenario.limits.clearance_min_m
    assert np.isinf(found).any()
    assert np.isfinite(found).any()
