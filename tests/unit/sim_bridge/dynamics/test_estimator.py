"""The filters: what they know on the pad, what they refuse, and how they do without."""

from __future__ import annotations

import numpy as np
import pytest

from sim_bridge.dynamics.error_model import ErrorModel
from sim_bridge.dynamics.estimator import COASTING_AFTER_S, GATE_SIGMA, GATE_TIMEOUT_S, Estimator
from sim_bridge.dynamics.failures import Failure, Sensor
from sim_bridge.dynamics.integrator import Turn
from sim_bridge.dynamics.sensors import BARO_PERIOD_S, GNSS, INERTIAL_PERIOD_S, RTK, Sensors
from tests.unit.sim_bridge.flights import FIELD, FIELD_LIMITS, YAW_RAD, course, fly, hold, stand, steps

STANDING = np.array([True])
AT_REST = np.array([[0.0], [0.0], [-9.8]])
STEPS_PER_UPDATE = round(BARO_PERIOD_S / INERTIAL_PERIOD_S)


class OnThePad:
    """One filter of a vehicle that stands still, its sensors, and the clock of both."""

    def __init__(self, state, grade=RTK, seed=1):
        self.estimator, self.sensors = Estimator(grade, 1, 9.8), Sensors(grade, 1, seed)
        self.state = state[:, None]
        self.updates = 0
        self.jump = np.zeros((6, 1))

    def update(self, *, fold_yaw=False):
        for _ in range(STEPS_PER_UPDATE):
            sample = self.sensors.read_inertial(self.state, AT_REST)
            self.estimator.propagate(sample, STANDING, any_landed=True)
        self.updates += 1
        if self.updates % 2:
            yaw = self.sensors.read_compass(self.state)
            turn = {"compass": np.angle(np.exp(1j * yaw)) if fold_yaw else yaw}
        else:
            turn = {"gnss": self.sensors.read_gnss(self.state) + self.jump}
        self.estimator.update(STANDING, self.sensors.read_baro(self.state), **turn)


def pad_state(yaw_rad=2.0):
    state = np.zeros(12)
    state[:3], state[8] = (3.0, -4.0, 5.0), yaw_rad
    return state


def test_on_the_pad_it_averages_to_less_than_one_fix():
    pad = OnThePad(pad_state())
    for _ in range(100):
        pad.update()
    estimate, mean = pad.estimator.state[:, 0], pad.estimator.mean[0]
    assert pad.estimator.healthy.all()
    np.testing.assert_allclose(estimate[:3], [3.0, -4.0, 5.0], atol=0.006)
    np.testing.assert_allclose(estimate[8], 2.0, atol=0.01)
    np.testing.assert_array_equal(estimate[3:8], 0.0)
    np.testing.assert_allclose(mean[9:12], pad.sensors.slow_errors[:3, 0], atol=6e-4)
    np.testing.assert_allclose(mean[12:15], pad.sensors.slow_errors[3:6, 0], atol=0.015)


@pytest.mark.parametrize("yaw_rad", [np.pi, -np.pi + 0.005])
def test_yaw_averages_and_updates_across_the_wrap(yaw_rad):
    pad = OnThePad(pad_state(yaw_rad), seed=2)
    for _ in range(100):
        pad.update(fold_yaw=True)
        assert not (pad.estimator.ratios.compass > 1.0).any()
    off = np.angle(np.exp(1j * (pad.estimator.state[8, 0] - yaw_rad)))
    assert abs(off) < 0.01


def test_a_jump_of_gnss_is_refused_then_believed_after_the_time_out():
    pad = OnThePad(pad_state())
    for _ in range(100):
        pad.update()
    before = pad.estimator.state[0, 0]
    pad.jump[0] = 1.0
    pad.update()
    pad.update()
    assert not pad.estimator.healthy.any()
    assert pad.estimator.ratios.position_horizontal[0] > 1.0 / (GATE_SIGMA * 0.02)
    assert pad.estimator.ratios.velocity[0] < 1.0
    for _ in range(round(0.9 * GATE_TIMEOUT_S / BARO_PERIOD_S)):
        pad.update()
        assert abs(pad.estimator.state[0, 0] - before) < 0.005
    assert pad.estimator.coasting.all()
    for _ in range(20):
        pad.update()
    assert pad.estimator.healthy.all()
    np.testing.assert_allclose(pad.estimator.state[0, 0] - before, 1.0, atol=0.05)


def test_transitions_are_what_dead_reckoning_does_to_errors():
    """The matrix against finite differences of the mechanisation itself, over one update period."""
    rng = np.random.default_rng(4)
    vehicles = 3
    state = 0.3 * rng.normal(size=(9, vehicles))
    slow = np.zeros((10, vehicles))
    inertial = np.concatenate((np.zeros((3, vehicles)), rng.normal(size=(3, vehicles)) - [[0.0], [0.0], [9.8]]))
    flying = np.zeros(vehicles, dtype=bool)

    def reckoned(nudge, component):
        estimator = Estimator(GNSS, vehicles, 9.8)
        estimator.aligned[:] = True
        whole = np.concatenate((state, slow))
        whole[component] += nudge
        estimator.state[:9] = whole[:9]
        estimator.state[9:] = inertial[:3] - whole[9:12]
        estimator._slow = whole[9:]  # the one thing no public call can set
        for _ in range(STEPS_PER_UPDATE):
            estimator.propagate(inertial, flying, any_landed=False)
        return estimator.mean

    turn = Turn.of(state[6:9])
    exact = ErrorModel.of(GNSS).transition(turn, turn.to_ned(inertial[3:]), flying)
    nudge = 1e-5
    for component in range(15):
        moved = (reckoned(nudge, component) - reckoned(-nudge, component)) / (2.0 * nudge)
        np.testing.assert_allclose(exact[:, :15, component], moved[:, :15], atol=2e-3)


def hovering_fleet(grade=RTK, vehicles=2, seed=4):
    """In the air at 3 m for some seconds, and the reference that holds it there."""
    pads = 5.0 * np.arange(vehicles)[:, None] * np.array([[1.0, 0.0, 0.0]])
    airframes = stand(FIELD, FIELD_LIMITS, grade, pads, seed=seed)
    home = airframes.estimate[:, :3].copy()
    fly(airframes, course(yaw_swing_rad=0.0).part(0.0, 13.5), home)
    there = hold(home + np.array([0.0, 0.0, -3.0]), np.full(vehicles, YAW_RAD))
    return airframes, there


def go_on(airframes, reference, seconds):
    for _ in range(steps(seconds)):
        airframes.step(reference, np.ones(len(airframes.landed), dtype=bool))


def test_it_coasts_through_an_outage_and_is_as_wrong_as_it_says():
    airframes, there = hovering_fleet()
    airframes.fail(0, [Failure(gnss_lost=True)])
    go_on(airframes, there, 9.9)
    assert airframes.gnss_fix.tolist() == [False, True]
    assert airframes.estimator.coasting.tolist() == [True, False]
    off_m = np.linalg.norm((airframes.estimate - airframes.truth)[:, :2], axis=1)
    sigma_m = airframes.estimator.accuracy.position_horizontal_m
    assert sigma_m[0] > 10.0 * sigma_m[1]
    assert off_m[0] < 3.0 * sigma_m[0] and off_m[1] < 0.03
    airframes.fail(0, [])
    go_on(airframes, there, 2.9)
    assert airframes.gnss_fix.all() and not airframes.estimator.coasting.any() and airframes.healthy.all()
    assert np.linalg.norm((airframes.estimate - airframes.truth)[:, :2], axis=1).max() < 0.03


def test_a_fix_that_jumps_for_a_moment_moves_nobody():
    airframes, there = hovering_fleet()
    airframes.fail(1, [Failure(offset_ned_m=(5.0, 0.0, -3.0))])
    go_on(airframes, there, COASTING_AFTER_S + 0.5)
    assert airframes.estimator.coasting.tolist() == [False, True]
    assert airframes.estimator.ratios.position_horizontal[1] > 10.0
    go_on(airframes, there, 0.8 * GATE_TIMEOUT_S - COASTING_AFTER_S - 0.5)
    airframes.fail(1, [])
    go_on(airframes, there, GATE_TIMEOUT_S)
    assert np.linalg.norm((airframes.truth - airframes.estimate)[:, :3], axis=1).max() < 0.05


def test_a_fix_that_jumps_for_good_is_followed_in_the_end():
    airframes, there = hovering_fleet()
    airframes.fail(1, [Failure(offset_ned_m=(2.0, 0.0, 0.0))])
    go_on(airframes, there, GATE_TIMEOUT_S + 10.0)
    off = (airframes.truth - airframes.estimate)[:, 0]
    np.testing.assert_allclose(off, [0.0, -2.0], atol=0.05)
    np.testing.assert_allclose(airframes.estimate[:, :3], there[:, 0, :3], atol=0.1)


@pytest.mark.parametrize("sensor", [Sensor.BAROMETER, Sensor.COMPASS, Sensor.GNSS])
def test_an_aid_that_sticks_is_left_out_when_the_vehicle_moves(sensor):
    airframes, there = hovering_fleet()
    airframes.fail(0, [Failure(sensor=sensor)])
    away = hold(there[:, 0, :3] + np.array([0.5, 0.0, -4.0]), there[:, 0, 3] + 1.0)
    worst = 0.0
    for _ in range(16):
        go_on(airframes, away, 0.25)
        ratios = airframes.estimator.ratios
        seen = {Sensor.BAROMETER: ratios.baro, Sensor.COMPASS: ratios.compass, Sensor.GNSS: ratios.position_vertical}
        worst = max(worst, seen[sensor][0])
    assert worst > 1.0
    np.testing.assert_allclose(airframes.estimate[0], airframes.truth[0], atol=0.3)
