"""The distance to the ground in any direction: beside a cliff it is less than the height above ground.

The ground is the union of solids with a smooth top each: the mountains, both signs of the ripple, or the cells of a
relief. The distance to a union is the least of the distances, so kinks of the ground need no special care.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gcs.scenario.environment.terrain import ground_height_m, ripple_peak_m, ripple_wave_m
from gcs.scenario.schema.heightmap import Relief
from gcs.scenario.schema.scenario import Mountains, Ripple, Terrain
from gcs.types import Array

Highest = Callable[[Array, Array, Array], Array]  # north, east, distance
Surface = Callable[[Array, Array], tuple[Array, Array, Array]]  # north, east -> height and its slopes north and east
Index = NDArray[np.intp]

_STEPS = 120  # of the Gauss-Newton method, at most: beside a sharp top it converges slowly
_SETTLED_M = 1e-5  # a foot so near to the true one leaves an error far below 0.1 mm
_STARTS = 3
_RINGS = (2, 12)  # least and most rings of trial places around a place
_BLOCK = 400_000  # trial places at once
_CELL_STEPS = 20  # of Newton's method inside a cell
_CELL_SETTLED = 1e-7  # of a cell
_CELL_BLOCK = 200_000  # cells around places at once
_SEEDS = ((0.5, 0.5), (0.1, 0.1), (0.1, 0.9), (0.9, 0.1), (0.9, 0.9))


def ground_distance_m(terrain: Terrain, north_m: Array, east_m: Array, up_m: Array, reach_m: float) -> Array:
    """Least distance (...) from places to the ground, in any direction; `reach_m` where it is larger than that.

    Below the ground it is the negative height above ground.
    """
    north, east, up = (np.asarray(part, dtype=np.float64) for part in np.broadcast_arrays(north_m, east_m, up_m))
    shape = north.shape
    north, east, up = north.ravel(), east.ravel(), up.ravel()
    above = up - ground_height_m(terrain, north, east)
    # No ground within the horizontal distance `d` is higher than the ground below plus `steepness * d`.
    least = above / np.hypot(1.0, steepness(terrain))
    found = np.minimum(above, reach_m)
    near = np.flatnonzero((above > 0.0) & (least < reach_m))
    if len(near):
        at = north[near], east[near], up[near]
        if terrain.relief is not None:
            found[near] = distance_to_relief_m(terrain.relief, *at, found[near])
        else:
            for surface, feature_m, highest_m in _surfaces(terrain):
                # A top that is lower than this everywhere around cannot be nearer.
                rows = near[at[2] - highest_m(at[0], at[1], found[near]) < found[near]]
                if len(rows):
                    away = _distance_to_surface(surface, feature_m, north[rows], east[rows], up[rows], found[rows])
                    found[rows] = np.minimum(found[rows], away)
    return found.reshape(shape)


def steepness(terrain: Terrain) -> float:
    """A slope (rise over run) that the ground nowhere exceeds."""
    if terrain.relief is not None:
        return terrain.relief.steepness
    # exp(-r^2) is steepest at r = sqrt(1/2), by sqrt(2/e).
    spread = np.minimum(terrain.mountains.spread_north_m, terrain.mountains.spread_east_m)
    mountains = float(np.sqrt(2.0 / np.e) * np.sum(np.abs(terrain.mountains.height_m) / spread))
    if terrain.ripple is None:
        return mountains
    r = terrain.ripple
    along_east = 1.0 + abs(r.e)
    return max(mountains, float(np.hypot(along_east, r.b)) + abs(r.c * r.d) + abs(r.f * r.g))


def _surfaces(terrain: Terrain) -> list[tuple[Surface, float, Highest]]:
    """The smooth tops whose largest is the ground; of each the size of its smallest feature in m, and how high it is
    at most within a distance of places."""
    mountains, ripple = terrain.mountains, terrain.ripple
    spread = min((*mountains.spread_north_m, *mountains.spread_east_m), default=np.inf)
    surfaces: list[tuple[Surface, float, Highest]] = [
        (partial(_mountains, mountains), 0.5 * float(spread), partial(_highest, mountains))
    ]
    if ripple is not None:
        feature_m, peak_m = 1.0 / max(1.0, abs(ripple.d), abs(ripple.g)), ripple_peak_m(ripple)
        for sign in (1.0, -1.0):
            top: Surface = partial(_ripple, ripple, sign)
            surfaces.append((top, feature_m, lambda n, _e, _d: np.full_like(n, peak_m)))
    return surfaces


def _mountains(mountains: Mountains, north: Array, east: Array) -> tuple[Array, Array, Array]:
    height, slope_north, slope_east = (np.zeros_like(north) for _ in range(3))
    for top, n, e, spread_n, spread_e in mountains.rows:
        x, y = (north - n) / spread_n, (east - e) / spread_e
        part = top * np.exp(-x * x - y * y)
        height += part
        slope_north -= 2.0 * x / spread_n * part
        slope_east -= 2.0 * y / spread_e * part
    return height, slope_north, slope_east


def _highest(mountains: Mountains, north: Array, east: Array, distance_m: Array) -> Array:
    """A height (N,) that mountains nowhere exceed within a distance (N,) of places."""
    height = np.zeros_like(north)
    for top, n, e, spread_n, spread_e in mountains.rows:
        x = np.maximum(np.abs(north - n) - distance_m, 0.0) / spread_n
        y = np.maximum(np.abs(east - e) - distance_m, 0.0) / spread_e
        height += max(top, 0.0) * np.exp(-x * x - y * y)
    return height


def _ripple(ripple: Ripple, sign: float, north: Array, east: Array) -> tuple[Array, Array, Array]:
    """Eq. 52 without its absolute value, times `sign`."""
    r = np.hypot(north, east)
    outward = ripple.f * ripple.g * np.cos(ripple.g * r) - ripple.c * ripple.d * np.sin(ripple.d * r)
    outward = outward / np.maximum(r, 1e-9)
    height = ripple_wave_m(ripple, north, east)
    slope_north = ripple.b * np.cos(north) + outward * north
    slope_east = np.cos(east + ripple.a) - ripple.e * np.sin(east) + outward * east
    return sign * height, sign * slope_north, sign * slope_east


def _distance_to_surface(
    surface: Surface, feature_m: float, north: Array, east: Array, up: Array, known: Array
) -> Array:
    """Distance (N,) to one smooth surface where that is less than what is `known` (N,); else something larger."""
    radius = float(known.max())
    rings = int(np.clip(np.ceil(radius / feature_m), *_RINGS))
    trial = trial_places(rings)
    found = np.full(len(north), np.inf)
    for part in np.array_split(np.arange(len(north)), int(np.ceil(len(north) * len(trial) / _BLOCK))):
        n, e, u = north[part], east[part], up[part]
        size = known[part, None]
        squared = _squared(surface, n[:, None], e[:, None], u[:, None], *(size * trial[:, axis] for axis in (0, 1)))
        # All starts of all places at once: for few places the calls cost more than the numbers.
        away = size[:, :, None] * trial[np.argpartition(squared, _STARTS, axis=1)[:, :_STARTS]]
        places = (np.repeat(values, _STARTS) for values in (n, e, u))
        feet = _descended(surface, *places, *away.reshape(-1, 2).T)
        found[part] = feet.reshape(-1, _STARTS).min(axis=1)
    return found


def trial_places(rings: int) -> Array:
    """Places (K, 2) on the unit disk."""
    places = [np.zeros((1, 2))]
    for ring in range(1, rings + 1):
        angle = 2.0 * np.pi * (np.arange(6 * ring) + 0.5 * (ring % 2)) / (6 * ring)
        places.append(ring / rings * np.column_stack([np.cos(angle), np.sin(angle)]))
    return np.concatenate(places)


def _squared(surface: Surface, north: Array, east: Array, up: Array, a: Array, b: Array) -> Array:
    return np.asarray(a * a + b * b + (up - surface(north + a, east + b)[0]) ** 2)


def _descended(surface: Surface, north: Array, east: Array, up: Array, a: Array, b: Array) -> Array:
    """Distance (N,) from places to the surface by the Gauss-Newton method, from feet (a, b) beside the places."""
    best = _squared(surface, north, east, up, a, b)
    share = np.ones_like(best)
    open_ = np.arange(len(best))
    a, b = a.copy(), b.copy()
    for _ in range(_STEPS):
        n, e, u, x, y = north[open_], east[open_], up[open_], a[open_], b[open_]
        height, p, q = surface(n + x, e + y)
        lack = u - height
        pull_a, pull_b = x - lack * p, y - lack * q  # half of the gradient
        # (I + g g') inverted.
        along = (p * pull_a + q * pull_b) / (1.0 + p * p + q * q)
        step_a, step_b = share[open_] * (p * along - pull_a), share[open_] * (q * along - pull_b)
        value = _squared(surface, n, e, u, x + step_a, y + step_b)
        better = value <= best[open_]
        a[open_] = np.where(better, x + step_a, x)
        b[open_] = np.where(better, y + step_b, y)
        best[open_] = np.where(better, value, best[open_])
        share[open_] = np.where(better, np.minimum(1.5 * share[open_], 1.0), 0.3 * share[open_])
        open_ = open_[np.hypot(step_a, step_b) > _SETTLED_M]
        if not len(open_):
            break
    return np.sqrt(best)


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
    for part in np.array_split(near, max(int(np.ceil(len(near) * len(window) / _CELL_BLOCK)), 1)):
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
    edges = [pixels[np.clip(i + di, 0, last_row), np.clip(j + dj, 0, last_column)] for dj in (0, 1) for di in (0, 1)]
    u0, v0 = row[who] - i, column[who] - j
    squared = _to_patch(np.stack(edges), u0, v0, to_metres[who], up[who])
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
        for _ in range(_CELL_STEPS):
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
            if max(np.abs(step_u).max(), np.abs(step_v).max()) < _CELL_SETTLED:
                break
        least = np.minimum(least, best)
    return least
