"""The air: how wind is written, the spectrum gusts have, and what neighbours feel."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import freqz, welch

from gcs.errors import UsageError
from sim_bridge.dynamics.wind_field import GUST_PERIOD_S, LENGTHS_M, VERTICAL_SHARE, Wind, WindField, dryden, parse_wind

FAR_APART = np.arange(40)[:, None] * np.array([[2000.0, 0.0, 0.0]])


def test_wind_is_written_as_where_it_comes_from():
    np.testing.assert_allclose(parse_wind("3@270").mean_ned_mps, [0.0, 3.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(parse_wind("2@0").mean_ned_mps, [-2.0, 0.0, 0.0], atol=1e-12)
    assert parse_wind().gust_mps == 0.0
    assert parse_wind("", "moderate").gust_mps > parse_wind("", "light").gust_mps > 0.0
    assert parse_wind("", "0.8") == Wind(None, 0.8)


@given(st.floats(0.0, 30.0), st.floats(-360.0, 360.0))
def test_any_wind_keeps_its_speed(speed, direction):
    wind = parse_wind(f"{speed}@{direction}")
    np.testing.assert_allclose(np.hypot(*wind.mean_ned_mps[:2]), speed, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("wind", ["3", "3@", "@270", "-1@0", "99@0", "3@400", "x@y", "nan@0", "3@nan", "inf@0"])
def test_nonsense_for_wind_is_quoted(wind):
    with pytest.raises(UsageError, match="--wind") as caught:
        parse_wind(wind)
    assert repr(wind) in caught.value.message and "3@270" in caught.value.hint


@pytest.mark.parametrize("gusts", ["strong", "-1", "nan", "inf", "31"])
def test_nonsense_for_gusts_is_quoted(gusts):
    with pytest.raises(UsageError, match="--gusts"):
        parse_wind("", gusts)


def test_without_gusts_the_wind_is_constant():
    field = WindField(Wind((1.0, -2.0, 0.0)), np.zeros((3, 3)), seed=1)
    first = field.draw()
    np.testing.assert_array_equal(first, np.tile([[1.0], [-2.0], [0.0]], 3))
    assert field.draw() is first


@pytest.mark.parametrize("transverse", [False, True])
def test_filters_have_the_spectrum_of_dryden(transverse):
    """|H(jω)|² of MIL-F-8785C up to frequencies near sampling, and a variance of exactly σ²."""
    sigma, time_s = 1.3, 4.0
    b, a = dryden(sigma, time_s, transverse=transverse)
    omega = np.geomspace(0.01, 10.0, 50)
    _, h = freqz(b, a, worN=omega * GUST_PERIOD_S)
    x = (omega * time_s) ** 2
    exact = sigma**2 * time_s * ((1.0 + 3.0 * x) / (1.0 + x) ** 2 if transverse else 2.0 / (1.0 + x))
    np.testing.assert_allclose(np.abs(h) ** 2 * GUST_PERIOD_S, exact, rtol=0.05)
    kernel = np.zeros(20_000)
    kernel[0] = 1.0
    from scipy.signal import lfilter

    np.testing.assert_allclose((lfilter(b, a, kernel) ** 2).sum(), sigma**2, rtol=1e-6)


@pytest.fixture(scope="module")
def gusts():
    """Along, across and vertical gusts (N, 3, V) of far-apart places in a wind out of the north-east."""
    field = WindField(parse_wind("6@45", "1.5"), FAR_APART, seed=2)
    samples = np.array([field.draw() for _ in range(4000)])
    to_ned = np.array([[-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [0.0, 0.0, np.sqrt(2.0)]]) / np.sqrt(2.0)
    mean = np.array([-6.0, -6.0, 0.0]) / np.sqrt(2.0)
    return np.einsum("ji,njv->niv", to_ned, samples - mean[:, None])


def test_gusts_have_their_deviation_from_the_first_sample_on(gusts):
    expected = 1.5 * np.array([1.0, 1.0, VERTICAL_SHARE])
    np.testing.assert_allclose(gusts.std(axis=(0, 2)), expected, rtol=0.1)
    np.testing.assert_allclose(gusts[0].std(axis=1), expected, rtol=0.5)
    np.testing.assert_allclose(gusts.mean(axis=(0, 2)), 0.0, atol=0.3)


def test_sampled_gusts_have_the_spectrum_of_dryden(gusts):
    time_s = LENGTHS_M[2] / 6.0
    f, power = welch(gusts[:, 2], fs=1.0 / GUST_PERIOD_S, nperseg=1024, axis=0)
    x = (2.0 * np.pi * f * time_s) ** 2
    exact = 2.0 * (1.5 * VERTICAL_SHARE) ** 2 * time_s * (1.0 + 3.0 * x) / (1.0 + x) ** 2
    band = (f > 0.05) & (f < 2.0)
    np.testing.assert_allclose(power.mean(axis=1)[band], exact[band], rtol=0.25)


def test_neighbours_are_pushed_together_and_strangers_are_not():
    places = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [5000.0, 0.0, 0.0]])
    fields = [WindField(Wind((4.0, 0.0, 0.0), 1.0), places, seed=s) for s in range(200)]
    samples = np.array([field.draw() for field in fields])
    for axis, length in enumerate(LENGTHS_M):
        like = np.corrcoef(samples[:, axis].T)
        np.testing.assert_allclose(like[0, 1], np.exp(-2.0 / length), atol=0.1)
        assert abs(like[0, 2]) < 0.25


def test_the_same_seed_blows_the_same_wind_for_the_first_vehicles_of_any_fleet():
    places = np.random.default_rng(1).normal(size=(5, 3)) * 10.0
    few, many, other = (
        WindField(Wind((1.0, 1.0, 0.0), 0.5), p, seed=s) for p, s in ((places[:2], 7), (places, 7), (places, 8))
    )
    for _ in range(300):
        a, b, c = few.draw(), many.draw(), other.draw()
        np.testing.assert_allclose(a, b[:, :2], atol=1e-12)
        assert np.abs(b - c).max() > 1e-6
