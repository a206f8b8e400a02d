"""Separation, motion, effort, places and zones of tracks, each bounded over intervals of time."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gcs.mission.proving.track import FleetMotion
from gcs.physics.quadrotor import Quadrotor
from gcs.plan.trajectory.constraint_id import Kind
from gcs.plan.verification.constraints.position_limits import RESOLUTION_M, outside_zone
from gcs.plan.verification.proof.subdivision import SHORTEST_S, Cells, Constraint, Mask, Rows, halved, joined
from gcs.plan.verification.proof.taylor import FUNCTIONS, Taylor
from gcs.plan.verification.proof.verdict import LENGTH_TOLERANCE_M, LIMIT_TOLERANCE
from gcs.scenario.environment.no_fly import Zone, ZoneName
from gcs.types import Array

_ROUNDING_M = 1e-9
PIECE = -1  # the level of a cell in which neither vehicle has a joint
_DOWN = 2
NamedRanges = tuple[tuple[str, tuple[float, float] | None], ...]  # of north, east and height: its name, its limits
LENGTH = Constraint(LENGTH_TOLERANCE_M, RESOLUTION_M)


@dataclass(frozen=True)
class TrackCriterion:
    """What is proved, for people: the quantity, its unit and its limit, and whether the limit is the most."""

    name: str
    unit: str
    limit: float
    most: bool = False
    kind: Kind | None = None  # where code must know it


@dataclass(frozen=True, eq=False)
class TrackSeparation:
    """The distance of pairs (a, b), on 2^k windows that are divided down to one, at its joints, and then in halves.

    With a vertical scale above 1 vehicles must be farther apart in height, for the downwash: a metre of height counts
    as 1 / scale.
    """

    motion: FleetMotion
    limit_m: float
    vertical_scale: float

    @property
    def criteria(self) -> tuple[TrackCriterion, ...]:
        """The one criterion."""
        return (TrackCriterion("separation", "m", self.limit_m, kind=Kind.SEPARATION),)

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """In the order of the margins."""
        return (LENGTH,)

    def cells(self) -> Cells:
        """Every pair on the one window that holds all of the flight."""
        pairs = np.stack(np.triu_indices(len(self.motion.begins), 1), axis=1)
        level, edges_s = len(self.motion.relative.windows) - 1, self.motion.edges_s
        patch = np.tile([float(level), 0.0], (len(pairs), 1))
        start_s, end_s = np.full(len(pairs), edges_s[0]), np.full(len(pairs), edges_s[-1])
        return self._in_pieces(Cells(pairs, start_s, end_s, np.zeros(len(pairs), dtype=np.intp), patch))

    @cached_property
    def scale(self) -> Array:
        """What a metre north, east and down counts as."""
        return np.array([1.0, 1.0, 1.0 / self.vertical_scale])

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`."""
        low, seen = np.empty(len(cells)), np.empty(len(cells))
        for level in np.unique(cells.patch[:, 0]).astype(int).tolist():
            chosen = np.flatnonzero(cells.patch[:, 0] == level)
            of = self._within_one(cells[chosen]) if level == PIECE else self.of_windows(cells[chosen], level)
            low[chosen], seen[chosen] = of
        return low[None] - self.limit_m, seen[None] - self.limit_m

    def _within_one(self, cells: Cells) -> tuple[Array, Array]:
        """Distances, bounded by the tangent in the middle's direction and by the square."""
        first, second = (self.motion.enclosed(cells.who[:, one], cells.start_s, cells.end_s) for one in (0, 1))
        apart = (first - second) * self.scale[:, None]
        length = np.linalg.norm(apart.middle, axis=0)
        toward = apart.middle / np.maximum(length, 1e-9)
        along = (apart[0] * toward[0] + apart[1] * toward[1] + apart[2] * toward[2]).low()
        return np.maximum(along, np.sqrt(np.maximum(squared(apart).low(), 0.0))), self._distance(cells)

    def of_windows(self, cells: Cells, level: int) -> tuple[Array, Array]:
        """Distances (M,) on windows of one level, by the gap of boxes, the distance in the middle and the velocity."""
        number = cells.patch[:, 1].astype(np.intp)
        beside = self.motion.relative
        low, high, slow, fast = beside.windows[level]
        a, b = cells.who.T
        gap = np.maximum(low[a, number] - high[b, number], low[b, number] - high[a, number])
        boxes = np.linalg.norm(np.maximum(gap, 0.0) * self.scale, axis=1)
        relative = np.maximum(fast[a, number] - slow[b, number], fast[b, number] - slow[a, number])
        moved = 0.5 * (cells.end_s - cells.start_s) * np.linalg.norm(relative * self.scale, axis=1)
        begins = number << level
        ends = np.minimum(begins + (1 << level), len(self.motion.edges_s) - 1)
        first = self.motion.begins
        jumped = sum(beside.jumps_m[first[row, ends] - 1] - beside.jumps_m[first[row, begins]] for row in (a, b))
        distance = self._distance(cells)
        off = (self.motion.off_m[a] + self.motion.off_m[b]) * max(1.0, 1.0 / self.vertical_scale)
        return np.maximum(boxes, distance - moved - jumped - off - _ROUNDING_M), distance

    def _distance(self, cells: Cells) -> Array:
        """The distance (M,) in the middle."""
        first, second = (self.motion.places(cells.who[:, one], cells.middle_s) for one in (0, 1))
        return np.asarray(np.linalg.norm((first - second) * self.scale, axis=1))

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """See `Family`: both halves of windows, the parts of one between the joints of both, halves of a part."""
        level = cells.patch[:, 0].astype(np.intp)
        long = np.flatnonzero(chosen & (level == PIECE) & (cells.end_s - cells.start_s > SHORTEST_S))
        found, origin = [halved(cells[long])], [np.concatenate([long, long])]
        wide = np.flatnonzero(chosen & (level > 0))
        below, count = level[wide] - 1, len(self.motion.edges_s) - 1
        for side in (0, 1):
            number = 2 * cells.patch[wide, 1].astype(np.intp) + side
            begins, ends = number << below, np.minimum((number + 1) << below, count)
            there = begins < count
            edges_s = self.motion.edges_s
            patch = np.stack([below, number], axis=1)[there].astype(np.float64)
            starts_s, ends_s = edges_s[begins[there]], edges_s[ends[there]]
            parts = replace(cells[wide[there]], start_s=starts_s, end_s=ends_s, patch=patch)
            found.append(self._in_pieces(parts))
            origin.append(wide[there])
        jointed = np.flatnonzero(chosen & (level == 0))
        parts, of = self._between_joints(cells[jointed])
        found.append(parts)
        origin.append(jointed[of])
        return joined(found), np.concatenate(origin)

    def _in_pieces(self, cells: Cells) -> Cells:
        """Cells of one window in which neither vehicle has a joint are within one piece."""
        window = cells.patch[:, 1].astype(np.intp)
        whole = cells.patch[:, 0] == 0.0
        for one in (0, 1):
            whole[whole] = self.motion.single(cells.who[whole, one], window[whole])
        cells.patch[whole, 0] = PIECE
        return cells

    def _between_joints(self, cells: Cells) -> tuple[Cells, Rows]:
        """The parts of cells of one window between the joints of both vehicles, and the cell of each."""
        window, every = cells.patch[:, 1].astype(np.intp), np.arange(len(cells))
        of, at_s = [every], [cells.start_s]
        for one in (0, 1):
            first, last = (self.motion.begins[cells.who[:, one], window + after] for after in (0, 1))
            inner = last - first - 1
            cell = np.repeat(every, inner)
            piece = first[cell] + 1 + np.arange(len(cell)) - (np.cumsum(inner) - inner)[cell]
            of.append(cell)
            at_s.append(self.motion.starts_s[piece])
        begins = np.unique(np.stack([np.concatenate(of), np.concatenate(at_s)], axis=1), axis=0)
        origin, start_s = begins[:, 0].astype(np.intp), begins[:, 1]
        ends_here = np.append(origin[1:] != origin[:-1], True)
        end_s = np.where(ends_here, cells.end_s[origin], np.append(start_s[1:], 0.0))
        patch = np.column_stack([np.full(len(origin), float(PIECE)), cells.patch[origin, 1]])
        return replace(cells[origin], start_s=start_s, end_s=end_s, patch=patch), origin


class _OfVehicles:
    """Margins of single vehicles, divided in time alone."""

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """See `Family`."""
        long = np.flatnonzero(chosen & (cells.end_s - cells.start_s > SHORTEST_S))
        return halved(cells[long]), np.concatenate([long, long])


@dataclass(frozen=True, eq=False)
class TrackMotion(_OfVehicles):
    """Speed, acceleration and jerk, and the speed along single axes."""

    motion: FleetMotion
    sizes: tuple[tuple[int, TrackCriterion], ...]  # the derivative, and its most
    along: tuple[TrackCriterion, ...] = ()  # the most of the speed along north, east and the vertical

    @property
    def criteria(self) -> tuple[TrackCriterion, ...]:
        """In the order of the margins."""
        return (*(criterion for _, criterion in self.sizes), *self.along)

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """In the order of the margins."""
        return tuple(map(_relative, self.criteria))

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`."""
        low, seen = [], []
        for derivative, criterion in self.sizes:
            vector = self.motion.enclosed(cells.who[:, 0], cells.start_s, cells.end_s, derivative)
            low.append(criterion.limit - np.sqrt(np.maximum(squared(vector).range()[1], 0.0)))
            seen.append(criterion.limit - np.linalg.norm(vector.middle, axis=0))
        if self.along:
            velocity = self.motion.enclosed(cells.who[:, 0], cells.start_s, cells.end_s, 1)
            most, now = velocity.size(), np.abs(velocity.middle)
            low += [criterion.limit - most[axis] for axis, criterion in enumerate(self.along)]
            seen += [criterion.limit - now[axis] for axis, criterion in enumerate(self.along)]
        return np.stack(low), np.stack(seen)


@dataclass(frozen=True, eq=False)
class TrackEffort(_OfVehicles):
    """Thrust and tilt of one type of vehicle: Eq. 1 solved for the force of the rotors, with its drag and the wind.

    The tilt is the angle between that force and the vertical: |roll| and |pitch| are at most as large.
    """

    motion: FleetMotion
    vehicle: Quadrotor
    thrust_N: tuple[float, float]
    tilt_rad: float

    @property
    def criteria(self) -> tuple[TrackCriterion, ...]:
        """In the order of the margins."""
        low_N, high_N = self.thrust_N
        thrust = TrackCriterion("least thrust", "N", low_N), TrackCriterion("greatest thrust", "N", high_N, most=True)
        return (*thrust, TrackCriterion("tilt", "deg", np.degrees(self.tilt_rad).item(), most=True))

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """In the order of the margins."""
        return tuple(map(_relative, self.criteria))

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`."""
        q = self.vehicle
        place, velocity, acceleration = (
            self.motion.enclosed(cells.who[:, 0], cells.start_s, cells.end_s, derivative) for derivative in (0, 1, 2)
        )
        wind = q.wind.at(-place[2], FUNCTIONS)
        gravity = (0.0, 0.0, q.gravity_mps2)
        force = [
            q.mass_kg * (gravity[axis] - acceleration[axis]) - q.drag_Nspm[axis] * (velocity[axis] - wind[axis])
            for axis in range(3)
        ]
        beside, up = force[0].square() + force[1].square(), force[2]
        least, most = (beside + up.square()).range()
        # Below the level the tilt is largest where the force is most nearly vertical.
        aside_N = np.sqrt(np.maximum(np.where(up.low() < 0.0, *beside.range()), 0.0))
        tilted = np.degrees(np.arctan2(aside_N, up.low()))
        now = np.stack([part.middle for part in force])
        thrust = np.linalg.norm(now, axis=0)
        tilt = np.degrees(np.arctan2(np.hypot(now[0], now[1]), now[2]))
        (low_N, high_N), limit_deg = self.thrust_N, np.degrees(self.tilt_rad)
        low = [np.sqrt(np.maximum(least, 0.0)) - low_N, high_N - np.sqrt(most), limit_deg - tilted]
        return np.stack(low), np.stack([thrust - low_N, high_N - thrust, limit_deg - tilt])


def _relative(criterion: TrackCriterion) -> Constraint:
    """What is allowed beyond a limit by rounding, as a share of it."""
    size = LIMIT_TOLERANCE * abs(criterion.limit)
    return Constraint(size, size / 4.0)


@dataclass(frozen=True, eq=False)
class TrackPlaces(_OfVehicles):
    """Heights above 0 and zones, at the times at which the zones are there."""

    motion: FleetMotion
    ranges_m: NamedRanges
    zones: tuple[tuple[ZoneName, Zone], ...]
    zone_margin_m: float

    @property
    def criteria(self) -> tuple[TrackCriterion, ...]:
        """In the order of the margins."""
        found = []
        for what, limits_m in self.ranges_m:
            if limits_m is not None:
                found.append(TrackCriterion(f"least {what}", "m", limits_m[0]))
                found.append(TrackCriterion(f"greatest {what}", "m", limits_m[1], most=True))
        named = (TrackCriterion(f"distance to {name.edge}", "m", self.zone_margin_m) for name, _ in self.zones)
        return (*found, *named)

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """In the order of the margins."""
        return (LENGTH,) * len(self.criteria)

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`."""
        place = self._place(cells)
        found: list[tuple[Array, Array]] = []
        for axis, (_, limits_m) in enumerate(self.ranges_m):
            if limits_m is not None:
                sign = -1.0 if axis == _DOWN else 1.0
                (least, most), at = (sign * place[axis]).range(), sign * place.middle[axis]
                found += [(least - limits_m[0], at - limits_m[0]), (limits_m[1] - most, limits_m[1] - at)]
        for _, zone in self.zones:
            low, seen = self._outside(zone, place, cells)
            found.append((low - self.zone_margin_m, seen - self.zone_margin_m))
        return np.stack([low for low, _ in found]), np.stack([seen for _, seen in found])

    def _place(self, cells: Cells) -> Taylor:
        """Where (3, M) the vehicles of cells are."""
        return self.motion.enclosed(cells.who[:, 0], cells.start_s, cells.end_s)

    def _outside(self, zone: Zone, place: Taylor, cells: Cells) -> tuple[Array, Array]:
        """How far (M,) they are outside a zone: at least, and in the middle."""
        return outside_zone(zone, place, cells)


def squared(vector: Taylor) -> Taylor:
    """The squared length (M,) of vectors (3, M)."""
    return vector[0].square() + vector[1].square() + vector[2].square()
