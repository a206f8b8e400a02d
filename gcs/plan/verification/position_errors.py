"""Worst-case separation under navigation error.

A vehicle is where its estimate has the planned place. So two true positions are nearer or farther than planned by the
difference of two errors: with standard deviation sigma of one vehicle and one axis, sqrt(2) sigma along their line.
Errors are independent here. Real receivers side by side share a part of theirs, which leaves more.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.navigation_error import SIGMA
from gcs.types import Array

STEP_S = 0.25
DEVIATIONS = 2.5  # estimates of 200 emulated fleets in missions/field lost less


@dataclass(frozen=True)
class SeparationLeft:
    """The least separation that position errors leave, with the planned one of the same two vehicles."""

    left_m: float
    planned_m: float
    pair: tuple[int, int]  # system ids
    t_s: float


def separation_left(plan: Plan) -> SeparationLeft | None:
    """Return the least separation that position errors of the scenario's sensors leave; None for one vehicle."""
    if len(plan.sysids) < 2:
        return None
    sigma = SIGMA[plan.scenario.sensors.grade]
    lost = DEVIATIONS * math.sqrt(2.0) * np.array([sigma.horizontal_m, sigma.horizontal_m, sigma.vertical_m])
    best: SeparationLeft | None = None
    for t_s, places in _placed(plan):
        # The pairs (P, 2) of rows that can be the nearest, whatever is lost up to `lost_m`
        tree = KDTree(places)
        nearest_m = float(tree.query(places, k=2)[0][:, 1].min())
        pairs = np.asarray(tree.query_pairs(nearest_m + float(lost.max()) + 1e-9, output_type="ndarray"))
        between = places[pairs[:, 1]] - places[pairs[:, 0]]
        apart_m = np.linalg.norm(between, axis=1)
        left_m = apart_m - np.linalg.norm(between * lost, axis=1) / np.maximum(apart_m, 1e-9)
        least = int(np.argmin(left_m))
        if best is None or left_m[least] < best.left_m:
            first, second = sorted(plan.sysids[row] for row in pairs[least].tolist())
            best = SeparationLeft(float(left_m[least]), float(apart_m[least]), (first, second), t_s)
    return best


def climb_separation_m(plan: Plan) -> float:
    """Return the least distance between the columns over two pads: autopilots climb at their own rates."""
    columns = plan.pads_ned_m[:, :2]
    return float(KDTree(columns).query(columns, k=2)[0][:, 1].min())


def _placed(plan: Plan) -> Iterator[tuple[float, Array]]:
    """Instants and positions (V, 3): the columns over the pads and landing points, and each shape of the flight."""
    for t_s, points in ((plan.t_start_s, plan.pads_ned_m), (plan.t_end_s, plan.landing_points_ned_m)):
        if t_s != plan.t_start_s or plan.begin_state is None:
            yield t_s, points * [1.0, 1.0, 0.0]
    times = np.arange(plan.airborne_s, plan.phase(PhaseKind.LANDING).start_s, STEP_S)
    moving = plan.shape.is_moving(times)
    piece = np.searchsorted(plan.shape.joints_s, times, side="right")
    once = np.unique(piece[~moving], return_index=True)[1]
    for t_s in [*times[~moving][once].tolist(), *times[moving].tolist()]:
        yield t_s, plan.shape.at(t_s)
