"""The least distance from a place to the ground in any direction, by trying places of the ground, denser and denser."""

from __future__ import annotations

import numpy as np

from gcs.scenario.schema.scenario import Terrain
from gcs.types import Array

_SIDE = 17  # places along one side of the first square
_ZOOMS, _ZOOM_SIDE = 8, 5
_STARTS = 3  # best places of the first square that are looked at closer
_CHUNK = 400


def height_up_m(terrain: Terrain, north_m: Array, east_m: Array) -> Array:
    """Height of the ground (...): Eq. 52, Eq. 53, or bilinear between the pixels of a relief."""
    if terrain.relief is not None:
        return _relief_m(terrain, north_m, east_m)
    peaks = np.zeros_like(north_m)
    hills = terrain.mountains
    for h, x, y, sx, sy in zip(
        hills.height_m, hills.north_m, hills.east_m, hills.spread_north_m, hills.spread_east_m, strict=True
    ):
        peaks = peaks + h * np.exp(-(((north_m - x) / sx) ** 2 + ((east_m - y) / sy) ** 2))
    k = terrain.ripple
    if k is None:
        return np.asarray(peaks)
    r = np.sqrt(north_m**2 + east_m**2)
    wave = np.sin(east_m + k.a) + k.b * np.sin(north_m) + k.c * np.cos(k.d * r)
    return np.maximum(np.abs(wave + k.e * np.cos(east_m) + k.f * np.sin(k.g * r)), peaks)


def distance_m(terrain: Terrain, places_ned_m: Array, enough_m: float = np.inf) -> Array:
    """Distance (N,) of places (N, 3) to the ground, negative below it; what is more than `enough_m` may be less."""
    parts = np.array_split(places_ned_m, len(places_ned_m) // _CHUNK + 1)
    found = [_distance(terrain, part, enough_m) for part in parts]
    return np.concatenate(found)


def _distance(terrain: Terrain, places: Array, enough_m: float) -> Array:
    above = -places[:, 2] - height_up_m(terrain, places[:, 0], places[:, 1])
    reach = np.minimum(np.abs(above), enough_m)
    square = np.linspace(-1.0, 1.0, _SIDE)
    offsets = np.stack(np.meshgrid(square, square, indexing="ij"), axis=-1).reshape(-1, 2)
    tried = places[:, None, :2] + reach[:, None, None] * offsets
    tried = np.concatenate([tried, _likely(terrain, places, reach)], axis=1)
    squared = _squared(terrain, places, tried)
    best = np.argpartition(squared, _STARTS, axis=1)[:, :_STARTS]
    centre = np.take_along_axis(tried, best[..., None], axis=1)
    least = squared.min(axis=1)
    size = np.broadcast_to((reach * 2.0 / (_SIDE - 1))[:, None], best.shape)
    around = np.linspace(-1.0, 1.0, _ZOOM_SIDE)
    near = np.stack(np.meshgrid(around, around, indexing="ij"), axis=-1).reshape(-1, 2)
    for _ in range(_ZOOMS):
        tried = centre[:, :, None] + size[:, :, None, None] * near
        squared = _squared(terrain, places, tried.reshape(len(places), -1, 2)).reshape(*size.shape, -1)
        inner = squared.argmin(axis=2)
        centre = np.take_along_axis(tried, inner[:, :, None, None], axis=2)[:, :, 0]
        least = np.minimum(least, squared.min(axis=(1, 2)))
        size = size * 0.5
    return np.where(above < 0.0, -1.0, 1.0) * np.minimum(np.sqrt(least), np.abs(above))


def _likely(terrain: Terrain, places: Array, reach: Array) -> Array:
    """Summits and the pixels around each place (N, M, 2), which a square of places may miss.

    Where the pixels of a relief do not stand straight, they are only near.
    """
    if terrain.relief is None:
        tops = np.array([terrain.mountains.north_m, terrain.mountains.east_m]).T.reshape(1, -1, 2)
        return np.repeat(tops, len(places), axis=0)
    span = np.arange(-2.0, 3.0) * terrain.relief.spacing_m
    offsets = np.stack(np.meshgrid(span, span, indexing="ij"), axis=-1).reshape(1, -1, 2)
    pixel = np.round(places[:, None, :2] / terrain.relief.spacing_m) * terrain.relief.spacing_m
    return np.asarray(pixel + offsets)


def _squared(terrain: Terrain, places: Array, tried: Array) -> Array:
    """Squared distance to the rock below the tried places, or to the air above them from a place in the rock."""
    up = height_up_m(terrain, tried[..., 0], tried[..., 1])
    here = height_up_m(terrain, places[:, 0], places[:, 1])
    side = np.where(-places[:, 2] < here, -1.0, 1.0)[:, None]
    fall = np.maximum(side * (-places[:, None, 2] - up), 0.0)
    return np.asarray(np.sum((tried - places[:, None, :2]) ** 2, axis=-1) + fall**2)


def _relief_m(terrain: Terrain, north_m: Array, east_m: Array) -> Array:
    """Bilinear between pixels; row and column are cubic polynomials of north and east."""
    relief = terrain.relief
    assert relief is not None
    table = relief.pixels_m
    n, e = (north_m - relief.centre_m[0]) / relief.reach_m, (east_m - relief.centre_m[1]) / relief.reach_m
    powers = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
    row, column = (
        sum(c * n**i * e**j for c, (i, j) in zip(p, powers, strict=True)) for p in (relief.row, relief.column)
    )
    row, column = np.clip(row, 0.0, len(table) - 1.0), np.clip(column, 0.0, table.shape[1] - 1.0)
    i, j = (np.minimum(part.astype(int), size - 2) for part, size in ((row, len(table)), (column, table.shape[1])))
    u, v = row - i, column - j
    low = (1.0 - v) * table[i, j] + v * table[i, j + 1]
    high = (1.0 - v) * table[i + 1, j] + v * table[i + 1, j + 1]
    return np.asarray((1.0 - u) * low + u * high)
