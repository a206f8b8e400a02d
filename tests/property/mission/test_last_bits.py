"""Plans that differ in their last bits: the same altitudes, waypoints and parameters.

States and controls of the leader are changed by up to 1e-9 of themselves, a million times as much as processors differ.
Compared exactly are return altitudes and speeds, parameters, the numbers of fence corners and of rally points, the
number, kinds and times of mission items, altitudes and yaws. Map positions may differ by one unit of 1e-7 degrees, and
speeds by one unit of 0.1 mm/s: a number beside the middle of two units is rounded either way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.mission.model import Command, VehicleMission
from gcs.mission.returns.fence_rally import Safety, build_safety
from gcs.mission.waypoints.arrival_times import corrected_legs
from gcs.mission.waypoints.mission_items import build_missions, timed_legs
from gcs.mission.waypoints.timed_legs import TimedLegs
from gcs.plan.trajectory.plan import Plan

SHARE = 1e-9
MISSIONS = ("simulation1", "ridge")
EACH = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long if at else pytest.mark.slow) for at, name in enumerate(MISSIONS)]
)
SHORT = "field"
SEEDS = (1, 2)


def perturbed(plan: Plan, seed: int) -> Plan:
    """The plan with every coefficient of its leader's polynomials changed by up to SHARE of itself."""
    chance = np.random.default_rng(seed)

    def moved(part: PPoly) -> PPoly:
        return PPoly(part.c * (1.0 + SHARE * chance.uniform(-1.0, 1.0, part.c.shape)), part.x)

    motion = plan.leader_trajectory
    return replace(plan, leader_trajectory=replace(motion, state=moved(motion.state), control=moved(motion.control)))


def assert_same_safety(ours: Safety, theirs: Safety) -> None:
    assert ours.returns.altitudes_m == theirs.returns.altitudes_m
    assert ours.returns.speeds == theirs.returns.speeds
    assert ours.parameters == theirs.parameters
    assert ours.fence.geofence.circles == theirs.fence.geofence.circles
    polygons = [[polygon.points for polygon in safety.fence.geofence.polygons] for safety in (ours, theirs)]
    points = [[[point.place for point in points] for points in safety.rally] for safety in (ours, theirs)]
    for one, other in zip(polygons[0] + points[0], polygons[1] + points[1], strict=True):
        assert len(one) == len(other)
        for place, near in zip(one, other, strict=True):
            assert abs(place.lat_degE7 - near.lat_degE7) <= 1
            assert abs(place.lon_degE7 - near.lon_degE7) <= 1


def assert_same_missions(ours: tuple[VehicleMission, ...], theirs: tuple[VehicleMission, ...]) -> None:
    for mission, other in zip(ours, theirs, strict=True):
        assert len(mission.items) == len(other.items)
        for item, near in zip(mission.items, other.items, strict=True):
            assert (item.command, item.frame, item.alt_m) == (near.command, near.frame, near.alt_m)
            assert abs(item.lat_degE7 - near.lat_degE7) <= 1
            assert abs(item.lon_degE7 - near.lon_degE7) <= 1
            speed = item.command == Command.DO_CHANGE_SPEED
            assert item.params == pytest.approx(near.params, rel=0.0, abs=1.01e-4 if speed else 0.0)


def missions_of(plan: Plan, legs: Callable[[Plan], TimedLegs]) -> tuple[VehicleMission, ...]:
    return build_missions(plan, legs(plan), firmware=plan.autopilots[0])


def corrected(plan: Plan) -> TimedLegs:
    return corrected_legs(plan, plan.autopilots[0])


@EACH
def test_returns_fence_and_parameters(plan_of: Callable[[str], Plan], name: str) -> None:
    plan = plan_of(f"{name}/scenario.toml")
    first = build_safety(plan, plan.autopilots)
    for seed in SEEDS:
        assert_same_safety(build_safety(perturbed(plan, seed), plan.autopilots), first)


@pytest.mark.parametrize("name", [SHORT, *(pytest.param(name, marks=pytest.mark.long) for name in MISSIONS)])
def test_waypoints_at_the_plans_speeds(plan_of: Callable[[str], Plan], name: str) -> None:
    plan = plan_of(f"{name}/scenario.toml")
    first = missions_of(plan, timed_legs)
    for seed in SEEDS[: 1 if name == SHORT else None]:
        assert_same_missions(missions_of(perturbed(plan, seed), timed_legs), first)


@EACH
def test_waypoints_at_corrected_speeds(plan_of: Callable[[str], Plan], name: str) -> None:
    plan = plan_of(f"{name}/scenario.toml")
    first = missions_of(plan, corrected)
    assert_same_missions(missions_of(perturbed(plan, SEEDS[0]), corrected), first)
