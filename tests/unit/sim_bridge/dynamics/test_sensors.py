"""Sensor errors: the statistics they claim, whose they are, and what a breakdown does to them."""

from __future__ import annotations

import numpy as np
import pytest

from sim_bridge.dynamics.failures import Effects, Sensor
from sim_bridge.dynamics.sensors import BARO_PERIOD_S, GNSS, GNSS_PERIOD_S, INERTIAL_PERIOD_S, RTK, Sensors

VEHICLES = 40
TRUTH = np.random.default_rng(5).normal(size=(12, VEHICLES))
FORCE = np.random.default_rng(6).normal(size=(3, VEHICLES))


@pytest.fixture(scope="module")
def rtk_errors():
    sensors = Sensors(RTK, VEHICLES, seed=3)
    gnss = np.array([sensors.read_gnss(TRUTH) - TRUTH[:6] for _ in range(500)])
    seen = np.concatenate((TRUTH[9:], FORCE))
    inertial = np.array([sensors.read_inertial(TRUTH, FORCE) - seen for _ in range(500)])
    return gnss, inertial


def test_rtk_positions_are_white_with_centimetres_of_deviation(rtk_errors):
    gnss, _ = rtk_errors
    expected = [0.01, 0.01, 0.015, 0.02, 0.02, 0.03]
    np.testing.assert_allclose(gnss.std(axis=(0, 2)), expected, rtol=0.03)
    np.testing.assert_allclose(gnss.mean(axis=(0, 2)), 0.0, atol=1e-3)
    following = (gnss[1:] * gnss[:-1]).mean(axis=(0, 2)) / gnss.var(axis=(0, 2))
    np.testing.assert_allclose(following, 0.0, atol=0.03)


def test_inertial_errors_are_white_around_a_bias_of_each_vehicle_own(rtk_errors):
    _, inertial = rtk_errors
    for part, white, bias in (
        (inertial[:, :3], RTK.gyro_radps, RTK.gyro_bias_radps),
        (inertial[:, 3:], RTK.accel_mps2, RTK.accel_bias_mps2),
    ):
        biases = part.mean(axis=0)
        np.testing.assert_allclose(biases.std(), bias.start, rtol=0.2)
        np.testing.assert_allclose((part - biases).std(), white, rtol=0.03)


def test_biases_walk_as_far_as_they_say():
    sensors = Sensors(RTK, VEHICLES, seed=8)
    sensors.read_inertial(TRUTH, FORCE)
    before = sensors.slow_errors[:6].copy()
    for _ in range(2000):
        sensors.read_inertial(TRUTH, FORCE)
    gone = (sensors.slow_errors[:6] - before) / np.sqrt(2000 * INERTIAL_PERIOD_S)
    np.testing.assert_allclose(gone[:3].std(), RTK.gyro_bias_radps.per_root_s, rtol=0.2)
    np.testing.assert_allclose(gone[3:].std(), RTK.accel_bias_mps2.per_root_s, rtol=0.2)


def test_slow_errors_are_stationary_gauss_markov_processes():
    sensors = Sensors(GNSS, VEHICLES, seed=4)
    slow, period_s = GNSS.gnss_horizontal_drift_m, GNSS_PERIOD_S
    north = np.array([sensors.read_gnss(TRUTH)[0] - TRUTH[0] for _ in range(4000)])
    np.testing.assert_allclose(north.std(), np.hypot(slow.sigma, GNSS.gnss_horizontal_m), rtol=0.1)
    lag = round(slow.time_s / period_s)
    correlation = (north[lag:] * north[:-lag]).mean() / slow.sigma**2
    np.testing.assert_allclose(correlation, np.exp(-1.0), atol=0.15)


def test_what_is_called_slow_is_what_is_not_white():
    sensors = Sensors(GNSS, VEHICLES, seed=4)
    height = np.array([sensors.read_baro(TRUTH) + TRUTH[2] - sensors.slow_errors[6] for _ in range(500)])
    place = np.array([sensors.read_gnss(TRUTH)[:3] - TRUTH[:3] - sensors.slow_errors[7:] for _ in range(500)])
    np.testing.assert_allclose(height.std(), GNSS.baro_m, rtol=0.03)
    np.testing.assert_allclose(place.std(axis=(0, 2)), GNSS.gnss_white[:3], rtol=0.03)
    yaw = np.array([sensors.read_compass(TRUTH) - TRUTH[8] for _ in range(500)])
    np.testing.assert_allclose(yaw.std(), GNSS.compass_rad, rtol=0.03)


def test_the_barometer_drifts_over_minutes():
    sensors = Sensors(RTK, VEHICLES, seed=5)
    drift = np.array([(sensors.read_baro(TRUTH), sensors.slow_errors[6])[1] for _ in range(3000)])
    slow = RTK.baro_drift_m
    gone = np.diff(drift[:: round(10.0 / BARO_PERIOD_S)], axis=0)
    np.testing.assert_allclose(gone.std(), slow.sigma * np.sqrt(2.0 * (1.0 - np.exp(-10.0 / slow.time_s))), rtol=0.1)


def sample_all(sensors, truth, force):
    return (
        sensors.read_gnss(truth),
        sensors.read_inertial(truth, force),
        sensors.read_baro(truth),
        sensors.read_compass(truth),
    )


def test_a_vehicle_hears_the_same_noise_in_any_fleet():
    few, many = Sensors(GNSS, 2, seed=9), Sensors(GNSS, VEHICLES, seed=9)
    for _ in range(300):
        for a, b in zip(sample_all(few, TRUTH[:, :2], FORCE[:, :2]), sample_all(many, TRUTH, FORCE), strict=True):
            np.testing.assert_array_equal(a, b[..., :2])


def test_another_seed_and_another_vehicle_hear_other_noise():
    first, other = Sensors(RTK, 2, seed=9), Sensors(RTK, 2, seed=10)
    same_place = np.zeros((12, 2))
    a, b = first.read_gnss(same_place), other.read_gnss(same_place)
    assert len(np.unique(np.concatenate([a, b]))) == a.size + b.size


def test_breakdowns_change_samples_and_not_the_noise_that_follows():
    well, ill = Sensors(RTK, 3, seed=9), Sensors(RTK, 3, seed=9)
    truth, force = TRUTH[:, :3], FORCE[:, :3]
    before = sample_all(ill, truth, force)
    sample_all(well, truth, force)
    ill.effects = Effects.of([()] * 3)
    ill.effects.sound = False
    ill.effects.stuck[0, :] = True
    ill.effects.gnss_lost[1] = True
    ill.effects.gnss_offset_ned_m[2] = 1.0, -2.0, 3.0
    for _ in range(5):
        gnss, *others = sample_all(ill, truth + 1.0, force + 1.0)
        reference = sample_all(well, truth + 1.0, force + 1.0)
        for was, now in zip(before, (gnss, *others), strict=True):
            np.testing.assert_array_equal(now[..., 0], was[..., 0])
        for now, sound in zip(others, reference[1:], strict=True):
            np.testing.assert_array_equal(now[..., 1:], sound[..., 1:])
        assert np.isnan(gnss[:, 1]).all()
        np.testing.assert_allclose(gnss[:, 2] - reference[0][:, 2], [1.0, -2.0, 3.0, 0.0, 0.0, 0.0], atol=1e-12)
    ill.effects = Effects.of([()] * 3)
    for now, sound in zip(sample_all(ill, truth, force), sample_all(well, truth, force), strict=True):
        np.testing.assert_array_equal(now, sound)


@pytest.mark.parametrize("sensor", list(Sensor))
def test_each_sensor_sticks_alone(sensor):
    sensors = Sensors(RTK, 1, seed=1)
    truth, force = np.zeros((12, 1)), np.zeros((3, 1))

    def samples():
        gnss, inertial, baro, compass = sample_all(sensors, truth, force)
        return {
            Sensor.GNSS: gnss[:, 0],
            Sensor.GYRO: inertial[:3, 0],
            Sensor.ACCELEROMETER: inertial[3:, 0],
            Sensor.BAROMETER: baro,
            Sensor.COMPASS: compass,
        }

    before = samples()
    sensors.effects.sound = False
    sensors.effects.stuck[0, sensor] = True
    after = samples()
    for name in Sensor:
        assert (after[name] == before[name]).all() == (name == sensor)
