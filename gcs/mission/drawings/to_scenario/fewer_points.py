"""A route with as many points as a scenario may have, and no two of them at one place; a recorded line thinned."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs.errors import FileFormatError
from gcs.mission.drawings.drawing import Datum, Drawing, DrawnPoint, LeftOut
from gcs.mission.drawings.item_course import HOLD_MAX_S
from gcs.mission.drawings.to_scenario.placed_point import PlacedPoint
from gcs.physics.quadrotor import Array
from gcs.scenario.schema.route_tables import ROUTE_MAX

_SAME_M = 0.3
_TRACK_M, _TRACK_MAX_M, _STRAIGHT_M = 1.0, 32.0, 0.5  # tolerances of lines with fewer points
_CLIMB_M, _STILL_M = 2.0, 3.0  # a take-off climbs more, and stays so near to where it began


def fewer(drawing: Drawing, points: list[PlacedPoint], said: list[LeftOut]) -> list[PlacedPoint]:
    """As many points as a scenario may have. Raises `FileFormatError` where drawn ones would be lost."""
    most = ROUTE_MAX + (1 if drawing.returns else 2)
    if len(points) <= most and not drawing.recorded:
        return points
    places_m = np.array([point.place_m for point in points])
    drawn = [point.drawn for point in points]
    after = [*drawn[1:], drawn[-1]]
    kept = np.array([_is_drawn_on_purpose(one, next_one) for one, next_one in zip(drawn, after, strict=True)])
    is_line = all(one.datum is not Datum.HOME and not one.hold_s and one.speed_mps is None for one in drawn)
    tolerance_m = _TRACK_M if is_line else _STRAIGHT_M
    stays = thinned(places_m, tolerance_m, kept & (not drawing.recorded))
    while is_line and stays.sum() > most and tolerance_m < _TRACK_MAX_M:
        tolerance_m *= 2.0
        stays = thinned(places_m, tolerance_m, np.zeros(len(points), dtype=bool))
    if stays.sum() > most:
        raise FileFormatError(
            f"{drawing.source}: has {len(points)} points, and a route has at most {most}.",
            hint="split it into several files, or draw it with fewer points",
        )
    if stays.sum() < len(points):
        text = (
            f"{stays.sum()} of {len(points)} points are flown; no other is more than {tolerance_m:g} m from the route"
        )
        said.append(LeftOut("points", text))
    return [point for point, stay in zip(points, stays, strict=True) if stay]


def _is_drawn_on_purpose(one: DrawnPoint, after: DrawnPoint) -> bool:
    """Whether a point is more than a place between the one before and the one `after`."""
    return bool(one.hold_s or (one.name and one.name != after.name) or one.speed_mps != after.speed_mps)


def merged_points(points: list[PlacedPoint], said: list[LeftOut]) -> list[PlacedPoint]:
    """The points without those at the place of the one before, whose holds count there."""
    merged = points[:1]
    for point in points[1:]:
        before = merged[-1]
        if float(np.linalg.norm(np.subtract(point.place_m, before.place_m))) > _SAME_M:
            merged.append(point)
            continue
        hold_s = min(before.drawn.hold_s + point.drawn.hold_s, HOLD_MAX_S)
        radius_m = 0.0 if hold_s else before.drawn.radius_m
        name = before.drawn.name or point.drawn.name
        merged[-1] = replace(before, drawn=replace(before.drawn, hold_s=hold_s, radius_m=radius_m, name=name))
        said.append(LeftOut(point.drawn.label, f"at the place of {before.drawn.label}; one point with it"))
    return merged


def thinned(points_m: Array, tolerance_m: float, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of the points (N, 3) a line within `tolerance_m` of all points needs (N,); those of `kept` stay.

    Between two points that stay, the point farthest from the straight line stays too, until none is too far.
    """
    stays = kept.copy()
    stays[[0, -1]] = True
    rows = np.flatnonzero(stays)
    waiting = list(itertools.pairwise(rows.tolist()))
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        away_m = _away_m(points_m[first + 1 : last], points_m[first], points_m[last])
        farthest = int(away_m.argmax())
        if away_m[farthest] > tolerance_m:
            middle = first + 1 + farthest
            stays[middle] = True
            waiting += [(first, middle), (middle, last)]
    return stays


def airborne(points_m: Array) -> tuple[int, int]:
    """The rows of the first and the last point of a track (N, 3) between its vertical take-off and landing.

    Without a take-off or a landing in the track it is 0, or N - 1.
    """
    return _top(points_m), len(points_m) - 1 - _top(points_m[::-1])


def _top(points_m: Array) -> int:
    """The row at which a vertical climb from the first point ends; 0 if there is none."""
    is_away = np.hypot(*(points_m[:, :2] - points_m[0, :2]).T) > _STILL_M
    rows = int(is_away.argmax()) if is_away.any() else len(points_m)
    climbed_m = points_m[:rows, 2] - points_m[0, 2]
    return int(climbed_m.argmax()) if climbed_m.max() >= _CLIMB_M else 0


def _away_m(points_m: Array, start_m: Array, end_m: Array) -> Array:
    """The distances of points (N, 3) from the straight line between two points, m."""
    along = end_m - start_m
    length2 = float(along @ along)
    share = np.clip((points_m - start_m) @ along / length2, 0.0, 1.0) if length2 else np.zeros(len(points_m))
    return np.asarray(np.linalg.norm(points_m - start_m - share[:, None] * along, axis=1))
