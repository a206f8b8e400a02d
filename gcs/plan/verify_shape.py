"""Is the formation what the scenario asks for? Places, separations and the shape's own motion, for every vehicle.

Knows: what each change must lead to, worked out anew from the scenario. Does not know: how changes were made, by whom.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from gcs.plan.formation.coordinates import target_ned_m
from gcs.plan.formation.shape import Shape
from gcs.plan.margins import Margin
from gcs.plan.trajectory import Plan
from gcs.quadrotor import Array
from gcs.scenario.physical import NED_FROM_UP, landing_points_ned_m, offsets_ned_m, shape_offsets_ned_m

_FEW = 40  # vehicles for which all distances are faster than a tree of neighbours


def expected_places(plan: Plan) -> list[tuple[float, float, Array]]:
    """Stretches of the flight over which the schedule asks for a rigid shape, and its offsets (V, 3) there."""
    scenario = plan.scenario
    changes = [change for change in scenario.formation.change if not change.auto]
    moves = [move for move in plan.moves if move.trigger != "auto"]
    places = offsets_ned_m(scenario)
    found, since = [], -np.inf
    for change, move in zip(changes, moves, strict=True):
        found.append((since, move.start_s, places))
        if change.kind == "rotate":
            assert change.angle_deg is not None
            axis = np.array([0.0, 0.0, 1.0] if change.axis is None else change.axis * NED_FROM_UP)
            turn = Rotation.from_rotvec(np.radians(change.angle_deg) * axis / np.linalg.norm(axis))
            places = turn.apply(places)
        elif change.kind == "shrink":
            assert change.scale is not None
            places = change.scale * places
        else:
            assert change.to is not None
            targets = shape_offsets_ned_m(scenario, change.to)
            taken = KDTree(targets).query(plan.shape.at(move.end_s))[1]
            if change.assignment == "fixed" or len(set(taken.tolist())) < len(targets):
                taken = np.arange(len(targets))  # two on one place: let the check say how far off the others are
            places = targets[taken]
        since = move.end_s
    found.append((since, np.inf, places))
    return found


def landing_points(plan: Plan) -> Array:
    """Ground points (V, 3) under the shape in which the scenario's formation ends."""
    if plan.scenario.formation.frame == "course":
        return plan.landing_points_ned_m  # how far it has turned is the plan's to say
    return landing_points_ned_m(plan.scenario, expected_places(plan)[-1][2])


def place_in_formation(plan: Plan, places_ned_m: Array, times: Array) -> Margin:
    """Eq. 22: every vehicle where the scenario's formation has it, seen from the leader; places (V, N, 3)."""
    seen = places_ned_m - places_ned_m[plan.leader]
    off = np.zeros(seen.shape[:2])
    similar = any(change.auto for change in plan.scenario.formation.change) or plan.scenario.formation.frame == "course"
    blends = any(change.auto and change.to is not None for change in plan.scenario.formation.change)
    target = target_ned_m(plan.scenario) if blends else None
    for start_s, end_s, expected in expected_places(plan):
        inside = (times >= start_s) & (times <= end_s)
        if not inside.any():
            continue
        wanted = expected[:, None]
        if similar:
            wanted = _nearest_alike(seen[:, inside], expected, target)
        off[:, inside] = np.linalg.norm(seen[:, inside] - wanted, axis=-1)
    return Margin("place in formation", "m", -off, 1.0)


def _nearest_alike(seen: Array, expected: Array, target: Array | None) -> Array:
    """The shape nearest to `seen` (V, N, 3) that is `expected` turned, scaled and, where it may, blended with `target`.

    Horizontally all three are linear in one complex number for each shape; vertically in a real one.
    """
    shapes = [expected] if target is None else [expected, target]
    flat = np.column_stack([s[:, 0] + 1j * s[:, 1] for s in shapes])
    tall = np.column_stack([s[:, 2] for s in shapes])
    seen_flat = seen[..., 0] + 1j * seen[..., 1]
    near = flat @ np.linalg.lstsq(flat, seen_flat, rcond=None)[0]
    high = tall @ np.linalg.lstsq(tall, seen[..., 2], rcond=None)[0]
    return np.stack([near.real, near.imag, high], axis=-1)


def least_separation(shape: Shape, times: Array) -> tuple[float, float]:
    """Least distance between any two vehicles over `times`, and when; a rigid stretch is looked at once."""
    moving = shape.is_moving(times)
    piece = np.searchsorted(shape.joints_s, times, side="right")
    once = np.unique(piece[~moving], return_index=True)[1]
    worth = np.concatenate([times[~moving][once], times[moving]])
    least, when = np.inf, float(times[0])
    for t in worth:
        distance = nearest_pair_m(shape.at(float(t)))
        if distance < least:
            least, when = distance, float(t)
    return least, when


def nearest_pair_m(places: Array) -> float:
    """Least distance between two of (V, 3) places."""
    if len(places) <= _FEW:
        return float(pdist(places).min())
    return float(KDTree(places).query(places, k=2)[0][:, 1].min())
