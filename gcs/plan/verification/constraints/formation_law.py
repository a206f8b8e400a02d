"""Places in the formation (Eq. 22), and how vehicles move while it changes by schedule (§2.2.1-2.2.3).

While the shape is rigid, every offset is that of the scenario. While it rotates, all vehicles turn about the axis by
one angle, at the same distance. While it shrinks, all offsets have one scale. While it is reshaped, vehicles fly
straight and in step from one standstill of the shape to the next.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Generic, Literal, TypeVar

import numpy as np

from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints.formation_checks import began_before, expected_places
from gcs.plan.verification.constraints.position_limits import ORDER, RESOLUTION_M
from gcs.plan.verification.constraints.scheduled_shape import Stretch, legs_of
from gcs.plan.verification.proof.polynomials import combined, enclosed
from gcs.plan.verification.proof.subdivision import SHORTEST_S, Cells, Mask, Rows, halved
from gcs.plan.verification.proof.taylor import Taylor, total
from gcs.plan.verification.proof.verdict import LENGTH_TOLERANCE_M, NamedConstraint
from gcs.scenario.values.si import NED_FROM_UP
from gcs.types import Array

_STILL_MPS = 1e-6  # the shape stands still between two legs


@dataclass(frozen=True)
class Span:
    """A part of the flight over which offsets follow one law."""

    start_s: float
    end_s: float
    law: Literal["rigid", "rotate", "in step"]
    before_ned_m: Array  # (V, 3)
    after_ned_m: Array  # (V, 3)
    axis_ned: Array  # (3,)


_Part = TypeVar("_Part", Span, Stretch)


def spans(plan: Plan) -> list[Span]:
    """The parts of the flight in order; without automatic changes, in a formation that keeps its heading."""
    changes = [change for change in plan.scenario.formation.change if not change.auto]
    down = np.array([0.0, 0.0, 1.0])
    found: list[Span] = []
    places = expected_places(plan)
    for number, (start_s, end_s, expected) in enumerate(places):
        found.append(Span(start_s, end_s, "rigid", expected, expected, down))
        if number >= len(places) - 1:
            break
        move, change = plan.scheduled_moves[number], changes[number]
        after = places[number + 1][2]
        if change.kind == "rotate":
            axis = down if change.axis is None else np.array(change.axis) * NED_FROM_UP
            found.append(Span(move.start_s, move.end_s, "rotate", expected, after, axis / np.linalg.norm(axis)))
            continue
        if began_before(plan, move.start_s):  # of which the shape no longer tells its first standstills
            stops, ends = legs_of(plan, change, expected, after)
            edges = (move.start_s + (move.end_s - move.start_s) * ends).tolist()
        else:
            edges = _standstills(plan, move.start_s, move.end_s)
            stops = [expected, *(plan.shape.at(t_s) for t_s in edges[1:-1]), after]
        for low, high, a, b in zip(edges[:-1], edges[1:], stops[:-1], stops[1:], strict=True):
            found.append(Span(low, high, "in step", a, b, down))
    return found


def _standstills(plan: Plan, start_s: float, end_s: float) -> list[float]:
    """The instants from start to end at which no vehicle moves within the shape: where one leg ends."""
    joints = plan.shape.joints_s
    inner = joints[(joints > start_s + 1e-6) & (joints < end_s - 1e-6)]
    speed = np.linalg.norm(plan.offsets(inner, 1), axis=2).max(axis=0) if len(inner) else np.empty(0)
    return [start_s, *inner[speed < _STILL_MPS].tolist(), end_s]


@dataclass(frozen=True)
class InParts(Generic[_Part]):
    """Constraints of all vehicles together over parts of the flight. The cell's group is the number of a part."""

    plan: Plan
    parts: list[_Part]

    def cells(self, start_s: Array, end_s: Array, phase: Rows) -> Cells:
        """One cell for each interval (N,); intervals do not reach over the ends of parts."""
        middle = 0.5 * (start_s + end_s)
        number = np.zeros(len(middle), dtype=np.intp)
        for index, part in enumerate(self.parts):
            number[(middle >= part.start_s) & (middle <= part.end_s)] = index
        return Cells(number[:, None], start_s, end_s, phase, np.zeros((len(middle), 0)))

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """See `Family`."""
        long = np.flatnonzero(chosen & (cells.end_s - cells.start_s > SHORTEST_S))
        return halved(cells[long]), np.concatenate([long, long])

    def row(self, who: Rows) -> int:
        """See `Family`: which vehicle it is must be looked up at the instant."""
        return -1


@dataclass(frozen=True)
class FormationLaw(InParts[Span]):
    """How far (negative) vehicles are from where the law of the span has them."""

    @cached_property
    def constraints(self) -> tuple[NamedConstraint, ...]:
        """The places of the vehicles alone."""
        return (NamedConstraint(LENGTH_TOLERANCE_M, RESOLUTION_M, ConstraintId(Kind.PLACE), "m"),)

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`."""
        low, seen = np.full(len(cells), np.inf), np.full(len(cells), np.inf)
        for index in np.unique(cells.who[:, 0]):
            chosen = np.flatnonzero(cells.who[:, 0] == index)
            off = _off(self.parts[index], self._offsets(cells[chosen]))  # three components (V, N)
            squared = total([part.square() for part in off])
            low[chosen] = -np.sqrt(np.maximum(squared.range()[1], 0.0)).max(axis=0)
            seen[chosen] = -np.sqrt(sum(part.middle**2 for part in off)).max(axis=0)
        return low[None], seen[None]

    def farthest_row(self, constraint: ConstraintId, t_s: float) -> int:
        """The row of the vehicle that is farthest from its place."""
        moment = np.array([t_s])
        cells = self.cells(moment - 1e-9, moment + 1e-9, np.zeros(1, dtype=np.intp))
        off = _off(self.parts[cells.who[0, 0]], self._offsets(cells))
        return int(np.sum([part.middle[:, 0] ** 2 for part in off], axis=0).argmax())

    def _offsets(self, cells: Cells) -> list[Taylor]:
        """Offsets from the leader: three components (V, N)."""
        shape = self.plan.shape
        functions = enclosed(shape.functions, cells.start_s, cells.end_s, ORDER)  # (K, N)
        table = shape.basis_ned_m - shape.basis_ned_m[:, self.plan.leader][:, None]
        return combined(functions, table)


def _off(span: Span, offsets: list[Taylor]) -> list[Taylor]:
    """How far offsets (three components (V, N)) are from the law of a span."""
    before, after = span.before_ned_m, span.after_ned_m
    if span.law == "rigid":
        return [offset - before[:, axis, None] for axis, offset in enumerate(offsets)]
    if span.law == "rotate":
        return _off_the_turn(before, span.axis_ned, offsets)
    # One share of the way for all: that of the vehicle with the longest way.
    way = after - before
    longest = int(np.linalg.norm(way, axis=1).argmax())
    length = float(np.linalg.norm(way[longest]))
    if length == 0.0:
        return [offset - before[:, axis, None] for axis, offset in enumerate(offsets)]
    flown = total(
        [
            (offset[longest] - before[longest, axis]) * (way[longest, axis] / length**2)
            for axis, offset in enumerate(offsets)
        ]
    )
    share = Taylor(flown.c[:, None], flown.remainder[None])
    return [offset - before[:, axis, None] - share * way[:, axis, None] for axis, offset in enumerate(offsets)]


def _off_the_turn(before: Array, axis_ned: Array, offsets: list[Taylor]) -> list[Taylor]:
    """Along the axis, and across it: the angle is that of the vehicle farthest from the axis."""
    side = np.cross(axis_ned, np.eye(3)[np.abs(axis_ned).argmin()])
    side /= np.linalg.norm(side)
    frame = np.stack([side, np.cross(axis_ned, side), axis_ned])  # rows: two across, one along
    turned = [total([offsets[i] * float(row[i]) for i in range(3)]) for row in frame]
    start = before @ frame.T  # (V, 3)
    widest = int(np.hypot(start[:, 0], start[:, 1]).argmax())
    radius = float(np.hypot(start[widest, 0], start[widest, 1]))
    along = turned[2] - start[:, 2, None]
    if radius == 0.0:
        return [turned[0] - start[:, 0, None], turned[1] - start[:, 1, None], along]
    # (c, s) is the turn of the widest vehicle; its length must be 1, and all others must be turned alike.
    u, v = start[widest, 0] / radius**2, start[widest, 1] / radius**2
    first, second = turned[0][widest], turned[1][widest]
    c, s = first * u + second * v, second * u - first * v
    cosine, sine = (Taylor(part.c[:, None], part.remainder[None]) for part in (c, s))
    longer = (c.square() + s.square() - 1.0) * (0.5 * radius)
    x = turned[0] - cosine * start[:, 0, None] + sine * start[:, 1, None]
    y = turned[1] - sine * start[:, 0, None] - cosine * start[:, 1, None]
    return [x + Taylor(longer.c[:, None], longer.remainder[None]), y, along]
