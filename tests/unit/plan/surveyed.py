"""Surveys whose plans fly straight from corner to corner, made without an optimiser."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import shapely
from scipy.interpolate import PPoly

from gcs.frames import Origin
from gcs.plan.formation.shape import rigid
from gcs.plan.trajectory.phases import phases_of
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.sources.survey_flight import SurveyOrder, survey_flight
from gcs.scenario.sources.template import scenario_text
from gcs.scenario.values.si import NED_FROM_UP, offsets_ned_m, quadrotor
from gcs.types import Array

POND = [(40.0, 90.0), (60.0, 90.0), (60.0, 120.0), (40.0, 120.0)]
FIELD = shapely.Polygon([(0, 0), (100, 20), (110, 230), (-10, 200)], [POND])
SWATH_M = 12.0


def scenario_of(order: SurveyOrder, folder: Path) -> Scenario:
    file = folder / "scenario.toml"
    file.write_text(
        scenario_text(Path("field"), Origin(47.0, 8.0, 400.0), flight=survey_flight(order)), encoding="utf-8"
    )
    return load_scenario(file)


def flown(scenario: Scenario, corners_ned_m: Array) -> Plan:
    """A plan that rests at each corner and flies straight between them, each leg in the same time."""
    phases = phases_of(scenario)
    legs = np.linspace(0.0, scenario.time.flight_s, len(corners_ned_m))
    joints = np.concatenate([[phases[0].start_s], legs, [phases[-1].end_s]])
    coefficients = np.zeros((6, len(joints) - 1, 12))
    coefficients[5, 0, :3], coefficients[5, -1, :3] = corners_ned_m[0], corners_ned_m[-1]
    span_s = legs[1] - legs[0]
    for number, (a, b) in enumerate(itertools.pairwise(corners_ned_m), start=1):
        coefficients[5, number, :3] = a
        for row, factor in enumerate((6.0, -15.0, 10.0)):  # of t^5, t^4, t^3
            coefficients[row, number, :3] = factor * (b - a) / span_s ** (5 - row)
    control = np.zeros((1, len(joints) - 1, 4))
    control[..., 0] = quadrotor(scenario).weight_N
    leader = Trajectory(PPoly(coefficients, joints), PPoly(control, joints))
    shape = rigid(offsets_ned_m(scenario), joints[0], joints[-1])
    return Plan(scenario, leader, shape, phases, 0.0)


def corners_of(scenario: Scenario) -> Array:
    places = [scenario.start.position_m, *(point.position_m for point in scenario.route), scenario.end.position_m]
    return np.asarray(np.array(places) * NED_FROM_UP)
