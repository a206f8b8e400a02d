"""The verdict on separation, in closed form: flights as planned, and flights in which two vehicles come together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly
from scipy.spatial.distance import pdist

from gcs.flight.assessment.criterion import Criterion, CriterionName
from gcs.flight.assessment.judge import Truth, Verdict, judge
from gcs.flight.monitoring.progress import FlightTimes
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Terrain
from gcs.types import Array

T0_UNIX_S = 1.7e9
STEP_S = 0.1
Change = Callable[[Array, Array], None]  # plan times (N,), true states (V, N, 12)


def judged(plan: Plan, change: Change = lambda t_s, states: None) -> Verdict:
    """The verdict on a flight as planned, changed by `change`."""
    t_s = np.arange(plan.t_start_s, plan.t_end_s, STEP_S)
    states = np.array(plan.states(t_s))
    change(t_s, states)
    landing_s = plan.phase("landing").start_s
    times = FlightTimes(T0_UNIX_S + plan.airborne_s, T0_UNIX_S, T0_UNIX_S + landing_s)
    return judge(plan, Truth(plan.sysids, T0_UNIX_S + t_s, states), times)


def named(verdict: Verdict, name: str) -> Criterion:
    (found,) = (c for c in verdict.criteria if c.name == name)
    return found


def planned_m(plan: Plan, from_s: float, to_s: float) -> float:
    """The least planned separation between two instants."""
    places = plan.states(np.arange(from_s, to_s, STEP_S))[..., POSITION]
    return min(float(pdist(places[:, n]).min()) for n in range(places.shape[1]))


def beside(t_s: float, metres: float, seconds: float = 0.2) -> Change:
    """Vehicle 5 so far east of vehicle 2, for a moment."""

    def change(times_s: Array, states: Array) -> None:
        now = np.abs(times_s - t_s) <= seconds
        states[4, now, :3] = states[1, now, :3] + [0.0, metres, 0.0]

    return change


def test_a_flight_as_planned_keeps_both_separations(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    verdict = judged(plan)
    landing_s = plan.phase("landing").start_s
    ground_m = min(planned_m(plan, plan.t_start_s, 0.0), planned_m(plan, landing_s + STEP_S, plan.t_end_s))
    assert named(verdict, "separation").value == pytest.approx(planned_m(plan, 0.0, landing_s), abs=5e-3)
    assert named(verdict, CriterionName.GROUND_SEPARATION).value == pytest.approx(ground_m, abs=5e-3)
    assert verdict.ok


@pytest.mark.parametrize("where", ["the pads", "take-off", "the hover before T0", "landing", "the last stop"])
def test_two_vehicles_that_touch_near_the_ground_fail_the_flight(simulation1_plan: Plan, where: str) -> None:
    plan = simulation1_plan
    landing = plan.phase("landing")
    t_s = {
        "the pads": plan.t_start_s + 0.5,
        "take-off": plan.t_start_s + 4.0,
        "the hover before T0": plan.airborne_s + 1.0,
        "landing": landing.start_s + 3.0,
        "the last stop": plan.t_end_s - 0.5,
    }[where]
    verdict = judged(plan, beside(t_s, 0.1))
    ground = named(verdict, CriterionName.GROUND_SEPARATION)
    assert ground.value == pytest.approx(0.1, abs=1e-6)
    assert ground.limit == plan.scenario.judge.separation_min_m
    assert not ground.ok
    assert not verdict.ok
    assert ground.vehicles == "vehicles 2, 5"
    assert ground.t_s == pytest.approx(t_s, abs=0.3)
    assert named(verdict, "separation").ok


def test_two_vehicles_that_touch_on_the_plan_fail_that_criterion_alone(simulation1_plan: Plan) -> None:
    verdict = judged(simulation1_plan, beside(50.0, 0.1))
    assert named(verdict, "separation").value == pytest.approx(0.1, abs=1e-6)
    assert not named(verdict, "separation").ok
    assert named(verdict, CriterionName.GROUND_SEPARATION).ok


def test_vehicles_may_stand_as_near_as_their_pads(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    assert pdist(plan.pads_ned_m).min() >= plan.scenario.judge.separation_min_m
    assert pdist(plan.landing_points_ned_m).min() >= plan.scenario.judge.separation_min_m


def test_clearance_is_the_distance_to_the_ground_in_any_direction(simulation1_plan: Plan) -> None:
    """A vehicle is put beside a summit, where the slope is nearer than the ground below: looked for on a fine grid."""
    plan = simulation1_plan
    mountains = plan.scenario.terrain.mountains
    top = int(np.argmax(np.array(mountains.height_m) / np.array(mountains.spread_north_m)))
    place = np.array([mountains.north_m[top] + 0.7 * mountains.spread_north_m[top], mountains.east_m[top]])
    below_m = float(ground_height_m(plan.scenario.terrain, *place[:, None])[0])
    up_m = below_m + 0.6

    def change(times_s: Array, states: Array) -> None:
        states[2, np.abs(times_s - 100.0) <= 0.3, :6] = [*place, -up_m, 0.0, 0.0, 0.0]

    north, east = np.meshgrid(*(centre + np.arange(-1.0, 1.0, 2e-3) for centre in place), indexing="ij")
    ground = ground_height_m(plan.scenario.terrain, north, east)
    nearest_m = float(np.sqrt((north - place[0]) ** 2 + (east - place[1]) ** 2 + (ground - up_m) ** 2).min())
    assert nearest_m < 0.5
    clearance = named(judged(plan, change), "clearance above ground")
    assert clearance.value == pytest.approx(nearest_m, abs=5e-3)
    assert (clearance.sysid, clearance.t_s) == (plan.sysids[2], pytest.approx(100.0, abs=0.31))


@pytest.mark.parametrize("aside_m", [-0.04, 0.0, 0.04])
@pytest.mark.parametrize(("late_s", "ok"), [(0.0, True), (6.0, False)])
def test_a_figure_at_the_edge_of_the_arrival_circle_makes_no_vehicle_late(
    simulation1_plan: Plan, aside_m: float, late_s: float, *, ok: bool
) -> None:
    """Forty vehicles in a show: one waits for a minute as far from its goal as the circle is wide, 2 cm inside."""
    scenario = simulation1_plan.scenario.model_copy(update={"terrain": Terrain()})
    plan = replace(simulation1_plan, scenario=scenario)
    end_s, radius_m = plan.flight_s, plan.scenario.judge.arrival_position_m
    joints = np.array([plan.t_start_s, end_s - 90.0, end_s - 80.0, end_s - 20.0, end_s - 10.0, plan.t_end_s + 10.0])
    state = np.zeros((2, 5, 12))
    state[1, :, 0] = (-100.0, -100.0, 0.02 - radius_m, 0.02 - radius_m, 0.0)  # north of the goal, m
    state[0, :, 0] = np.append(np.diff(state[1, :, 0]), 0.0) / np.diff(joints)
    state[1, :, 1], state[1, :, 2] = state[1, :, 0] / 1e3, -60.0  # not quite along one axis: the course has a direction
    waiting = replace(plan, leader_trajectory=Trajectory(PPoly(state, joints), PPoly(np.zeros((1, 5, 4)), joints)))

    def change(times_s: Array, states: Array) -> None:
        states[:] = waiting.states(times_s - late_s * (times_s > 0.0))
        waits = (times_s > end_s - 79.0) & (times_s < end_s - 21.0)
        states[:, waits, 0] += aside_m

    arrival = named(judged(waiting, change), CriterionName.ARRIVAL_TIME)
    assert arrival.ok is ok
    assert arrival.value < 0.2 or not ok
