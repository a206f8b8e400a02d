"""Bounds of a smooth path that hold at every instant: places and speeds of all vehicles.

Splines are polynomials between their knots, so Taylor models bound them there. Distances are bounded along chords; a
path is never farther from a chord over h seconds than h^2 / 8 times its largest acceleration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import BSpline, PPoly

from gcs.mission.check.between_samples import clearance_along, outside_along, parts_beside
from gcs.mission.check.flight_checks import LENGTH_TOLERANCE_M
from gcs.physics.quadrotor import Array
from gcs.plan.verification.proof.polynomials import combined, enclosed
from gcs.plan.verification.proof.taylor import Taylor, stacked
from gcs.scenario.environment.ground_bounds import highest_ground
from gcs.scenario.environment.no_fly import zone_names, zones

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

_CHORD_S = 0.0125
_ORDER = 3


@dataclass(frozen=True)
class PathBounds:
    """What is violated, in words, and the clearance that no vehicle falls below."""

    violated: tuple[str, ...]
    clearance_m: float


def path_bounds(plan: Plan, spline: BSpline, limit_tolerance: float) -> PathBounds:
    """The bounds of the leader's spline (north, east, down, yaw) with the offsets of a plan.

    Lengths have the tolerance of every export, 1 cm; speeds a share `limit_tolerance` of their limit.
    """
    leader = _pieces(spline)
    edges_s = _edges(plan, leader)
    begin_s, end_s = edges_s[:-1], edges_s[1:]
    place, velocity, acceleration = (_motion(plan, leader, begin_s, end_s, order) for order in range(3))
    violated = [*_box(plan, place, begin_s), *_speeds(plan, velocity, limit_tolerance)]
    fastest_mps2 = np.sqrt(np.sum(acceleration.size() ** 2, axis=0))  # (V, N)
    bent_m = (end_s - begin_s) ** 2 / 8.0 * fastest_mps2
    at_edges = spline(np.minimum(edges_s, np.nextafter(edges_s[-1], 0.0)))[:, :3] + plan.offsets(edges_s)  # (V, N+1, 3)
    begin_m, end_m = (at_edges[:, part].reshape(-1, 3) for part in (slice(None, -1), slice(1, None)))
    begins_s, ends_s = (np.tile(part, len(at_edges)) for part in (begin_s, end_s))
    slack, lasts_s = bent_m.ravel(), ends_s - begins_s
    margin_m = plan.scenario.limits.zone_margin_m or 0.0
    for name, zone in zip(zone_names(plan.scenario), zones(plan.scenario), strict=True):
        parts = parts_beside(zone, begin_m, end_m, begins_s, ends_s)
        outside = outside_along(zone, parts, margin_m - LENGTH_TOLERANCE_M, slack=slack[parts.piece])
        if outside.verdict != "proved":
            violated.append(f"{name} violated by {margin_m - outside.proved:.3g} m")
    required_m = plan.scenario.limits.clearance_min_m
    highest = highest_ground(plan.scenario.terrain)
    above = clearance_along(highest, begin_m, end_m, required_m - LENGTH_TOLERANCE_M, slack=slack, duration_s=lasts_s)
    if above.verdict != "proved":
        violated.append(f"clearance above ground violated by {required_m - above.proved:.3g} m")
    return PathBounds(tuple(violated), above.proved)


def _pieces(spline: BSpline) -> PPoly:
    """The spline as polynomials between its knots: Taylor's coefficients at the begin of each."""
    knots = np.unique(spline.t)
    powers = range(spline.k, -1, -1)
    return PPoly(np.stack([spline(knots[:-1], nu=power) / math.factorial(power) for power in powers]), knots)


def _edges(plan: Plan, leader: PPoly) -> Array:
    """Instants between which all polynomials are the same, at most `_CHORD_S` apart."""
    start_s, end_s = float(leader.x[0]), float(leader.x[-1])
    count = int(np.ceil((end_s - start_s) / _CHORD_S)) + 1
    joints_s = np.concatenate([leader.x, plan.shape.joints_s])
    inner = joints_s[(joints_s > start_s) & (joints_s < end_s)]
    return np.unique(np.concatenate([np.linspace(start_s, end_s, count), inner]))


def _motion(plan: Plan, leader: PPoly, begin_s: Array, end_s: Array, order: int) -> Taylor:
    """Places (3, V, N) of all vehicles, or a derivative."""
    flown = enclosed(leader, begin_s, end_s, _ORDER, order)[:3]
    functions = enclosed(plan.shape.functions, begin_s, end_s, _ORDER, order)
    return flown[:, None] + stacked(combined(functions, plan.shape.basis_ned_m))


def _box(plan: Plan, place: Taylor, begin_s: Array) -> list[str]:
    limits, mission = plan.scenario.limits, plan.phase("mission")
    flies = (begin_s >= mission.start_s) & (begin_s < mission.end_s)
    low, high = place.range()
    found = [("height", _outside(-high[2], -low[2], limits.height_m))]
    for axis, (name, bounds) in enumerate((("north position", limits.north_m), ("east position", limits.east_m))):
        found.append((name, _outside(low[axis][:, flies], high[axis][:, flies], bounds)))
    return [f"{name} violated by {off_m:.3g} m" for name, off_m in found if off_m > LENGTH_TOLERANCE_M]


def _outside(low: Array, high: Array, bounds: tuple[float, float]) -> float:
    return max(bounds[0] - float(low.min()), float(high.max()) - bounds[1])


def _speeds(plan: Plan, velocity: Taylor, tolerance: float) -> list[str]:
    names = ("north speed", "east speed", "vertical speed")
    fastest = velocity.size().max(axis=(1, 2))
    limits = plan.scenario.limits.speed_ned_mps
    return [
        f"{name} violated by {speed - limit:.3g} m/s"
        for name, speed, limit in zip(names, fastest.tolist(), limits, strict=True)
        if speed > limit * (1.0 + tolerance)
    ]
