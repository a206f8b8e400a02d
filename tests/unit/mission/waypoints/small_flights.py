"""Flights of a minute and less whose motion is written down, not planned."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly

from gcs.plan.formation.shape import rigid
from gcs.plan.trajectory.phases import Phase, phases_of
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import offsets_ned_m
from tests.unit.plan.problems import meadow

FLIGHT_S = 48.0
STEP = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])  # from rest to rest, highest power first


def there_and_on(scenario: Scenario) -> Plan:
    """Three vehicles, 60 m north in the first half and 60 m east in the second, from rest to rest to rest."""
    three = [v.model_dump() for v in scenario.formation.vehicle[:3]]
    ends = {"start": {"position_m": [5.0, 5.0, 8.0]}, "end": {"position_m": [65.0, 65.0, 8.0]}}
    flight = meadow(scenario, formation={"vehicle": three}, time={"flight_s": FLIGHT_S}, **ends)
    phases, half_s = phases_of(flight), 0.5 * FLIGHT_S
    joints = np.array([phases[0].start_s, 0.0, half_s, FLIGHT_S, phases[-1].end_s])
    state = np.zeros((6, 4, 12))
    state[5, :, :3] = [[5.0, 5.0, -8.0], [5.0, 5.0, -8.0], [65.0, 5.0, -8.0], [65.0, 65.0, -8.0]]
    for piece, axis in ((1, 0), (2, 1)):
        state[:, piece, axis] += 60.0 * STEP / half_s ** np.arange(5.0, -1.0, -1.0)
        state[1:, piece, 3 + axis] = (state[:, piece, axis] * np.arange(5.0, -1.0, -1.0))[:-1]
    motion = Trajectory(PPoly(state, joints), PPoly(np.zeros((1, 4, 4)), joints))
    return Plan(flight, motion, rigid(offsets_ned_m(flight), joints[0], joints[-1]), phases, 0.0)


def stop_and_go(plan: Plan, yaw_ned_rad: float) -> Plan:
    """South at 2 m/s for 10 s, 20 s standing, north at 4 m/s for 5 s; 5 m above the origin's height."""
    joints = np.array([-10.0, 0.0, 10.0, 30.0, 35.0, 45.0])
    speed = np.array([0.0, -2.0, 0.0, 4.0, 0.0])
    state = np.zeros((2, 5, 12))
    state[0, :, 0] = speed
    state[1, :, 0] = np.concatenate([[0.0], np.cumsum(speed * np.diff(joints))[:-1]])
    state[1, :, 2] = -5.0
    state[1, :, 3] = speed
    state[1, :, 8] = yaw_ned_rad
    names = ("takeoff", "mission", "landing")
    phases = tuple(map(Phase, names, (-10.0, 0.0, 35.0), (0.0, 35.0, 45.0)))
    shape = rigid(np.zeros((len(plan.sysids), 3)), -10.0, 45.0)
    scenario = plan.scenario.model_copy(
        update={
            "origin": plan.scenario.origin.model_copy(update={"lat_deg": -35.0, "lon_deg": -71.0}),
            "time": plan.scenario.time.model_copy(update={"flight_s": 35.0}),
        }
    )
    motion = Trajectory(PPoly(state, joints), PPoly(np.zeros((1, 5, 4)), joints))
    return Plan(scenario, motion, shape, phases, 0.0)
