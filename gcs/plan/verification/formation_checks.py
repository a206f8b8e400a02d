"""Check the formation of a plan against its scenario: places of all vehicles, separations, times of changes.

The result of each change is computed anew from the scenario, not taken from the planner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist, pdist
from scipy.spatial.transform import Rotation

from gcs.errors import Infeasible
from gcs.physics.quadrotor import VELOCITY, Array
from gcs.plan.formation.assignment import bottleneck
from gcs.plan.formation.changes.reshape import reshape
from gcs.plan.formation.coordinates import Name, bent, target_ned_m
from gcs.plan.formation.separation import least_distance
from gcs.plan.formation.shape import Rows
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import ChangeTable, Scenario
from gcs.scenario.si import NED_FROM_UP, landing_points_ned_m, offsets_ned_m, shape_offsets_ned_m

# A formation that turns with its course must face where it flies above this speed.
COURSE_SPEED_MPS = 1.0
_LONGER = 1.0 + 1e-6  # ways that differ by rounding are equally long
_BEYOND = 0.05  # share of its range: an automatic change rests a little inside it
_SLACK = 1e-3  # share of its size, as for every limit
_TRIED, _ZOOMS = 21, 6
_FEW = 40  # up to so many vehicles, all distances are faster than a k-d tree


def expected_places(plan: Plan) -> list[tuple[float, float, Array]]:
    """Start, end and offsets (V, 3) of every part of the flight over which the schedule requires a rigid shape."""
    scenario = plan.scenario
    changes = [change for change in scenario.formation.change if not change.auto]
    moves = [move for move in plan.moves if move.trigger != "auto"]
    places = offsets_ned_m(scenario)
    found, since = [], -np.inf
    for change, move in zip(changes, moves, strict=False):  # the number of moves is a check of its own
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
            places = targets[_taken(plan, change, places, targets, move.end_s)]
        since = move.end_s
    found.append((since, np.inf, places))
    return found


def landing_points(plan: Plan) -> Array:
    """Ground points (V, 3) under the final shape of the scenario's formation."""
    if plan.scenario.formation.frame == "course":
        return plan.landing_points_ned_m  # the scenario does not fix its final heading
    return landing_points_ned_m(plan.scenario, expected_places(plan)[-1][2])


def late_s(plan: Plan) -> list[tuple[float, float]]:
    """Lateness of each scheduled change, and the instant at which it should begin, s."""
    mission = plan.phase("mission")
    changes = [change for change in plan.scenario.formation.change if not change.auto]
    moves = [move for move in plan.moves if move.trigger != "auto"]
    found = [(np.inf, mission.end_s)] * abs(len(changes) - len(moves))
    for change, move in zip(changes, moves, strict=False):
        if plan.begin_state is not None and move.start_s < plan.t_start_s:
            continue  # it began before this plan
        required = change.at_s if change.gate_m is None else crossing_s(plan, change.gate_m)
        begun = plan.shape.joints_s[np.abs(plan.shape.joints_s - move.start_s).argmin()]
        found.append(
            (np.inf, move.start_s) if required is None else (float(np.ptp([move.start_s, begun, required])), required)
        )
    return found


def crossing_s(plan: Plan, gate_m: tuple[tuple[float, float], tuple[float, float]]) -> float | None:
    """The instant of the mission at which the leader first crosses a gate (two points north, east), or None.

    The leader's side of the gate's line is a polynomial of time: its roots are the crossings.
    """
    mission, state = plan.phase("mission"), plan.leader_trajectory.state
    a, b = np.array(gate_m)
    along = b - a
    side = along[0] * (state.c[:, :, 1]) - along[1] * state.c[:, :, 0]
    side[-1] -= along[0] * a[1] - along[1] * a[0]
    roots = np.sort(PPoly(side, state.x).roots(extrapolate=False))
    roots = roots[np.isfinite(roots) & (roots >= mission.start_s) & (roots <= mission.end_s)]
    where = (state(roots)[:, :2] - a) @ along / (along @ along)
    hits = roots[(where >= -_SLACK) & (where <= 1.0 + _SLACK)]
    return float(hits[0]) if len(hits) else None


def bends(plan: Plan) -> bool:
    """Whether automatic changes or the course may bend the scheduled shape."""
    return _Bends.of(plan.scenario) is not None


def away_m(plan: Plan, seen_ned_m: Array, times: Array) -> Array:
    """Distance (V, N) of every vehicle from the nearest place that is allowed; offsets (V, N, 3) from the leader."""
    off = np.zeros(seen_ned_m.shape[:2])
    allowed = _Bends.of(plan.scenario)
    for start_s, end_s, expected in expected_places(plan):
        inside = (times >= start_s) & (times <= end_s)
        if inside.any():
            seen = seen_ned_m[:, inside]
            wanted = expected[:, None] if allowed is None else allowed.nearest(seen, expected)[0]
            off[:, inside] = np.linalg.norm(seen - wanted, axis=-1)
    return off


def course(plan: Plan, times: Array) -> tuple[Array, Array]:
    """Margin of the heading along the course (N,), deg, and its instants (N,): where the shape is rigid."""
    allowed = _Bends.of(plan.scenario)
    assert allowed is not None
    begin = plan.scenario.start
    north, east = begin.velocity_mps[:2]
    facing = np.arctan2(east, north) if north or east else np.radians(begin.roll_pitch_yaw_deg[2])
    velocity = plan.leader_trajectory.state(times)[:, VELOCITY]
    headings = np.full(len(times), np.nan)
    for start_s, end_s, expected in expected_places(plan):
        inside = (times >= start_s) & (times <= end_s)
        if inside.any():
            headings[inside] = allowed.nearest(plan.offsets(times[inside]), expected)[1]
    known = np.isfinite(headings)
    away = np.angle(np.exp(1j * (np.arctan2(velocity[known, 1], velocity[known, 0]) - headings[known] - facing)))
    fast = np.hypot(velocity[known, 0], velocity[known, 1]) > COURSE_SPEED_MPS
    return plan.scenario.formation.course_tolerance_deg - np.where(fast, np.degrees(np.abs(away)), 0.0), times[known]


def assignments_m(plan: Plan) -> list[tuple[float, float]]:
    """For each scheduled change with a free assignment: how much longer its longest way is than need be (Eq. 14), and
    when it begins.

    Longer ways are needed where vehicles on the shortest ones would come too near to each other.
    """
    changes = [change for change in plan.scenario.formation.change if not change.auto]
    moves = [move for move in plan.moves if move.trigger != "auto"]
    found = []
    for change, move in zip(changes, moves, strict=False):
        if change.kind != "reshape" or change.assignment == "fixed" or bends(plan):
            continue
        before, after = plan.shape.at(move.start_s), plan.shape.at(move.end_s)
        ways = cdist(before, after)
        others = np.arange(len(ways)) != plan.leader
        ways[plan.leader, others], ways[others, plan.leader] = np.inf, np.inf
        flown_m = float(np.diagonal(ways).max())
        if not _possible(ways < flown_m / _LONGER):
            found.append((0.0, move.start_s))
            continue
        fastest = bottleneck(ways)
        assert fastest is not None
        straight_m = least_distance(before, after[fastest])[0]
        limit_m = plan.scenario.limits.separation_min_m
        shortest_m = float(ways[np.arange(len(ways)), fastest].max())
        found.append((flown_m - shortest_m if straight_m >= limit_m else 0.0, move.start_s))
    return found


def _possible(allowed: Rows) -> bool:
    """Whether every vehicle can have a place of its own with the allowed ways (V, V)."""
    return bool((maximum_bipartite_matching(csr_array(allowed), perm_type="column") >= 0).all())


@dataclass(frozen=True)
class _Bends:
    """How much automatic changes and the course may rotate, scale and blend the scheduled shape."""

    scale: tuple[float, float]
    turn_rad: float  # either way
    blend: tuple[float, float]
    target_ned_m: Array  # (V, 3)

    @classmethod
    def of(cls, scenario: Scenario) -> _Bends | None:
        """The allowed ranges; None where the schedule alone defines the shape."""
        autos = {change.kind: change for change in scenario.formation.change if change.auto}
        if not autos and scenario.formation.frame == "inertial":
            return None
        least = getattr(autos.get("shrink"), "scale", 1.0)
        turn_rad = np.radians(abs(getattr(autos.get("rotate"), "angle_deg", 0.0)))
        return cls(
            scale=(least - _SLACK, 1.0 + _BEYOND * (1.0 - least) + _SLACK) if "shrink" in autos else (1.0, 1.0),
            turn_rad=np.pi if scenario.formation.frame == "course" else turn_rad * (1.0 + _SLACK),
            blend=(-_BEYOND - _SLACK, 1.0 + _SLACK) if "reshape" in autos else (0.0, 0.0),
            target_ned_m=target_ned_m(scenario),
        )

    def nearest(self, seen: Array, expected: Array) -> tuple[Array, Array]:
        """Allowed shapes (V, N, 3) nearest to `seen` (V, N, 3), and their rotation (N,), rad.

        For a given blend, the best rotation and scale have closed forms; the blend is searched by zooming.
        """
        low, high = (np.full(seen.shape[1], end) for end in self.blend)
        for _ in range(_ZOOMS if self.blend[1] > self.blend[0] else 1):
            tried = np.linspace(low, high, _TRIED)  # (tried, N)
            gain = self._fitted(seen, expected, tried)[2]
            best = np.take_along_axis(tried, gain.argmax(axis=0)[None], axis=0)[0]
            step = (high - low) / (_TRIED - 1)
            low, high = np.maximum(best - step, self.blend[0]), np.minimum(best + step, self.blend[1])
        scale, turn, _ = (part[0] for part in self._fitted(seen, expected, best[None]))
        shape = (1.0 - best)[:, None] * expected[:, None] + best[:, None] * self.target_ned_m[:, None]
        values: dict[Name, Array] = {"scale": scale, "heading": turn}
        return np.stack(bent(values, tuple(np.moveaxis(shape, 2, 0)), ()), axis=-1), turn

    def _fitted(self, seen: Array, expected: Array, blend: Array) -> tuple[Array, Array, Array]:
        """Scale and rotation that bring each blend (B, N) of the shapes nearest to `seen`, and the gain of it."""
        shapes = (expected, self.target_ned_m)
        shares = (1.0 - blend, blend)
        flat = [(s[:, 0] - 1j * s[:, 1]) @ (seen[..., 0] + 1j * seen[..., 1]) for s in shapes]
        tall = [s[:, 2] @ seen[..., 2] for s in shapes]
        across = sum(share * part for share, part in zip(shares, flat, strict=True))
        up = sum(share * part for share, part in zip(shares, tall, strict=True))
        parts = list(zip(shares, shapes, strict=True))
        size = sum(a * b * np.vdot(s, t) for a, s in parts for b, t in parts)
        turn = np.clip(np.angle(across), -self.turn_rad, self.turn_rad)
        alike = (across * np.exp(-1j * turn)).real + up
        scale = np.clip(alike / np.maximum(size, 1e-12), *self.scale)
        return scale, turn, 2.0 * scale * alike - scale**2 * size


def _taken(plan: Plan, change: ChangeTable, places: Array, targets: Array, end_s: float) -> Rows:
    """The place of each vehicle (V,) after a change; any is right where the assignment is free."""
    fixed = np.arange(len(targets))
    if change.assignment == "fixed":
        return fixed
    if _Bends.of(plan.scenario) is not None:  # rotated and scaled, the shape does not tell which vehicle is where
        limits, leader = plan.scenario.limits, plan.leader
        try:
            return reshape(places, targets, leader, limits.separation_min_m).places
        except Infeasible:
            return fixed
    taken = np.asarray(KDTree(targets).query(plan.shape.at(end_s))[1])
    return (
        taken if len(np.unique(taken)) == len(taken) else fixed
    )  # two on one place: the check names the vehicle that is off


def nearest_pair_m(places: Array) -> float:
    """Least distance between two of V positions (V, 3)."""
    if len(places) <= _FEW:
        return float(pdist(places).min())
    return float(KDTree(places).query(places, k=2)[0][:, 1].min())
