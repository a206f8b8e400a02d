"""Energy of all vehicles (Eqs. 30-32): representatives and plans against sums over every vehicle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.plan.formation.timeline import lay
from gcs.plan.ocp.objective_sum import cost_shares, term_cost
from gcs.plan.ocp.objectives import TERMS
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.ocp.representatives import representatives
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tests.unit.plan.formations import SHRINK, TURN, at, auto, fleet
from tests.unit.plan.problems import meadow

ENERGY = TERMS[0]


@pytest.mark.parametrize("size", [(3, 1, 1), (25, 40, 1), (10, 10, 10)])
def test_means_over_representatives_are_means_over_all(size: tuple[int, int, int]) -> None:
    """|v + A r|^3 has no closed mean; a few vehicles and weights give it to 1 %, the mean square exactly."""
    steps = np.stack(np.meshgrid(*(np.arange(n) for n in size), indexing="ij"), axis=-1).reshape(-1, 3) * 3.0
    offsets = steps - steps[len(steps) // 3]
    leader = len(steps) // 3
    sample = representatives(offsets[None], offsets, leader)
    assert sample.rows[0] == leader and len(set(sample.rows.tolist())) == len(sample.rows) <= 41
    assert np.all(sample.weights > 0.0) and sample.weights.sum() == pytest.approx(1.0, abs=1e-9)
    random = np.random.default_rng(7)
    for _ in range(20):
        reach = np.linalg.norm(offsets, axis=1).max()
        velocity, bend = random.normal(size=3) * 4.0, random.normal(size=(3, 3)) * 1.5 / reach
        speed = np.linalg.norm(velocity + offsets @ bend, axis=1)
        assert speed[sample.rows] ** 2 @ sample.weights == pytest.approx(np.mean(speed**2), rel=1e-9)
        assert speed[sample.rows] ** 3 @ sample.weights == pytest.approx(np.mean(speed**3), rel=1e-2)


def course(scenario: Scenario) -> Problem:
    return flight_problem(fleet(scenario, 4, "row", formation={"frame": "course"}, time={"flight_s": 40.0}))


def automatic(scenario: Scenario) -> Problem:
    return flight_problem(fleet(scenario, 4, "row", (auto(SHRINK),), time={"flight_s": 40.0}))


def scheduled(scenario: Scenario) -> Problem:
    made = fleet(scenario, 4, "row", (at(TURN, 5.0),), time={"flight_s": 40.0})
    return replace(flight_problem(made), shape=lay(made, (5.0,), 0.0, 40.0).shape)


def flown(problem: Problem) -> Trajectory:
    """A turn at 3 m/s, in which the coordinates move by parabolas (with consistent rates)."""
    joints = np.array([0.0, 40.0])
    chains = len(problem.coordinates)
    state = np.zeros((3, 1, 12 + 4 * chains))
    state[1, 0, :2], state[0, 0, 1] = (3.0, 1.0), 0.04  # position; then its rate
    state[2, 0, 3:5], state[1, 0, 4] = (3.0, 1.0), 0.08
    state[2, 0, 2] = -5.0
    for c in range(chains):
        state[:, 0, 12 + 4 * c] = (1e-3, 5e-3, 1.0)
        state[1:, 0, 13 + 4 * c] = (2e-3, 5e-3)
    return Trajectory(PPoly(state, joints), PPoly(np.zeros((1, 1, 4 + chains)), joints))


@pytest.mark.parametrize("make", [course, automatic, scheduled])
def test_energy_is_that_of_every_vehicle(simulation1: Scenario, make: object) -> None:
    """Velocities by differences of places, which no line of the objective knows."""
    assert callable(make)
    problem: Problem = make(simulation1)
    trajectory = flown(problem)
    times = np.linspace(0.0, 40.0, 8001)
    places = _places(problem, trajectory, times)
    speed = np.linalg.norm(np.diff(places, axis=1), axis=2) / np.diff(times)
    reference = problem.objective.speed_ref_mps
    every = np.sqrt(speed**2 + (1e-2 * reference) ** 2) ** 3
    expected = every.mean() / reference**3
    leader = every[problem.leader].mean() / reference**3
    cost = term_cost(problem, ENERGY, trajectory)
    assert cost == pytest.approx(expected, rel=1e-3)
    assert abs(cost - leader) > 1e-2 * leader  # the leader alone would be another number


def _places(problem: Problem, trajectory: Trajectory, t_s: Array) -> Array:
    """Places (V, N, 3), by the definition of each coordinate."""
    x = trajectory.state(t_s)
    offsets = problem.shape.offsets(t_s)
    for c, coordinate in enumerate(problem.coordinates):
        value = x[:, 12 + 4 * c]
        if coordinate.name == "scale":
            offsets = offsets * value[:, None]
        else:
            cosine, sine = np.cos(value), np.sin(value)
            north, east = offsets[..., 0], offsets[..., 1]
            offsets = np.stack([cosine * north - sine * east, sine * north + cosine * east, offsets[..., 2]], axis=-1)
    return np.asarray(x[:, :3] + offsets)


def test_a_rigid_formation_costs_what_its_leader_costs(simulation1: Scenario) -> None:
    """The weights of Eq. 35 keep their meaning, and no vehicle beside the leader enters the program."""
    problem = flight_problem(meadow(simulation1))
    assert problem.representatives is None
    assert cost_shares(problem, *(np.zeros(3),) * 3).shape == (2, 3)


def test_vehicles_at_other_heights_of_sheared_wind_count(simulation1: Scenario) -> None:
    wind = {"speed_mps": 2.0, "from_deg": 200.0, "shear": 0.3}
    vehicles = [{"sysid": 1, "position_m": [2.0, 1.0, 3.0]}, {"sysid": 2, "position_m": [2.0, 4.0, 23.0]}]
    problem = flight_problem(meadow(simulation1, wind=wind, formation={"vehicle": vehicles}))
    trajectory = flown(problem)
    velocity = trajectory.state(np.linspace(0.0, 40.0, 4001))[:, 3:6]
    reference = problem.objective.speed_ref_mps
    every = []
    for height_m in (5.0, 25.0):
        air = np.array(problem.quadrotor.wind.at(height_m))
        every.append(np.mean(np.sqrt(np.sum((velocity - air) ** 2, axis=1) + (1e-2 * reference) ** 2) ** 3))
    assert every[0] != pytest.approx(every[1], rel=0.01)
    assert term_cost(problem, ENERGY, trajectory) * problem.mean_s / 40.0 == pytest.approx(
        np.mean(every) / reference**3, rel=1e-3
    )


def test_a_thousand_vehicles_cost_no_more_than_forty(simulation1: Scenario) -> None:
    problem = flight_problem(fleet(simulation1, 1000, "row", formation={"frame": "course"}))
    assert problem.representatives is not None
    assert len(problem.representatives.rows) <= 41
