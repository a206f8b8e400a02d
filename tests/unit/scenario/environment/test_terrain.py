"""Eqs. 52 and 53 against a second writing of them, and the promises of the envelope."""

from __future__ import annotations

import math

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.scenario.environment.terrain import ground_envelope_m, ground_height_m, ripple_height_m, ripple_peak_m
from gcs.scenario.schema.scenario import Mountains, Ripple, Scenario, Terrain

coefficient = st.floats(-3.0, 3.0)
ripples = st.builds(
    Ripple,
    a=st.floats(-20, 20),
    b=coefficient,
    c=coefficient,
    d=coefficient,
    e=coefficient,
    f=coefficient,
    g=coefficient,
)
places = st.floats(-50.0, 1550.0)


def eq_52(x: float, y: float) -> float:
    """As printed, with §4's a..g."""
    a, b, c, d, e, f, g = 10, 0.2, 0.1, 0.6, 1, 0.1, 0.1
    r = math.sqrt(x**2 + y**2)
    return abs(math.sin(y + a) + b * math.sin(x) + c * math.cos(d * r) + e * math.cos(y) + f * math.sin(g * r))


def eq_53(x: float, y: float) -> float:
    """As printed, with §4's seven mountains (h, x, y, x_s, y_s)."""
    peaks = [
        (55, 500, 1100, 50, 50),
        (20, 300, 410, 40, 30),
        (40, 300, 800, 30, 20),
        (30, 1300, 450, 86, 79),
        (48, 760, 750, 87, 83),
        (25, 700, 200, 60, 90),
        (31, 1300, 1300, 30, 30),
    ]
    return sum(h * math.exp(-(((x - xi) / xs) ** 2) - ((y - yi) / ys) ** 2) for h, xi, yi, xs, ys in peaks)


@given(places, places)
def test_ground_is_the_larger_of_both_equations(simulation1: Scenario, north: float, east: float) -> None:
    ours = ground_height_m(simulation1.terrain, np.array(north), np.array(east))
    assert float(ours) == pytest.approx(max(eq_52(north, east), eq_53(north, east)), rel=1e-12, abs=1e-12)


def test_flat_ground_is_zero_with_the_shape_of_its_arguments() -> None:
    height = ground_height_m(Terrain(), np.zeros((2, 3)), np.ones((2, 3)))
    assert height.shape == (2, 3)
    assert not height.any()
    assert ground_envelope_m(Terrain(), np.zeros((2, 3)), np.ones((2, 3))).shape == (2, 3)


def test_the_papers_ripple_nearly_reaches_its_peak(simulation1: Scenario) -> None:
    ripple = simulation1.terrain.ripple
    assert ripple is not None
    random = np.random.default_rng(5)
    north, east = random.uniform(0, 1500, (2, 1_000_000))
    highest = float(ripple_height_m(ripple, north, east).max())
    assert 0.97 * ripple_peak_m(ripple) < highest <= ripple_peak_m(ripple)


@given(ripples, places, places)
def test_no_ripple_exceeds_its_peak(ripple: Ripple, north: float, east: float) -> None:
    assert float(ripple_height_m(ripple, np.array(north), np.array(east))) <= ripple_peak_m(ripple) + 1e-12


@given(places, places)
def test_the_envelope_is_nowhere_below_the_ground(simulation1: Scenario, north: float, east: float) -> None:
    at = np.array(north), np.array(east)
    assert ground_envelope_m(simulation1.terrain, *at) >= ground_height_m(simulation1.terrain, *at)


def test_the_envelope_bends_gently_where_mountain_meets_ripple(simulation1: Scenario) -> None:
    """Second differences on two grids agree: there is a second derivative, where the exact ground has a corner."""
    terrain = simulation1.terrain
    north = np.linspace(330.0, 430.0, 20_001)  # down the flank of the mountain at (300, 410)
    east = np.full_like(north, 410.0)
    step = north[1] - north[0]
    fine = np.diff(ground_envelope_m(terrain, north, east), 2) / step**2
    coarse = np.diff(ground_envelope_m(terrain, north[::2], east[::2]), 2) / (2 * step) ** 2
    middle = fine[1::2]  # centred where the coarse differences are
    scale = np.abs(fine).max()
    assert np.abs(middle - coarse).max() < 1e-3 * scale
    assert np.abs(np.diff(fine)).max() < 0.02 * scale
    assert terrain.ripple is not None
    mountains = ground_height_m(Terrain(mountains=terrain.mountains), north, east)
    cornered = np.diff(np.maximum(ripple_peak_m(terrain.ripple), mountains), 2) / step**2
    assert np.abs(cornered).max() > 10 * scale


@given(places, places)
def test_symbols_and_arrays_get_the_same_envelope(simulation1: Scenario, north: float, east: float) -> None:
    x, y = casadi.SX.sym("x"), casadi.SX.sym("y")
    symbolic = casadi.Function("h", [x, y], [ground_envelope_m(simulation1.terrain, x, y, casadi)])
    numeric = ground_envelope_m(simulation1.terrain, np.array(north), np.array(east))
    assert float(symbolic(north, east)) == pytest.approx(float(numeric), rel=1e-12, abs=1e-12)


def test_one_mountain_is_its_height_on_top() -> None:
    one = Mountains(north_m=(5.0,), east_m=(6.0,), height_m=(7.0,), spread_north_m=(2.0,), spread_east_m=(3.0,))
    assert float(ground_height_m(Terrain(mountains=one), np.array(5.0), np.array(6.0))) == 7.0
