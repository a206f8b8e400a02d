"""What happens at limits, in flight: nothing winds up, and yaw gives way to tilt, tilt to height."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.types import Array
from sim_bridge.dynamics.airframes import Airframes
from sim_bridge.dynamics.presets import FIELD
from sim_bridge.dynamics.sensors import RTK
from sim_bridge.dynamics.wind_field import CALM, WindField, parse_wind
from tests.unit.sim_bridge.flights import YAW_RAD, course, fly, hold, stand, steps

PAD_NED_M = np.zeros((1, 3))
ON = np.ones(1, dtype=bool)
UP_M = 3.0


def hovering(limits=FIELD.limits) -> Airframes:
    airframes = stand(FIELD.quadrotor, limits, RTK, PAD_NED_M, seed=3)
    fly(airframes, course(yaw_swing_rad=0.0).part(0.0, 13.5), PAD_NED_M)
    return airframes


def test_a_storm_that_nobody_could_hold_leaves_nothing_behind() -> None:
    """Blown away with the observer at its limit, it comes back in calm air, and not past its place."""
    airframes, place = hovering(), np.array([0.0, 0.0, -UP_M])
    there = hold(place[None], np.array([YAW_RAD]))
    airframes._wind_field = WindField(parse_wind("30@180"), PAD_NED_M, 1)
    for _ in range(steps(3.0)):
        airframes.step(there, ON)
    blown_m, push_mps2 = airframes.truth[0, 0], airframes.controller.push[0, 0]
    assert blown_m > 5.0
    airframes._wind_field = WindField(CALM, PAD_NED_M, 1)
    least_m, pushes = blown_m, []
    for _ in range(steps(20.0)):
        airframes.step(there, ON)
        least_m = min(least_m, airframes.truth[0, 0])
        pushes.append(abs(airframes.controller.push[0, 0]))
    assert least_m > -0.05 * blown_m
    assert pushes[steps(6.0)] < 0.1 * push_mps2
    np.testing.assert_allclose(airframes.truth[0, :3], place, atol=0.06)


def turned(airframes: Airframes, yaw_rad: float, goal: tuple[float, float, float]) -> tuple[Array, bool]:
    """True states along a step of place and heading, and whether a rotor was at its limit on the way."""
    there = hold(np.array([goal]), np.array([YAW_RAD + yaw_rad]))
    states, limit = [], False
    for _ in range(steps(5.0)):
        airframes.step(there, ON)
        states.append(airframes.truth[0].copy())
        share = airframes.rotors_radps[0] / airframes.rotor_max_radps
        limit = limit or bool(share.max() > 1.0 - 1e-9 or share.min() <= 0.0)
    return np.array(states), limit


@pytest.mark.parametrize("away_m", [8.0, pytest.param(20.0, marks=pytest.mark.slow)])
def test_yaw_gives_way_to_tilt_and_tilt_to_height(away_m: float) -> None:
    """Half a turn asked for together with a dash: the dash is the same as without it."""
    goal = (0.0, away_m, -UP_M)
    (alone, _), (both, limit) = turned(hovering(None), 0.0, goal), turned(hovering(None), 3.0, goal)
    assert limit
    assert np.abs(both[:, :2] - alone[:, :2]).max() < 0.1
    assert np.abs(both[:, 2] + UP_M).max() < 0.1
    assert both[-1, 8] - YAW_RAD > 1.0  # it does turn, as far as there is thrust left for that
