"""The separation of a large fleet's straight returns (RTL) at one altitude, at whatever instant of the plan they begin.

Pairs of groups of vehicles are bounded over long intervals. Groups are divided and intervals are halved where that is
not enough. Pairs of vehicles that move against each other are then bounded as those of small fleets are.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from gcs.autopilots.traits import FleetFirmware
from gcs.mission.failsafe.every_start.large_fleets.fleet_cell import FleetCell, FleetReturn
from gcs.mission.failsafe.every_start.large_fleets.fleet_halves import FleetHalves
from gcs.mission.failsafe.every_start.large_fleets.relative_motion import least_level_m
from gcs.mission.failsafe.every_start.pair_search import (
    LONGEST_S,
    PairItems,
    PairSearch,
    ProvedSeparation,
)
from gcs.mission.failsafe.every_start.start_cells import Rows
from gcs.mission.failsafe.rtl_cases import return_ends
from gcs.mission.failsafe.rtl_motion import ReturnSpeeds
from gcs.physics.quadrotor import Array

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

_BLOCK_S = 10.0  # while the shape moves, vehicles have other neighbours after this time
_BATCH = 20_000
_GROUPS_MAX, _PAIRS_MAX = 3_000_000, 200_000  # looked at; what is left then is undecided
_SAME = 1e-12  # of the shape's functions


def proved_fleet(
    plan: Plan,
    firmware: FleetFirmware,
    speeds: ReturnSpeeds,
    altitudes_m: Array,
    rally_ned_m: Array,
    required_m: float,
    seen_m: float,
) -> ProvedSeparation:
    """The proved separation of returns at these altitudes (V,); `seen_m` is a distance that is known to occur."""
    ends = return_ends(plan, firmware, rally_ned_m)
    pairs = PairSearch(plan, ends, speeds, altitudes_m, required_m, seen_m, _PAIRS_MAX)
    for to_rally in (False, True):
        search = _GroupSearch(FleetReturn(plan, ends, altitudes_m, to_rally), speeds, pairs)
        for begin_s, end_s in _blocks(plan):
            search.settle(begin_s, end_s)
    return pairs.proof


def _blocks(plan: Plan) -> list[tuple[float, float]]:
    """Intervals in which the shape is rigid, and others in each of which it is one polynomial."""
    functions = plan.shape.functions
    moves = np.any(functions.c[:-1] != 0.0, axis=(0, 2))
    jumps = np.any(np.abs(np.diff(functions.c[-1], axis=0)) > _SAME, axis=-1)
    kept = np.concatenate([[True], moves[1:] | moves[:-1] | jumps, [True]])
    marks_s = functions.x[kept].clip(plan.t_start_s, plan.t_end_s)
    spans = [(a, b) for a, b in itertools.pairwise(marks_s.tolist()) if b > a]
    found: list[tuple[float, float]] = []
    for begin_s, end_s in spans:
        moving = plan.shape.is_moving(np.array([0.5 * (begin_s + end_s)]))[0]
        parts = int(np.ceil((end_s - begin_s) / _BLOCK_S)) if moving else 1
        edges = np.linspace(begin_s, end_s, parts + 1).tolist()
        found += itertools.pairwise(edges)
    return found


class _GroupSearch:
    """Divides groups and intervals until every pair of vehicles is settled."""

    def __init__(self, returns: FleetReturn, speeds: ReturnSpeeds, pairs: PairSearch) -> None:
        self._returns, self._speeds, self._pairs = returns, speeds, pairs
        self._joints_s = returns.plan.leader_trajectory.joints_s
        self._looked = 0

    def settle(self, begin_s: float, end_s: float) -> None:
        """Bound all pairs of an interval of `_blocks`."""
        middle_s = np.array([0.5 * (begin_s + end_s)])
        offsets = self._returns.plan.offsets(middle_s)[:, 0, :2]
        tree = FleetHalves.of(np.concatenate([offsets, self._returns.places_m[:, 0, :2]], axis=1))
        root = np.array([1])
        left = [(begin_s, end_s, root, root)]
        while left:
            begin_s, end_s, first, second = left.pop()
            cell = self._returns.cell(tree, begin_s, end_s)
            first, second = self._divided(tree, cell, first, second, begin_s, end_s)
            if len(first):
                middle = self._middle_s(begin_s, end_s)
                left += [(middle, end_s, first, second), (begin_s, middle, first, second)]

    def _divided(
        self, tree: FleetHalves, cell: FleetCell, first: Rows, second: Rows, begin_s: float, end_s: float
    ) -> tuple[Rows, Rows]:
        """The pairs of groups that a shorter interval may settle; others are settled."""
        shorter = []
        whole = not np.any((self._joints_s > begin_s) & (self._joints_s < end_s))
        can_halve = not whole or end_s - begin_s > LONGEST_S
        while len(first):
            self._looked += len(first)
            same = first == second
            low_m = np.full(len(first), np.inf)
            for part in (slice(n, n + _BATCH) for n in range(0, len(first), _BATCH)):
                low_m[part] = least_level_m(cell.between(first[part], second[part], self._speeds))
            leaves = tree.is_leaf(first) & tree.is_leaf(second)
            empty = tree.is_empty(first) | tree.is_empty(second) | (same & leaves)
            low_m[same & ~leaves] = -np.inf
            low_m[empty] = np.inf
            spent = self._looked > _GROUPS_MAX
            enough_m = min(self._pairs.enough_m, self._pairs.proved_m)
            done = (low_m >= enough_m) | spent
            self._pairs.keep(low_m[done], np.full(int(done.sum()), 0.5 * (begin_s + end_s)))
            left = np.flatnonzero(~done)
            first, second, leaves = first[left], second[left], leaves[left]
            in_time = cell.time_counts(first, second) > cell.size_counts(first, second)
            in_time &= can_halve & (first != second)
            in_time |= leaves & can_halve
            shorter.append((first[in_time], second[in_time]))
            alone = leaves & ~in_time
            if alone.any():
                self._pairs_alone(tree.vehicle(first[alone]), tree.vehicle(second[alone]), begin_s, end_s)
            first, second = _halves(tree, first[~in_time & ~alone], second[~in_time & ~alone])
        if not shorter:
            return first, second
        return np.concatenate([a for a, _ in shorter]), np.concatenate([b for _, b in shorter])

    def _pairs_alone(self, first: Rows, second: Rows, begin_s: float, end_s: float) -> None:
        begins, ends = np.full(len(first), begin_s), np.full(len(first), end_s)
        self._pairs.settle(PairItems(begins, ends, first, second), to_rally=self._returns.to_rally)

    def _middle_s(self, begin_s: float, end_s: float) -> float:
        """The joint of the leader's motion that is nearest to the middle; without one, the middle."""
        middle_s = 0.5 * (begin_s + end_s)
        inner_s = self._joints_s[(self._joints_s > begin_s) & (self._joints_s < end_s)]
        return float(inner_s[np.argmin(np.abs(inner_s - middle_s))]) if len(inner_s) else middle_s


def _halves(tree: FleetHalves, first: Rows, second: Rows) -> tuple[Rows, Rows]:
    """All pairs of the halves of groups; a leaf stays whole, and of one group alone no pair counts twice."""
    pairs = []
    for one in (0, 1):
        for other in (0, 1):
            ones = np.where(tree.is_leaf(first), first, 2 * first + one)
            others = np.where(tree.is_leaf(second), second, 2 * second + other)
            twice = (tree.is_leaf(first) & (one == 1)) | (tree.is_leaf(second) & (other == 1))
            twice |= (first == second) & (one > other)
            pairs.append((ones[~twice], others[~twice]))
    return np.concatenate([a for a, _ in pairs]), np.concatenate([b for _, b in pairs])
