"""The distance from places to the ground of an elevation model: the least one to any of its bilinear cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.scenario.schema.heightmap import Relief
from gcs.types import Array

Index = NDArray[np.intp]

_STEPS = 20  # of Newton's method inside a cell
_SETTLED = 1e-7  # of a cell
_BLOCK = 200_000  # cells around places at once
_SEEDS = ((0.5, 0.5), (0.1, 0.1), (0.1, 0.9), (0.9, 0.1), (0.9, 0.9))


def distance_to_relief_m(relief: Relief, north: Array, east: Array, up: Array, known: Array) -> Array:
    """Distance (N,) to the relief where that is less than what is `known` (N,), which is returned elsewhere."""
    found = known.copy()
    row, column, to_metres = relief.local_grid(north, east)
    cells = 1 + int(np.ceil(known.max() / relief.least_step_m))
    highest = relief.highest_around_m(cells + 1)
    i, j = (np.floor(at).astype(np.intp) for at in (row, column))
    around = highest[np.clip(i, 0, highest.shape[0] - 1), np.clip(j, 0, highest.shape[1] - 1)]
    near = np.flatnonzero(up - known < around)
    window = np.stack(np.meshgrid(*[np.arange(-cells, cells + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    for part in np.array_split(near, max(int(np.ceil(len(near) * len(window) / _BLOCK)), 1)):
        _of_block(relief, part, (row, column, to_metres, up), window, found)
    return found


def _of_block(
    relief: Relief, part: Index, places: tuple[Array, Array, Array, Array], window: Index, found: Array
) -> None:
    row, column, to_metres, up = (values[part] for values in places)
    i = np.floor(row).astype(np.intp)[:, None] + window[:, 0]
    j = np.floor(column).astype(np.intp)[:, None] + window[:, 1]
    pixels = relief.pixels_m
    last_row, last_column = pixels.shape[0] - 1, pixels.shape[1] - 1
    top = np.full(i.shape, -np.inf)
    for di, dj in ((0, 0), (0, 1), (1, 0), (1, 1)):
        top = np.maximum(top, pixels[np.clip(i + di, 0, last_row), np.clip(j + dj, 0, last_column)])
    # A cell is at least as far as its box.
    beside_row = np.maximum(np.maximum(i - row[:, None], row[:, None] - i - 1.0), 0.0)
    beside_column = np.maximum(np.maximum(j - column[:, None], column[:, None] - j - 1.0), 0.0)
    beside = relief.least_step_m * np.hypot(beside_row, beside_column)
    below = np.maximum(up[:, None] - top, 0.0)
    who, cell = np.nonzero(np.hypot(beside, below) < found[part][:, None])
    if not len(who):
        return
    i, j = i[who, cell], j[who, cell]
    corners = np.stack(
        [
            pixels[np.clip(i + di, 0, last_row), np.clip(j + dj, 0, last_column)]
            for di, dj in ((0, 0), (1, 0), (0, 1), (1, 1))
        ]
    )
    u0, v0 = row[who] - i, column[who] - j
    squared = _to_patch(corners, u0, v0, to_metres[who], up[who])
    least = found[part] ** 2
    np.minimum.at(least, who, squared)
    found[part] = np.sqrt(least)


def _to_patch(corners: Array, u0: Array, v0: Array, metric: Array, up: Array) -> Array:
    """Squared distance (C,) from places at (u0, v0) in cells to the cells' bilinear surfaces over [0, 1] x [0, 1]."""
    base, along_u, along_v = corners[0], corners[1] - corners[0], corners[2] - corners[0]
    twist = corners[3] - corners[1] - corners[2] + corners[0]
    # Lengths on the ground: |K (du, dv)|^2 = guu du^2 + 2 guv du dv + gvv dv^2.
    guu, guv, gvv = (np.einsum("ck,ck->c", metric[:, :, a], metric[:, :, b]) for a, b in ((0, 0), (0, 1), (1, 1)))

    def squared(u: Array, v: Array) -> Array:
        du, dv = u - u0, v - v0
        lack = up - (base + along_u * u + along_v * v + twist * u * v)
        return np.asarray(guu * du * du + 2.0 * guv * du * dv + gvv * dv * dv + lack * lack)

    least = np.full(len(up), np.inf)
    # On an edge the surface is a straight line: its nearest point has a formula.
    for fixed in (0.0, 1.0):
        slope, start = along_u + twist * fixed, base + along_v * fixed
        u = (guu * u0 - guv * (fixed - v0) + slope * (up - start)) / (guu + slope * slope)
        least = np.minimum(least, squared(np.clip(u, 0.0, 1.0), np.full_like(u, fixed)))
        slope, start = along_v + twist * fixed, base + along_u * fixed
        v = (gvv * v0 - guv * (fixed - u0) + slope * (up - start)) / (gvv + slope * slope)
        least = np.minimum(least, squared(np.full_like(v, fixed), np.clip(v, 0.0, 1.0)))
    for seed_u, seed_v in _SEEDS:
        u, v = np.full_like(up, seed_u), np.full_like(up, seed_v)
        best = squared(u, v)
        share = np.ones_like(u)
        for _ in range(_STEPS):
            p, q = along_u + twist * v, along_v + twist * u
            lack = up - (base + along_u * u + along_v * v + twist * u * v)
            pull_u = guu * (u - u0) + guv * (v - v0) - lack * p
            pull_v = guv * (u - u0) + gvv * (v - v0) - lack * q
            huu, huv, hvv = guu + p * p, guv + p * q, gvv + q * q
            determinant = huu * hvv - huv * huv
            step_u = np.clip(u - share * (hvv * pull_u - huv * pull_v) / determinant, 0.0, 1.0) - u
            step_v = np.clip(v - share * (huu * pull_v - huv * pull_u) / determinant, 0.0, 1.0) - v
            value = squared(u + step_u, v + step_v)
            better = value <= best
            u, v, best = np.where(better, u + step_u, u), np.where(better, v + step_v, v), np.where(better, value, best)
            share = np.where(better, np.minimum(1.5 * share, 1.0), 0.3 * share)
            if max(np.abs(step_u).max(), np.abs(step_v).max()) < _SETTLED:
                break
        least = np.minimum(least, best)
    return least
