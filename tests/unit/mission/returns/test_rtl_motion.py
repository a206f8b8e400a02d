"""Returns of a whole fleet: worked out by hand, flown again here in small steps, and the heights that were searched."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gcs.autopilots.stored_fields import StoredAs
from gcs.autopilots.traits import Autopilot
from gcs.mavlink import FenceCommand
from gcs.mission.returns.fence_rally import FENCE_ABOVE_M, build_rally, build_safety, return_parameters
from gcs.mission.returns.rtl_altitudes import STEP_MIN_M, ReturnPlan, plan_returns
from gcs.mission.returns.rtl_cases import (
    Returning,
    ReturnSpeeds,
    ReturnTo,
    highest_ground_m,
    pair_distances,
    return_cases,
)
from gcs.mission.returns.zones_crossed import zones_crossed
from gcs.physics.states import POSITION
from gcs.plan.formation.shape import rigid
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.terrain import ground_height_m
from gcs.types import Array
from tests.unit.plan.problems import alone, changed

SPEEDS = ReturnSpeeds(climb_mps=2.0, cruise_mps=5.0, sink_mps=1.0, wait_s=3.0)
ARDUPILOT, PX4 = Autopilot.ARDUPILOT, Autopilot.PX4


def returning(start: list[list[float]], ends: list[list[float]], datum_m: float = 0.0) -> Returning:
    """Vehicles at one instant."""
    places, grounds = np.array(start)[:, None], np.array(ends)[:, None]
    return Returning(ReturnTo.HOME, np.zeros(1), places, grounds, np.full((len(start), 1), datum_m), SPEEDS)


def test_up_across_wait_down() -> None:
    """From 10 m up and 50 m away to 20 m: 5 s up, 10 s across, 3 s there, 20 s down."""
    times, places = returning([[30, 40, -10]], [[0, 0, 0]]).motion(0, 20.0)
    assert times[0].tolist() == pytest.approx([0, 5, 15, 18, 38])
    assert places[0].tolist() == [[30, 40, -10], [30, 40, -20], [0, 0, -20], [0, 0, -20], [0, 0, 0]]


def test_who_is_higher_stays_there() -> None:
    times, places = returning([[30, 40, -25]], [[0, 0, 0]]).motion(0, 20.0)
    assert times[0].tolist() == pytest.approx([0, 0, 10, 13, 38])
    assert places[0, :, 2].tolist() == [-25, -25, -25, -25, 0]


def test_heights_count_from_the_datum() -> None:
    _, places = returning([[0, 0, -5]], [[0, 0, -2]], datum_m=3.0).motion(0, 20.0)
    assert places[0, :, 2].tolist() == [-5, -23, -23, -23, -2]


def test_passing_under_one_who_still_climbs() -> None:
    """Both at 10 m, 10 m apart in line; the rear one leaves its level 2 m below the other's, which is still 4 m up."""
    case = returning([[0, 0, -10], [10, 0, -10]], [[100, 0, 0], [110, 0, 0]])
    low, high = case.motion(0, 12.0), case.motion(1, 20.0)
    # The first starts across after 1 s and is below the second 2 s later, which is then 4 m higher than the first.
    speeds = np.hypot(5.0, 2.0)
    assert pair_distances(low, high)[0] == pytest.approx(4.0 * 5.0 / speeds, abs=1e-9)
    assert pair_distances(high, low)[0] == pytest.approx(4.0 * 5.0 / speeds, abs=1e-9)


def test_many_heights_at_once() -> None:
    case = returning([[0, 0, -10], [10, 0, -10]], [[100, 0, 0], [110, 0, 0]])
    heights = np.array([12.0, 20.0, 28.0])
    (t0, p0), (t1, p1) = (case.motion(row, heights[:, None]) for row in range(2))
    table = pair_distances((t0[:, None], p0[:, None]), (t1[None], p1[None]))[..., 0]
    for a, b in itertools.product(range(3), repeat=2):
        one = pair_distances(case.motion(0, heights[a]), case.motion(1, heights[b]))[0]
        assert table[a, b] == pytest.approx(one, abs=1e-12)


@pytest.fixture(scope="module")
def returns(simulation1_plan: Plan) -> ReturnPlan:
    return plan_returns(simulation1_plan, ARDUPILOT)


def fly_home(plan: Plan, returns: ReturnPlan, t_s: float, to_rally: bool, datum_is_end: bool = False) -> Array:
    """Places (V, N, 3) every 50 ms of the whole fleet returning from one instant, step by step."""
    here = plan.states(np.array([t_s]))[:, 0, POSITION]
    ends = plan.pads_ned_m.copy()
    if to_rally:
        away = [
            np.linalg.norm(here[:, :2] - end[:, :2], axis=1) for end in (plan.pads_ned_m, plan.landing_points_ned_m)
        ]
        ends = np.where((away[0] <= away[1])[:, None], plan.pads_ned_m, plan.landing_points_ned_m)
    datum = ends if datum_is_end else plan.pads_ned_m
    tops = np.minimum(here[:, 2], datum[:, 2] - np.array(returns.altitudes_m))
    dt, speeds = 0.05, returns.speeds
    waited = np.zeros(len(here))
    rows = [here.copy()]
    while not np.allclose(here, ends):
        assert len(rows) < 20_000
        left = np.linalg.norm(ends[:, :2] - here[:, :2], axis=1)
        away_still = left > 1e-9
        climbs = away_still & (here[:, 2] > tops)
        crosses = away_still & ~climbs
        waits = ~away_still & (waited < speeds.wait_s)
        sinks = ~away_still & ~waits
        here[climbs, 2] = np.maximum(tops, here[:, 2] - speeds.climb_mps * dt)[climbs]
        share = np.minimum(1.0, speeds.cruise_mps * dt / np.maximum(left, 1e-9))
        here[crosses, :2] += ((ends - here)[:, :2] * share[:, None])[crosses]
        waited[waits] += dt
        here[sinks, 2] = np.minimum(ends[:, 2], here[:, 2] + speeds.sink_mps * dt)[sinks]
        rows.append(here.copy())
    return np.stack(rows, axis=1)


def nearest_pair(plan: Plan, places: Array) -> tuple[float, tuple[int, int]]:
    gaps = {
        (plan.sysids[i], plan.sysids[j]): float(np.linalg.norm(places[i] - places[j], axis=-1).min())
        for i, j in itertools.combinations(range(len(places)), 2)
    }
    pair = min(gaps, key=gaps.__getitem__)
    return gaps[pair], pair


def test_the_worst_instant_is_as_bad_as_was_said(simulation1_plan: Plan, returns: ReturnPlan) -> None:
    worst = returns.worst
    assert worst is not None
    places = fly_home(simulation1_plan, returns, worst.t_s, worst.ends is ReturnTo.NEAREST)
    gap, pair = nearest_pair(simulation1_plan, places)
    assert gap == pytest.approx(worst.distance_m, abs=0.12)
    assert pair == worst.sysids
    assert worst.distance_m >= simulation1_plan.scenario.limits.separation_min_m


@pytest.mark.parametrize("to_rally", [False, True])
def test_no_other_instant_is_worse(simulation1_plan: Plan, returns: ReturnPlan, to_rally: bool) -> None:
    worst = returns.worst
    assert worst is not None
    for t_s in (-30.3, 0.0, 133.9, 203.3, 281.2):
        gap, _ = nearest_pair(simulation1_plan, fly_home(simulation1_plan, returns, t_s, to_rally))
        assert gap >= worst.distance_m - 0.12


def test_returns_clear_the_ground(simulation1_plan: Plan, returns: ReturnPlan) -> None:
    scenario = simulation1_plan.scenario
    for t_s in (120.0, 270.0):
        places = fly_home(simulation1_plan, returns, t_s, to_rally=False)
        moving = np.linalg.norm(np.diff(places[..., :2], axis=1), axis=-1) > 0
        across = places[:, 1:][moving][::4]
        above = -across[:, 2] - ground_height_m(scenario.terrain, across[:, 0], across[:, 1])
        assert above.min() >= scenario.limits.clearance_min_m


def test_heights_are_levels_a_step_apart(simulation1_plan: Plan, returns: ReturnPlan) -> None:
    tops = np.sort(np.array(returns.altitudes_m) - simulation1_plan.pads_ned_m[:, 2])
    assert returns.step_m == STEP_MIN_M
    assert np.diff(tops) == pytest.approx(np.full(5, STEP_MIN_M), abs=1.0)  # whole metres above homes that differ
    assert np.diff(tops).min() >= simulation1_plan.scenario.limits.separation_min_m
    assert tops[-1] == pytest.approx(returns.top_m)
    highest = -simulation1_plan.states(np.linspace(-30, 280, 2000))[..., 2].min()
    assert tops[0] >= max(returns.ground_max_m + simulation1_plan.scenario.limits.clearance_min_m, highest) - 0.1


def test_return_altitudes_are_what_each_autopilot_stores(simulation1_plan: Plan) -> None:
    """Up to the next one: ArduPilot's rally points have whole metres, and RTL_ALT with them. Verified after that."""
    for firmware, per_m in ((ARDUPILOT, 1), (PX4, 100)):
        returns = plan_returns(simulation1_plan, firmware)
        safe = build_safety(simulation1_plan, firmware)
        assert safe.returns.altitudes_m == returns.altitudes_m
        assert all(round(a * per_m) == pytest.approx(a * per_m, abs=1e-6) for a in returns.altitudes_m)
        storage = firmware.traits.link.item_storage.of(FenceCommand.RALLY_POINT).z
        for row, (point,) in enumerate(safe.rally):
            stored_m = math.trunc(point.alt_m) if storage.stored is StoredAs.WHOLE else point.alt_m
            assert stored_m == point.alt_m
            parameters = dict(safe.parameters[row])
            if firmware is ARDUPILOT:  # it returns at the higher of the two: they are equal, and what was verified
                assert parameters["RTL_ALT"] == 100 * stored_m == 100 * returns.altitudes_m[row]
            else:
                assert parameters["RTL_RETURN_ALT"] == returns.altitudes_m[row]
        assert returns.worst is not None
        assert returns.worst.distance_m >= simulation1_plan.scenario.limits.separation_min_m


def test_any_other_order_is_no_better(simulation1_plan: Plan, returns: ReturnPlan) -> None:
    """The order was searched on few instants; on those, at the speed that was chosen, nothing beats it."""
    plan = simulation1_plan
    cases = return_cases(plan, ARDUPILOT, returns.speeds, 8.0)
    homes_m = -plan.pads_ned_m[:, 2]
    tops = np.array(returns.altitudes_m) + homes_m

    def gap(heights: Array) -> float:
        least = np.inf
        for case in cases:
            motions = [case.motion(row, float(heights[row] - homes_m[row])) for row in range(6)]
            least = min(least, *(pair_distances(a, b).min() for a, b in itertools.combinations(motions, 2)))
        return float(least)

    chosen = gap(tops)
    random = np.random.default_rng(5)
    for _ in range(40):
        assert gap(random.permutation(tops)) <= chosen + 0.02  # whole centimetres move every top a little


def test_px4_counts_from_where_it_goes(simulation1_plan: Plan) -> None:
    """Landing points lie lower than pads: rally points shift the altitudes of all vehicles by that much."""
    plan = simulation1_plan
    at_home, at_nearest = return_cases(plan, PX4, SPEEDS, 5.0)
    ardupilot = return_cases(plan, ARDUPILOT, SPEEDS, 5.0)[1]
    assert np.array_equal(at_home.datum_m, -np.repeat(plan.pads_ned_m[:, 2:], len(at_home.t_s), axis=1))
    assert np.array_equal(ardupilot.datum_m, at_home.datum_m)
    assert np.array_equal(at_nearest.datum_m, -at_nearest.to_ned_m[..., 2])
    assert not np.array_equal(at_nearest.datum_m, at_home.datum_m)
    px4 = plan_returns(plan, PX4)
    assert px4.worst is not None
    places = fly_home(
        plan, px4, px4.worst.t_s, px4.worst.ends is ReturnTo.NEAREST, datum_is_end=px4.worst.ends is ReturnTo.NEAREST
    )
    assert nearest_pair(plan, places)[0] == pytest.approx(px4.worst.distance_m, abs=0.12)


@pytest.mark.slow
def test_straight_ways_through_closed_areas_are_told(plan_of: Callable[[str], Plan]) -> None:
    """The field's two areas lie between start and end: only near the ends is the straight way free."""
    plan = plan_of("field/scenario.toml")
    home, nearest = return_cases(plan, ARDUPILOT, SPEEDS, 0.5)
    rally = plan.landing_points_ned_m[:, None]
    found = list(zones_crossed(plan, ARDUPILOT, rally))
    for case in (home, nearest):
        for crossing in (one for one in found if one.ends is case.to):
            disk = plan.scenario.no_fly[crossing.zone - 1]
            for t_s, inside in (
                (crossing.from_s + 1.5, True),
                (crossing.to_s - 1.5, True),
                (crossing.from_s - 1.0, False),
            ):
                at = int(np.argmin(np.abs(case.t_s - t_s)))
                shares = np.linspace(0, 1, 2000)[:, None, None]
                ways = case.from_ned_m[:, at, :2] + shares * (case.to_ned_m - case.from_ned_m)[:, at, :2]
                depth = disk.radius_m - np.linalg.norm(ways - [disk.north_m, disk.east_m], axis=-1).min()
                assert (depth > plan.scenario.mission.tolerance_m - 0.01) == inside
    assert [c.zone for c in found if c.ends is ReturnTo.HOME] == [1, 2]
    returns = plan_returns(plan, ARDUPILOT)
    assert returns.worst is not None
    assert returns.worst.distance_m >= plan.scenario.judge.separation_min_m
    assert returns.step_m == pytest.approx(1.25 * plan.scenario.limits.separation_min_m)


def test_highest_ground_either_way(simulation1_plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """Too many ways to look at: then nothing in the rectangle around them is higher."""
    from gcs.mission.returns import rtl_cases as module

    cases = return_cases(simulation1_plan, ARDUPILOT, SPEEDS, 4.0)
    exact = highest_ground_m(simulation1_plan, cases)
    monkeypatch.setattr(module, "_LOOKS_MAX", 1)
    assert highest_ground_m(simulation1_plan, cases) >= exact


def test_one_vehicle_meets_nobody(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    shape = rigid(np.zeros((1, 3)), plan.t_start_s, plan.t_end_s)
    returns = plan_returns(replace(plan, scenario=alone(plan.scenario), shape=shape), ARDUPILOT)
    assert returns.worst is None
    assert len(returns.altitudes_m) == 1


def test_parameters_in_the_autopilots_units(returns: ReturnPlan) -> None:
    ardupilot = dict(return_parameters(ARDUPILOT, returns, 2, 1.5, 3.0))
    assert ardupilot["RTL_ALT"] == round(returns.altitudes_m[2] * 100)
    assert isinstance(ardupilot["RTL_ALT"], int)
    assert ardupilot["RTL_SPEED"] == round(returns.speeds.cruise_mps * 100)
    assert (ardupilot["RTL_CONE_SLOPE"], ardupilot["RTL_CLIMB_MIN"], ardupilot["RTL_ALT_FINAL"]) == (0, 0, 0)
    px4 = dict(return_parameters(PX4, returns, 2, 1.5, 2.15))
    assert px4["RTL_RETURN_ALT"] == returns.altitudes_m[2]
    assert (px4["RTL_TYPE"], px4["RTL_CONE_ANG"]) == (0, 0)
    assert px4["MIS_TAKEOFF_ALT"] == 2.1
    for name, parameters in (("FENCE_ALT_MAX", ardupilot), ("GF_MAX_VER_DIST", px4)):
        assert returns.top_m - 1.5 + FENCE_ABOVE_M <= parameters[name] < returns.top_m - 1.5 + FENCE_ABOVE_M + 1
    assert all(len(name) <= 16 for name in (*ardupilot, *px4))


@pytest.mark.long
def test_a_large_fleet_returns_in_formation(simulation1_plan: Plan) -> None:
    """More vehicles than can be staggered: one height, the distances of the formation, looked at now and then."""
    plan = simulation1_plan
    count = 16
    offsets = 0.5 * np.array([[n // 4, n % 4, 0] for n in range(count)])
    places = (np.array([2.0, 1.0, 3.0]) + offsets * [1, 1, -1]).tolist()
    vehicles = [{"sysid": n + 1, "position_m": place} for n, place in enumerate(places)]
    scenario = changed(plan.scenario, formation={"vehicle": vehicles})
    fleet = replace(plan, scenario=scenario, shape=rigid(offsets, plan.t_start_s, plan.t_end_s))
    returns = plan_returns(fleet, ARDUPILOT)
    tops = np.array(returns.altitudes_m) - fleet.pads_ned_m[:, 2]
    assert np.ptp(tops) < 0.011
    rally_m = np.array([point.alt_m for (point,) in build_rally(fleet, ARDUPILOT, returns)])
    assert np.array_equal(rally_m, np.floor(returns.altitudes_m))  # below RTL_ALT, which the vehicle then holds
    assert returns.worst is not None
    assert returns.worst.distance_m == pytest.approx(0.5, abs=0.12)  # pads are not level: climbs take different times
