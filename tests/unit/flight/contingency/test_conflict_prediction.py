"""Conflicts seen before they happen, and none where the plan is flown as it was verified."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gcs.flight.contingency.conflict_prediction import Conflict, SeparationWatch
from gcs.flight.monitor import VehicleView
from gcs.physics.quadrotor import POSITION, VELOCITY
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.load import load_scenario
from tests.bridge.flying import hop_scenario

T0 = 1_700_000_000.0
ALL = (1, 2, 3, 4, 5, 6)


@pytest.fixture(scope="module")
def hop_plan(repo_root: Path) -> Plan:
    """Three vehicles, 5 m apart."""
    return make_plan(hop_scenario(load_scenario(repo_root / "missions" / "field")))


def views_at(plan: Plan, t_s: float, age_s: float = 0.1, noise_m: float = 0.0, seed: int = 0) -> dict[int, VehicleView]:
    """What six vehicles that fly the plan tell at `t_s`, a little old."""
    rng = np.random.default_rng(seed)
    states = plan.states(np.array([t_s - age_s]))[:, 0]
    return {
        sysid: VehicleView(
            sysid,
            states[row, POSITION] + rng.normal(0.0, noise_m, 3),
            states[row, VELOCITY] + rng.normal(0.0, noise_m, 3),
            T0 + t_s - age_s,
        )
        for row, sysid in enumerate(plan.sysids)
    }


def test_a_verified_plan_flown_with_noise_has_no_conflicts(simulation1_plan: Plan) -> None:
    ours = SeparationWatch(simulation1_plan, 0.3)
    for n, t_s in enumerate(np.arange(-15.0, 275.0, 1.0)):
        views = views_at(simulation1_plan, t_s, noise_m=0.02, seed=n)
        assert ours.look(views, t_s, T0 + t_s, ALL, ALL) == []


def test_two_who_drift_together_are_seen_in_time(simulation1_plan: Plan) -> None:
    plan, ours = simulation1_plan, SeparationWatch(simulation1_plan, 0.3)
    found = []
    for t_s in np.arange(50.0, 50.31, 0.1):
        views = views_at(plan, t_s)
        between = views[2].position_ned_m - views[5].position_ned_m
        views[5].position_ned_m = views[5].position_ned_m + 0.25 * between / np.linalg.norm(between)
        found = ours.look(views, t_s, T0 + t_s, ALL, ALL)
        if t_s < 50.15:
            assert found == []  # one sample is no conflict
    (conflict,) = found
    assert conflict.pair == (2, 5)
    assert conflict.distance_m == pytest.approx(0.25, abs=0.02)
    assert conflict.in_s == 0.0


def test_who_stands_in_the_way_is_seen_seconds_ahead(simulation1_plan: Plan) -> None:
    plan, ours = simulation1_plan, SeparationWatch(simulation1_plan, 0.3)
    ahead = plan.states(np.array([52.0]))[3, 0, POSITION]
    for t_s in (50.0, 50.1, 50.2):
        views = views_at(plan, t_s)
        views[6] = VehicleView(6, ahead, np.zeros(3), T0 + t_s)
        found = ours.look(views, t_s, T0 + t_s, ALL[:5], ALL)
    mine = next(c for c in found if c.pair == (4, 6))
    assert 1.4 < mine.in_s < 2.0
    assert ours.look(views, t_s, T0 + t_s, ALL[:5], ALL[:5]) == []  # once it is down, it is no conflict


@pytest.mark.parametrize(("towards_mps", "nearest_m"), [(4.0, 3.0), (2.0, 4.0), (-4.0, 5.0)])
def test_a_deviation_drifts_on_for_half_a_second_in_all(hop_plan: Plan, towards_mps: float, nearest_m: float) -> None:
    """Two vehicles alone, 5 m abreast on the plan: one has a speed towards the other, which its controller will end."""
    ours = SeparationWatch(hop_plan, 5.5)
    for t_s in (10.0, 10.1, 10.2):
        views = views_at(hop_plan, t_s)
        between = views[3].position_ned_m - views[2].position_ned_m
        views[2].velocity_ned_mps = views[2].velocity_ned_mps + towards_mps * between / np.linalg.norm(between)
        found = ours.look(views, t_s, T0 + t_s, (2, 3), (2, 3))
    (conflict,) = found
    assert conflict.pair == (2, 3)
    assert conflict.distance_m == pytest.approx(nearest_m, abs=0.01)  # e^-6 of it is left after three seconds


def test_the_last_seconds_of_a_plan_are_predicted_too(hop_plan: Plan) -> None:
    ours = SeparationWatch(hop_plan, 2.0)
    for t_s in hop_plan.t_end_s - np.array([1.0, 0.5, 0.01]):
        assert ours.look(views_at(hop_plan, t_s), t_s, T0 + t_s, (1, 2, 3), (1, 2, 3)) == []


def on_pads(plan: Plan, unix_s: float, error_m: float = 0.0) -> dict[int, VehicleView]:
    """Vehicles that stand on their pads and report them with errors of this size, each in its own direction."""
    views = {}
    for row, sysid in enumerate(plan.sysids):
        off = error_m * np.array([np.cos(sysid), np.sin(sysid), 0.5])
        views[sysid] = VehicleView(sysid, plan.pads_ned_m[row] + off, np.zeros(3), unix_s)
        views[sysid].stands_on(plan.pads_ned_m[row])
    return views


def looked(
    plan: Plan, move: Callable[[dict[int, VehicleView]], None], error_m: float = 0.0, age_s: float = 0.0
) -> list[Conflict]:
    """What the watch says of vehicles before T0, after three looks, from reports of this age."""
    ours = SeparationWatch(plan, 1.0)
    found: list[Conflict] = []
    for n in range(3):
        views = on_pads(plan, T0 - 30.0 + 0.1 * n - age_s, error_m)
        move(views)
        found = ours.look(views, -30.0 + 0.1 * n, T0 - 30.0 + 0.1 * n, (), plan.sysids, plan.sysids)
    return found


def test_vehicles_that_climb_over_their_pads_have_no_conflict(hop_plan: Plan) -> None:
    def climb(views: dict[int, VehicleView]) -> None:
        for view in views.values():
            view.position_ned_m = view.position_ned_m + np.array([0.3, -0.2, -2.0])
            view.velocity_ned_mps = np.array([0.5 * (-1) ** view.sysid, 0.8, -2.5])

    assert looked(hop_plan, climb) == []
    assert looked(hop_plan, climb, error_m=4.0) == []


def test_a_climb_ends_at_the_hover(hop_plan: Plan) -> None:
    height_m = float(hop_plan.pads_ned_m[1, 2] - hop_plan.states(np.array([hop_plan.airborne_s]))[1, 0, 2])

    def passing(views: dict[int, VehicleView]) -> None:
        """Vehicle 2 nears its hover beneath vehicle 3, which was blown over it."""
        views[2].position_ned_m = views[2].position_ned_m + np.array([0.0, 0.0, 0.2 - height_m])
        views[2].velocity_ned_mps = np.array([0.0, 0.0, -2.5])
        views[3].position_ned_m = views[2].position_ned_m + np.array([0.0, 0.3, -2.0])

    assert looked(hop_plan, passing) == []


def drift(speed_mps: float, off_m: float) -> Callable[[dict[int, VehicleView]], None]:
    """Vehicle 2 is so far from its pad towards vehicle 3, and moves on."""

    def move(views: dict[int, VehicleView]) -> None:
        views[2].position_ned_m = views[2].position_ned_m + np.array([0.0, off_m, -0.5])
        views[2].velocity_ned_mps = np.array([0.0, speed_mps, 0.0])

    return move


def test_a_vehicle_that_drifts_towards_a_standing_one_is_seen_seconds_ahead(hop_plan: Plan) -> None:
    (conflict,) = looked(hop_plan, drift(1.5, 1.2), error_m=2.0)  # pads are 5 m apart
    assert conflict.pair == (2, 3)
    assert 1.0 < conflict.in_s < 2.6
    assert looked(hop_plan, drift(1.5, 0.8)) == []  # still over its pad: it comes back
    assert looked(hop_plan, drift(0.5, 1.2)) == []  # too slow to be near within three seconds


@pytest.mark.parametrize(("age_s", "in_s"), [(0.0, 1.75), (1.0, 0.75)])
def test_a_vehicle_has_drifted_on_since_its_report(hop_plan: Plan, age_s: float, in_s: float) -> None:
    """It is 3.8 m from the other and nears it at 1.5 m/s: 1 m apart after 1.87 s. Checks are 0.25 s apart."""
    (conflict,) = looked(hop_plan, drift(1.5, 1.2), age_s=age_s)
    assert (conflict.pair, conflict.in_s) == ((2, 3), in_s)
