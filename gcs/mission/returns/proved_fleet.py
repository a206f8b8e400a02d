"""Proved separation of a large fleet that returns straight (RTL) at one altitude, from any instant of the plan.

Pairs of groups of vehicles are bounded over long intervals. Groups are divided and intervals are halved where that is
not enough. Pairs of vehicles that move against each other are then bounded as those of small fleets are.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np

from gcs.mission.returns.fleet_cell import FleetCell, FleetReturn, least_level_m
from gcs.mission.returns.pair_returns import LONGEST_S, ProvedSeparation, StraightReturns
from gcs.mission.returns.rtl_cases import ReturnSpeeds
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof import subdivision
from gcs.plan.verification.proof.subdivision import Cells, Constraint, Looks, Mask, Proof, Rows
from gcs.plan.verification.proof.vehicle_tree import Groups
from gcs.types import Array

_BLOCK_S = 10.0  # while the shape moves, vehicles have other neighbours after this time
_GROUPS_MAX, _PAIRS_MAX = 3_000_000, 200_000  # looked at; what is left then is undecided
_SAME = 1e-12  # of the shape's functions


def proved_fleet(returns: StraightReturns, seen_m: float) -> ProvedSeparation:
    """What `proved_separation` proves, of a fleet that returns at one altitude."""
    proof, looks = Proof.begun((1, 1), 3, seen_m), Looks(_PAIRS_MAX)
    for to_rally in (False, True):
        group_looks = Looks(_GROUPS_MAX)
        for begin_s, end_s in _blocks(returns.plan):
            _settle_block(replace(returns, to_rally=to_rally), begin_s, end_s, proof, group_looks, looks)
    return ProvedSeparation.of(proof)


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


@dataclass(frozen=True)
class _GroupPairs:
    """The family of pairs of groups, while all vehicles begin to return in one interval."""

    constraints: tuple[Constraint, ...]
    groups: Groups
    cell: FleetCell
    speeds: ReturnSpeeds
    can_halve: bool

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`. The pairs within a group have no distance of their own: it must be divided."""
        first, second = cells.who.T
        low_m = least_level_m(self.cell.between(first, second, self.speeds))
        alone = self.groups.parts[first, 0] < 0
        low_m = np.where(first == second, np.where(alone, np.inf, -np.inf), low_m)
        return low_m[None], np.full((1, len(cells)), np.inf)

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """See `Family`: pairs of halves of groups, unless two vehicles or a shorter interval are to be looked at."""
        numbers = np.flatnonzero(chosen & ~self._are_single(cells).all(axis=1) & ~self.in_time(cells))
        whole, single = cells[numbers], self._are_single(cells[numbers])
        same, halves = whole.who[:, 0] == whole.who[:, 1], self.groups.parts[whole.who]  # (M, 2, 2)
        found, origin = [], []
        for one, other in itertools.product((0, 1), repeat=2):
            who = np.where(single, whole.who, np.stack([halves[:, 0, one], halves[:, 1, other]], axis=1))
            # A single vehicle counts once, and so does a pair within one group.
            once = ~(np.any(single & [one == 1, other == 1], axis=1) | (same & (one > other)))
            found.append(replace(whole[once], who=who[once]))
            origin.append(numbers[once])
        return subdivision.joined(found), np.concatenate(origin)

    def in_time(self, cells: Cells) -> Mask:
        """Which pairs a shorter interval may settle."""
        first, second = cells.who.T
        counts = (self.cell.time_counts(first, second) > self.cell.size_counts(first, second)) & (first != second)
        return np.asarray((counts | self._are_single(cells).all(axis=1)) & self.can_halve)

    def _are_single(self, cells: Cells) -> Mask:
        return np.asarray(self.groups.parts[cells.who, 0] < 0)


def _settle_block(
    pairs: StraightReturns, begin_s: float, end_s: float, proof: Proof, group_looks: Looks, pair_looks: Looks
) -> None:
    """Divide groups and intervals until every pair of vehicles is settled that begins to return in a block."""
    plan, returns = pairs.plan, FleetReturn(pairs.plan, pairs.ends, pairs.altitudes_m, pairs.to_rally)
    offsets = plan.offsets(np.array([0.5 * (begin_s + end_s)]))[:, 0, :2]
    groups, _ = Groups.of(np.concatenate([offsets, returns.places_m[:, 0, :2]], axis=1))
    waiting = [subdivision.plain_cells(np.zeros((1, 2), dtype=np.intp), np.array([begin_s]), np.array([end_s]))]
    while waiting:
        cells = waiting.pop()
        begin_s, end_s, middle_s = (float(each[0]) for each in (cells.start_s, cells.end_s, cells.middle_s))
        joints_s = plan.leader_trajectory.joints_s
        inner_s = joints_s[(joints_s > begin_s) & (joints_s < end_s)]
        can_halve = len(inner_s) > 0 or end_s - begin_s > LONGEST_S
        cell = returns.cell(groups, begin_s, end_s)
        family = _GroupPairs(pairs.constraints, groups, cell, pairs.speeds, can_halve)
        left, _ = subdivision.refined(family, cells, proof, group_looks, proved_is_enough=True)
        if not len(left):
            continue
        in_time = family.in_time(left)
        subdivision.settle(pairs, pairs.cells(replace(left, who=groups.row[left.who])[~in_time]), proof, pair_looks)
        left = left[in_time]
        if len(left):
            # The joint of the leader's motion that is nearest to the middle; without one, the middle.
            at_s = float(inner_s[np.argmin(np.abs(inner_s - middle_s))]) if len(inner_s) else middle_s
            edges_s = np.full(len(left), at_s)
            waiting += [replace(left, start_s=edges_s), replace(left, end_s=edges_s)]
