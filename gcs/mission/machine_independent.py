"""Rounding that gives the same files on all machines.

The last bits of a sum or of a sine depend on the processor and its libraries. Searches therefore take their inputs from
a grid that is far coarser than round-off, and of equal candidates the first one. What is written is rounded.
"""

import math

import numpy as np

from gcs.types import Array

SAMPLE_GRID = 2.0**-13  # m: of positions from which waypoints are chosen; 0.12 mm
ORDER_GRID = 2.0**-8  # m and s: of waypoints and due times for which speeds are searched; an item's own step is 11 mm
EQUAL = 1e-6  # values that differ by less are equal
_INDEX_DECIMALS = 5
_CERTAIN = 1e-8  # far more than the last bits of a bound, far less than the last decimal of an index


def on_grid(values: Array, grid: float) -> Array:
    """The nearest multiples of `grid`, a power of two: decimal lengths are then never halfway between two of them."""
    return np.asarray(np.round(np.asarray(values) / grid) * grid + 0.0)


def first_least(values: Array) -> int:
    """The flat index of the first value that is the least, or within `EQUAL` of it; NaN counts as none."""
    flat = np.ravel(values)
    return int(np.argmax(flat <= np.nanmin(flat) + EQUAL))


def rounded_down(bound: float, decimals: int = _INDEX_DECIMALS) -> float:
    """A lower bound as it is written: rounded down, so that what is written holds."""
    scale = 10.0**decimals
    return math.floor((bound - _CERTAIN) * scale) / scale if math.isfinite(bound) else bound


def rounded(document: object) -> object:
    """A JSON document with every number rounded to hundredths of a millimetre, and of a millisecond."""
    if isinstance(document, float):
        return round(document, _INDEX_DECIMALS) + 0.0
    if isinstance(document, dict):
        return {key: rounded(value) for key, value in document.items()}
    if isinstance(document, list | tuple):
        return [rounded(value) for value in document]
    return document
