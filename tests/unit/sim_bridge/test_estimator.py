"""The filters: what they know on the pad, what they refuse, and whether they are as sure as they should be."""

from __future__ import annotations

import numpy as np
import pytest

from sim_bridge.estimator import GATE_SIGMA, GATE_TIMEOUT_S, Estimator
from sim_bridge.sensors import GRADES, INERTIAL_PERIOD_S, RTK, Sensors
from tests.unit.sim_bridge.flights import F150, F150_LIMITS, course, fly, stand

STANDING = np.array([True])


def standing_estimator(state, grade=RTK, seed=1):
    """A filter that watched a vehicle stand still for ten seconds, its sensors, and the clock of both."""
    estimator, sensors = Estimator(F150, F150_LIMITS, grade, 1), Sensors(grade, 1, seed)
    for k in range(500):
        estimator.propagate(np.zeros((1, 4)), STANDING, INERTIAL_PERIOD_S)
        gnss = sensors.read_gnss(state) if k % 5 == 0 else None
        estimator.measure(sensors.read_inertial(state), gnss, STANDING)
    return estimator, sensors


def test_on_the_pad_it_averages_to_less_than_one_fix():
    state = np.zeros((1, 12))
    state[0, :3], state[0, 8] = (3.0, -4.0, 5.0), 2.0
    estimator, sensors = standing_estimator(state)
    assert estimator.healthy.all()
    np.testing.assert_allclose(estimator.state[0, :3], state[0, :3], atol=0.006)
    np.testing.assert_allclose(estimator.state[0, 8], 2.0, atol=0.004)
    np.testing.assert_array_equal(estimator.state[0, 3:8], 0.0)
    np.testing.assert_allclose(estimator.mean[:, 12:], sensors.gyro_bias_radps, atol=4e-4)


@pytest.mark.parametrize("yaw_rad", [np.pi, -np.pi + 0.005])
def test_yaw_averages_and_updates_across_the_wrap(yaw_rad):
    state = np.zeros((1, 12))
    state[0, 8] = yaw_rad
    estimator, sensors = Estimator(F150, F150_LIMITS, RTK, 1), Sensors(RTK, 1, 2)
    for k in range(500):
        estimator.propagate(np.zeros((1, 4)), STANDING, INERTIAL_PERIOD_S)
        inertial = sensors.read_inertial(state)
        inertial[:, 3] = np.angle(np.exp(1j * inertial[:, 3]))  # as a compass reports it
        estimator.measure(inertial, sensors.read_gnss(state) if k % 5 == 0 else None, STANDING)
        assert not (estimator.ratios.compass > 1.0).any()
    off = np.angle(np.exp(1j * (estimator.state[0, 8] - yaw_rad)))
    assert abs(off) < 0.004


def test_a_jump_of_gnss_is_refused_then_believed_after_the_time_out():
    state = np.zeros((1, 12))
    estimator, sensors = standing_estimator(state)
    before = estimator.state[0, 0]
    jump = np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    moved = []
    for k in range(round((GATE_TIMEOUT_S + 60.0) / INERTIAL_PERIOD_S)):
        estimator.propagate(np.zeros((1, 4)), STANDING, INERTIAL_PERIOD_S)
        gnss = sensors.read_gnss(state) + jump if k % 5 == 0 else None
        estimator.measure(sensors.read_inertial(state), gnss, STANDING)
        moved.append(estimator.state[0, 0] - before)
        if k == 0:
            assert not estimator.healthy.any()
            assert estimator.ratios.position_horizontal[0] > 1.0 / (GATE_SIGMA * 0.02)
            assert estimator.ratios.velocity[0] < 1.0
    refusing = round(0.9 * GATE_TIMEOUT_S / INERTIAL_PERIOD_S)
    assert np.abs(moved[:refusing]).max() < 1e-3
    assert moved[-1] > 0.5


@pytest.mark.parametrize("name", ["rtk", "gnss"])
def test_filters_are_about_as_wrong_as_they_think(name):
    """Mean NEES of flying vehicles lies near its 15 degrees of freedom.

    Below, because the filters allow for disturbances that still air does not bring; above would be overconfidence.
    """
    vehicles = 10
    pads = np.zeros((vehicles, 3))
    airframes = stand(F150, F150_LIMITS, GRADES[name], pads, seed=21)
    flight = course(yaw_swing_rad=0.3)
    nees = []
    for start in range(0, 2000, 100):
        fly(airframes, flight.part(start, start + 100), pads)
        truth = np.column_stack([airframes.truth, airframes.sensors.gyro_bias_radps])
        off = airframes.estimator.mean - truth
        nees.append(np.einsum("vi,vij,vj->v", off, np.linalg.inv(airframes.estimator.covariance), off))
    airborne = np.array(nees)[5:]
    assert 8.0 < airborne.mean() < 15.0
