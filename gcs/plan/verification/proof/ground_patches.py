"""How far the ground reaches in a direction, over a patch: exact for an elevation model, with a bound for formulas.

A patch is a rectangle in the ground's own coordinates: north and east in metres for formulas, rows and columns for an
elevation model, which is bilinear between them.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from gcs.plan.verification.proof.subdivision import Mask
from gcs.scenario.environment.terrain import ground_height_m, mountain_height_m, ripple_peak_m
from gcs.scenario.schema.heightmap import Relief, terms_of
from gcs.scenario.schema.scenario import Mountains, Ripple, Terrain
from gcs.types import Array


class GroundPatches(Protocol):
    """The ground as patches (N, 4): least and largest first coordinate, least and largest second one."""

    def around(self, north_m: Array, east_m: Array, reach_m: Array) -> Array:
        """Patches (N, 4) that cover all ground within a horizontal reach (N,) of places (N,)."""
        ...

    def points_ned_m(self, first: Array, second: Array) -> Array:
        """Points (N, 3) of the ground at coordinates (N,)."""
        ...

    def nearest(self, patches: Array, north_m: Array, east_m: Array) -> tuple[Array, Array]:
        """Coordinates (N,) within the patches nearest to places (N,)."""
        ...

    def support(self, patches: Array, direction_ned: Array) -> Array:
        """An upper bound (N,) of direction . point over all ground of a patch; directions (N, 3) do not point down."""
        ...

    def parts(self, patches: Array) -> tuple[Array, Array]:
        """Two halves (N, 4) of each patch."""
        ...


def ground_patches(terrain: Terrain) -> GroundPatches:
    """The ground of a scenario."""
    return SmoothGround(terrain) if terrain.relief is None else ReliefGround(terrain.relief)


@dataclass(frozen=True)
class SmoothGround:
    """Eqs. 52 and 53: three smooth surfaces (the ripple, its mirror image, the mountains), the highest of them.

    Between the corners of a rectangle a surface lies below their bilinear interpolation plus a remainder from its
    second derivatives.
    """

    terrain: Terrain

    def around(self, north_m: Array, east_m: Array, reach_m: Array) -> Array:
        """See `GroundPatches`."""
        return np.stack([north_m - reach_m, north_m + reach_m, east_m - reach_m, east_m + reach_m], axis=1)

    def points_ned_m(self, first: Array, second: Array) -> Array:
        """See `GroundPatches`."""
        return np.stack([first, second, -ground_height_m(self.terrain, first, second)], axis=-1)

    def nearest(self, patches: Array, north_m: Array, east_m: Array) -> tuple[Array, Array]:
        """See `GroundPatches`."""
        return np.clip(north_m, patches[:, 0], patches[:, 1]), np.clip(east_m, patches[:, 2], patches[:, 3])

    def support(self, patches: Array, direction_ned: Array) -> Array:
        """See `GroundPatches`."""
        north, east = _corners(patches)
        flat = direction_ned[:, :1] * north + direction_ned[:, 1:2] * east
        up = -direction_ned[:, 2:]
        bend_m, highest_m = self._mountain_bounds_m(patches)
        surfaces: list[tuple[Array, Array, Array | float]] = [
            (mountain_height_m(self.terrain.mountains, north, east), bend_m, highest_m)
        ]
        if (ripple := self.terrain.ripple) is not None:
            wave, bend_m, peak_m = _wave_m(ripple, north, east), _wave_bend_m(ripple, patches), ripple_peak_m(ripple)
            surfaces += [(wave, bend_m, peak_m), (-wave, bend_m, peak_m)]
        found = [
            np.minimum((flat + up * height).max(axis=1) + up[:, 0] * bend, flat.max(axis=1) + up[:, 0] * highest)
            for height, bend, highest in surfaces
        ]
        return np.asarray(np.max(found, axis=0))

    def parts(self, patches: Array) -> tuple[Array, Array]:
        """See `GroundPatches`."""
        return _halves(patches, 0.5 * (patches[:, :1] + patches[:, 1:2]), 0.5 * (patches[:, 2:3] + patches[:, 3:]))

    def _mountain_bounds_m(self, patches: Array) -> tuple[Array, Array]:
        """Largest error (N,) of bilinear interpolation of Eq. 53 over the patch, and a height (N,) never exceeded.

        The second derivatives of h exp(-q) with q = (x / s)^2 + (y / s')^2 are at most h exp(-q) max(2, 4 q) /
        min(s, s')^2.
        """
        mountains = self.terrain.mountains
        bend, highest = np.zeros(len(patches)), np.zeros(len(patches))
        for height, summit, spread in _each(mountains):
            low, high = np.zeros(len(patches)), np.zeros(len(patches))
            for axis in range(2):
                a, b = patches[:, 2 * axis] - summit[axis], patches[:, 2 * axis + 1] - summit[axis]
                nearest = np.where((a <= 0.0) & (b >= 0.0), 0.0, np.minimum(np.abs(a), np.abs(b)))
                low += (nearest / spread[axis]) ** 2
                high += (np.maximum(np.abs(a), np.abs(b)) / spread[axis]) ** 2
            most = np.minimum(np.exp(-low) * np.maximum(2.0, 4.0 * high), 2.0)
            bend += abs(height) * most / min(spread) ** 2
            highest += max(height, 0.0) * np.exp(-low)
        return bend * _squared_sides(patches) / 8.0, highest


def _each(mountains: Mountains) -> list[tuple[float, tuple[float, float], tuple[float, float]]]:
    return [
        (height, (north, east), (spread_north, spread_east))
        for height, north, east, spread_north, spread_east in zip(
            mountains.height_m,
            mountains.north_m,
            mountains.east_m,
            mountains.spread_north_m,
            mountains.spread_east_m,
            strict=True,
        )
    ]


def _wave_m(ripple: Ripple, north_m: Array, east_m: Array) -> Array:
    """Eq. 52 before its absolute value is taken."""
    r = np.hypot(north_m, east_m)
    waves = np.sin(east_m + ripple.a) + ripple.b * np.sin(north_m) + ripple.e * np.cos(east_m)
    return np.asarray(waves + ripple.c * np.cos(ripple.d * r) + ripple.f * np.sin(ripple.g * r))


def _wave_bend_m(ripple: Ripple, patches: Array) -> Array:
    """Largest error (N,) of bilinear interpolation of Eq. 52: rings f sin(g r) have a corner at the origin."""
    squared = _squared_sides(patches)
    across = float(np.hypot(np.cos(ripple.a), np.sin(ripple.a) + ripple.e))
    curvature = across + abs(ripple.b) + abs(ripple.c) * ripple.d**2
    nearest = np.hypot(*(_from_zero(patches[:, 2 * axis], patches[:, 2 * axis + 1]) for axis in range(2)))
    slope = abs(ripple.f * ripple.g)
    with np.errstate(divide="ignore", invalid="ignore"):
        rings = np.maximum(slope * abs(ripple.g), slope / nearest) * squared / 8.0
    rings = np.fmin(rings, slope * np.sqrt(squared))  # a patch of no size at the origin has no bound of its own
    return np.asarray(curvature * squared / 8.0 + rings)


def _from_zero(low: Array, high: Array) -> Array:
    """The least absolute value (N,) in [low, high]."""
    return np.where((low <= 0.0) & (high >= 0.0), 0.0, np.minimum(np.abs(low), np.abs(high)))


def _squared_sides(patches: Array) -> Array:
    return np.asarray((patches[:, 1] - patches[:, 0]) ** 2 + (patches[:, 3] - patches[:, 2]) ** 2)


def _corners(patches: Array) -> tuple[Array, Array]:
    """Both coordinates (N, 4) of the corners."""
    return patches[:, [0, 0, 1, 1]], patches[:, [2, 3, 2, 3]]


def _halves(patches: Array, first: Array, second: Array) -> tuple[Array, Array]:
    """Both parts of each patch, divided along its longer side at a coordinate (N, 1)."""
    along = patches[:, 1:2] - patches[:, :1] >= patches[:, 3:] - patches[:, 2:3]
    a, b, c, d = (patches[:, i : i + 1] for i in range(4))
    low = np.hstack([a, np.where(along, first, b), c, np.where(along, d, second)])
    high = np.hstack([np.where(along, first, a), b, np.where(along, c, second), d])
    return low, high


@dataclass(frozen=True)
class ReliefGround:
    """An elevation model: bilinear within a pixel, so that a linear function has its maximum at a corner."""

    relief: Relief

    def around(self, north_m: Array, east_m: Array, reach_m: Array) -> Array:
        """See `GroundPatches`."""
        first, second = self._coordinates(north_m, east_m)
        reach = reach_m * self._pixels_per_m
        return np.stack([first - reach, first + reach, second - reach, second + reach], axis=1)

    def points_ned_m(self, first: Array, second: Array) -> Array:
        """See `GroundPatches`."""
        north, east = self._places(first, second)
        return np.stack([north, east, -self._height_m(first, second)], axis=-1)

    def nearest(self, patches: Array, north_m: Array, east_m: Array) -> tuple[Array, Array]:
        """See `GroundPatches`."""
        first, second = self._coordinates(north_m, east_m)
        return np.clip(first, patches[:, 0], patches[:, 1]), np.clip(second, patches[:, 2], patches[:, 3])

    def support(self, patches: Array, direction_ned: Array) -> Array:
        """See `GroundPatches`."""
        rows, columns = self._corners_and_edges(patches)
        north, east = self._places(rows, columns)
        flat = direction_ned[:, :1] * north + direction_ned[:, 1:2] * east
        up = -direction_ned[:, 2]
        exact = (flat + up[:, None] * self._height_m(rows, columns)).max(axis=1)
        # A height (N,) that no pixel of a patch exceeds
        shape = np.array(self.relief.pixels_m.shape)
        low = np.clip(np.floor(patches[:, [0, 2]]), 0, shape - 1).astype(int)
        high = np.clip(np.ceil(patches[:, [1, 3]]), 0, shape - 1).astype(int)
        level = np.ceil(np.log2((high - low).max(axis=1) + 1)).astype(int)
        found = np.empty(len(patches))
        for number in np.unique(level):
            chosen = level == number
            table = self._peaks[min(number, len(self._peaks) - 1)]
            found[chosen] = table[low[chosen, 0], low[chosen, 1]]
        crude = flat.max(axis=1) + up * found
        return np.asarray(np.where(self._few(patches), exact, crude) + self._map_bend_m(patches))

    def parts(self, patches: Array) -> tuple[Array, Array]:
        """See `GroundPatches`: at the edge of a pixel where there is one inside."""
        cut = []
        for axis in range(2):
            low, high = patches[:, 2 * axis : 2 * axis + 1], patches[:, 2 * axis + 1 : 2 * axis + 2]
            middle = 0.5 * (low + high)
            edge = np.round(middle)
            inside = (edge > low + _EDGE) & (edge < high - _EDGE)
            edge = np.where(inside, edge, np.floor(low) + 1.0)
            cut.append(np.where((edge > low + _EDGE) & (edge < high - _EDGE), edge, middle))
        return _halves(patches, cut[0], cut[1])

    @cached_property
    def _pixels_per_m(self) -> float:
        """The most pixels in a metre, over the whole map."""
        rates = [np.abs(self._gradient(p)).sum() for p in (self.relief.row, self.relief.column)]
        return float(max(rates))

    def _gradient(self, polynomial: tuple[float, ...]) -> Array:
        """Bounds (2,) of the derivatives of a coordinate, per metre."""
        p = np.abs(polynomial)
        reach = self.relief.reach_m
        north = p[1] + 2.0 * p[3] + p[4] + 3.0 * p[6] + 2.0 * p[7] + p[8]
        east = p[2] + p[4] + 2.0 * p[5] + p[7] + 2.0 * p[8] + 3.0 * p[9]
        return np.array([north, east]) / reach

    @cached_property
    def _affine(self) -> tuple[Array, Array]:
        """The coordinates at the centre (2,), and the inverse of their derivatives there (2, 2), m per pixel."""
        polynomials: Array = np.array([self.relief.row, self.relief.column], dtype=np.float64)
        back: Array = np.asarray(np.linalg.inv(polynomials[:, 1:3] / self.relief.reach_m), dtype=np.float64)
        return polynomials[:, 0], back

    def _coordinates(self, north_m: Array, east_m: Array) -> tuple[Array, Array]:
        relief = self.relief
        north, east = (north_m - relief.centre_m[0]) / relief.reach_m, (east_m - relief.centre_m[1]) / relief.reach_m
        place: Array = np.tensordot(np.array([relief.row, relief.column]), terms_of(north, east), axes=1)
        return place[0], place[1]

    def _places(self, rows: Array, columns: Array) -> tuple[Array, Array]:
        """North and east (...) of coordinates (...): Newton's iteration from the affine part."""
        back = self._affine[1]
        north, east = np.full_like(rows, self.relief.centre_m[0]), np.full_like(columns, self.relief.centre_m[1])
        for _ in range(_NEWTON):
            first, second = self._coordinates(north, east)
            off = rows - first, columns - second
            north, east = (
                north + back[0, 0] * off[0] + back[0, 1] * off[1],
                east + back[1, 0] * off[0] + back[1, 1] * off[1],
            )
        return north, east

    def _height_m(self, rows: Array, columns: Array) -> Array:
        table = self.relief.pixels_m
        row, column = np.clip(rows, 0.0, table.shape[0] - 1.0), np.clip(columns, 0.0, table.shape[1] - 1.0)
        i = np.clip(np.floor(row).astype(int), 0, table.shape[0] - 2)
        j = np.clip(np.floor(column).astype(int), 0, table.shape[1] - 2)
        a, b = row - i, column - j
        return np.asarray(
            (1.0 - a) * ((1.0 - b) * table[i, j] + b * table[i, j + 1])
            + a * ((1.0 - b) * table[i + 1, j] + b * table[i + 1, j + 1])
        )

    @staticmethod
    def _few(patches: Array) -> Mask:
        """Whether each patch (N,) crosses one edge of pixels at most, each way."""
        low, high = patches[:, [0, 2]], patches[:, [1, 3]]
        return np.asarray((np.ceil(high - _EDGE) - np.floor(low + _EDGE)).max(axis=1) <= 2.0)

    @staticmethod
    def _corners_and_edges(patches: Array) -> tuple[Array, Array]:
        """Both coordinates (N, 9) of the corners and of the points between them at an edge of pixels."""
        three = []
        for axis in range(2):
            low, high = patches[:, 2 * axis], patches[:, 2 * axis + 1]
            three.append(np.stack([low, np.clip(np.floor(low + _EDGE) + 1.0, low, high), high], axis=1))
        return np.repeat(three[0], 3, axis=1), np.tile(three[1], (1, 3))

    @cached_property
    def _peaks(self) -> list[Array]:
        """The largest height of squares of 2^k pixels from a pixel on, for each k."""
        tables = [np.asarray(self.relief.pixels_m)]
        while (step := 1 << (len(tables) - 1)) < max(tables[0].shape):
            last = tables[-1]
            rows = np.minimum(np.arange(last.shape[0]) + step, last.shape[0] - 1)
            columns = np.minimum(np.arange(last.shape[1]) + step, last.shape[1] - 1)
            wide = np.maximum(last, last[:, columns])
            tables.append(np.maximum(wide, wide[rows]))
        return tables

    def _map_bend_m(self, patches: Array) -> Array:
        """How far (N,) places and coordinates of a patch differ from an affine map between its corners."""
        bend = 0.0
        for p in (np.abs(self.relief.row), np.abs(self.relief.column)):
            second = 2.0 * (p[3] + p[4] + p[5]) + 6.0 * (p[6] + p[7] + p[8] + p[9])
            bend = max(bend, float(second) / self.relief.reach_m**2)  # pixels per square metre
        per_pixel_m = float(np.abs(self._affine[1]).sum())
        sides = np.maximum(patches[:, 1] - patches[:, 0], patches[:, 3] - patches[:, 2])
        return np.asarray(bend * per_pixel_m * (sides * per_pixel_m) ** 2 / 2.0)


_EDGE = 1e-9  # pixels
_NEWTON = 6
