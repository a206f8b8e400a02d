"""Sentences of the paper judged a second time: from its printed numbers and closed forms, without the tools' tracks."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.sources.load import load_scenario
from tools.paper.sentences import judge
from tools.paper.track import Track
from tools.paper.unstated import HEADING_SCALE, VALUES, value_of, with_value

# §4, typed from the paper: mountains of Eq. 53, take-off places of the six vehicles.
HEIGHTS = (55.0, 20.0, 40.0, 30.0, 48.0, 25.0, 31.0)
NORTH = (500.0, 300.0, 300.0, 1300.0, 760.0, 700.0, 1300.0)
EAST = (1100.0, 410.0, 800.0, 450.0, 750.0, 200.0, 1300.0)
SPREAD_NORTH = (50.0, 40.0, 30.0, 86.0, 87.0, 60.0, 30.0)
SPREAD_EAST = (50.0, 30.0, 20.0, 79.0, 83.0, 90.0, 30.0)
PLACES = ((2, 1, 3), (0, 0, 3), (0, 2, 3), (1, 0.5, 3), (0, 0.5, 3), (1, 1.5, 3))
PlanOf = Callable[[str], Plan]
ARM_M, K_F = 0.075, 0.0146
WEIGHTS = ("constant", "squared", "scenario", "inverse_square")
STUDIES = ("simulation1", "simulation2", *(f"terminal_weighting/{name}.toml" for name in WEIGHTS))


def mountains_m(north: float, east: float) -> float:
    """Eq. 53."""
    rows = zip(HEIGHTS, NORTH, EAST, SPREAD_NORTH, SPREAD_EAST, strict=True)
    return sum(h * math.exp(-(((north - x) / a) ** 2) - ((east - y) / b) ** 2) for h, x, y, a, b in rows)


@pytest.fixture(scope="module")
def judged(simulation1_plan: Plan) -> dict[str, list[Any]]:
    """A1 to A26: whether each holds, and its numbers."""
    return judge("A", Track(simulation1_plan))


@pytest.mark.parametrize(
    ("study", "ceiling_m", "time_s", "start_deg", "end_deg"),
    [
        ("simulation1", 35.0, 275.0, (0.0, -1.0, 45.0), (0.0, 0.0, 45.0)),
        ("simulation2", 15.0, 350.0, (0.0, -18.0, 60.0), (0.0, 0.0, -60.0)),
    ],
)
def test_the_scenarios_are_what_is_printed(
    repo_root: Path, study: str, ceiling_m: float, time_s: float, start_deg: Any, end_deg: Any
) -> None:
    s = load_scenario(repo_root / "missions" / study)
    ground, limits, vehicle = s.terrain.mountains, s.limits, s.vehicle
    assert (ground.height_m, ground.north_m, ground.east_m) == (HEIGHTS, NORTH, EAST)
    assert (ground.spread_north_m, ground.spread_east_m) == (SPREAD_NORTH, SPREAD_EAST)
    assert tuple(v.position_m for v in s.formation.vehicle) == PLACES
    assert (s.time.flight_s, limits.height_m) == (time_s, (0.0, ceiling_m))
    assert (s.start.roll_pitch_yaw_deg, s.end.roll_pitch_yaw_deg) == (start_deg, end_deg)
    assert (s.start.velocity_mps, s.end.position_m) == ((2.0, 2.0, 0.0), (1200.0, 1000.0, 2.0))
    assert (limits.speed_ned_mps, limits.rates_degps) == ((5.0, 5.0, 2.0), (32.0, 10.0, 5.0))
    assert (limits.thrust_N, limits.roll_pitch_force_N, limits.yaw_moment_Nm) == ((0.0, 5.2), (0.0501, 0.0501), 0.0209)
    assert (vehicle.drag_Nspm, vehicle.drag_moment_Nms) == ((0.073,) * 3, (0.0055,) * 3)
    assert (vehicle.arm_m, vehicle.thrust_coeff_Ns2, vehicle.moment_coeff_Nms2) == (ARM_M, 1.105e-5, 1.779e-7)


def test_what_the_paper_leaves_out_is_chosen_once(repo_root: Path) -> None:
    scenarios = [load_scenario(repo_root / "missions" / study) for study in STUDIES]
    assert len({tuple(value_of(scenario, key) for key in VALUES) for scenario in scenarios}) == 1
    assert 15.0 < scenarios[0].objective.height_ref_m < 35.0  # between the ceilings of both simulations


def test_the_sentences_on_simulation_1_are_judged_as_in_docs(judged: dict[str, list[Any]], repo_root: Path) -> None:
    record = json.loads((repo_root / "docs" / "paper.json").read_text(encoding="utf-8"))["simulations"]["found"]
    assert {name: found[0] for name, found in judged.items()} == {n: record[n][0] for n in record if n[0] == "A"}


def test_a6_the_nearest_mountain_can_be_flown_over_in_simulation_1_and_not_in_2(judged: dict[str, list[Any]]) -> None:
    nearest = min(range(7), key=lambda i: math.hypot(NORTH[i] - 2.0, EAST[i] - 1.0))
    summit_m = mountains_m(NORTH[nearest], EAST[nearest])
    assert summit_m == pytest.approx(20.0, abs=0.01)
    assert 15.0 < summit_m < 35.0
    assert judged["A6"][:2] == [True, pytest.approx(summit_m, abs=0.01)]


def test_a9_no_flight_of_275_s_takes_less_than_the_straight_one_and_this_takes_hardly_more(
    simulation1_plan: Plan, judged: dict[str, list[Any]]
) -> None:
    """Jensen: the integral of k_f v³ over T is at least k_f D³ / T² for ends D apart."""
    apart_m = math.dist((2.0, 1.0, 3.0), (1200.0, 1000.0, 2.0))
    least_J = K_F * apart_m**3 / 275.0**2
    t_s = np.linspace(0.0, np.nextafter(275.0, 0.0), 20001)
    v = simulation1_plan.states(t_s)[0][:, 3:6]
    spent_J = float(np.trapezoid(K_F * np.linalg.norm(v, axis=1) ** 3, t_s))
    assert least_J < spent_J < 1.05 * least_J
    assert not judged["A9"][0]
    # A detour of a twentieth, which the sentence takes for granted, costs 16 % more.
    assert K_F * (1.05 * apart_m) ** 3 / 275.0**2 > 1.15 * least_J


def test_a22_and_a26_from_the_plan_itself(simulation1_plan: Plan, judged: dict[str, list[Any]]) -> None:
    t_s = np.linspace(15.0, 260.0, 9801)
    u2, u3, u4 = simulation1_plan.controls(t_s)[0][:, 1:].T
    moments = [math.sqrt(float(np.mean(m**2))) for m in (ARM_M * u2, ARM_M * u3, u4)]
    holds, m4, m2, m3 = judged["A22"][:4]
    assert holds is bool(moments[2] > max(moments[:2]))
    assert [m2, m3, m4] == pytest.approx([1e6 * m for m in moments], rel=0.02)
    down_mps = simulation1_plan.states(np.linspace(215.0, np.nextafter(275.0, 0.0), 2401))[0][:, 5]
    fastest = int(np.argmax(down_mps))
    assert judged["A26"][0]
    assert 0.5 < down_mps[fastest] <= 2.0 and abs(down_mps[-1]) < 1e-6
    assert np.all(np.diff(down_mps[fastest:]) < 1e-9)  # once it is fastest it only slows down


@pytest.mark.slow
def test_b2_b3_b13_follow_from_the_two_ceilings(simulation1_plan: Plan, plan_of: PlanOf) -> None:
    two_plan = plan_of("simulation2/scenario.toml")
    judged = judge("B", Track(simulation1_plan), Track(two_plan))
    one, two = (plan.states(np.linspace(15.0, plan.flight_s - 15.0, 8001))[0] for plan in (simulation1_plan, two_plan))
    assert judged["B2"][0] is bool(np.ptp(two[:, 2]) < np.ptp(one[:, 2]))
    assert judged["B3"][0] is bool(-two[:, 2].mean() < -one[:, 2].mean())
    assert judged["B13"][0] is bool(two[:, 5].std() < one[:, 5].std())
    assert -one[:, 2].max() < 15.0 < -one[:, 2].min()  # what Simulation 2 may not do


@pytest.mark.slow
def test_simulation_2_cannot_hold_its_height_at_t_0(plan_of: PlanOf) -> None:
    """Level flight at 18 degrees takes 5.15 N: Eq. 51 allows it by 1 %, a plan that leaves a margin does not."""
    plan = plan_of("simulation2/scenario.toml")
    needed, limits = plan.quadrotor.weight_N / np.cos(np.radians(18.0)), plan.scenario.limits
    allowed = plan.quadrotor.weight_N + (1.0 - limits.control_margin) * (limits.thrust_N[1] - plan.quadrotor.weight_N)
    assert allowed < needed < limits.thrust_N[1]
    assert plan.accelerations(np.array([0.0]))[plan.leader, 0, 2] > 0.0
    assert 2.0 < (-plan.states(np.arange(0.0, 10.0, 0.05))[plan.leader, :, 2]).min() < 3.0


def test_the_four_flights_differ_in_nothing_but_q(repo_root: Path) -> None:
    four = [load_scenario(repo_root / "missions" / "terminal_weighting" / f"{name}.toml") for name in WEIGHTS]
    weights = [scenario.objective.terminal_weight for scenario in four]
    assert weights == ["1", "t^2", "1/(tf-t+0.5)", "1/(tf-t+0.5)^2"]
    assert len({scenario.model_dump_json(exclude={"name", "title", "objective"}) for scenario in four}) == 1
    assert len({scenario.objective.model_dump_json(exclude={"terminal_weight"}) for scenario in four}) == 1


@pytest.mark.slow
def test_a_constant_weight_does_not_bend_the_path_and_is_lowest_before_the_end(plan_of: PlanOf) -> None:
    """The cost rate is convex in velocity, and Q = 1 weighs all instants alike: constant velocity is best (Jensen)."""
    one, squared, chosen, _ = (Track(plan_of(f"terminal_weighting/{name}.toml")) for name in WEIGHTS)
    assert np.ptp(one.course_deg[one.cruise]) < 2.0
    assert one.course_deg[one.cruise].mean() == pytest.approx(45.0, abs=0.5)
    assert one.at_to_go(one.height_m, 60.0) > 0.95 * 20.0
    for seconds in (30, 20, 15, 10):
        height_m, *others = (t.at_to_go(t.height_m, seconds) for t in (one, squared, chosen))
        assert height_m < min(others) - 1.5


@pytest.mark.slow
def test_weights_that_grow_to_the_end_bring_it_in_from_90_degrees_where_heading_costs_more(repo_root: Path) -> None:
    """A heading scale of 5 degrees instead of 60. t^2 differs by a twentieth over the last 8 s and never gets there."""
    found = {}
    for name in WEIGHTS[1:]:
        scenario = load_scenario(repo_root / "missions" / "terminal_weighting" / f"{name}.toml")
        track = Track(make_plan(with_value(scenario, HEADING_SCALE, 5.0)))
        last = track.last(10.0, 4.0)
        found[name] = np.abs(track.course_deg[last] - 90.0).max(), np.abs(track.yaw_deg[last] - 90.0).max()
    assert np.all(np.array([found["scenario"], found["inverse_square"]]) < (7.0, 3.0))
    assert 12.0 < found["squared"][0] < 17.0 and found["squared"][1] < 6.0
