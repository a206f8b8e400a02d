"""Bounds that hold at every instant of a flight, not only at samples. Pure functions; pieces are halved until proved.

Distances to a fixed set change by no more than the place moves. Of a piece whose value changes by at most c, and is a
at its begin and b at its end, no instant is therefore below (a + b - c) / 2. Pieces that are too low by this bound are
halved. What is left at 1 ms or 1 mm is undecided, which counts as a violation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs.plan.verification.proof.verdict import ProofVerdict
from gcs.scenario.environment.ground_bounds import Highest
from gcs.scenario.environment.no_fly import Zone, displacement_m, signed_distance_m
from gcs.types import Array

RESOLUTION_M, RESOLUTION_S = 1e-3, 1e-3
_GAP_M, _FINE_M = 0.1, 5e-3  # at most, and at least, between the bound that is proved and the least value seen
_GAP_SHARE = 0.25  # of what is left to the limit
_CELLS_MAX = 1_000_000  # that one proof looks at; what is left then is undecided

Rows = NDArray[np.intp]
Value = Callable[[Rows, Array], Array]  # values (M,) on pieces (M,) at shares (M,) of them


@dataclass(frozen=True)
class Bound:
    """The bound of a value on a whole flight: nowhere below `proved`; `least` was seen at `share` of `piece`."""

    verdict: ProofVerdict  # never only sampled
    proved: float
    least: float
    piece: int
    share: float


def bound_along(value: Value, change: Array, required: float, *, slack: Array, duration_s: Array) -> Bound:
    """The bound of a value on N pieces, on each of which it changes by at most `change` (N,).

    The value may be wrong by `slack` (N,): a flight that is so far from its pieces at most.
    """
    piece, begin, width = np.arange(len(change)), np.zeros(len(change)), np.ones(len(change))
    at_begin, at_end = value(piece, begin), value(piece, begin + width)
    seen = _Least(required)
    seen.look(at_begin, slack, piece, begin)
    seen.look(at_end, slack, piece, begin + width)
    looked = len(piece)
    while len(piece):
        low = 0.5 * (at_begin + at_end - change[piece] * width) - slack[piece]
        fine = (change[piece] * width <= RESOLUTION_M) | (width * duration_s[piece] <= RESOLUTION_S)
        done = (low >= seen.enough) | fine | (looked > _CELLS_MAX)
        seen.keep(low[done])
        left = ~done
        piece, begin, width = piece[left], begin[left], 0.5 * width[left]
        at_begin, at_end = at_begin[left], at_end[left]
        middle = value(piece, begin + width)
        seen.look(middle, slack, piece, begin + width)
        piece, begin, width = np.tile(piece, 2), np.concatenate([begin, begin + width]), np.tile(width, 2)
        at_begin, at_end = np.concatenate([at_begin, middle]), np.concatenate([middle, at_end])
        looked += len(piece)
    return seen.bound()


@dataclass(frozen=True)
class ZoneParts:
    """Parts of straight pieces, as seen from a zone that moves: begins and ends (M, 2), each part of a `piece`."""

    piece: Rows
    first: Array  # shares of the piece at which parts begin and end
    last: Array
    begin_m: Array
    end_m: Array
    duration_s: Array

    def whole(self, part: int, share: float) -> tuple[int, float]:
        """The piece, and the share of it."""
        return int(self.piece[part]), float(self.first[part] + share * (self.last[part] - self.first[part]))


def parts_beside(zone: Zone, begin_m: Array, end_m: Array, begin_s: Array, end_s: Array) -> ZoneParts:
    """Pieces from begin to end (N, 3) at plan times (N,), cut where the motion of the zone changes."""
    piece, first, last = np.arange(len(begin_m)), np.zeros(len(begin_m)), np.ones(len(begin_m))
    for turn_s in (move[0] for move in zone.moves or ()):
        at = np.full(len(piece), np.nan)
        np.divide(turn_s - begin_s[piece], (end_s - begin_s)[piece], out=at, where=(end_s > begin_s)[piece])
        cut = np.flatnonzero((at > first) & (at < last))
        piece, first, last = np.append(piece, piece[cut]), np.append(first, at[cut]), np.append(last, last[cut])
        last[cut] = at[cut]
    duration_s = (end_s - begin_s)[piece]

    def seen_at(share: Array) -> Array:
        places = begin_m[piece, :2] + share[:, None] * (end_m - begin_m)[piece, :2]
        return np.asarray(places - displacement_m(zone, begin_s[piece] + share * duration_s))

    return ZoneParts(piece, first, last, seen_at(first), seen_at(last), duration_s * (last - first))


def outside_along(zone: Zone, parts: ZoneParts, required_m: float, *, slack: Array) -> Bound:
    """The bound of the distance outside a zone; negative inside."""
    moved_m = parts.end_m - parts.begin_m

    def outside_m(part: Rows, share: Array) -> Array:
        places = parts.begin_m[part] + share[:, None] * moved_m[part]
        return signed_distance_m(zone, places[:, 0], places[:, 1])

    change_m = np.linalg.norm(moved_m, axis=1)
    return bound_along(outside_m, change_m, required_m, slack=slack, duration_s=parts.duration_s)


def clearance_along(
    highest: Highest, begin_m: Array, end_m: Array, required_m: float, *, slack: Array, duration_s: Array
) -> Bound:
    """The bound of the distance to the ground in any direction, on straight pieces from begin to end (N, 3), NED.

    Both the pieces and the ground are halved: a square of the ground that is far from a piece is not divided
    further. A place below the ground has its depth, straight up, as a negative distance.
    """
    seen = _Least(required_m)
    cells = _Cells.of(begin_m, end_m)
    for share in (0.0, 1.0):
        point = begin_m + share * (end_m - begin_m)
        seen.look(-point[:, 2] - highest(point[:, :2], point[:, :2]), slack, cells.piece, 0.0 * cells.share + share)
    # Ground farther away than what was seen straight below does not count.
    reach_m = max(seen.least, 0.0) + float(slack.max(initial=0.0)) + RESOLUTION_M
    cells = replace(cells, half_m=cells.half_m + reach_m)
    length_m, looked = np.linalg.norm(end_m - begin_m, axis=1), 0
    while len(cells.piece):
        looked += len(cells.piece)
        point = begin_m[cells.piece] + cells.share[:, None] * (end_m - begin_m)[cells.piece]
        half_m, flat = cells.half_m[:, None], point[:, :2]
        over_m = -point[:, 2] - highest(cells.centre_m - half_m, cells.centre_m + half_m)
        near_m = np.clip(flat, cells.centre_m - half_m, cells.centre_m + half_m)
        moved_m = 0.5 * cells.width * length_m[cells.piece]
        low = _apart_m(over_m, near_m - flat) - moved_m - slack[cells.piece]
        seen.look(_apart_m(-point[:, 2] - highest(near_m, near_m), near_m - flat), slack, cells.piece, cells.share)
        fine = (cells.half_m <= 0.25 * RESOLUTION_M) & (
            (2.0 * moved_m <= RESOLUTION_M) | (cells.width * duration_s[cells.piece] <= RESOLUTION_S)
        )
        done = (low >= seen.enough) | fine | (looked > _CELLS_MAX)
        seen.keep(low[done])
        cells = cells.halved(~done, along=moved_m > cells.half_m)
    return seen.bound()


def _apart_m(over_m: Array, beside_m: Array) -> Array:
    """Distances (N,) to columns of ground whose tops are `over_m` below and which begin `beside_m` (N, 2) away."""
    away_m = np.linalg.norm(beside_m, axis=1)
    return np.where(away_m > 0.0, np.hypot(np.maximum(over_m, 0.0), away_m), over_m)


@dataclass
class _Cells:
    """Parts of pieces, each with a square of the ground around it."""

    piece: Rows
    share: Array  # of the part's middle
    width: Array  # of the part, as a share of its piece
    centre_m: Array  # (M, 2)
    half_m: Array  # of the square's side

    @classmethod
    def of(cls, begin_m: Array, end_m: Array) -> _Cells:
        count = len(begin_m)
        half_m = 0.5 * np.abs(end_m - begin_m)[:, :2].max(axis=1, initial=0.0)
        centre_m = 0.5 * (begin_m + end_m)[:, :2]
        return cls(np.arange(count), np.full(count, 0.5), np.ones(count), centre_m, half_m)

    def halved(self, kept: NDArray[np.bool_], *, along: NDArray[np.bool_]) -> _Cells:
        """The cells to keep: two parts of each `along` its piece, four squares of each other one."""
        parts = []
        for share in (-0.25, 0.25):
            rows = np.flatnonzero(kept & along)
            moved = self.share[rows] + share * self.width[rows]
            parts.append((self.piece[rows], moved, 0.5 * self.width[rows], self.centre_m[rows], self.half_m[rows]))
        for north, east in ((-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)):
            rows = np.flatnonzero(kept & ~along)
            centre_m = self.centre_m[rows] + self.half_m[rows, None] * np.array([north, east])
            parts.append((self.piece[rows], self.share[rows], self.width[rows], centre_m, 0.5 * self.half_m[rows]))
        return _Cells(*(np.concatenate(column) for column in zip(*parts, strict=True)))


class _Least:
    """The least value seen, and the least bound proved, while a value is bounded."""

    def __init__(self, required: float) -> None:
        self._required = required
        self.least = self._surely = self._proved = np.inf
        self._slack, self._place = 0.0, (0, 0.0)

    def look(self, values: Array, slack: Array, piece: Rows, share: Array) -> None:
        """Values (M,) that there are, each wrong by at most the slack of its piece; what is no number is -inf."""
        if not len(values):
            return
        values = np.where(np.isnan(values), -np.inf, values)
        at = int(np.argmin(values))
        self._surely = min(self._surely, float(np.min(values - slack[piece])))
        if values[at] < self.least:
            self.least, self._slack = float(values[at]), float(slack[piece[at]])
            self._place = int(piece[at]), float(share[at])

    @property
    def enough(self) -> float:
        """A bound that need not be better: near the least value, and kept from the limit where that is possible."""
        left = self._surely - self._required
        gap = min(max(_GAP_SHARE * abs(left), _FINE_M), _GAP_M)
        return max(self._surely - gap, self._required) if left >= 0.0 else self._surely - gap

    def keep(self, low: Array) -> None:
        """Bounds that are final."""
        self._proved = min(self._proved, float(np.min(np.where(np.isnan(low), -np.inf, low), initial=np.inf)))

    def bound(self) -> Bound:
        proved = min(self._proved, self._surely)
        verdict = ProofVerdict.PROVED if proved >= self._required else ProofVerdict.UNDECIDED
        if self.least + self._slack < self._required:
            verdict = ProofVerdict.VIOLATED
        return Bound(verdict, proved, self.least, *self._place)
