"""Upper bounds of the ground height over rectangles.

Mountains (Eq. 53) are bounded one by one at their nearest places, the ripple (Eq. 52) by its slope and by its peak. An
elevation model is bilinear, so its bound is its highest value where grid lines and edges meet. The smaller
the rectangle, the tighter the bound.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from gcs.scenario.environment.terrain import ripple_height_m, ripple_peak_m
from gcs.scenario.schema.heightmap import Relief, terms_of
from gcs.scenario.schema.scenario import Mountains, Ripple, Terrain
from gcs.types import Array

# Highest ground, m, over N rectangles with corners low and high (N, 2), north and east.
Highest = Callable[[Array, Array], Array]


def highest_ground(terrain: Terrain) -> Highest:
    """The bound of a scenario's ground, above height 0."""
    if terrain.relief is not None:
        return _ReliefBound(terrain.relief)
    mountains, ripple = terrain.mountains, terrain.ripple
    if ripple is None:
        return lambda low_m, high_m: _mountains(mountains, low_m, high_m)
    return lambda low_m, high_m: np.maximum(_mountains(mountains, low_m, high_m), _ripple(ripple, low_m, high_m))


def from_heights(height_m: Callable[[Array, Array], Array], slope_max: float) -> Highest:
    """The bound of a ground that is known by its heights alone and nowhere steeper than `slope_max`."""

    def highest(low_m: Array, high_m: Array) -> Array:
        middle = 0.5 * (low_m + high_m)
        reach_m = 0.5 * np.hypot(*(high_m - low_m).T)
        return np.asarray(height_m(middle[:, 0], middle[:, 1]) + slope_max * reach_m)

    return highest


def _mountains(mountains: Mountains, low_m: Array, high_m: Array) -> Array:
    total = np.zeros(len(low_m))
    for height_m, north, east, *spread_m in mountains.rows:
        centre = np.array([north, east])
        near = np.clip(centre, low_m, high_m) - centre
        if height_m < 0.0:  # a hollow: highest where it is farthest
            near = np.where(np.abs(low_m - centre) > np.abs(high_m - centre), low_m, high_m) - centre
        total += height_m * np.exp(-np.sum((near / np.array(spread_m)) ** 2, axis=1))
    return total


def _ripple(ripple: Ripple, low_m: Array, high_m: Array) -> Array:
    middle, half_m = 0.5 * (low_m + high_m), 0.5 * (high_m - low_m)
    # The slope along each axis, of the waves of that axis and of the rings.
    rings = abs(ripple.c * ripple.d) + abs(ripple.f * ripple.g)
    east = np.hypot(np.cos(ripple.a), np.sin(ripple.a) + ripple.e)
    rise_m = abs(ripple.b) * half_m[:, 0] + east * half_m[:, 1] + rings * np.hypot(*half_m.T)
    highest_m = ripple_height_m(ripple, middle[:, 0], middle[:, 1]) + rise_m
    return np.asarray(np.minimum(highest_m, ripple_peak_m(ripple)))


class _ReliefBound:
    """The bound of an elevation model."""

    def __init__(self, relief: Relief) -> None:
        self._relief = relief
        self._blocks = [relief.pixels_m]  # maxima over blocks of 2**level pixels each way
        while max(self._blocks[-1].shape) > 1:
            table = self._blocks[-1]
            rows, columns = table.shape
            even = np.pad(table, ((0, rows % 2), (0, columns % 2)), mode="edge")
            self._blocks.append(np.asarray(even.reshape(len(even) // 2, 2, -1, 2).max(axis=(1, 3))))

    def __call__(self, low_m: Array, high_m: Array) -> Array:
        low, high = self._pixels(low_m, high_m)
        last = np.array(self._relief.pixels_m.shape) - 1.0
        low, high = np.clip(low, 0.0, last), np.clip(high, 0.0, last)
        small = np.all(high - low <= 1.0, axis=1)
        found = np.empty(len(low))
        found[small] = self._within(low[small], high[small])
        found[~small] = self._over(low[~small], high[~small])
        return found

    def _within(self, low: Array, high: Array) -> Array:
        """Over less than a pixel each way: the highest of the corners, and of where grid lines cross."""
        cross = np.clip(np.ceil(low), low, high)
        places = np.stack([low, cross, high])  # (3, N, 2)
        rows = np.broadcast_to(places[:, None, :, 0], (3, 3, len(low)))
        columns = np.broadcast_to(places[None, :, :, 1], (3, 3, len(low)))
        index = np.stack([rows.ravel(), columns.ravel()])
        heights = ndimage.map_coordinates(self._relief.pixels_m, index, order=1, mode="nearest", prefilter=False)
        return np.asarray(heights.reshape(9, len(low)).max(axis=0))

    def _over(self, low: Array, high: Array) -> Array:
        """Over more pixels: the highest of all that belong to the rectangle's cells."""
        first, last = np.floor(low).astype(int), np.ceil(high).astype(int)
        level = np.ceil(np.log2(np.maximum((last - first + 1).max(axis=1, initial=1), 1))).astype(int)
        level = np.minimum(level, len(self._blocks) - 1)
        found = np.empty(len(low))
        for each in np.unique(level).tolist():
            rows = np.flatnonzero(level == each)
            begin, end = first[rows] >> each, last[rows] >> each  # the same block or neighbours
            ends = ((n, e) for n in (begin[:, 0], end[:, 0]) for e in (begin[:, 1], end[:, 1]))
            found[rows] = np.max([self._blocks[each][n, e] for n, e in ends], axis=0)
        return found

    def _pixels(self, low_m: Array, high_m: Array) -> tuple[Array, Array]:
        """Rectangles of rows and columns that hold the images of rectangles of places."""
        relief = self._relief
        middle, half = 0.5 * (low_m + high_m), 0.5 * (high_m - low_m) / relief.reach_m
        north, east = ((middle - np.array(relief.centre_m)) / relief.reach_m).T
        ends: list[NDArray[np.float64]] = []
        for polynomial in (relief.row, relief.column):
            centre = np.tensordot(np.array(polynomial), terms_of(north, east), axes=1)
            ends.append(np.stack([centre, _reach(polynomial, north, east, half)]))
        centre, reach = np.stack(ends, axis=-1)
        return centre - reach, centre + reach


def _reach(polynomial: tuple[float, ...], north: Array, east: Array, half: Array) -> Array:
    """How far a cubic of two variables is from its value in the middle, anywhere within `half` (N, 2)."""
    _, p1, p2, p11, p12, p22, p111, p112, p122, p222 = polynomial
    n, e, h, k = north, east, half[:, 0], half[:, 1]
    first = np.abs(p1 + 2 * p11 * n + p12 * e + 3 * p111 * n * n + 2 * p112 * n * e + p122 * e * e) * h
    first += np.abs(p2 + p12 * n + 2 * p22 * e + p112 * n * n + 2 * p122 * n * e + 3 * p222 * e * e) * k
    second = np.abs(p11 + 3 * p111 * n + p112 * e) * h * h + np.abs(p22 + p122 * n + 3 * p222 * e) * k * k
    second += np.abs(p12 + 2 * p112 * n + 2 * p122 * e) * h * k
    third = abs(p111) * h**3 + abs(p112) * h * h * k + abs(p122) * h * k * k + abs(p222) * k**3
    return np.asarray(first + second + third)
