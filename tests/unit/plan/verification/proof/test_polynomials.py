"""Piecewise polynomials over intervals: each interval is enclosed as if it were alone."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly

from gcs.plan.verification.proof.polynomials import enclosed

ORDER = 4


def test_intervals_in_any_order_and_several_times_are_each_enclosed() -> None:
    rng = np.random.default_rng(7)
    polynomial = PPoly(rng.normal(size=(6, 3, 2)), np.array([0.0, 1.0, 3.0, 4.0]))
    # The same start with two ends, and two starts with the same end.
    start_s = np.array([1.0, 3.5, 1.0, 0.0, 1.0, 2.0, 1.0])
    end_s = np.array([3.0, 4.0, 2.0, 1.0, 3.0, 3.0, 2.0])
    for derivative in range(3):
        together = enclosed(polynomial, start_s, end_s, ORDER, derivative)
        exact = polynomial.derivative(derivative)
        for n, span_s in enumerate(zip(start_s, end_s, strict=True)):
            alone = enclosed(polynomial, *(np.array([at_s]) for at_s in span_s), ORDER, derivative)
            np.testing.assert_array_equal(together.c[:, :, n], alone.c[:, :, 0])
            np.testing.assert_array_equal(together.remainder[:, n], alone.remainder[:, 0])
            scaled = np.linspace(-1.0, 1.0, 21)
            values = np.polynomial.polynomial.polyval(scaled, together.c[:, :, n])  # (2, 21)
            t_s = 0.5 * sum(span_s) + 0.5 * (span_s[1] - span_s[0]) * scaled
            off = np.abs(values - exact(np.clip(t_s, span_s[0], np.nextafter(span_s[1], 0.0))).T)
            assert np.all(off <= together.remainder[:, n, None] + 1e-9)
