"""Bounds and margins of Eqs. 17-25 and 51 on states made by hand, with the numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.plan.ocp import margins
from gcs.plan.ocp.bounds import leader_state_bounds
from gcs.plan.ocp.problem import control_bounds, flight_problem, run_up_problem
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import offsets_ned_m, quadrotor
from gcs.types import Array
from tests.unit.plan.problems import changed, meadow


def states(**values: float) -> Array:
    """One vehicle at one instant, all zero but what is named."""
    names = ("x", "y", "z", "vx", "vy", "vz", "roll", "pitch", "yaw", "p", "q", "r")
    state = np.zeros((1, 1, 12))
    for name, value in values.items():
        state[0, 0, names.index(name)] = value
    return state


def only(found: list[margins.Margin], name: str) -> float:
    (margin,) = [m for m in found if m.name == name]
    return float(margin.value[0, 0])


def test_followers_boxes_are_folded_into_the_leaders(simulation1: Scenario) -> None:
    lifted = [v.model_dump() for v in simulation1.formation.vehicle]
    lifted[2]["position_m"] = (0.0, 2.0, 4.5)
    scenario = changed(simulation1, formation={"vehicle": lifted})
    (low,), (high,) = leader_state_bounds(flight_problem(scenario), np.zeros(1))
    # Vehicle 2 is 2 m south and 1 m west of the leader, vehicle 3 is 1 m east of it and 1.5 m above.
    np.testing.assert_allclose(low[:3], [2.0, 1.0, -33.5])
    np.testing.assert_allclose(high[:3], [1500.0, 1499.0, 0.0])
    for corner in (low[:3], high[:3]):
        places = corner + offsets_ned_m(scenario)
        box = np.array([[0, 1500], [0, 1500], [-35, 0]])
        assert (places >= box[:, 0] - 1e-9).all()
        assert (places <= box[:, 1] + 1e-9).all()
    np.testing.assert_allclose(high[3:6], [5, 5, 2])
    np.testing.assert_allclose(high[6:9], np.radians([180, 60, 60]))
    np.testing.assert_allclose(high[9:], np.radians([32, 10, 5]))
    np.testing.assert_array_equal(low[3:], -high[3:])


def test_the_control_margin_draws_bounds_towards_hover(simulation1: Scenario) -> None:
    low, high = control_bounds(simulation1)
    np.testing.assert_allclose(low, [0, -0.0501, -0.0501, -0.0209])
    np.testing.assert_allclose(high, [5.2, 0.0501, 0.0501, 0.0209])
    low, high = control_bounds(simulation1, 0.3)
    np.testing.assert_allclose(low, [4.9 - 0.7 * 4.9, -0.03507, -0.03507, -0.01463])
    np.testing.assert_allclose(high, [4.9 + 0.7 * 0.3, 0.03507, 0.03507, 0.01463])
    problem = flight_problem(simulation1)
    np.testing.assert_allclose(problem.control_high, high)  # the scenario asks 0.3


def test_the_run_up_may_leave_the_box_and_nothing_else(simulation1: Scenario) -> None:
    flight = flight_problem(simulation1)
    run_up = run_up_problem(simulation1, np.array([-15.0, -17.0, -3.0]))
    assert np.isinf(run_up.state_low[:2]).all()
    np.testing.assert_array_equal(run_up.state_low[2:], flight.state_low[2:])
    np.testing.assert_array_equal(run_up.end_state, flight.start_state)
    assert (run_up.start_s, run_up.end_s, run_up.duration_s) == (-20.0, 0.0, 20.0)


def test_clearance_is_measured_to_the_higher_ground(simulation1: Scenario) -> None:
    hill = {"north_m": [0.0], "east_m": [0.0], "height_m": [20.0], "spread_north_m": [10.0], "spread_east_m": [5.0]}
    scenario = changed(simulation1, terrain={"ripple": None, "mountains": hill})
    assert margins.clearance(scenario, states(z=-21)).value[0, 0] == pytest.approx(1.0 - 0.5)
    # Beside the summit the slope is nearer than the ground below; by symmetry its nearest point is on the same axis.
    for state, spread_m in ((states(x=10, z=-9), 10.0), (states(y=10, z=-9), 5.0)):
        axis = np.linspace(0.0, 20.0, 2_000_001)
        away = np.hypot(axis - 10.0, 20.0 * np.exp(-((axis / spread_m) ** 2)) - 9.0).min()
        assert away < 9.0 - 20.0 * np.exp(-((10.0 / spread_m) ** 2))
        assert margins.clearance(scenario, state, 50.0).value[0, 0] == pytest.approx(away - 0.5, abs=1e-6)
        assert margins.clearance(scenario, state, 1.0).value[0, 0] == pytest.approx(min(1.0, away - 0.5), abs=1e-6)
    # On Simulation 1 at the origin: Eq. 52 on a grid of 4 mm; mountains are hundreds of metres away.
    north, east = np.meshgrid(*[np.linspace(-2.0, 2.0, 1001)] * 2)
    r = np.hypot(north, east)
    waves = np.sin(east + 10.0) + 0.2 * np.sin(north) + 0.1 * np.cos(0.6 * r) + np.cos(east) + 0.1 * np.sin(0.1 * r)
    away = np.sqrt(r**2 + (3.0 - np.abs(waves)) ** 2).min()
    assert margins.clearance(simulation1, states(z=-3), 50.0).value[0, 0] == pytest.approx(away - 0.5, abs=1e-5)


def test_box_and_state_limits(simulation1: Scenario) -> None:
    box = margins.box(simulation1, states(x=-1, y=1490))
    assert only(box, "north position") == pytest.approx(-1)
    assert only(box, "east position") == pytest.approx(10)
    state = states(z=-36, vx=-5.5, vy=1, vz=-2.25, roll=3, pitch=-1.2, yaw=1, p=-0.6, q=0.1, r=0.1)
    found = margins.state_limits(simulation1, state)
    assert margins.height(simulation1, state).value[0, 0] == pytest.approx(-1)
    assert only(found, "north speed") == pytest.approx(-0.5)
    assert only(found, "east speed") == pytest.approx(4)
    assert only(found, "vertical speed") == pytest.approx(-0.25)
    for name, limit, value in (
        ("roll", 180, 3),
        ("pitch", 60, 1.2),
        ("yaw", 60, 1),
        ("roll rate", 32, 0.6),
        ("pitch rate", 10, 0.1),
        ("yaw rate", 5, 0.1),
    ):
        assert only(found, name) == pytest.approx(limit - np.degrees(value))
    assert margins.height(simulation1, states(z=1)).value[0, 0] == pytest.approx(-1)
    assert margins.height(simulation1, states(z=1), to_the_ground=True).value[0, 0] > 0


def test_control_limits_and_rotors(simulation1: Scenario) -> None:
    found = margins.control_limits(simulation1, np.array([[[5.3, -0.06, 0.05, 0.01]]]))
    assert only(found, "thrust U1") == pytest.approx(-0.1)
    assert only(found, "control U2") == pytest.approx(-0.0099)
    assert only(found, "control U3") == pytest.approx(0.0001)
    assert only(found, "control U4") == pytest.approx(0.0109)
    assert only(found, "rotor speed") == pytest.approx(0, abs=1e-12)
    # Slow rotors lift 4 K_T 340^2 = 5.109 N and no more: 0.0195 N are missing of a limit of 5.2 N.
    slow = changed(simulation1, vehicle={"rotor_max_radps": 340.0})
    missing = 5.129 - 4 * 1.105e-5 * 340**2
    control = np.array([[[5.129, 0.0, 0.0, 0.0]]])
    assert only(margins.control_limits(slow, control), "rotor speed") == pytest.approx(-missing / 5.2)
    # A yaw moment that cannot be had is seen, small as it is beside the weight.
    yawing = np.array([[[4.9, 0.0, 0.0, 0.0209]]])
    assert only(margins.control_limits(slow, yawing), "rotor speed") < -0.1


def test_turning_is_the_normal_acceleration(simulation1: Scenario) -> None:
    """Rolled by a, flying north, heading north: g tan(a) sideways at hover height, minus the drag along the way."""
    bank = np.radians(10.0)
    thrust = np.array([[[4.9 / np.cos(bank), 0, 0, 0]]])
    found = margins.turning(simulation1, states(vx=4.0, roll=bank), thrust)
    assert found.value[0, 0] == pytest.approx(0.3 - np.tan(bank))
    # Tilted along the way it speeds up and does not turn.
    assert margins.turning(simulation1, states(vx=4.0, pitch=bank), thrust).value[0, 0] == pytest.approx(0.3)
    # At rest there is no turning, and no division by nothing.
    assert margins.turning(simulation1, states(roll=bank), thrust).value[0, 0] == pytest.approx(0.3)
    # Eq. 18's radius: v^2 / R = a_n.
    radius, speed = 40.0, 4.0
    bank = np.arctan(speed**2 / radius / 9.8)
    thrust = np.array([[[4.9 / np.cos(bank), 0, 0, 0]]])
    found = margins.turning(simulation1, states(vx=speed, roll=bank), thrust)
    assert found.value[0, 0] == pytest.approx(0.3 - speed**2 / (radius * 9.8))


@pytest.mark.parametrize("speed_mps", [0.0, 0.02, 0.099, 0.101, 0.15, 3.0])
def test_below_a_tenth_of_a_metre_a_second_turning_fades_with_the_speed(
    simulation1: Scenario, speed_mps: float
) -> None:
    """The bank pushes to the side with tan(0.05) g; of that, the share counts that the speed has of 0.1 m/s."""
    weight_N = quadrotor(simulation1).weight_N
    thrust = np.array([[[weight_N / np.cos(0.05), 0.0, 0.0, 0.0]]])
    found = margins.turning(simulation1, states(vx=speed_mps, roll=0.05), thrust)
    most = simulation1.limits.load_factor_max
    assert found.value[0, 0] == pytest.approx(most - np.tan(0.05) * min(speed_mps / 0.1, 1.0), abs=1e-9)


def test_no_fly_disks_are_circles_of_their_radius(simulation1: Scenario) -> None:
    scenario = changed(simulation1, no_fly=[{"north_m": 30.0, "east_m": 40.0, "radius_m": 45.0}])
    (disk,) = margins.no_fly(scenario, states(), np.zeros(1))
    assert disk.value[0, 0] == pytest.approx(50 - 45)
    (disk,) = margins.no_fly(scenario, states(x=30, y=41), np.zeros(1))
    assert disk.value[0, 0] == pytest.approx(1 - 45)


def test_the_optimiser_grants_no_turn_the_verifier_would_refuse(simulation1: Scenario) -> None:
    """At any speed: where the optimiser's load factor is just held, the verifier's is, to a tenth of a per cent."""
    from gcs.plan.ocp import stage_functions

    problem = flight_problem(meadow(simulation1))
    path = stage_functions.functions(problem).path
    slots, row = np.zeros(path.size1_in(1)), path.size1_out(0) - 1  # the leader's turning comes last
    for speed in (0.0, 0.01, 0.05, 0.1, 0.15, 0.3, 1.0, 4.0):
        for bank in np.radians(np.linspace(0, 30, 61)):
            state = states(z=-3, vx=speed, roll=float(bank))
            control = np.array([[[4.9 / np.cos(bank), 0, 0, 0]]])
            z = np.concatenate([state[0, 0], control[0, 0]])
            if float(path(z, slots)[row]) >= 0:
                judged = margins.turning(problem.scenario, state, control)
                assert judged.value[0, 0] >= -1e-3 * judged.scale


def test_a_formation_faces_its_course_above_1_mps(simulation1: Scenario) -> None:
    """Course and heading over all four quarters; down counts for nothing, and 350 degrees are 10 away from north."""
    scenario = changed(simulation1, formation={"frame": "course", "course_tolerance_deg": 8.0})
    courses_deg, off_deg = np.array([0.0, 100.0, -170.0, 30.0]), np.array([3.0, -5.0, 10.0, 20.0])
    speeds = np.array([2.0, 1.01, 3.0, 0.99])
    angle = np.radians(courses_deg)
    velocities = np.stack([speeds * np.cos(angle), speeds * np.sin(angle), np.full(4, 7.0)], axis=1)
    found = margins.course(scenario, velocities, np.radians(courses_deg + off_deg + [0.0, 360.0, -360.0, 0.0]))
    np.testing.assert_allclose(found.value, [[5.0, 3.0, -2.0, 8.0]], atol=1e-9)
    assert (found.name, found.unit, found.scale) == ("heading along the course", "deg", 8.0)
