"""The distance of every vehicle to the ground in any direction (Eqs. 20, 23, 52, 53, or an elevation model).

A plane between a vehicle and a patch of ground proves a distance: along its normal, the vehicle is beyond all of the
patch. Groups of vehicles, intervals of time and patches are divided until the least distance is known.

On the ground phases a vehicle stands or hovers over its pad. There the height above the ground must not be negative,
and the distance at least a quarter of the height above the pad, less 0.25 m: slopes are allowed, a wall is not.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.plan.verification.constraints.position_limits import RESOLUTION_M
from gcs.plan.verification.proof.ground_patches import GroundPatches, ground_patches
from gcs.plan.verification.proof.subdivision import SHORTEST_S, Cells, Mask, Rows, halved, joined
from gcs.plan.verification.proof.taylor import Taylor
from gcs.plan.verification.proof.vehicle_tree import VehicleTree
from gcs.plan.verification.proof.verdict import LENGTH_TOLERANCE_M, NamedConstraint
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Terrain
from gcs.types import Array

PAD_SHARE = 0.25  # of the height above the pad: the slope of the ground may be 75 degrees
PAD_FREE_M = 0.25  # above the pad, up to which nothing is required: at the pad itself the distance is 0
_SMALLEST = 1e-4  # of a patch, in metres or pixels
_TOUCHING_M = 0.02
_ENOUGH_M = 10.0  # beside a pad only the verdict matters, not the margin
CLEARANCE, BESIDE = 0, 1


@dataclass(frozen=True, eq=False)
class GroundClearance:
    """The distance to the ground where the formation flies, and to what is beside the pads elsewhere."""

    places: Callable[[Cells], Taylor]  # (3, N), NED, of all vehicles of each cell
    tree: VehicleTree
    terrain: Terrain
    limit_m: float
    airborne: Rows  # numbers of the phases
    pad_down_m: Array  # (P, V) of the pad or landing point of each vehicle, NED; 0 in other phases

    @property
    def constraints(self) -> tuple[NamedConstraint, ...]:
        """In the order of the margins."""
        return (
            NamedConstraint(LENGTH_TOLERANCE_M, RESOLUTION_M, ConstraintId(Kind.CLEARANCE), "m"),
            NamedConstraint(LENGTH_TOLERANCE_M, _ENOUGH_M, ConstraintId(Kind.BESIDE_PAD), "m"),
        )

    @cached_property
    def ground(self) -> GroundPatches:
        """The ground as patches."""
        return ground_patches(self.terrain)

    @cached_property
    def _lowest_down_m(self) -> Array:
        """The lowest pad (P, M) of each group."""
        return np.stack([self.tree.largest(down_m) for down_m in self.pad_down_m])

    def around(self, cells: Cells) -> Cells:
        """Cells with the patch of ground that can matter for them; a wall farther away is no nearest ground."""
        place = self.places(cells)
        spread = np.sqrt(sum(place[axis].deviation() ** 2 for axis in range(3)))
        middle = place.middle
        below = self._height_m(middle)
        reach = np.full(len(cells), np.inf)
        flies = np.isin(cells.phase, self.airborne)
        for phase in np.unique(cells.phase):
            chosen = cells.phase == phase
            # In flight no ground matters that is farther than the nearest known.
            reach[chosen] = np.maximum(below[chosen].min(), 0.0)
        half_m = PAD_SHARE * self.limit_m
        reach = np.where(flies, reach, half_m) + spread + 2.0 * LENGTH_TOLERANCE_M
        return replace(cells, patch=self.ground.around(middle[0], middle[1], reach))

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`."""
        flies = np.isin(cells.phase, self.airborne)
        place, along, supported, point, *_ = self._supported(cells)
        middle = place.middle
        distance = np.linalg.norm(middle.T - point, axis=1)
        low = along.low() - supported
        depth = self._height_m(middle)
        seen = np.where(depth < 0.0, depth, np.minimum(distance, np.maximum(depth, 0.0)))
        found = np.full((2, len(cells)), np.inf), np.full((2, len(cells)), np.inf)
        found[0][CLEARANCE] = np.where(flies, low - self.limit_m, np.inf)
        found[1][CLEARANCE] = np.where(flies, seen - self.limit_m, np.inf)
        if not flies.all():
            self._on_the_ground(cells, place, along, supported, flies, seen, found)
        return found

    def _on_the_ground(
        self,
        cells: Cells,
        place: Taylor,
        along: Taylor,
        supported: Array,
        flies: Mask,
        seen: Array,
        found: tuple[Array, Array],
    ) -> None:
        """Margins of the ground phases."""
        group = cells.who[:, 0]
        lowest, own = self._lowest_down_m[cells.phase, group], self.pad_down_m[cells.phase, self.tree.row[group]]
        above = (-place[2]) + (lowest - PAD_FREE_M)
        required = PAD_SHARE * np.minimum(own - PAD_FREE_M - place[2].middle, self.limit_m)
        low = np.maximum(
            (along - above * PAD_SHARE).low() - supported, along.low() - supported - PAD_SHARE * self.limit_m
        )
        found[0][BESIDE] = np.where(flies, np.inf, low)
        found[1][BESIDE] = np.where(flies, np.inf, seen - required)

    @lru_cache(maxsize=1)  # noqa: B019 - asked twice in a row for the same cells; the family lives no longer than a proof
    def _supported(self, cells: Cells) -> tuple[Taylor, Taylor, Array, Array, Array]:
        """Places; how far they and the patch reach along a direction out of the ground; a point (N, 3) of the patch.

        Last, how much (2, N) the spread of places and the unevenness of the patch take from the distance.
        """
        place = self.places(cells)
        middle = place.middle
        first, second = self.ground.nearest(cells.patch, middle[0], middle[1])
        foot, normal = self._foot(cells.patch, first, second, middle)
        point = self.ground.points_ned_m(*foot)
        apart = middle.T - point  # (N, 3), from the ground to the vehicle
        # The ground goes on below the patch, so beside a higher patch the way out is level.
        apart[:, 2] = np.minimum(apart[:, 2], 0.0)
        # Some vehicle of the group is over the patch at some time while the patch is nearer than they are spread.
        beyond = apart.copy()
        for axis in (0, 1):
            spread = place[axis].deviation()
            beyond[:, axis] -= np.clip(apart[:, axis], -spread, spread)
        # At the ground itself the slope says which way is out.
        direction = normal
        for way in (apart, beyond):
            length = np.linalg.norm(way, axis=1, keepdims=True)
            direction = np.where(length > _TOUCHING_M, way / np.maximum(length, 1e-9), direction)
        along = place[0] * direction[:, 0] + place[1] * direction[:, 1] + place[2] * direction[:, 2]
        supported = self.ground.support(cells.patch, direction)
        to_point = np.sum(direction * point, axis=1)
        # What is lost to the spread of places, and to the patch that is not flat.
        losses = np.linalg.norm(apart, axis=1) - (along.low() - to_point), supported - to_point
        return place, along, supported, point, np.stack(losses)

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """See `Family`: of group, time and patch what lowers the bound most is divided."""
        place, _, _, _, losses = self._supported(cells)
        losses = losses.copy()
        group = cells.who[:, 0]
        reach = self.tree.reach_m[group]
        spread = np.sqrt(sum(place[axis].deviation() ** 2 for axis in range(3)))
        of_group = (self.tree.parts[group, 0] >= 0) & (2.0 * reach > spread)
        sides = np.hypot(cells.patch[:, 1] - cells.patch[:, 0], cells.patch[:, 3] - cells.patch[:, 2])
        losses[0, ~of_group & (cells.end_s - cells.start_s <= SHORTEST_S)] = -1.0
        losses[1, sides <= _SMALLEST] = -1.0
        which = np.where(losses[0] >= losses[1], np.where(of_group, 0, 1), 2)
        which[~chosen | (losses.max(axis=0) < 0.0)] = -1
        parts, origin = [], []
        for side in (0, 1):
            groups = np.flatnonzero(which == 0)
            who = self.tree.parts[group[groups], side][:, None]
            parts.append(replace(cells[groups], who=who))
            origin.append(groups)
        times = np.flatnonzero(which == 1)
        parts.append(halved(cells[times]))
        origin.append(np.concatenate([times, times]))
        patches = np.flatnonzero(which == 2)
        for half in self.ground.parts(cells.patch[patches]):
            parts.append(replace(cells[patches], patch=half))
            origin.append(patches)
        return joined(parts), np.concatenate(origin)

    def row(self, who: Rows) -> int:
        """See `Family`."""
        return int(self.tree.row[who[0]])

    def _height_m(self, places: Array) -> Array:
        """Height (N,) of places (3, N) above the ground."""
        return np.asarray(-places[2] - ground_height_m(self.terrain, places[0], places[1]))

    def _foot(self, patches: Array, first: Array, second: Array, places: Array) -> tuple[tuple[Array, Array], Array]:
        """Coordinates (N,) near the nearest ground of a patch, from the slope below, and that slope's normal (N, 3).

        Any ground would do: these only make the bound good.
        """
        step = 1e-3
        here = self.ground.points_ned_m(first, second)
        edges = [
            self.ground.points_ned_m(first + step, second) - here,
            self.ground.points_ned_m(first, second + step) - here,
        ]
        normal = np.cross(edges[0], edges[1])
        normal *= np.where(normal[:, 2:] > 0.0, -1.0, 1.0) / np.maximum(
            np.linalg.norm(normal, axis=1, keepdims=True), 1e-30
        )
        # The foot on the tangent plane: least squares of p - here by both edges.
        away = places.T - here
        a, b, c = (np.sum(edges[i] * edges[j], axis=1) for i, j in ((0, 0), (0, 1), (1, 1)))
        d, e = (np.sum(edge * away, axis=1) for edge in edges)
        size = np.maximum(a * c - b * b, 1e-30)
        moved = first + step * (c * d - b * e) / size, second + step * (a * e - b * d) / size
        foot = np.clip(moved[0], patches[:, 0], patches[:, 1]), np.clip(moved[1], patches[:, 2], patches[:, 3])
        return foot, normal
