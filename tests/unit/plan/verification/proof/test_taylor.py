"""Taylor models: what they enclose contains the sampled values, and what they leave over shrinks with their order."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.plan.verification.proof.taylor import FUNCTIONS, Taylor, arctan2
from gcs.types import Array

S = np.linspace(-1.0, 1.0, 201)


def of(coefficients: list[float], order: int, remainder: float = 0.0) -> Taylor:
    """One quantity."""
    c = np.zeros((order + 1, 1))
    c[: len(coefficients), 0] = coefficients
    return Taylor(c, np.array([remainder]))


def values(model: Taylor) -> Array:
    """The polynomial at S."""
    return np.polynomial.polynomial.polyval(S, model.c[:, 0])


def assert_encloses(model: Taylor, exact: Array) -> None:
    off = np.abs(values(model) - exact)
    slack = 1e-12 * (1.0 + np.abs(exact))
    assert np.all(off <= model.remainder[0] + slack), float(off.max())
    low, high = model.range()
    assert np.all(low[0] <= exact + slack)
    assert np.all(exact <= high[0] + slack)


small = st.floats(-1.0, 1.0)
polynomials = st.lists(small, min_size=1, max_size=3)
UNARY: dict[str, tuple[Callable[[Any], Any], Callable[[Array], Array], float]] = {
    "sin": (FUNCTIONS.sin, np.sin, 0.0),
    "cos": (FUNCTIONS.cos, np.cos, 0.0),
    "exp": (lambda x: x.exp(), np.exp, 0.0),
    "atan": (lambda x: x.atan(), np.arctan, 0.0),
    "square": (lambda x: x.square(), np.square, 0.0),
    "sqrt": (FUNCTIONS.sqrt, np.sqrt, 3.5),
    "power 0.3": (lambda x: x**0.3, lambda v: v**0.3, 3.5),
    "power -2": (lambda x: x.power(-2.0), lambda v: v**-2.0, 3.5),
    "1 / x": (lambda x: 1.0 / x, lambda v: 1.0 / v, 3.5),
    "-1 / x": (lambda x: 1.0 / x, lambda v: 1.0 / v, -3.5),
}


@pytest.mark.parametrize("name", UNARY)
@settings(max_examples=40, deadline=None)
@given(c=polynomials, order=st.integers(2, 6))
def test_a_function_of_a_polynomial_is_enclosed(name: str, c: list[float], order: int) -> None:
    function, exact, offset = UNARY[name]
    inner = of(c, order) + offset
    assert_encloses(function(inner), exact(values(inner)))


@settings(max_examples=60, deadline=None)
@given(a=polynomials, b=polynomials, order=st.integers(2, 6), left_out=st.floats(0.0, 0.3), within=small)
def test_a_product_is_enclosed_with_what_its_factors_leave_out(
    a: list[float], b: list[float], order: int, left_out: float, within: float
) -> None:
    first, second = of(a, order, left_out), of(b, order)
    x, y = values(first) + within * left_out, values(second)
    assert_encloses(first * second, x * y)
    assert_encloses(second * first, x * y)
    assert_encloses(first + second, x + y)
    assert_encloses(2.0 - first, 2.0 - x)
    assert_encloses(first / -4.0, x / -4.0)
    assert_encloses(first / (second + 3.5), x / (y + 3.5))
    assert_encloses(2.0 / (second + 3.5), 2.0 / (y + 3.5))


@settings(max_examples=60, deadline=None)
@given(a=polynomials, angle=st.floats(-10.0, 10.0), order=st.integers(2, 6), size=st.floats(4.0, 9.0))
def test_an_angle_is_continuous_across_pi(a: list[float], angle: float, order: int, size: float) -> None:
    """Around any direction, the one at which arctan2 jumps too."""
    turn = of(a, order)
    y, x = (turn + angle).sin() * size, (turn + angle).cos() * size
    if abs(np.ptp(values(turn))) > 1.5:
        return  # it turns too far: infinitely wide is right
    found = arctan2(y, x)
    exact = values(turn) + angle
    exact += 2.0 * np.pi * np.round((found.c[0, 0] - exact[100]) / (2.0 * np.pi))
    low, high = found.range()
    assert np.all(low[0] - 1e-9 <= exact)
    assert np.all(exact <= high[0] + 1e-9)


@pytest.mark.parametrize("c", [[0.5, 1.0], [0.0, 0.1], [-1.0, 0.0], [1.0, 1.0]])
def test_a_power_of_what_may_be_zero_or_less_is_bounded_by_nothing(c: list[float]) -> None:
    assert np.isinf(of(c, 3).sqrt().remainder[0])


def test_one_over_what_changes_its_sign_is_bounded_by_nothing_and_its_middle_is_real() -> None:
    """The middle of the interval is a real value: it must stay one where the enclosure says nothing."""
    found = of([0.5, 1.0], 3).reciprocal()
    assert np.isinf(found.remainder[0])
    assert found.middle[0] == pytest.approx(2.0)
    assert of([0.25, 1.0], 2).sqrt().middle[0] == pytest.approx(0.5)


@pytest.mark.parametrize("name", ["sin", "exp", "sqrt", "1 / x", "atan"])
@pytest.mark.parametrize("order", [2, 3, 5])
def test_the_remainder_falls_with_the_interval_to_the_power_of_the_order_plus_one(name: str, order: int) -> None:
    function, _, offset = UNARY[name]
    left = [float(function(of([0.3 + offset, r], order)).remainder[0]) for r in (0.1, 0.05, 0.025)]
    rates = np.log2(np.array(left[:-1]) / left[1:])
    np.testing.assert_allclose(rates, order + 1, atol=0.25)


@settings(max_examples=200, deadline=None)
@given(st.tuples(*[st.floats(-5.0, 5.0)] * 3))
def test_the_range_of_a_parabola_is_exact(c: tuple[float, float, float]) -> None:
    low, high = of(list(c), 2).range()
    fine = np.polynomial.polynomial.polyval(np.linspace(-1.0, 1.0, 20001), c)
    assert low[0] - 1e-150 <= fine.min() <= low[0] + 1e-7
    assert high[0] - 1e-7 <= fine.max() <= high[0] + 1e-150
