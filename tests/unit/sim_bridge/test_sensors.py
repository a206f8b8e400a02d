"""Sensor errors: the statistics they claim, and whose they are."""

from __future__ import annotations

import numpy as np
import pytest

from sim_bridge.sensors import GNSS, GNSS_PERIOD_S, INERTIAL_PERIOD_S, RTK, Sensors

TRUTH = np.random.default_rng(5).normal(size=(40, 12))


@pytest.fixture(scope="module")
def rtk_errors():
    sensors = Sensors(RTK, len(TRUTH), seed=3)
    gnss = np.array([sensors.read_gnss(TRUTH) - TRUTH[:, :6] for _ in range(500)])
    seen = np.column_stack([TRUTH[:, 9:12], TRUTH[:, 8], -TRUTH[:, 2]])
    inertial = np.array([sensors.read_inertial(TRUTH) - seen for _ in range(500)])
    return gnss, inertial


def test_rtk_positions_are_white_with_centimetres_of_deviation(rtk_errors):
    gnss, _ = rtk_errors
    expected = [0.01, 0.01, 0.015, 0.02, 0.02, 0.03]
    np.testing.assert_allclose(gnss.std(axis=(0, 1)), expected, rtol=0.03)
    np.testing.assert_allclose(gnss.mean(axis=(0, 1)), 0.0, atol=1e-3)
    following = (gnss[1:] * gnss[:-1]).mean(axis=(0, 1)) / gnss.var(axis=(0, 1))
    np.testing.assert_allclose(following, 0.0, atol=0.03)


def test_inertial_errors_are_white_around_a_bias_of_each_vehicle_own(rtk_errors):
    _, inertial = rtk_errors
    gyro, yaw, height = inertial[..., :3], inertial[..., 3], inertial[..., 4]
    biases = gyro.mean(axis=0)
    np.testing.assert_allclose(biases.std(), RTK.gyro_bias_radps, rtol=0.2)
    np.testing.assert_allclose((gyro - biases).std(), RTK.gyro_radps, rtol=0.03)
    np.testing.assert_allclose(yaw.std(), RTK.mag_rad, rtol=0.03)
    np.testing.assert_allclose(np.diff(height, axis=0).std(), np.sqrt(2.0) * RTK.baro_m, rtol=0.03)


def test_slow_errors_are_stationary_gauss_markov_processes():
    sensors = Sensors(GNSS, len(TRUTH), seed=4)
    north = np.array([sensors.read_gnss(TRUTH)[:, 0] - TRUTH[:, 0] for _ in range(6000)])
    slow = GNSS.gnss_horizontal_drift_m
    np.testing.assert_allclose(north.std(), np.hypot(slow.sigma, GNSS.gnss_horizontal_m), rtol=0.1)
    lag = round(slow.time_s / GNSS_PERIOD_S)
    correlation = (north[lag:] * north[:-lag]).mean() / slow.sigma**2
    np.testing.assert_allclose(correlation, np.exp(-1.0), atol=0.15)


def test_the_equivalent_white_variance_has_the_power_of_the_slow_error():
    slow = GNSS.baro_drift_m
    keep = np.exp(-INERTIAL_PERIOD_S / slow.time_s)
    exact = slow.sigma**2 * (1.0 + keep) / (1.0 - keep)  # sum of the autocovariances over all lags
    np.testing.assert_allclose(slow.equivalent_variance(INERTIAL_PERIOD_S), exact, rtol=1e-3)


def test_a_vehicle_hears_the_same_noise_in_any_fleet():
    few, many = Sensors(GNSS, 2, seed=9), Sensors(GNSS, 40, seed=9)
    for _ in range(300):
        np.testing.assert_array_equal(few.read_gnss(TRUTH[:2]), many.read_gnss(TRUTH)[:2])
        np.testing.assert_array_equal(few.read_inertial(TRUTH[:2]), many.read_inertial(TRUTH)[:2])


def test_another_seed_and_another_vehicle_hear_other_noise():
    first, other = Sensors(RTK, 2, seed=9), Sensors(RTK, 2, seed=10)
    same_place = np.zeros((2, 12))
    a, b = first.read_gnss(same_place), other.read_gnss(same_place)
    assert len(np.unique(np.concatenate([a, b]))) == a.size + b.size
