"""Fleets above 12 vehicles that return at one altitude, from every instant: a brute oracle, and what samples miss."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.autopilots.traits import Autopilot
from gcs.mission.returns.fleet_cell import Between, least_level_m
from gcs.mission.returns.pair_returns import StraightReturns
from gcs.mission.returns.proved_fleet import proved_fleet
from gcs.mission.returns.rtl_altitudes import plan_returns, return_warnings
from gcs.mission.returns.rtl_cases import ReturnSpeeds, return_ends
from gcs.plan.formation.shape import Shape
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tests.unit.mission.returns.test_pair_returns import ENDS_S, dip, flown, northwards

SPEEDS = ReturnSpeeds(2.0, 5.0, 1.5, 5.0)
ALTITUDE_M, STEP_S = 30.0, 0.05
VEHICLES = 14


def least_by_steps(plan: Plan, ends_m: Array, t_s: float, wait_s: float) -> float:
    """The least distance on a grid of time while all vehicles return at `t_s`: climb, cruise, wait, sink."""
    starts = plan.leader_trajectory.state(np.array([t_s]))[:, :3] + plan.offsets(np.array([t_s]))[:, 0]
    looks = np.arange(0.0, 300.0, STEP_S)
    tracks = []
    for start, ends in zip(starts, ends_m, strict=True):
        end = min(ends, key=lambda place: float(np.hypot(*(place - start)[:2])))
        climb_s = max(ALTITUDE_M + start[2], 0.0) / SPEEDS.climb_mps
        way_m = np.hypot(*(end - start)[:2])
        done = np.clip((looks - climb_s) * SPEEDS.cruise_mps / max(way_m, 1e-9), 0.0, 1.0)[:, None]
        level = start[:2] + done * (end - start)[:2]
        sink_m = np.maximum(looks - climb_s - way_m / SPEEDS.cruise_mps - wait_s, 0.0) * SPEEDS.sink_mps
        up = np.minimum(-start[2] + np.minimum(looks, climb_s) * SPEEDS.climb_mps, np.maximum(ALTITUDE_M - sink_m, 0.0))
        tracks.append(np.column_stack([level, -up]))
    return min(float(np.linalg.norm(a - b, axis=1).min()) for a, b in itertools.combinations(tracks, 2))


def returning(plan: Plan, rally_ned_m: Array, required_m: float) -> StraightReturns:
    """All vehicles at one altitude."""
    ends = return_ends(plan, Autopilot.ARDUPILOT, rally_ned_m)
    return StraightReturns(plan, ends, SPEEDS, np.full(len(plan.sysids), ALTITUDE_M), required_m)


def scattered(scenario: Scenario, seed: int) -> Plan:
    """Vehicles that fly about 12 m apart on tracks of their own, and about as far apart over their pads."""
    random = np.random.default_rng(seed)
    leader = np.zeros((2, 2, 3))
    leader[0], leader[1, 0] = random.uniform(-6.0, 6.0, (2, 3)) * [1.0, 1.0, 0.0], (60.0, -40.0, -20.0)
    leader[1, 1] = leader[1, 0] + 17.3 * leader[0, 0]
    line = np.array([[0.0, 10.0 * n, 0.0] for n in range(VEHICLES)])
    tables = np.stack([line + random.uniform(-2.0, 2.0, line.shape), random.uniform(-1.0, 1.0, line.shape)])
    functions = PPoly(np.array([[[0.0, 2e-4]], [[0.0, -0.01]], [[1.0, 0.2]]]), [0.0, ENDS_S])
    return flown(scenario, leader, np.array([0.0, 17.3, ENDS_S]), functions, tables)


@pytest.mark.parametrize("seed", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2, 3))])
def test_no_return_is_nearer_than_was_proved(simulation1: Scenario, seed: int) -> None:
    plan = scattered(simulation1, seed)
    rally = plan.pads_ned_m[:, None] + np.array([[[150.0 - 80.0 * seed, 40.0, 0.0]]])
    proof = proved_fleet(returning(plan, rally, 0.3), np.inf)
    assert proof.proved_m >= 0.0
    random = np.random.default_rng(100 + seed)
    wait_s = Autopilot.ARDUPILOT.traits.returns.wait_s
    every = np.concatenate([random.uniform(0.0, ENDS_S - 1e-6, 25), [min(proof.t_s, ENDS_S - 1e-6), proof.proved_at_s]])
    for t_s in every:
        for ends_m in (plan.pads_ned_m[:, None], np.concatenate([plan.pads_ned_m[:, None], rally], axis=1)):
            assert least_by_steps(plan, ends_m, float(t_s), wait_s) >= proof.proved_m - 1e-9


def test_bounds_come_as_near_as_they_promise(simulation1: Scenario) -> None:
    """Vehicles that return to homes only, so that all choose alike: the bound is within 10 cm of what occurs."""
    plan = scattered(simulation1, 1)
    far = plan.pads_ned_m[:, None] + np.array([[[9e5, 0.0, 0.0]]])
    proof = proved_fleet(returning(plan, far, 0.3), np.inf)
    wait_s = Autopilot.ARDUPILOT.traits.returns.wait_s
    seen = least_by_steps(plan, plan.pads_ned_m[:, None], proof.t_s, wait_s)
    assert proof.least_m == pytest.approx(seen, abs=0.2)
    assert proof.least_m - 0.11 <= proof.proved_m <= seen


@pytest.mark.parametrize("at_s", [12.25, 30.13])
def test_two_of_many_vehicles_that_are_near_for_100_ms_are_found(simulation1: Scenario, at_s: float) -> None:
    """Only a return that begins within 50 ms of `at_s` is too close, between the instants that are sampled."""
    tables = np.zeros((2, VEHICLES, 3))
    tables[0, :, 1], tables[1, 8, 1] = 10.0 * np.arange(VEHICLES), -9.8
    plan = flown(simulation1, northwards(20.0), np.array([0.0, ENDS_S]), dip(at_s, 0.1), tables)
    found = plan_returns(plan, Autopilot.ARDUPILOT)
    assert found.worst is not None
    assert (found.worst.distance_m, found.worst.t_s) == pytest.approx((0.2, at_s), abs=0.1)
    assert set(found.worst.sysids) == {8, 9}
    assert any("vehicles 8 and 9 come within" in text for text in return_warnings(plan, found, Autopilot.ARDUPILOT))
    rigid = flown(simulation1, northwards(20.0), np.array([0.0, ENDS_S]), dip(at_s, 0.1), tables * [[[1]], [[0]]])
    worst = plan_returns(rigid, Autopilot.ARDUPILOT).worst
    assert worst is not None
    assert worst.proved_m is not None
    assert worst.proved_m >= simulation1.judge.separation_min_m


def test_vehicles_as_far_from_home_as_from_rally_points_may_cross(simulation1: Scenario) -> None:
    """All have the same distances: which end each one chooses is not proved, and the warning says when."""
    tables, still = np.zeros((1, VEHICLES, 3)), PPoly(np.ones((1, 1, 1)), np.array([0.0, ENDS_S]))
    tables[0, :, 1] = 10.0 * np.arange(VEHICLES)
    leader = np.zeros((2, 1, 3))
    leader[:, 0] = (0.0, 5.0, 0.0), (-16.0, 200.0, -20.0)  # along the line of vehicles
    plan = flown(simulation1, leader, np.array([0.0, ENDS_S]), still, tables)
    half_way_s = 25.0
    first = leader[1, 0] + half_way_s * leader[0, 0]
    rally = 2.0 * (first + tables[0])[:, None] * [1.0, 1.0, 0.0] - plan.pads_ned_m[:, None] * [1.0, 1.0, 0.0]
    proof = proved_fleet(returning(plan, rally, 0.3), 10.0)
    assert proof.proved_m < 0.3
    assert proof.proved_at_s == pytest.approx(half_way_s, abs=0.1)
    assert proved_fleet(returning(plan, rally + np.array([9e5, 0.0, 0.0]), 0.3), 10.0).proved_m > 9.8


@pytest.mark.parametrize("vehicles", [200, 1000])
def test_a_rigid_fleet_is_one_cell(simulation1: Scenario, vehicles: int) -> None:
    """Pads stand as the formation flies: no pair need be looked at more than once, over the whole plan."""
    data = simulation1.model_dump(mode="json")
    shape = {"name": "grid", "generator": "grid", "spacing_m": 3.0}
    data["formation"] = {"leader": 1, "count": vehicles, "start_shape": "grid", "shape": [shape]}
    still = PPoly(np.ones((1, 1, 1)), np.array([0.0, ENDS_S]))
    leader = np.zeros((2, 1, 3))
    leader[:, 0] = (6.0, 3.0, 0.0), (200.0, 0.0, -20.0)
    few = flown(simulation1, leader, np.array([0.0, ENDS_S]), still, np.zeros((1, 1, 3)))
    data["terrain"] = few.scenario.model_dump(mode="json")["terrain"]
    many = replace(few, scenario=Scenario.model_validate(data), shape=Shape(still, np.zeros((1, vehicles, 3))))
    plan = replace(many, shape=Shape(still, (many.pads_ned_m - many.pads_ned_m[0])[None]))
    far = plan.pads_ned_m[:, None] + np.array([[[9e5, 0.0, 0.0]]])
    proof = proved_fleet(returning(plan, far, 2.0), 3.0)
    assert 2.89 <= proof.proved_m <= 3.0


@pytest.mark.parametrize("seed", range(2))
def test_the_triangle_holds_every_pair(seed: int) -> None:
    """Pairs with random starts, ends and climbs, moved by as much as is uncertain: none comes nearer than its bound."""
    random = np.random.default_rng(seed)
    starts, ends = random.normal(0.0, 10.0, (2, 300, 2, 2))
    starts[:, 1] = starts[:, 0] + random.normal(0.0, 4.0, (300, 2))
    ends[:, 1] = ends[:, 0] + starts[:, 1] - starts[:, 0] + random.normal(0.0, 2.0, (300, 2))
    late_m, off = random.normal(0.0, 1.0, 300), random.uniform(0.0, 0.3, 300)
    ways = ends - starts
    begin = starts[:, 1] - starts[:, 0]
    pairs = Between(
        begin, ways[:, 1] - ways[:, 0], 2 * off, 2 * off, 0 * off, (ways[:, 0], ways[:, 1]), (off, off), late_m, 0 * off
    )
    bound = least_level_m(pairs)
    assert (bound > 0.0).mean() > 0.2
    for _ in range(20):
        moves = random.normal(size=(300, 2, 2))
        moves *= (random.uniform(0.0, 1.0, (300, 2)) * off[:, None] / np.linalg.norm(moves, axis=2))[..., None]
        begins = starts + moves
        length = np.linalg.norm(ends - begins, axis=2)
        done = np.linspace(-5.0, 80.0, 1500)[:, None, None] - np.stack([0.0 * late_m, late_m], axis=1)
        share = np.clip(done / length, 0.0, 1.0)[..., None]
        places = begins + share * (ends - begins)
        assert (np.linalg.norm(places[:, :, 1] - places[:, :, 0], axis=2).min(axis=0) >= bound - 1e-9).all()
