"""Places in a formation that changes automatically or turns with its course, and its heading along the course.

Such a shape is the scheduled one e, blended with the target g, rotated about the vertical and scaled:

    offset = scale * Rz(turn) * ((1 - blend) * e + blend * g)

A witness is enough for a proof: polynomials of time for scale, turn and blend from which no vehicle is farther than the
tolerance. In the middle of an interval they are the nearest allowed shape; Newton's method on the coefficients of the
Taylor models gives the higher powers. What such polynomials leave of their ranges counts as a distance.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from gcs.physics.states import VELOCITY
from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.plan.verification.constraints.allowed_shapes import AllowedShapes
from gcs.plan.verification.constraints.formation_law import InParts
from gcs.plan.verification.constraints.position_limits import RESOLUTION_M
from gcs.plan.verification.constraints.scheduled_shape import Stretch
from gcs.plan.verification.proof.polynomials import combined, enclosed
from gcs.plan.verification.proof.subdivision import Cells
from gcs.plan.verification.proof.taylor import Taylor, arctan2, constant, stacked, total
from gcs.plan.verification.proof.verdict import LENGTH_TOLERANCE_M, NamedConstraint
from gcs.types import Array

# A formation that turns with its course must face where it flies above this speed.
COURSE_SPEED_MPS = 1.0
COURSE_TOLERANCE = 0.01  # share of `course_tolerance_deg`
ORDER = 4
_POLISHED = 2  # steps of Gauss and Newton after the search for the nearest allowed shape
_TOGETHER = 200_000  # vehicles times intervals at once: more would need gigabytes of memory
_SINGULAR = 1e-8  # of the largest eigenvalue: below it, shapes do not tell scale, turn and blend apart
_FLAT = np.array([1.0, 1.0, 0.0])
_QUARTER = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # row vectors: (n, e) -> (-e, n)
_Factor = TypeVar("_Factor", Taylor, Array)


@dataclass(frozen=True)
class _Witness:
    """The allowed shape found near the flown one in each of N intervals, and how far vehicles are from it."""

    turn: Taylor  # (N,)
    off_m: Array  # (N,) no vehicle is farther from it, at any instant
    off_middle_m: Array  # (V, N) in the middle


@dataclass(frozen=True)
class BentFormation(InParts[Stretch]):
    """How far (negative) vehicles are from an allowed shape."""

    allowed: AllowedShapes
    mission: int  # the number of the phase in which the heading is checked

    @cached_property
    def constraints(self) -> tuple[NamedConstraint, ...]:
        """The heading only where the formation turns with its course."""
        place = NamedConstraint(LENGTH_TOLERANCE_M, RESOLUTION_M, ConstraintId(Kind.PLACE), "m")
        if self.plan.scenario.formation.frame != "course":
            return (place,)
        tolerance = COURSE_TOLERANCE * self.plan.scenario.formation.course_tolerance_deg
        return place, NamedConstraint(tolerance, 0.2 * tolerance, ConstraintId(Kind.COURSE), "deg")

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`."""
        shape = len(self.constraints), len(cells)
        low, seen = np.full(shape, np.inf), np.full(shape, np.inf)
        many = max(_TOGETHER // len(self.plan.sysids), 1)
        for index in np.unique(cells.who[:, 0]):
            whole = np.flatnonzero(cells.who[:, 0] == index)
            for chosen in np.split(whole, range(many, len(whole), many)):
                part = cells[chosen]
                witness = self._witness(self.parts[index], part)
                low[0, chosen] = -witness.off_m
                seen[0, chosen] = -witness.off_middle_m.max(axis=0)
                if len(self.constraints) > 1:
                    low[1, chosen], seen[1, chosen] = self._heading_deg(part, witness)
        return low, seen

    def farthest_row(self, constraint: ConstraintId, t_s: float) -> int:
        """The row of the vehicle that is farthest from its place; the leader of the heading."""
        if constraint.kind is Kind.COURSE:
            return self.plan.leader
        moment = np.array([t_s])
        cells = self.cells(moment - 1e-9, moment + 1e-9, np.zeros(1, dtype=np.intp))
        off = self._witness(self.parts[cells.who[0, 0]], cells).off_middle_m[:, 0]
        return int(np.nan_to_num(off, nan=np.inf).argmax())

    def _witness(self, stretch: Stretch, cells: Cells) -> _Witness:
        """The allowed shapes nearest to the plan's, and what is left of the offsets."""
        plan = self.plan
        own = enclosed(plan.shape.functions, cells.start_s, cells.end_s, ORDER)  # (K, N)
        own_m = plan.shape.basis_ned_m - plan.shape.basis_ned_m[:, plan.leader][:, None]
        base = stretch.functions(cells.start_s, cells.end_s, ORDER)
        tables = np.concatenate([stretch.tables_ned_m, self.allowed.target_ned_m[None]])
        bent_m = np.concatenate([tables * _FLAT, tables @ _QUARTER, tables * (1.0 - _FLAT)])
        every_m = np.concatenate([own_m, bent_m])

        def left(x: list[Taylor]) -> list[Taylor]:
            """Offsets less those of an allowed shape: three components (V, N)."""
            scale, turn, blend = x
            c, s = scale * turn.cos(), scale * turn.sin()
            bent = stacked(_weights(c, s, scale, _shares(base, blend)))
            whole = Taylor(np.concatenate([own.c, -bent.c], axis=1), np.concatenate([own.remainder, bent.remainder]))
            return combined(whole, every_m)

        middle = [function.middle for function in base]
        start, slopes = self._fitted(combined(own, own_m), middle, stretch.tables_ned_m, bent_m)
        x = [constant(value, ORDER) for value in start]
        for _ in range(ORDER):
            rest = np.stack([part.c[1:] for part in left(x)])  # (3, K, V, N)
            steps = np.einsum("davn,akvn->dkn", slopes, rest)
            x = [
                Taylor(np.concatenate([v.c[:1], v.c[1:] + step]), v.remainder) for v, step in zip(x, steps, strict=True)
            ]
        off = left(x)
        off_m = np.sqrt(np.maximum(total([part.square() for part in off]).range()[1], 0.0)).max(axis=0)
        return _Witness(x[1], off_m + self._outside_m(x, stretch), np.sqrt(sum(part.middle**2 for part in off)))

    def _fitted(self, seen: list[Taylor], base: list[Array], base_m: Array, bent_m: Array) -> tuple[Array, Array]:
        """Scale, turn and blend (3, N) nearest to what is seen in the middle, and the pseudo-inverse (3, 3, V, N).

        Rows of what may not change are zero.
        """
        places = np.stack([part.middle for part in seen], axis=-1)  # (V, N, 3)
        expected = np.einsum("kn,kva->vna", np.stack(base), base_m)
        x = np.stack(self.allowed.nearest(places, expected))
        ranges = np.array(self.allowed.ranges)
        low, high = ranges[:, :1], ranges[:, 1:]
        free = np.asarray(high > low, dtype=float)

        def left(x: Array) -> Array:
            scale, turn, blend = x
            weights = _weights(scale * np.cos(turn), scale * np.sin(turn), scale, _shares(base, blend))
            return np.asarray(places - np.einsum("kn,kva->vna", np.stack(weights), bent_m))

        for _ in range(_POLISHED):
            better = np.clip(x + np.einsum("davn,vna->dn", _inverse(x, base, bent_m, free), left(x)), low, high)
            gain = np.sum(left(better) ** 2, axis=(0, 2)) < np.sum(left(x) ** 2, axis=(0, 2))
            x = np.where(gain, better, x)
        return x, _inverse(x, base, bent_m, free)

    def _outside_m(self, x: list[Taylor], stretch: Stretch) -> Array:
        """By how much (N,) a vehicle moves when polynomials are cut off at the ends of their ranges."""
        size_m = 1.1 * (stretch.widest_m + float(np.linalg.norm(self.allowed.target_ned_m, axis=1).max()))
        beyond = []
        for value, (low, high) in zip(x, self.allowed.ranges, strict=True):
            least, most = np.min(value.c[0]), np.max(value.c[0])
            if low == high and least == most == low and not value.c[1:].any():
                beyond.append(np.zeros(value.c.shape[1]))  # without the room for rounding that a bound has
                continue
            least, most = value.range()
            beyond.append(np.maximum(np.maximum(low - least, most - high), 0.0))
        largest = x[0].size()
        return np.asarray(size_m * (beyond[0] + (largest + beyond[0]) * (beyond[1] + beyond[2])))

    def _heading_deg(self, cells: Cells, witness: _Witness) -> tuple[Array, Array]:
        """The margin of the heading along the course, where the leader is fast enough: bound and middle (N,)."""
        begin, formation = self.plan.scenario.start, self.plan.scenario.formation
        north, east = begin.velocity_mps[:2]
        facing = np.arctan2(east, north) if north or east else np.radians(begin.roll_pitch_yaw_deg[2])
        velocity = enclosed(self.plan.leader_trajectory.state, cells.start_s, cells.end_s, ORDER)[VELOCITY]
        heading = witness.turn + float(facing)
        c, s = heading.cos(), heading.sin()
        away = arctan2(velocity[1] * c - velocity[0] * s, velocity[0] * c + velocity[1] * s)
        fastest = (velocity[0].square() + velocity[1].square()).range()[1]
        now = np.hypot(velocity[0].middle, velocity[1].middle)
        low = formation.course_tolerance_deg - np.degrees(away.size())
        # The heading is that of an allowed shape which proves the places too.
        loose = witness.off_m - witness.off_middle_m.max(axis=0) > LENGTH_TOLERANCE_M
        low = np.where(loose | np.isnan(low), -np.inf, low)
        seen = formation.course_tolerance_deg - np.degrees(np.abs(away.middle))
        applies = cells.phase == self.mission
        return (
            np.where(applies & ~(fastest <= COURSE_SPEED_MPS**2), low, np.inf),
            np.where(applies & ~(now <= COURSE_SPEED_MPS), seen, np.inf),
        )


def _shares(base: list[_Factor], blend: _Factor) -> list[_Factor]:
    """The part of each table in the blended shape: those of the scheduled shape, then that of the target."""
    return [function * (1.0 - blend) for function in base] + [blend]


def _weights(c: _Factor, s: _Factor, up: _Factor, shares: list[_Factor]) -> list[_Factor]:
    """The factors of all tables as they are, then a quarter turn ahead, then their vertical parts."""
    return [factor * share for factor in (c, s, up) for share in shares]


def _inverse(x: Array, base: list[Array], bent_m: Array, free: Array) -> Array:
    """The pseudo-inverse (3, 3, V, N) of the derivatives of all offsets by scale, turn and blend."""
    scale, turn, blend = x
    c, s, none = np.cos(turn), np.sin(turn), np.zeros_like(scale)
    shares = _shares(base, blend)
    by = [
        _weights(c, s, none + 1.0, shares),
        _weights(-scale * s, scale * c, none, shares),
        _weights(scale * c, scale * s, scale, [-function for function in base] + [none + 1.0]),
    ]
    slopes = np.einsum("dkn,kva->davn", np.stack([np.stack(part) for part in by]), bent_m) * free[:, :, None, None]
    squares = np.nan_to_num(np.einsum("davn,eavn->nde", slopes, slopes), nan=0.0, posinf=0.0, neginf=0.0)
    values, vectors = np.linalg.eigh(squares)
    large = values > np.maximum(_SINGULAR * values[:, -1:], 1e-12)
    inverse = np.einsum("ndi,ni,nei->nde", vectors, np.where(large, 1.0 / np.where(large, values, 1.0), 0.0), vectors)
    return np.asarray(np.einsum("nde,eavn->davn", inverse, slopes))
