"""The rally points of a fleet, chosen so that straight returns (RTL) cross no-fly zones at as few instants as possible.

Autopilots return straight to the nearest of home and rally points. The first rally point of a vehicle is its landing
point. Further ones lie below its own track or a little beside it, as at one plan time for all vehicles, on flat ground.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import shapely

from gcs.mission.failsafe.fence_areas import inclusion_corners, outside_area, planned_places_m, swept_area
from gcs.physics.quadrotor import POSITION, VELOCITY, Array
from gcs.scenario.environment.no_fly import displacement_m, outline, zones
from gcs.scenario.environment.terrain import ground_height_m

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

_INSTANTS, _CANDIDATES = 70, 36
_CLEARANCE_M = 3.0  # from no-fly zones and inside the fence
_ASIDE_M = (0.0, 6.0, -6.0)  # of the track
_FLAT_M, _SLOPE = 3.0, math.tan(math.radians(10.0))
_LOWER_M = 0.3  # than home: PX4's return altitude counts from the ground of the rally point


def rally_points_ned_m(plan: Plan, points_max: int) -> Array:
    """Ground points (V, R, 3): each vehicle's landing point, then those that keep more returns out of no-fly zones."""
    chosen = plan.landing_points_ned_m[:, None]
    if not zones(plan.scenario):
        return chosen
    t_s = np.linspace(plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf), _INSTANTS)
    start = (plan.leader_trajectory.state(t_s)[:, POSITION] + plan.offsets(t_s))[..., :2]  # (V, N, 2)
    candidates = _candidates(plan)  # (V, C, 3)
    ends = np.concatenate([plan.pads_ned_m[:, None], chosen, candidates], axis=1)
    away_m = np.linalg.norm(start[:, :, None] - ends[:, None, :, :2], axis=-1)  # (V, N, E)
    through = straight_through(plan, t_s, start, ends[..., :2])
    taken = [0, 1]
    best = _crossings(away_m, through, taken)
    while best and len(taken) <= points_max:
        possible = [
            (_crossings(away_m, through, [*taken, end]), end)
            for end in range(2, ends.shape[1])
            if end not in taken and _apart(plan, ends[:, taken], ends[:, end])
        ]
        fewer, end = min(possible, default=(best, 0))
        if fewer >= best:
            break
        best = fewer
        taken.append(end)
    return np.asarray(ends[:, taken[1:]])


def straight_through(plan: Plan, t_s: Array, start: Array, ends: Array) -> Array:
    """Whether (V, N, E) straight tracks from (V, N, 2) at plan times (N,) to (V, E, 2) cross a no-fly zone."""
    shape = (len(start), len(t_s), ends.shape[1], 2)
    first, last = np.broadcast_to(start[:, :, None], shape), np.broadcast_to(ends[:, None], shape)
    through = np.zeros(shape[:3], dtype=bool)
    for zone in zones(plan.scenario):
        area = outline(zone).buffer(-plan.scenario.mission.tolerance_m)
        shapely.prepare(area)
        moved = displacement_m(zone, t_s)[:, None]
        through |= shapely.intersects(area, shapely.linestrings(np.stack([first - moved, last - moved], axis=-2)))
    return through


def _candidates(plan: Plan) -> Array:
    """Ground points (V, C, 3) where all vehicles have flat ground, clear of zones and inside the fence."""
    t_s = np.linspace(plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf), _CANDIDATES + 2)[1:-1]
    leader = plan.leader_trajectory.state(t_s)
    tracks = (leader[:, POSITION] + plan.offsets(t_s))[..., :2]
    right = np.stack([-leader[:, VELOCITY][:, 1], leader[:, VELOCITY][:, 0]], axis=-1)
    right /= np.maximum(np.linalg.norm(right, axis=-1, keepdims=True), 1e-9)
    flat = np.concatenate([tracks + aside_m * right for aside_m in _ASIDE_M], axis=1)
    around = np.concatenate([[[0.0, 0.0]], _FLAT_M * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])])
    near = flat[..., None, :] + around
    ground_m = ground_height_m(plan.scenario.terrain, near[..., 0], near[..., 1])
    good = np.ptp(ground_m, axis=-1) <= 2 * _FLAT_M * _SLOPE
    good &= ground_m[..., 0] >= -plan.pads_ned_m[:, None, 2] - _LOWER_M
    fence = shapely.Polygon(inclusion_corners(planned_places_m(plan)))
    avoided = [swept_area(zone, _CLEARANCE_M, plan.t_start_s, math.inf) for zone in zones(plan.scenario)]
    for area in (outside_area(fence, _CLEARANCE_M), *avoided):
        good &= ~shapely.intersects(area, shapely.points(flat))
    places = np.concatenate([flat, -ground_m[..., :1]], axis=-1)
    return np.asarray(places[:, good.all(axis=0)])


def _apart(plan: Plan, taken: Array, points: Array) -> bool:
    """Whether points (V, 3) keep the plan's separation from each other and from those of other vehicles (V, T, 3)."""
    others = np.concatenate([taken, points[:, None]], axis=1)[..., :2]
    away_m = np.linalg.norm(points[:, None, None, :2] - others, axis=-1)  # (V, V, T + 1)
    away_m[np.arange(len(points)), np.arange(len(points))] = np.inf
    return bool(away_m.min() >= plan.scenario.limits.separation_min_m)


def _crossings(away_m: Array, through: Array, ends: list[int]) -> int:
    """The number of returns to the nearest of these ends that cross a no-fly zone."""
    nearest = np.argmin(away_m[..., ends], axis=-1)
    return int(np.take_along_axis(through[..., ends], nearest[..., None], axis=-1).sum())
