"""Returns that are bad only if they begin within 100 ms, between the instants that are sampled; and a brute oracle."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import shapely
from scipy.interpolate import PPoly

from gcs.autopilots.traits import Autopilot
from gcs.mission.returns.pair_returns import StraightReturns, proved_separation
from gcs.mission.returns.rtl_altitudes import plan_returns, return_warnings
from gcs.mission.returns.rtl_cases import ReturnSpeeds, ReturnTo, pair_distances, return_cases, return_ends
from gcs.mission.returns.zones_crossed import zones_crossed
from gcs.plan.formation.shape import Shape
from gcs.plan.trajectory.phases import Phase
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tests.unit.plan.problems import FLAT, changed

ENDS_S = 40.0
SPEEDS = ReturnSpeeds(2.0, 5.0, 1.5, 5.0)


def flown(scenario: Scenario, leader: Array, joints_s: Array, functions: PPoly, tables: Array, **more: object) -> Plan:
    """A plan over flat ground: the leader's polynomials (D, M, 3), and a shape. It is a mission from 0 to `ENDS_S`."""
    first = scenario.formation.vehicle[0].model_dump()
    rows = [{**first, "sysid": n + 1, "position_m": [0.0, 10.0 * n, 5.0]} for n in range(tables.shape[1])]
    scenario = changed(
        scenario, terrain=FLAT, time={"flight_s": ENDS_S}, formation={"leader": 1, "vehicle": rows}, **more
    )
    state = np.zeros((*leader.shape[:2], 12))
    state[..., :3] = leader
    motion = Trajectory(PPoly(state, joints_s), PPoly(np.zeros((1, len(joints_s) - 1, 4)), joints_s))
    ends = (Phase("takeoff", 0.0, 0.0), Phase("mission", 0.0, ENDS_S), Phase("landing", ENDS_S, ENDS_S))
    return Plan(scenario, motion, Shape(functions, tables), ends, 0.0)


def northwards(height_m: float) -> Array:
    """Hovering 200 m north of the origin."""
    leader = np.zeros((1, 1, 3))
    leader[0, 0] = 200.0, 0.0, -height_m
    return leader


def turning() -> Array:
    """To the north at 4 m/s, in a curve to the east, so that the way home turns."""
    leader = np.zeros((3, 1, 3))
    leader[:, 0] = (0.0, 0.1, 0.0), (4.0, 0.0, 0.0), (0.0, 0.0, -20.0)
    return leader


def dip(at_s: float, lasts_s: float) -> PPoly:
    """1 throughout, and a second function that is 0 but for a moment, at whose middle it is 1."""
    joints_s = np.array([0.0, at_s - 0.5 * lasts_s, at_s, at_s + 0.5 * lasts_s, ENDS_S])
    c = np.zeros((2, 4, 2))
    c[1, :, 0] = 1.0
    c[0, 1, 1], c[0, 2, 1], c[1, 2, 1] = 2.0 / lasts_s, -2.0 / lasts_s, 1.0
    return PPoly(c, joints_s)


@pytest.mark.parametrize("at_s", [12.25, 30.13])
def test_two_vehicles_that_are_near_for_100_ms_are_found(simulation1: Scenario, at_s: float) -> None:
    """Between the instants that are sampled, vehicle 2 comes to 0.2 m for a moment: only then is a return too close."""
    tables = np.zeros((2, 2, 3))
    tables[0, 1], tables[1, 1] = (0.0, 10.0, 0.0), (0.0, -9.8, 0.0)
    plan = flown(simulation1, northwards(20.0), np.array([0.0, ENDS_S]), dip(at_s, 0.1), tables)
    found = plan_returns(plan, Autopilot.ARDUPILOT)
    assert found.worst is not None
    assert found.worst.distance_m == pytest.approx(0.2, abs=0.1)
    assert found.worst.t_s == pytest.approx(at_s, abs=2e-3)
    assert found.worst.proved_m is not None
    assert found.worst.proved_m <= 0.2 + 1e-6
    assert any("vehicles 1 and 2 come within" in text for text in return_warnings(plan, found, Autopilot.ARDUPILOT))
    rigid = flown(simulation1, northwards(20.0), np.array([0.0, ENDS_S]), dip(at_s, 0.1), tables * [[[1]], [[0]]])
    worst = plan_returns(rigid, Autopilot.ARDUPILOT).worst
    assert worst is not None
    assert worst.proved_m is not None
    assert worst.proved_m >= simulation1.judge.separation_min_m


@pytest.mark.parametrize("at_s", [12.25, 30.13])
def test_a_needle_that_tracks_sweep_in_100_ms_is_found(simulation1: Scenario, at_s: float) -> None:
    """Half way home lies a disk that tracks of vehicle 1 meet only if the return begins within 50 ms of `at_s`."""
    tables, still = np.zeros((1, 2, 3)), PPoly(np.ones((1, 1, 1)), np.array([0.0, ENDS_S]))
    tables[0, 1, 1] = 100.0
    free = flown(simulation1, turning(), np.array([0.0, ENDS_S]), still, tables)
    home_m = free.pads_ned_m[0, :2]
    begins_m = np.array([[4.0 * t_s, 0.1 * t_s**2] for t_s in (at_s - 0.05, at_s, at_s + 0.05)])
    disk_m = 0.5 * (home_m + begins_m[1])
    tracks = shapely.linestrings([[home_m, begin_m] for begin_m in begins_m])
    radius_m = float(shapely.distance(tracks[[0, 2]], shapely.Point(disk_m)).min())
    needle = {"north_m": disk_m[0], "east_m": disk_m[1], "radius_m": simulation1.mission.tolerance_m + radius_m}
    plan = flown(simulation1, turning(), np.array([0.0, ENDS_S]), still, tables, no_fly=[needle])
    rally = plan.landing_points_ned_m[:, None]
    crossed = zones_crossed(plan, Autopilot.ARDUPILOT, rally)
    found = [c for c in crossed if c.ends is ReturnTo.HOME and 1 in c.sysids and c.from_s <= at_s <= c.to_s]
    assert len(found) == 1
    assert (found[0].from_s > at_s - 0.2, found[0].to_s < at_s + 0.2) == (True, True)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("firmware", list(Autopilot))
def test_bounds_are_below_returns_every_2_ms(simulation1: Scenario, seed: int, firmware: Autopilot) -> None:
    """Three vehicles on cubic tracks, at random altitudes: no return of any instant is nearer than was proved."""
    random = np.random.default_rng(seed)
    leader = random.uniform(-1.0, 1.0, (4, 2, 3)) * np.array([1e-3, 3e-2, 3.0, 30.0])[:, None, None]
    leader[3, :, 2] = -15.0
    leader[:3, :, 2] *= 0.1
    functions = PPoly(random.uniform(-1.0, 1.0, (3, 1, 2)) * np.array([[[1e-3]], [[0.05]], [[1.0]]]), [0.0, ENDS_S])
    tables = random.uniform(-8.0, 8.0, (2, 3, 3)) * [1.0, 1.0, 0.2]
    joints_s = np.array([0.0, 17.3, ENDS_S])
    leader[3, 1, :2] = PPoly(leader[:, :1], joints_s[:2])(17.3)[:2]
    plan = flown(simulation1, leader, joints_s, functions, tables)
    altitudes_m = random.uniform(12.0, 22.0, 3)
    rally = plan.landing_points_ned_m[:, None]
    proof = proved_separation(
        StraightReturns(plan, return_ends(plan, firmware, rally), SPEEDS, altitudes_m, 0.3), np.inf
    )
    brute_m = np.inf
    for case in return_cases(plan, firmware, SPEEDS, 2e-3):
        motions = [case.motion(row, float(altitudes_m[row])) for row in range(3)]
        brute_m = min(brute_m, *(float(pair_distances(a, b).min()) for a, b in itertools.combinations(motions, 2)))
    assert proof.proved_m <= brute_m + 1e-9
    assert proof.proved_m >= min(brute_m, proof.least_m) - 0.11
    assert proof.least_m >= brute_m - 0.03
