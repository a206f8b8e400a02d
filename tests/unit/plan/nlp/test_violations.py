"""The check between the nodes finds all violations that a check of all vehicles at all instants finds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import Array
from gcs.plan.formation.changes.transforms import straight as straight_leg
from gcs.plan.formation.followers import formation_motion
from gcs.plan.formation.shape import Shape, joined, rigid, stretched
from gcs.plan.nlp import margins
from gcs.plan.nlp.violations import LENGTH_TOLERANCE_M, LIMIT_TOLERANCE, check_between_nodes
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.formations import SHRINK, auto, fleet
from tests.unit.plan.problems import straight

HILLS = {
    "north_m": [40.0, 75.0],
    "east_m": [-8.0, 10.0],
    "height_m": [6.0, 5.0],
    "spread_north_m": [6.0, 5.0],
    "spread_east_m": [5.0, 5.0],
}
FLIGHT: dict[str, Any] = {
    "time": {"flight_s": 25.0},
    "start": {"position_m": [0.0, 0.0, 5.0]},
    "end": {"position_m": [100.0, 0.0, 5.0]},
    "limits": {"speed_ned_mps": [4.5, 4.0, 1.5]},
}
BLOCK = ({"name": "row", "generator": "grid", "spacing_m": 4.0},)


def crossing(scenario: Scenario, count: int, **tables: Any) -> Problem:
    """`count` vehicles that cross 100 m of level ground in 25 s: 2 m from glance to glance."""
    limits = FLIGHT["limits"] | tables.pop("limits", {})
    return flight_problem(fleet(scenario, count, "row", (), BLOCK, **FLIGHT | {"limits": limits} | tables))


def found(problem: Problem, shape: Shape | None = None, trajectory: Trajectory | None = None) -> dict[str, str]:
    """Complaints by the constraint they name."""
    shape = problem.shape if shape is None else shape
    _, complaints = check_between_nodes(problem, straight(problem) if trajectory is None else trajectory, shape)
    return {text.split(" violated by")[0]: text for text in complaints}


def everything(problem: Problem, trajectory: Trajectory, shape: Shape, step_s: float = 0.05) -> dict[str, float]:
    """Least value of every constraint of every vehicle, with no vehicle left out."""
    scenario = problem.scenario
    times = np.linspace(problem.start_s, problem.end_s, round(problem.duration_s / step_s) + 1)
    vehicle = trajectory.vehicle
    states, controls = formation_motion(vehicle.state, vehicle.control, shape, problem.quadrotor, times)
    every = [
        margins.clearance(scenario, states),
        margins.height(scenario, states),
        *margins.no_fly(scenario, states, times),
        *margins.box(scenario, states),
        *margins.state_limits(scenario, states),
        margins.turning(scenario, states, controls),
        *margins.acceleration(scenario, states, controls),
        *margins.shape_motion(scenario, shape.offsets(times, 1), shape.offsets(times, 2)),
    ]
    lengths = ("clearance", "no-fly", "position")
    tolerance = {
        m.name: LENGTH_TOLERANCE_M if any(word in m.name for word in lengths) else LIMIT_TOLERANCE * m.scale
        for m in every
    }
    return {m.name: float(m.value.min()) for m in every if m.value.min() < -tolerance[m.name]}


@pytest.mark.parametrize("count", [5, 60])
def test_where_nothing_is_broken_nothing_is_found(simulation1: Scenario, count: int) -> None:
    problem = crossing(simulation1, count)
    instants, complaints = check_between_nodes(problem, straight(problem), problem.shape)
    assert complaints == ()
    assert len(instants) == 0


@pytest.mark.parametrize("count", [3, 16, 17, 60])
def test_hills_are_found_under_any_number(simulation1: Scenario, count: int) -> None:
    problem = crossing(simulation1, count, terrain={"ripple": None, "mountains": HILLS})
    complaints, brute = found(problem), everything(problem, straight(problem), problem.shape)
    assert set(complaints) == set(brute)
    if brute:
        by_m = float(complaints["clearance above ground"].split("by ")[1].split(" m")[0])
        assert by_m == pytest.approx(-brute["clearance above ground"], rel=5e-3)


def track(problem: Problem, vehicle: int, at_s: float = 12.25) -> Array:
    """Where a vehicle is at a time, (3,)."""
    return np.asarray(straight(problem).state(np.array([at_s]))[0, :3] + problem.shape.at(at_s)[vehicle])


@pytest.mark.parametrize("count", [5, 60])
@pytest.mark.parametrize("vehicle", [0, 3, -1])
def test_a_single_vehicle_over_a_needle_is_found(simulation1: Scenario, count: int, vehicle: int) -> None:
    """A spike 5 m wide, a few centimetres too high."""
    at_all = track(crossing(simulation1, count), vehicle)
    spike = {
        "north_m": [float(at_all[0])],
        "east_m": [float(at_all[1])],
        "height_m": [4.1],
        "spread_north_m": [4.0],
        "spread_east_m": [2.0],
    }
    problem = crossing(simulation1, count, terrain={"ripple": None, "mountains": spike})
    complaints, brute = found(problem), everything(problem, straight(problem), problem.shape)
    assert set(complaints) == set(brute) == {"clearance above ground"}
    by_m = float(complaints["clearance above ground"].split("by ")[1].split(" m")[0])
    assert by_m == pytest.approx(-brute["clearance above ground"], rel=5e-3)


@pytest.mark.parametrize("radius_m", [0.2, 1.0, 8.0])
@pytest.mark.parametrize("vehicle", [0, 3, -1])
@pytest.mark.parametrize("count", [5, 60])
def test_a_disk_between_two_glances_is_found(simulation1: Scenario, count: int, vehicle: int, radius_m: float) -> None:
    """A zone as small as a mast, wherever a vehicle passes it between two coarse instants."""
    for at_s in (12.0, 12.1, 12.2, 12.3, 12.4):
        at_all = track(crossing(simulation1, count), vehicle, at_s)
        mast = {"north_m": float(at_all[0]), "east_m": float(at_all[1]) + 0.5 * radius_m, "radius_m": radius_m}
        problem = crossing(simulation1, count, no_fly=[mast])
        assert set(found(problem)) == {"no-fly zone 1"} == set(everything(problem, straight(problem), problem.shape))


@pytest.mark.parametrize("count", [5, 60])
def test_the_box_is_found_of_the_one_who_leaves_it(simulation1: Scenario, count: int) -> None:
    east_m = float(crossing(simulation1, count).shape.at(0.0)[:, 1].max())
    problem = crossing(simulation1, count, limits={"east_m": [-60.0, east_m - 0.01]})
    assert set(found(problem)) == {"east position"}


@pytest.mark.parametrize("count", [5, 60])
@pytest.mark.parametrize("vehicle", [0, -1])
def test_the_ceiling_is_found_of_the_one_who_is_above_it(simulation1: Scenario, count: int, vehicle: int) -> None:
    """High over level ground, far from everything else."""
    problem = crossing(simulation1, count, limits={"height_m": [0.0, 7.0]})
    places = problem.shape.at(0.0)
    places[vehicle, 2] -= 2.05
    complaints = found(problem, rigid(places, problem.start_s, problem.end_s))
    assert set(complaints) == {"height"}


@pytest.mark.parametrize("count", [5, 60])
def test_the_leaders_own_limits_are_found(simulation1: Scenario, count: int) -> None:
    problem = crossing(simulation1, count, limits={"speed_ned_mps": [3.9, 4.0, 1.5]})
    assert set(found(problem)) == {"north speed"}


def one_goes_elsewhere(problem: Problem, vehicle: int, by_ned_m: tuple[float, float, float], seconds: float) -> Shape:
    """All vehicles rigid but one, which leaves its place from 10 s on."""
    start = problem.shape.at(problem.start_s)
    there = start.copy()
    there[vehicle] += by_ned_m
    return joined(
        [
            rigid(start, problem.start_s, 10.0),
            stretched(straight_leg(start, there), 10.0, 10.0 + seconds),
            rigid(there, 10.0 + seconds, problem.end_s),
        ]
    )


# Between the eight directions in which the farthest is looked for, straight up, and along an axis.
WAYS = [(3.0, 3.0 * np.tan(np.pi / 8.0), 0.0), (0.0, -3.0, 0.0), (0.0, 0.0, -3.0), (2.0, 2.0, -2.0)]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("vehicle", [1, 2, -1])
@pytest.mark.parametrize("count", [5, 60])
def test_one_who_moves_too_fast_in_the_shape_is_found(
    simulation1: Scenario, count: int, vehicle: int, way: tuple[float, float, float]
) -> None:
    """While all others move half as far in the other direction, or not at all."""
    problem = crossing(simulation1, count, limits={"accel_max_mps2": 30.0, "load_factor_max": 3.0})
    for others in (0.0, -0.5):
        shape = one_goes_elsewhere(problem, vehicle, way, 5.0)
        tables = shape.basis_ned_m.copy()
        tables[2:] += others * np.array(way)
        tables[2:, vehicle] -= others * np.array(way)
        tables[2:, problem.leader] = 0.0
        tables[-1] = tables[2]
        shape = replace(shape, basis_ned_m=tables)
        brute = everything(problem, straight(problem), shape)
        assert "speed in the shape" in brute
        assert {"speed in the shape", "acceleration in the shape"} & set(found(problem, shape)) == {
            "speed in the shape",
            "acceleration in the shape",
        } & set(brute)


@pytest.mark.parametrize("count", [5, 60])
def test_the_fastest_is_found_beside_others_who_are_faster_along_every_axis(simulation1: Scenario, count: int) -> None:
    """Half way between two directions in which the farthest is looked for, with one almost as fast along each."""
    problem = crossing(simulation1, count, limits={"accel_max_mps2": 30.0, "load_factor_max": 3.0})
    start = problem.shape.at(problem.start_s)
    there = start.copy()
    # From a step in 8 s: 35/16 of the mean speed, so 1 m/s at the most is 3.66 m.
    for vehicle, angle_deg, way_m in ((2, 22.5, 3.7), (3, 0.0, 3.55), (4, 45.0, 3.55)):
        there[vehicle, :2] += way_m * np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    shape = joined(
        [rigid(start, 0.0, 10.0), stretched(straight_leg(start, there), 10.0, 18.0), rigid(there, 18.0, problem.end_s)]
    )
    brute = everything(problem, straight(problem), shape)
    complaints = found(problem, shape)
    assert set(complaints) == set(brute)
    assert "speed in the shape" in brute


@pytest.mark.parametrize("seed", range(4))
def test_of_a_few_everything_is_found_that_a_look_at_everyone_finds(simulation1: Scenario, seed: int) -> None:
    """Random motions of random shapes under random limits: the same constraints, to the same amount."""
    random = np.random.default_rng(seed)
    limits = {
        "speed_ned_mps": random.uniform([3.8, 0.2, 0.2], [4.5, 1.0, 1.0]).tolist(),
        "accel_max_mps2": float(random.uniform(0.3, 1.0)),
        "east_m": [-20.0, float(random.uniform(5.0, 12.0))],
        "height_m": [0.0, float(random.uniform(5.5, 8.0))],
        "roll_pitch_yaw_deg": [5.0, 5.0, 180.0],
        "load_factor_max": 0.05,
    }
    disk = {"north_m": 50.0, "east_m": float(random.uniform(-12.0, 12.0)), "radius_m": 2.0}
    problem = crossing(simulation1, 6, limits=limits, no_fly=[disk], terrain={"ripple": None, "mountains": HILLS})
    start = problem.shape.at(0.0)
    there = start + random.normal(size=start.shape) * [3.0, 3.0, 1.0]
    there[problem.leader] = 0.0
    shape = joined([rigid(start, 0.0, 6.0), stretched(straight_leg(start, there), 6.0, 14.0), rigid(there, 14.0, 25.0)])
    complaints, brute = found(problem, shape), everything(problem, straight(problem), shape)
    assert set(complaints) == set(brute)
    assert len(brute) >= 3
    for name, least in brute.items():
        assert float(complaints[name].split("violated by ")[1].split()[0]) == pytest.approx(-least, rel=6e-3)


def test_the_worst_instant_of_every_stretch_is_named(simulation1: Scenario) -> None:
    """Two hills, one after the other: two instants, each over a summit."""
    problem = crossing(simulation1, 1, terrain={"ripple": None, "mountains": {**HILLS, "east_m": [0.0, 0.0]}})
    instants, complaints = check_between_nodes(problem, straight(problem), problem.shape)
    np.testing.assert_allclose(instants, [10.0, 18.75], atol=0.06)
    assert len(complaints) == 1
    assert "violated by 2 m at t = 10.0 s" in complaints[0]


@pytest.mark.parametrize("count", [5, 60])
def test_a_coordinate_beyond_its_range_is_found(simulation1: Scenario, count: int) -> None:
    scenario = fleet(simulation1, count, "row", (auto(SHRINK),), BLOCK, **FLIGHT)
    problem = flight_problem(scenario)

    def at_scale(value: float) -> Trajectory:
        flat = straight(replace(problem, coordinates=()))
        state = np.concatenate([flat.state.c, np.zeros((2, 1, 4))], axis=2)
        state[-1, 0, 12] = value
        control = np.concatenate([flat.control.c, np.zeros((1, 1, 1))], axis=2)
        return Trajectory(PPoly(state, flat.joints_s), PPoly(control, flat.joints_s))

    assert found(problem, trajectory=at_scale(0.5)) == {}
    assert set(found(problem, trajectory=at_scale(0.499))) == {"scale"}
    assert set(found(problem, trajectory=at_scale(1.03))) == {"scale"}


def turning(problem: Problem, lag_deg: float, speed_mps: float) -> Trajectory:
    """North-east at one speed, the heading of the formation behind by so much."""
    flat = straight(replace(problem, coordinates=()))
    state = np.concatenate([flat.state.c, np.zeros((2, 1, 4))], axis=2)
    state[-1, 0, 3:5] = speed_mps * np.sqrt(0.5)
    state[-1, 0, 12] = np.radians(45.0 - lag_deg)
    control = np.concatenate([flat.control.c, np.zeros((1, 1, 1))], axis=2)
    return Trajectory(PPoly(state, flat.joints_s), PPoly(control, flat.joints_s))


@pytest.mark.parametrize(
    ("lag_deg", "speed_mps", "complains"), [(4.99, 2.0, False), (5.1, 2.0, True), (-5.1, 2.0, True), (90.0, 0.9, False)]
)
def test_a_formation_that_faces_away_from_its_course_is_found(
    simulation1: Scenario, lag_deg: float, speed_mps: float, complains: bool
) -> None:

    problem = flight_problem(fleet(simulation1, 5, "row", (), BLOCK, **FLIGHT, formation={"frame": "course"}))
    complaints = found(problem, trajectory=turning(problem, lag_deg, speed_mps))
    assert ("heading along the course" in complaints) == complains
