"""The ground of an elevation model: its measured heights, and a smooth surface above them.

`gcs.scenario.environment.dem` reads it from a file. A scenario and a plan contain it, so they need no other file.

Between four pixel centres the ground is bilinear, as the elevation model defines it. The smooth surface is a uniform
cubic B-spline. Where it would lie below the ground, its coefficients are raised. A height is a weighted mean of the
sixteen coefficients around a place, so raising all of them by the missing height is enough.
"""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy import ndimage

from gcs.scenario.schema.fields import Findings, Number, Part
from gcs.types import Array

PIXELS_MAX = 4_000_000
_PIXEL_BYTES = 4
TERMS = 10  # of a cubic polynomial of two variables
ENVELOPE_RESERVE_M = 0.02  # over what is asked of it
_STEP = 0.5  # of the pixels: half of them follow the ground four times as closely
_SUBSAMPLES = 4  # of a cell of the envelope, each way
_MARGIN_CELLS = 4
_CELLS_MAX = 500_000

PIXEL_LEAST_M, PIXEL_MOST_M = 0.01, 100_000.0
_HEIGHT_MOST_M = 20_000.0
_ENVELOPE_SIDE_MAX = 50_000  # cells

# A margin around the scenario's box is covered too.
Covered = Annotated[Number, Field(ge=-1e6, le=1e6)]
Term = Annotated[Number, Field(ge=-1e9, le=1e9)]
Polynomial = tuple[Term, Term, Term, Term, Term, Term, Term, Term, Term, Term]


@dataclass(frozen=True)
class Region:
    """What the ground is needed of, m north and east of the origin."""

    north_m: tuple[float, float]
    east_m: tuple[float, float]


class Relief(Part):
    """An elevation model in the local frame; made by reading a file, not by hand."""

    rows: int = Field(ge=2, description="pixels from one end to the other, first axis")
    columns: int = Field(ge=2, description="pixels along the second axis")
    heights: str = Field(description="m above height 0: float32, little endian, row by row; zlib, base64")
    centre_m: tuple[Covered, Covered] = Field(description="north, east of where the polynomials are expanded, m")
    reach_m: Number = Field(ge=0.001, le=1e6, description="unit of their variables, m")
    row: Polynomial = Field(description="row of a place, counted from 0 at the first pixel's centre")
    column: Polynomial = Field(description="column of a place")
    spacing_m: Number = Field(
        ge=PIXEL_LEAST_M, le=PIXEL_MOST_M, description="distance between two pixels, the smaller one, m"
    )
    north_m: tuple[Covered, Covered] = Field(description="[low, high] of what is covered for certain, m")
    east_m: tuple[Covered, Covered] = Field(description="[low, high] of what is covered for certain, m")

    def _disagreements(self) -> Findings:
        try:
            table = self.pixels_m
        except ValueError as problem:
            yield ("heights",), f"cannot be unpacked: {problem}"
            return
        if not np.all(np.abs(table) <= _HEIGHT_MOST_M):
            yield ("heights",), f"has places without a height, or with one beyond {_HEIGHT_MOST_M:g} m"
        for key, (low_m, high_m) in (("north_m", self.north_m), ("east_m", self.east_m)):
            if low_m >= high_m:
                yield (key,), "must be [low, high] with low < high"

    def __eq__(self, other: object) -> bool:
        """The same numbers; what was worked out from them is no matter."""
        return isinstance(other, Relief) and self.model_dump() == other.model_dump()

    def __hash__(self) -> int:
        """Of the heights, which hardly two have in common."""
        return hash(self.heights)

    @cached_property
    def pixels_m(self) -> Array:
        """Heights (rows, columns) above height 0. Raises ValueError when they cannot be unpacked."""
        size = _PIXEL_BYTES * self.rows * self.columns
        if self.rows * self.columns > PIXELS_MAX:
            raise ValueError(f"{self.rows:,} times {self.columns:,} pixels; the limit is {PIXELS_MAX:,}")
        try:
            raw = zlib.decompressobj().decompress(base64.b64decode(self.heights, validate=True), size + 1)
        except zlib.error as problem:
            raise ValueError(str(problem)) from None
        if len(raw) != size:
            raise ValueError(f"they unpack to {'more' if len(raw) > size else 'less'} than {size:,} bytes")
        return np.frombuffer(raw, dtype="<f4").astype(np.float64).reshape(self.rows, self.columns)

    def height_m(self, north_m: Array, east_m: Array) -> Array:
        """Bilinear height (...) at places (...); beyond the last pixel the ground goes on level."""
        return _interpolated(self.pixels_m, self.pixel_place(*np.broadcast_arrays(north_m, east_m)), order=1)

    def pixel_place(self, north_m: Array, east_m: Array) -> Array:
        """Row and column (2, ...) of places (...)."""
        terms = terms_of((north_m - self.centre_m[0]) / self.reach_m, (east_m - self.centre_m[1]) / self.reach_m)
        return np.stack([np.tensordot(np.array(p), terms, axes=1) for p in (self.row, self.column)])

    def local_grid(self, north_m: Array, east_m: Array) -> tuple[Array, Array, Array]:
        """Row and column (N,) of places (N,), and what one of each is there in m north and east (N, 2, 2)."""
        x, y = (north_m - self.centre_m[0]) / self.reach_m, (east_m - self.centre_m[1]) / self.reach_m
        one, none = np.ones_like(x), np.zeros_like(x)
        terms = terms_of(x, y)
        by_x = np.stack([none, one, none, 2 * x, y, none, 3 * x * x, 2 * x * y, y * y, none])
        by_y = np.stack([none, none, one, none, x, 2 * y, none, x * x, 2 * x * y, 3 * y * y])
        polynomials = np.array([self.row, self.column])
        row, column = (np.asarray(part @ terms) for part in polynomials)
        slopes = np.stack([polynomials @ by_x, polynomials @ by_y], axis=1) / self.reach_m  # (place, axis, N)
        return row, column, np.asarray(np.linalg.inv(np.moveaxis(slopes, 2, 0)), dtype=np.float64)

    @cached_property
    def least_step_m(self) -> float:
        """A length in m that one pixel measures at least, in any direction."""
        _, _, to_metres = self.local_grid(*(np.array([0.5 * sum(axis)]) for axis in (self.north_m, self.east_m)))
        return 0.999 * float(np.linalg.svd(to_metres[0], compute_uv=False)[-1])

    @cached_property
    def steepness(self) -> float:
        """A slope (rise over run) that the ground nowhere exceeds."""
        steps = (np.abs(np.diff(self.pixels_m, axis=axis)).max() for axis in (0, 1))
        return float(np.hypot(*steps)) / self.least_step_m

    def highest_around_m(self, cells: int) -> Array:
        """For each pixel (rows, columns) the highest one within this number of cells."""
        known = self._highest
        if cells not in known:
            known[cells] = ndimage.maximum_filter(self.pixels_m, 2 * cells + 1, mode="nearest")
        return known[cells]

    @cached_property
    def _highest(self) -> dict[int, Array]:
        return {}

    @cached_property
    def envelope(self) -> Envelope:
        """The smooth surface that the planner uses; the relief is nowhere above it."""
        return _envelope(self)


class Envelope:
    """A uniform bicubic B-spline: twice differentiable, nowhere below the relief it is made for."""

    def __init__(self, first_m: tuple[float, float], step_m: float, coefficients_m: Array) -> None:
        """Coefficient (i, j) of the table (I, J) stands at `first_m` + (i, j) `step_m`, north and east."""
        self.first_m, self.step_m, self.coefficients_m = first_m, step_m, coefficients_m

    def height_m(self, north_m: Array, east_m: Array) -> Array:
        """Height (...) at places (...); beyond the table it goes on level."""
        places = np.stack(np.broadcast_arrays(north_m, east_m))
        index = (places - np.reshape(self.first_m, (2, *[1] * (places.ndim - 1)))) / self.step_m
        last = np.reshape(np.array(self.coefficients_m.shape) - 2.0, (2, *[1] * (places.ndim - 1)))
        inside = np.clip(index, 1.0, last)
        return _interpolated(self.coefficients_m, inside, order=3)


def terms_of(north: Array, east: Array) -> Array:
    """The ten terms (10, ...) of a cubic polynomial in two variables, each about one in size."""
    one = np.ones_like(north)
    squares = (north * north, north * east, east * east)
    return np.stack([one, north, east, *squares, *(north * s for s in squares), east * squares[2]])


def packed(heights_m: Array) -> str:
    """A table of heights as text for a scenario: float32, compressed, base64."""
    return base64.b64encode(zlib.compress(np.ascontiguousarray(heights_m, dtype="<f4").tobytes(), 9)).decode()


def _interpolated(table: Array, place: Array, order: int) -> Array:
    """B-spline of an order with these coefficients, at places (2, ...) in steps of the table."""
    flat = ndimage.map_coordinates(table, place.reshape(2, -1), order=order, mode="nearest", prefilter=False)
    return np.asarray(flat.reshape(place.shape[1:]))


def _envelope(relief: Relief) -> Envelope:
    low = np.array([relief.north_m[0], relief.east_m[0]])
    size = np.array([relief.north_m[1], relief.east_m[1]]) - low
    coarsest_m = float(np.sqrt(size.prod() / _CELLS_MAX)), float(size.max()) / _ENVELOPE_SIDE_MAX
    step = max(_STEP * relief.spacing_m, *coarsest_m)
    first = low - _MARGIN_CELLS * step
    count = np.ceil(size / step).astype(int) + 2 * _MARGIN_CELLS + 1
    north, east = (first[axis] + step * np.arange(count[axis]) for axis in (0, 1))
    surface = Envelope(
        (float(first[0]), float(first[1])), step, relief.height_m(*np.meshgrid(north, east, indexing="ij"))
    )
    fine = (np.linspace(axis[0], axis[-1], _SUBSAMPLES * (len(axis) - 1) + 1) for axis in (north, east))
    places = np.meshgrid(*fine, indexing="ij")
    below = relief.height_m(*places) - surface.height_m(*places)
    # A kink between two places stands out by no more than half of the second difference beside it, along each axis.
    hidden = sum(np.abs(ndimage.correlate1d(below, [1.0, -2.0, 1.0], axis, mode="nearest")) for axis in (0, 1))
    # Two kinks between the same two places may hide each other: they do so near the pixel where they cross.
    pixel = relief.pixel_place(*places)
    _, _, to_metres = relief.local_grid(*(np.array([0.5 * sum(axis)]) for axis in (relief.north_m, relief.east_m)))
    away_m = np.tensordot(to_metres[0], np.round(pixel) - pixel, axes=1)
    near = np.abs(away_m).max(axis=0) <= 0.51 * step / _SUBSAMPLES  # no other sample is nearer
    crossings = [axis[near] + away for axis, away in zip(places, away_m[:, near], strict=True)]
    most = below + 0.5 * hidden
    most[near] = np.maximum(most[near], relief.height_m(*crossings) - surface.height_m(*crossings))
    windows = np.lib.stride_tricks.sliding_window_view(most, (_SUBSAMPLES + 1,) * 2)
    missing = np.maximum(windows[::_SUBSAMPLES, ::_SUBSAMPLES].max(axis=(2, 3)), 0.0) + ENVELOPE_RESERVE_M
    # Cell (i, j) is made from coefficients i-1 .. i+2: coefficient i takes part in cells i-2 .. i+1.
    table = np.zeros((count[0] + 3, count[1] + 3))
    table[2 : 2 + missing.shape[0], 2 : 2 + missing.shape[1]] = missing
    pushed = np.lib.stride_tricks.sliding_window_view(table, (4, 4)).max(axis=(2, 3))
    raised = np.maximum(ENVELOPE_RESERVE_M, pushed)
    return Envelope(surface.first_m, step, surface.coefficients_m + raised)
