"""What is drawn over time: heights above ground, nearest neighbours, errors, and of each the vehicle behind it."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from gcs.flight.scene.scene_model import Curve, Motion, Rows
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array

_STILL_MPS = 0.3  # a slower vehicle has no course
_STEP_S, _LEAST, _MOST = 0.2, 300, 1500  # between instants of a scene, and how many
_VALUES = 400_000  # vehicles times instants, unless that leaves fewer than the least


def instants_s(begin_s: float, end_s: float, vehicles: int) -> Array:
    """Return the times (N,) of a scene: 0.2 s apart or more, fewer for many vehicles."""
    most = int(np.clip(_VALUES // max(vehicles, 1), _LEAST, _MOST))
    return np.linspace(begin_s, end_s, int(np.clip(np.ceil((end_s - begin_s) / _STEP_S) + 1, 2, most)))


def motion_of(scenario: Scenario | None, places_ned_m: Array, rates_mps: Array, yaw_rad: Array | None = None) -> Motion:
    """Return the motion of places and velocities (V, N, 3); `yaw_rad` (V, N), else headings are courses."""
    above_m = np.full(places_ned_m.shape[:2], np.nan)
    if scenario is not None:
        known = np.isfinite(places_ned_m[..., 0])
        north_m, east_m, down_m = places_ned_m[known].T
        above_m[known] = -down_m - ground_height_m(scenario.terrain, north_m, east_m)
    heading_rad = course_rad(rates_mps) if yaw_rad is None else np.asarray(yaw_rad)
    speed_mps = np.linalg.norm(rates_mps, axis=-1)
    return Motion(places_ned_m, heading_rad, speed_mps, above_m, *neighbours(places_ned_m))


def course_rad(rates_mps: Array) -> Array:
    """Return courses (...), clockwise from north, of velocities (..., 3); NaN below 0.3 m/s over ground."""
    north, east = rates_mps[..., 0], rates_mps[..., 1]
    return np.asarray(np.where(np.hypot(north, east) > _STILL_MPS, np.arctan2(east, north), np.nan))


def neighbours(places_ned_m: Array) -> tuple[Array, Rows]:
    """Return the distance of each of (V, N, 3) to its nearest neighbour, and the neighbour's row, (V, N) each.

    NaN and -1 for a vehicle that is not known, or the only one that is.
    """
    shape = places_ned_m.shape[:2]
    away_m, rows = np.full(shape, np.nan), np.full(shape, -1, dtype=np.int64)
    for instant in range(shape[1]):
        known = np.flatnonzero(np.isfinite(places_ned_m[:, instant, 0]))
        if len(known) < 2:
            continue
        at_m, at = cKDTree(places_ned_m[known, instant]).query(places_ned_m[known, instant], k=2)
        # Two vehicles at one place: each may be found as its own second.
        other = np.where(at[:, 1] == np.arange(len(known)), at[:, 0], at[:, 1])
        away_m[known, instant], rows[known, instant] = at_m[:, 1], known[other]
    return away_m, rows


def ground_curve(
    sysids: tuple[int, ...],
    flown: Motion | None,
    planned: Motion | None,
    limit_m: float | None,
    true: Motion | None = None,
) -> Curve:
    """Return the least height above ground, and the vehicle that is so low."""
    values = [None if one is None else _extreme(one.above_ground_m, least=True) for one in (true, flown, planned)]
    name = "least height above ground"
    return _curve(name, "m", sysids, values, limit_m)


def speed_curve(
    sysids: tuple[int, ...], flown: Motion | None, planned: Motion | None, true: Motion | None = None
) -> Curve:
    """Return the greatest speed, and the vehicle that is so fast."""
    values = [None if one is None else _extreme(one.speed_mps, least=False) for one in (true, flown, planned)]
    return _curve("greatest speed", "m/s", sysids, values, None, at_least=False)


def error_curve(sysids: tuple[int, ...], error_m: Array, true_m: Array | None = None) -> Curve:
    """Return the greatest of position errors (V, N), and the vehicle that has it."""
    values = [None if one is None else _extreme(one, least=False) for one in (true_m, error_m, None)]
    return _curve("greatest position error", "m", sysids, values, None, at_least=False)


def separation_curve(
    sysids: tuple[int, ...],
    flown: Motion | None,
    planned: Motion | None,
    limit_m: float | None,
    true: Motion | None = None,
) -> Curve:
    """Return the distance of the nearest two vehicles, and which they are."""
    motions = (true, flown, planned)
    values = [None if one is None else _extreme(one.neighbour_m, least=True) for one in motions]
    curve = _curve("least separation", "m", sysids, values, limit_m)
    shown = next((one for one in motions if one is not None), None)
    if shown is None:
        return curve
    ids = np.array([0, *sysids], dtype=np.int64)
    row = next(one for one in values if one is not None)[1]
    other = shown.neighbour[np.maximum(row, 0), np.arange(len(row))]
    pairs = np.sort(np.stack([ids[row + 1], ids[np.where(row < 0, -1, other) + 1]], axis=1), axis=1)
    return replace(curve, vehicles=pairs)


def control_curves(sysids: tuple[int, ...], controls: Array) -> tuple[Curve, ...]:
    """Return U1 to U4 of planned controls (V, N, 4) by Eq. 1: of each the largest, and the vehicle behind it."""
    curves = []
    for column, (name, unit) in enumerate((("U1", "N"), ("U2", "N"), ("U3", "N"), ("U4", "N m"))):
        values = controls[..., column]
        row = _extreme(np.abs(values), least=False)[1]
        found = np.where(row < 0, np.nan, values[row, np.arange(values.shape[1])])
        curve = _curve(f"{name}, largest", unit, sysids, [None, None, (found, row)], None, at_least=False)
        curves.append(replace(curve, on_demand=True))
    return tuple(curves)


def _extreme(values: Array, *, least: bool) -> tuple[Array, Rows]:
    """The least or greatest (N,) of (V, N) and its row; NaN and -1 where nothing is known."""
    known = np.isfinite(values)
    row = np.where(known, values if least else -values, np.inf).argmin(axis=0)
    any_known = known.any(axis=0)
    found = np.where(any_known, values[row, np.arange(values.shape[1])], np.nan)
    return found, np.where(any_known, row, -1).astype(np.int64)


def _curve(
    name: str,
    unit: str,
    sysids: tuple[int, ...],
    values: list[tuple[Array, Rows] | None],
    limit: float | None,
    *,
    at_least: bool = True,
) -> Curve:
    true, flown, planned = values
    rows = next(one for one in values if one is not None)[1]
    ids = np.array([0, *sysids], dtype=np.int64)[rows + 1]
    vehicles = np.stack([ids, np.zeros_like(ids)], axis=1)
    told, meant = flown and flown[0], planned and planned[0]
    return Curve(name, unit, told, meant, vehicles, limit, at_least, true=true and true[0])
