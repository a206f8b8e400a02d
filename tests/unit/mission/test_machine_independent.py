"""Grids, equal candidates and rounding, worked by hand."""

from __future__ import annotations

import json

import numpy as np

from gcs.mission.machine_independent import ORDER_GRID, SAMPLE_GRID, first_least, on_grid, rounded


def test_decimal_lengths_are_not_halfway_between_two_multiples() -> None:
    lengths_m = np.arange(-2000, 2001) / 200.0
    for grid in (SAMPLE_GRID, ORDER_GRID):
        for noise_m in (-1e-10, 1e-10):
            assert np.array_equal(on_grid(lengths_m + noise_m, grid), on_grid(lengths_m, grid))
        assert np.abs(on_grid(lengths_m, grid) - lengths_m).max() <= grid / 2.0


def test_no_negative_zero_is_made() -> None:
    assert not np.signbit(on_grid(np.array([-1e-9]), SAMPLE_GRID)).any()
    assert json.dumps(rounded({"a_m": -1e-9, "b": [0.1234567, (1, "x", None, True)]})) == (
        '{"a_m": 0.0, "b": [0.12346, [1, "x", null, true]]}'
    )


def test_of_equal_values_the_first_counts() -> None:
    assert first_least(np.array([[3.0, 0.5 + 1e-12], [0.5, 0.5 - 1e-12]])) == 1
    assert first_least(np.array([np.nan, 2.0, 1.0, np.nan])) == 2
    assert first_least(np.array([1.0, 1.0 - 1e-3])) == 1
