"""Positions of groups of vehicles at the start of a return, bounded over an interval of start times.

An interval in which the shape is rigid may be long: the leader's whole track counts as uncertain, but it is the same
for all vehicles.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

from gcs.mission.returns.rtl_cases import ReturnEnds, ReturnSpeeds
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof.polynomials import scaled_coefficients
from gcs.plan.verification.proof.subdivision import Rows
from gcs.plan.verification.proof.vehicle_tree import Groups
from gcs.types import Array

_ROUNDING_M = 1e-9
_ENDS, _CHANGE, _CLIMB, _SEVERAL, _MOVES = slice(2, 4), slice(4, 6), 6, 7, 8  # columns of the boxes; offsets are first
_CHORD = 1.42  # a chord of an angle below 90 degrees, as a share of its sine, at most
_TINY = 1e-12


@dataclass(frozen=True)
class Between:
    """M pairs of vehicles, or of groups of them, and how wrong each value may be; all lengths are level, in m."""

    begin: Array  # (M, 2) from the first start to the second one
    change: Array  # (M, 2) what the ends' vector differs from it
    begin_off: Array  # (M,)
    change_off: Array
    ends_off: Array  # of begin + change
    ways: tuple[Array, Array]  # (M, 2) from the start to the end of the first and of the second one
    ways_off: tuple[Array, Array]
    late: Array  # (M,) what the first one cruises while the second one still climbs
    late_off: Array


def least_level_m(pairs: Between) -> Array:
    """A lower bound (M,) of the level distance of pairs that return at one altitude, by their differences alone, m.

    At equal shares of their ways, the vector between two vehicles is on the segment from that between their starts to
    that between their ends. The one with the longer way has done a smaller share: it is behind by the difference of the
    ways, at most. A vehicle that climbs longer is behind by what the other one cruises meanwhile. So the vector stays
    within a triangle, moved along a segment. A formation that stands on its pads as it flies stays as it is: then the
    triangle is a point, whatever the leader does.
    """
    length = [np.linalg.norm(way, axis=1) for way in pairs.ways]
    along = pairs.ways[1] / np.maximum(length[1], _TINY)[:, None]
    turned = np.where(pairs.ways_off[1] < length[1], _CHORD * pairs.ways_off[1] / np.maximum(length[1], _TINY), 2.0)
    turned = np.minimum(turned, 2.0)
    moved = pairs.ways_off[0] + pairs.ways_off[1]
    both = length[0] + length[1]
    mean = (pairs.ways[0] + pairs.ways[1]) / np.maximum(both, _TINY)[:, None]
    mean_off = np.where(moved < both, 2.0 * moved / np.maximum(both - moved, _TINY), 2.0)
    size = np.linalg.norm(pairs.change, axis=1)
    longer = np.sum(pairs.change * mean, axis=1)
    longer_off = pairs.change_off + size * np.minimum(mean_off, 2.0)
    end = pairs.begin + pairs.change
    behind = end - longer[:, None] * along
    behind_off = pairs.ends_off + longer_off + np.abs(longer) * turned
    late = -pairs.late[:, None] * along
    late_off = pairs.late_off + np.abs(pairs.late) * turned
    ends_off = np.maximum(pairs.begin_off, pairs.ends_off)
    corners = np.stack([pairs.begin, end, behind], axis=1)
    aimed = _outside_m(corners, late) - np.maximum(ends_off, behind_off)
    # Without a direction: any, by the largest difference of both ways.
    blind = _outside_m(corners[:, [0, 1, 1]], late) - (ends_off + size + pairs.change_off)
    return np.asarray(np.maximum(np.maximum(aimed, blind) - late_off, 0.0))


def _outside_m(corners: Array, shift: Array) -> Array:
    """The distance (M,) from 0 to triangles (M, 3, 2) that are moved by any share of a shift (M, 2); 0 inside."""
    edges = np.roll(corners, 1, axis=1) - corners
    normals = np.concatenate([edges, shift[:, None]], axis=1)[..., ::-1] * [1.0, -1.0]
    aims = np.concatenate([corners, corners + shift[:, None], normals, -normals], axis=1)
    aims = aims / np.maximum(np.linalg.norm(aims, axis=2), _TINY)[..., None]
    behind = np.minimum(np.einsum("mad,md->ma", aims, shift), 0.0)
    inner = np.einsum("mad,mcd->mac", aims, corners).min(axis=2) + behind
    return np.asarray(np.maximum(inner.max(axis=1), 0.0))


@dataclass(frozen=True)
class FleetCell:
    """Groups (G): the middle of what their members have, and how far members are from it, in m, level."""

    middle: Array  # (G, D) of the columns
    begin_off: Array  # (G,)
    ends_off: Array
    change_off: Array  # of the vector from the offset to the end
    moves: Array  # (G, C, 2) how the middle of the offsets moves, by powers of the scaled time
    moves_off: Array  # (G,) how much members move otherwise
    climb_off: Array
    several: Array  # (G,) how far apart the possible ends of one vehicle are
    leader_m: Array  # (2,)
    leader_off: float

    def between(self, first: Rows, second: Rows, speeds: ReturnSpeeds) -> Between:
        """Pairs (M,) of groups."""
        moved = self.moved_m(first, second)
        begin_off = self.begin_off[first] + self.begin_off[second] + moved
        change_off = self.change_off[first] + self.change_off[second] + moved
        ends_off = self.ends_off[first] + self.ends_off[second]
        share = speeds.cruise_mps / speeds.climb_mps
        apart = self.middle[second] - self.middle[first]
        ways = self._ways(first), self._ways(second)
        ways_off = self._ways_off(first), self._ways_off(second)
        late = share * apart[:, _CLIMB], share * (self.climb_off[first] + self.climb_off[second])
        ends_off = np.minimum(ends_off, begin_off + change_off)
        return Between(apart[:, :2], apart[:, _CHANGE], begin_off, change_off, ends_off, ways, ways_off, *late)

    def moved_m(self, first: Rows, second: Rows) -> Array:
        """How far (M,) groups move against each other."""
        across = np.linalg.norm(self.moves[second] - self.moves[first], axis=-1).sum(axis=-1)
        return np.asarray(across + self.moves_off[first] + self.moves_off[second])

    def time_counts(self, first: Rows, second: Rows) -> Array:
        """What (M,) a shorter interval makes certain, roughly."""
        change_m = np.linalg.norm(self.middle[second, _CHANGE] - self.middle[first, _CHANGE], axis=-1)
        found = self.moved_m(first, second) + self.several[first] + self.several[second]
        for each in (first, second):
            way_m = np.linalg.norm(self._ways(each), axis=-1)
            found = found + change_m * np.minimum(self.leader_off / np.maximum(way_m, 1e-9), 2.0)
        return np.asarray(found)

    def size_counts(self, first: Rows, second: Rows) -> Array:
        """What (M,) smaller groups make certain, roughly."""
        return np.asarray(self.begin_off[first] + self.begin_off[second] + self._own(first) + self._own(second))

    def _own(self, group: Rows) -> Array:
        return np.maximum(self.change_off[group] - self.several[group], 0.0) + self.climb_off[group]

    def _ways(self, group: Rows) -> Array:
        return np.asarray(self.middle[group, _CHANGE] - self.leader_m)

    def _ways_off(self, group: Rows) -> Array:
        moved = np.linalg.norm(self.moves[group], axis=-1).sum(axis=-1) + self.moves_off[group]
        return np.asarray(self.change_off[group] + moved + self.leader_off)


@dataclass(frozen=True)
class FleetReturn:
    """What does not depend on the interval: the plan, its ends, and the altitudes (V,) of the return."""

    plan: Plan
    ends: ReturnEnds
    altitudes_m: Array
    to_rally: bool

    @property
    def places_m(self) -> Array:
        """The ends (V, E, 3) of this case."""
        return self.ends.ned_m if self.to_rally else self.ends.ned_m[:, :1]

    def cell(self, groups: Groups, begin_s: float, end_s: float) -> FleetCell:
        """The cell of an interval in which the shape is rigid, or one polynomial."""
        functions = scaled_coefficients(self.plan.shape.functions, np.array([begin_s]), np.array([end_s]))[:, 0]
        tables = self.plan.shape.basis_ned_m
        leader, leader_reach = self._leader(begin_s, end_s)
        offsets = np.einsum("k,kva->va", functions[0], tables)
        moves = np.einsum("ck,kva->vca", functions[1:], tables)
        places = self.places_m
        chosen = self._possible(leader + offsets, leader_reach, moves)[..., None]
        tops = (self.ends.datum_m(places, to_rally=self.to_rally) + self.altitudes_m[:, None])[..., None]
        rises = np.abs(moves[..., 2]).sum(axis=1)[:, None]
        columns = []
        for sign, extreme in ((-1.0, np.min), (1.0, np.max)):
            ends = extreme(np.where(chosen, places[..., :2], -sign * np.inf), axis=1)
            climb = offsets[:, 2:] + extreme(np.where(chosen, tops, -sign * np.inf), axis=1) + sign * rises
            columns.append([offsets[:, :2], ends, ends - offsets[:, :2], climb])
        several = np.linalg.norm(columns[1][1] - columns[0][1], axis=1, keepdims=True)
        flat = moves[..., :2].reshape(len(moves), -1)
        least, most = (np.concatenate([*column, several, flat], axis=1) for column in columns)
        below, high = np.split(groups.largest(np.concatenate([-least, most], axis=1)), 2, axis=1)
        middle, half = 0.5 * (high - below), 0.5 * (high + below)
        begin_off, ends_off, change_off = (
            np.hypot(half[:, n], half[:, n + 1]) + _ROUNDING_M for n in (0, _ENDS.start, _CHANGE.start)
        )
        flat_moves, moved = (part[:, _MOVES:].reshape(len(middle), -1, 2) for part in (middle, half))
        each = flat_moves, np.linalg.norm(moved, axis=-1).sum(axis=-1)
        climb_off, several, reach_m = half[:, _CLIMB], high[:, _SEVERAL], float(np.hypot(*leader_reach[:2]))
        return FleetCell(middle, begin_off, ends_off, change_off, *each, climb_off, several, leader[:2], reach_m)

    def _possible(self, starts: Array, reach: Array, moves: Array) -> Array:
        """Which ends (V, E) returns of an interval may lead to."""
        away_m = np.linalg.norm(starts[:, None, :2] - self.places_m[..., :2], axis=-1)
        level_m = np.hypot(reach[0], reach[1]) + np.linalg.norm(moves[..., :2], axis=-1).sum(axis=-1) + _ROUNDING_M
        return np.asarray(away_m - away_m.min(axis=-1, keepdims=True) <= 2.0 * level_m[:, None])

    def _leader(self, begin_s: float, end_s: float) -> tuple[Array, Array]:
        """The middle (3,) of a box that the leader stays in, and half its sides."""
        state = self.plan.leader_trajectory.state
        inner_s = state.x[(state.x > begin_s) & (state.x < end_s)]
        marks_s = np.concatenate([[begin_s], inner_s, [end_s]])
        leader = PPoly(np.ascontiguousarray(state.c[:, :, POSITION]), state.x)
        powers = scaled_coefficients(leader, marks_s[:-1], marks_s[1:])
        reach = np.abs(powers[1:]).sum(axis=0)
        low, high = (powers[0] - reach).min(axis=0), (powers[0] + reach).max(axis=0)
        return 0.5 * (low + high), 0.5 * (high - low)
