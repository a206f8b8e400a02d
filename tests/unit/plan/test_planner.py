"""The whole flight: its phases meet, its states do not jump, it starts and ends on the ground as it is."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.physics.quadrotor import derivative
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.phases import phases_of
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory, joined
from gcs.plan.verification.verify import verify
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.problems import alone, changed, meadow

lengths = st.floats(1, 60)
tenths = st.integers(0, 300).map(lambda n: n / 10)


@settings(max_examples=200, deadline=None)
@given(takeoff=lengths, hover=tenths, run_up=lengths, flight=st.floats(1, 2000), landing=lengths)
def test_phases_meet_to_the_last_bit_whatever_their_lengths(
    simulation1: Scenario, takeoff: float, hover: float, run_up: float, flight: float, landing: float
) -> None:
    ground = {"takeoff_s": takeoff, "hover_s": hover, "run_up_s": run_up, "landing_s": landing}
    scenario = changed(simulation1, ground_phases=ground, time={"flight_s": flight})
    phases = phases_of(scenario)
    for before, after in itertools.pairwise(phases):
        assert before.end_s == after.start_s
    names = [phase.name for phase in phases]
    between = ["hover"] if hover else []
    arrival = ["arrival-hover"] if hover else []
    assert names == ["takeoff", *between, "run-up", "mission", *arrival, "landing"]
    mission = phases[names.index("mission")]
    assert (mission.start_s, mission.end_s) == (0.0, flight)
    run_up_phase = phases[names.index("run-up")]
    assert (run_up_phase.start_s, run_up_phase.end_s) == (-run_up, 0.0)
    assert phases[0].end_s - phases[0].start_s == pytest.approx(takeoff)


@pytest.mark.parametrize("name", ["simulation1_plan", "meadow_plan"])
def test_states_are_continuous_and_phases_are_the_plan(name: str, request: pytest.FixtureRequest) -> None:
    plan: Plan = request.getfixturevalue(name)
    assert plan.t_start_s == plan.phases[0].start_s == plan.joints_s[0]
    assert plan.t_end_s == plan.phases[-1].end_s == plan.joints_s[-1]
    assert {phase.start_s for phase in plan.phases} <= set(plan.joints_s)
    joints = plan.joints_s[1:-1]
    np.testing.assert_allclose(plan.states(joints), plan.states(np.nextafter(joints, -np.inf)), atol=1e-7)
    times = np.linspace(plan.t_start_s, plan.t_end_s, 2001)[1:-1]
    times = times[np.abs(times[:, None] - joints).min(axis=1) > 0.01]
    step = 1e-4
    rate = (plan.states(times + step)[..., :3] - plan.states(times - step)[..., :3]) / (2 * step)
    np.testing.assert_allclose(rate, plan.states(times)[..., 3:6], atol=2e-3)
    np.testing.assert_allclose(
        plan.accelerations(times), derivative(plan.states(times), plan.controls(times), plan.quadrotor)[..., 3:6]
    )


def test_it_starts_and_ends_at_rest_on_the_ground_as_it_is(simulation1_plan: Plan) -> None:
    """Each of the six on its own ripple, straight below its place in the air."""
    plan = simulation1_plan
    back = 25.0 / np.sqrt(2.0)  # 25 m behind the start, along [2, 2, 0]
    places = np.array([v.position_m[:2] for v in plan.scenario.formation.vehicle])
    for t, around in ((plan.t_start_s, places - back), (plan.t_end_s, places - places[0] + [1200.0, 1000.0])):
        state = plan.states(np.array([t]))[:, 0]
        np.testing.assert_allclose(state[:, :2], around, atol=1e-6)
        ground = ground_height_m(plan.scenario.terrain, around[:, 0], around[:, 1])
        assert np.ptp(ground) > 0.01  # the ground is not level there
        np.testing.assert_allclose(-state[:, 2], ground, atol=1e-6)
        np.testing.assert_allclose(state[:, 3:8], 0.0, atol=1e-9)
        np.testing.assert_allclose(state[:, 8], np.radians(45), atol=1e-9)
    np.testing.assert_array_equal(plan.pads_ned_m, plan.states(np.array([plan.t_start_s]))[:, 0, :3])


def test_at_t0_everyone_is_where_the_paper_has_it(simulation1_plan: Plan) -> None:
    state = simulation1_plan.states(np.array([0.0]))[:, 0]
    np.testing.assert_allclose(
        state[:, :3], [[2, 1, -3], [0, 0, -3], [0, 2, -3], [1, 0.5, -3], [0, 0.5, -3], [1, 1.5, -3]], atol=1e-9
    )
    np.testing.assert_allclose(state[:, 3:6], np.tile([2.0, 2.0, 0.0], (6, 1)), atol=1e-9)
    np.testing.assert_allclose(np.degrees(state[:, 6:9]), np.tile([0.0, -1.0, 45.0], (6, 1)), atol=1e-9)
    # The followers' controls differ from the leader's only where they climb to their places.
    controls = simulation1_plan.controls(np.array([-30.0, 100.0]))
    assert np.ptp(controls[:, 0, 0]) > 1e-6
    assert np.ptp(controls[:, 1]) > 0.0
    np.testing.assert_array_equal(controls[:, 1], np.tile(controls[0, 1], (6, 1)))


@pytest.mark.parametrize(
    "tables",
    [
        {},
        {"ground_phases": {"hover_s": 0.0}},
        {"start": {"velocity_mps": [1.5, 0.5, 0.0]}, "ground_phases": {"run_up_m": 8.0, "run_up_s": 10.1}},
        {
            "limits": {"load_factor_max": 0.004},
            "start": {"velocity_mps": [0.5, 0.0, 0.0]},
            "end": {"position_m": [4.0, 14.0, 5.0]},
            "objective": {"weights": [0.8, 0.0, 0.1]},
            "ground_phases": {"run_up_m": 5.0},
        },
    ],
    ids=["from a hover", "without hovers", "with a run-up", "turning slowly"],
)
def test_one_vehicle_plans_and_verifies(simulation1: Scenario, tables: dict[str, Any]) -> None:
    scenario = meadow(alone(simulation1), **tables)
    plan = make_plan(scenario)
    report = verify(plan)
    assert report.ok, [str(check) for check in report.failures]
    names = {phase.name for phase in plan.phases}
    assert ("run-up" in names) == any(scenario.start.velocity_mps)
    assert ("hover" in names) == (scenario.ground_phases.hover_s > 0)
    assert len(plan.mesh_history) >= 1


def test_a_formation_in_three_dimensions_keeps_its_shape_and_lands_flat(simulation1: Scenario) -> None:
    vehicles = [v.model_dump() for v in simulation1.formation.vehicle[:3]]
    vehicles[2]["position_m"] = (0.0, 2.0, 4.5)
    plan = make_plan(meadow(simulation1, formation={"vehicle": vehicles}, ground_phases={"takeoff_s": 9.0}))
    report = verify(plan)
    assert report.ok, [str(check) for check in report.failures]
    flown = plan.states(np.linspace(0, 20, 41))[..., :3]
    np.testing.assert_allclose(flown[2] - flown[0], np.tile([-2.0, 1.0, -1.5], (41, 1)), atol=1e-9)
    np.testing.assert_allclose(plan.states(np.array([plan.t_end_s]))[:, 0, 2], 0.0, atol=1e-9)


def test_parts_that_do_not_meet_are_refused(meadow_plan: Plan) -> None:
    whole = meadow_plan.leader_trajectory
    with pytest.raises(ValueError, match=r"ends at .* the next starts at"):
        joined([whole, whole])


def test_a_trajectory_needs_states_and_controls_on_the_same_joints(meadow_plan: Plan) -> None:
    whole = meadow_plan.leader_trajectory
    with pytest.raises(ValueError, match="same joints"):
        Trajectory(whole.state, whole.state)
