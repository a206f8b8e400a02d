"""Small flights for tests: over flat ground, solved in a tenth of a second."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import PPoly

from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario

FLAT = {"ripple": None, "mountains": {}}


def changed(scenario: Scenario, **tables: Any) -> Scenario:
    """The scenario with keys of its tables replaced; what is not a table is replaced as a whole."""
    data = scenario.model_dump()
    for name, value in tables.items():
        data[name] = {**(data.get(name) or {}), **value} if isinstance(value, dict) else value
    return Scenario.model_validate(data)


def alone(scenario: Scenario) -> Scenario:
    """The leader without its followers."""
    leader = scenario.formation.leader
    return changed(
        scenario, formation={"vehicle": [v.model_dump() for v in scenario.formation.vehicle if v.sysid == leader]}
    )


def meadow(scenario: Scenario, **tables: Any) -> Scenario:
    """From a hover to another 40 m away in 20 s, over flat ground, yaw held north, as `tables` do not say otherwise."""
    level = {"velocity_mps": [0.0, 0.0, 0.0], "roll_pitch_yaw_deg": [0.0, 0.0, 0.0]}
    calm = changed(
        scenario,
        time={"flight_s": 20.0},
        terrain=FLAT,
        start={"position_m": [2.0, 1.0, 3.0], **level},
        end={"position_m": [40.0, 14.0, 5.0], **level},
        objective={"heading_ref_deg": 0.0, "height_ref_m": 4.0, "terminal_weight": "1"},
        ground_phases={"takeoff_s": 6.1, "hover_s": 2.3, "landing_s": 7.7},
    )
    return changed(calm, **tables)


def vertical_move(scenario: Scenario, rise_m: float, duration_s: float) -> Problem:
    """Straight up from rest to rest at the least of the height term alone, in which nothing else moves."""
    start = [2.0, 1.0, 3.0]
    calm = meadow(
        alone(scenario),
        time={"flight_s": duration_s},
        end={"position_m": [*start[:2], start[2] + rise_m]},
        objective={"weights": [0.0, 0.0, 1.0]},
    )
    return flight_problem(calm)


def with_bounds(problem: Problem, control: float) -> Problem:
    """The same problem with controls this far from hover allowed."""
    hover = np.array([problem.quadrotor.weight_N, 0.0, 0.0, 0.0])
    return replace(problem, control_low=hover - control, control_high=hover + control)


def straight(problem: Problem) -> Trajectory:
    """The plainest guess: constant velocity, level, at hover thrust."""
    joints = np.array([problem.start_s, problem.end_s])
    rate = (problem.end_state - problem.start_state) / problem.duration_s
    state = np.zeros((2, 1, 12))
    state[0, 0], state[1, 0] = rate, problem.start_state
    state[1, 0, 3:6] = rate[:3]
    state[0, 0, 3:6] = 0.0
    control = np.zeros((1, 1, 4))
    control[0, 0, 0] = problem.quadrotor.weight_N
    return Trajectory(PPoly(state, joints), PPoly(control, joints))
