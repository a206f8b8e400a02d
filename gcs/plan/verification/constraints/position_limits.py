"""Places of every vehicle: box and height limits (Eq. 51), no-fly zones (Eqs. 21, 24) and keep-in areas."""

from dataclasses import dataclass

import numpy as np

from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints.state_control_limits import divided
from gcs.plan.verification.proof.ground_patches import GroundPatches
from gcs.plan.verification.proof.polynomials import enclosed
from gcs.plan.verification.proof.subdivision import Cells, Mask, Rows
from gcs.plan.verification.proof.taylor import Taylor
from gcs.plan.verification.proof.vehicle_tree import VehicleTree, enclosed_offsets
from gcs.plan.verification.proof.verdict import LENGTH_TOLERANCE_M, NamedConstraint
from gcs.scenario.environment.convex_pieces import Convex, Disk
from gcs.scenario.environment.no_fly import Zone, displacement_m, pieces, zone_names, zones
from gcs.scenario.environment.terrain import ground_height_m
from gcs.types import Array

ORDER = 2
RESOLUTION_M = 0.25e-3


def enclosed_places(plan: Plan, tree: VehicleTree, cells: Cells) -> Taylor:
    """Places (3, N), NED, of all vehicles of each cell."""
    leader = enclosed(plan.leader_trajectory.state, cells.start_s, cells.end_s, ORDER)[:3]
    return leader + enclosed_offsets(plan.shape, tree, cells.who[:, 0], cells.start_s, cells.end_s, ORDER)


@dataclass(frozen=True)
class PositionLimits:
    """Box, height limits and zones. The lower height limit and the narrow box hold in some phases only."""

    plan: Plan
    tree: VehicleTree
    airborne: Rows  # numbers of the phases in which the formation flies
    mission: int
    ground: GroundPatches
    area_m: tuple[tuple[float, float], tuple[float, float]]  # north and east: the box, and all pads in other phases

    @property
    def constraints(self) -> tuple[NamedConstraint, ...]:
        """In the order of the margins."""
        ids = [ConstraintId(kind) for kind in (Kind.HEIGHT, Kind.HEIGHT_ABOVE_GROUND, Kind.NORTH, Kind.EAST)]
        ids += [ConstraintId(Kind.ZONE, of=name) for name in zone_names(self.plan.scenario)]
        return tuple(NamedConstraint(LENGTH_TOLERANCE_M, RESOLUTION_M, one, "m") for one in ids)

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`."""
        place = enclosed_places(self.plan, self.tree, cells)
        limits = self.plan.scenario.limits
        flies, is_mission = np.isin(cells.phase, self.airborne), cells.phase == self.mission
        floor = np.where(flies, limits.height_m[0], -np.inf)
        found = [_between(-place[2], floor, np.full(len(cells), limits.height_m[1]))]
        found.append(self._above_ground(place, flies))
        for axis, narrow in enumerate((limits.north_m, limits.east_m)):
            wide = self.area_m[axis]
            low, high = (np.where(is_mission, narrow[end], wide[end]) for end in (0, 1))
            found.append(_between(place[axis], low, high))
        margin_m = limits.zone_margin_m or 0.0
        for zone in zones(self.plan.scenario):
            low, seen = outside_zone(zone, place, cells)
            found.append((low - margin_m, seen - margin_m))
        return np.stack([f[0] for f in found]), np.stack([f[1] for f in found])

    def _above_ground(self, place: Taylor, flies: Mask) -> tuple[Array, Array]:
        """The height above the ground, in the ground phases."""
        low, seen = np.full(len(flies), np.inf), np.full(len(flies), np.inf)
        if not flies.all():
            here = place[:, ~flies]
            column = self.ground.around(
                here.middle[0], here.middle[1], np.hypot(here[0].deviation(), here[1].deviation())
            )
            straight_up = np.broadcast_to([0.0, 0.0, -1.0], (len(column), 3))
            low[~flies] = (-here[2]).low() - self.ground.support(column, straight_up)
            seen[~flies] = -here.middle[2] - ground_height_m(self.plan.scenario.terrain, *here.middle[:2])
        return low, seen

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """See `Family`."""
        return divided(cells, chosen, self.tree)

    def row(self, who: Rows) -> int:
        """See `Family`."""
        return int(self.tree.row[who[0]])


def _between(value: Taylor, low: Array, high: Array) -> tuple[Array, Array]:
    least, most = value.range()
    return np.minimum(least - low, high - most), np.minimum(value.middle - low, high - value.middle)


def outside_zone(zone: Zone, place: Taylor, cells: Cells) -> tuple[Array, Array]:
    """The distance outside a zone, where it is at the time: it moves evenly within a cell."""
    ends = [displacement_m(zone, t_s) for t_s in (cells.start_s, cells.end_s)]  # (N, 2)
    moved = np.zeros((ORDER + 1, 2, len(cells)))
    moved[0], moved[1] = 0.5 * (ends[0] + ends[1]).T, 0.5 * (ends[1] - ends[0]).T
    return outside_moved_zone(zone, place, Taylor(moved, np.zeros(moved.shape[1:])), (cells.start_s, cells.end_s))


def outside_moved_zone(
    zone: Zone, place: Taylor, moved: Taylor, span_s: tuple[Array, Array], *, descends: bool = False
) -> tuple[Array, Array]:
    """The distance of places (3, N) outside a zone that has moved so far (2, N), north and east, in spans of time (N,).

    Above or below its heights a place is outside, and so are all in a span that ends before the zone is in force or
    begins afterwards. Below places of vehicles that descend are places too.
    """
    north, east = (place[axis] - moved[axis] for axis in (0, 1))
    low, seen = np.full(len(north.middle), np.inf), np.full(len(north.middle), np.inf)
    for piece in pieces(zone):
        of_piece, at_middle = _outside_piece(piece, north, east)
        low, seen = np.minimum(low, of_piece), np.minimum(seen, at_middle)
    if zone.height_m is not None:
        below, above = zone.height_m[0] + place[2], -place[2] - zone.height_m[1]
        low, seen = np.maximum(low, below.low()), np.maximum(seen, below.middle)
        if not descends:
            low, seen = np.maximum(low, above.low()), np.maximum(seen, above.middle)
    if zone.in_force_s is not None:
        begin_s, end_s = span_s
        never = (end_s <= zone.in_force_s[0]) | (begin_s >= zone.in_force_s[1])
        middle_s = 0.5 * (begin_s + end_s)
        not_now = never | (middle_s < zone.in_force_s[0]) | (middle_s > zone.in_force_s[1])
        low, seen = np.where(never, np.inf, low), np.where(not_now, np.inf, seen)
    return low, seen


def _outside_piece(piece: Disk | Convex, north: Taylor, east: Taylor) -> tuple[Array, Array]:
    if isinstance(piece, Disk):
        away = [north - piece.centre_m[0], east - piece.centre_m[1]]
        # Beyond the tangent in the middle's direction, and beyond the circle by the square of the distance.
        length = np.maximum(np.hypot(away[0].middle, away[1].middle), 1e-9)
        tangent = (away[0] * (away[0].middle / length) + away[1] * (away[1].middle / length)).low()
        squared = (away[0].square() + away[1].square()).low()
        return np.maximum(tangent, np.sqrt(np.maximum(squared, 0.0))) - piece.radius_m, length - piece.radius_m
    low, seen = np.full(len(north.middle), -np.inf), np.full(len(north.middle), -np.inf)
    for (n, e), offset in zip(piece.normals, piece.offsets_m, strict=True):
        beyond = north * n + east * e - offset
        low, seen = np.maximum(low, beyond.low()), np.maximum(seen, beyond.middle)
    # Beside a corner no edge faces the place; the direction from the nearest point gives the true distance.
    facing_n, facing_e, support = piece.facing(north.middle, east.middle)
    beyond, is_known = north * facing_n + east * facing_e - support, (facing_n != 0.0) | (facing_e != 0.0)
    low = np.where(is_known, np.maximum(low, beyond.low()), low)
    return low, np.where(is_known, np.maximum(seen, beyond.middle), seen)
