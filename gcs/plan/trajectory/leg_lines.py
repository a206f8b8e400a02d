"""The lines between the points of a drawn route, and how far the leader may leave them.

A line is straight, or follows the ground where both of its ends have a height above the ground.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from gcs.plan.formation.coordinates import coordinates
from gcs.scenario.environment.terrain import ground_envelope_m, ground_height_m
from gcs.scenario.schema.scenario import Scenario, Terrain
from gcs.scenario.values.si import NED_FROM_UP, quadrotor, route_points
from gcs.types import Array

_HEIGHT_M = 1.0
_LEAST_CORRIDOR_M = 1.0  # where no corner needs more
_EASE, _REST_M = 1.5, 0.5  # of what the corner's circle needs: attitude takes time to change
_FASTER = 1.25  # than the mean speed of the flight, where a point gives none
_EVERY_M, _ACROSS, _BESIDE_MOST_M = 1.0, 5, 5.0  # where the ground and its envelope are compared
_GROUND_RESERVE_M = 0.01  # of the height's tolerance, so that the proof need not look at every millimetre
_ROUGHEST = 0.75  # of the height's tolerance that the envelope may take


@dataclass(frozen=True)
class LegLimits:
    """How far the leader may be off the line of a leg; infinite where it flies freely."""

    corridor_m: float  # beside it
    height_m: float  # above or below it
    yaw_rad: float = np.inf  # from the heading of both ends

    @property
    def is_free(self) -> bool:
        """Whether the leader may be anywhere."""
        return bool(np.isinf(self.corridor_m) and np.isinf(self.height_m))


NO_LIMITS = LegLimits(np.inf, np.inf)


@dataclass(frozen=True)
class LegLine:
    """The line of one leg, NED, with its limits. What the scenario says is kept; a default gives way to obstacles."""

    number: int  # of the leg, from 1
    from_ned_m: Array  # (3,)
    to_ned_m: Array  # (3,)
    yaw_ned_rad: float
    limits: LegLimits
    set_by_scenario: tuple[bool, bool] = (
        False,
        False,
    )  # whether the scenario gives the corridor, and the height's tolerance
    ground: Terrain | None = None  # that the line follows; None: it is straight

    def flattened(self, places: Array) -> Array:
        """Places (..., 3), NED, with `down` from the ground below them where the line follows it."""
        if self.ground is None:
            return places
        north, east, down = np.moveaxis(places, -1, 0)
        return np.stack([north, east, down + ground_height_m(self.ground, north, east)], axis=-1)

    def places(self, share: Array) -> Array:
        """Places (..., 3), NED, on the line, from its begin (0) to its end (1)."""
        first, last = self._ends
        found = np.asarray(first + share[..., None] * (last - first))
        if self.ground is not None:
            found[..., 2] -= ground_height_m(self.ground, found[..., 0], found[..., 1])
        return found

    @cached_property
    def _ends(self) -> Array:
        return self.flattened(np.stack([self.from_ned_m, self.to_ned_m]))

    @cached_property
    def envelope_gap_m(self) -> float:
        """How far the optimiser's smooth ground is above the true one, at most, along a line that follows it."""
        if self.ground is None:
            return 0.0
        first, last = self._ends[:, :2]
        along = last - first
        share = np.linspace(0.0, 1.0, int(np.linalg.norm(along) / _EVERY_M) + 2)
        beside_m = min(self.limits.corridor_m, _BESIDE_MOST_M)
        across = np.array([-along[1], along[0]]) / max(float(np.linalg.norm(along)), 1e-9)
        places = first + share[:, None, None] * along + np.linspace(-beside_m, beside_m, _ACROSS)[:, None] * across
        north, east = np.moveaxis(places, -1, 0)
        gap_m = ground_envelope_m(self.ground, north, east) - ground_height_m(self.ground, north, east)
        return float(gap_m.max())

    @property
    def is_too_rough(self) -> bool:
        """Whether the ground is too rough to be followed within the height's tolerance."""
        return 0.5 * self.envelope_gap_m + _GROUND_RESERVE_M > _ROUGHEST * self.limits.height_m

    @cached_property
    def rows(self) -> Array:
        """Rows (4, 4) that take a difference of place and yaw from the line's begin to what is off the line.

        The first two are beside it, the third below it, the fourth is the yaw. A leg that climbs or sinks more steeply
        than 45 degrees is left sideways only: its first two rows are north and east of the line at the same height.
        """
        north, east, down = np.diff(self._ends, axis=0)[0]
        length_m = float(np.hypot(north, east))
        if self.is_steep:
            return np.array(
                [[1.0, 0.0, -north / down, 0.0], [0.0, 1.0, -east / down, 0.0], [0.0] * 4, [0.0, 0.0, 0.0, 1.0]]
            )
        north, east, slope = north / length_m, east / length_m, down / length_m
        return np.array(
            [[-east, north, 0.0, 0.0], [0.0] * 4, [-slope * north, -slope * east, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
        )

    @property
    def is_steep(self) -> bool:
        """Whether it climbs or sinks more steeply than 45 degrees: it has no height at a place."""
        north, east, down = np.diff(self._ends, axis=0)[0]
        return bool(abs(down) > np.hypot(north, east))

    @property
    def along(self) -> tuple[Array, Array, float]:
        """The middle of the line, place and yaw (4,); a row (1, 4) that takes a difference from it to what is along the
        line, or for a steep one below it; and how far the ends are from the middle.
        """
        way = np.append(np.diff(self._ends, axis=0)[0], 0.0)
        way[[0, 1] if self.is_steep else [2]] = 0.0
        length_m = float(np.linalg.norm(way))
        return np.append(self._ends.mean(axis=0), self.yaw_ned_rad), way[None] / length_m, 0.5 * length_m

    @property
    def begin(self) -> Array:
        """Place and yaw (4,) that differences are from; `down` is that of `flattened`."""
        return np.append(self._ends[0], self.yaw_ned_rad)

    @property
    def parameters(self) -> Array:
        """Numbers (21,) of the program: begin, rows over the limits column by column, whether it follows the ground.

        The leader keeps the line where the rows are within 1. The program has the smooth ground, which is up to
        `envelope_gap_m` higher: it aims at the middle of what that leaves.
        """
        kept, begin, gap_m = self.limits, self.begin.copy(), self.envelope_gap_m
        height_m = kept.height_m
        if self.ground is not None:
            begin[2] += 0.5 * gap_m
            height_m -= 0.5 * gap_m + _GROUND_RESERVE_M
        scaled = self.rows / np.array([[kept.corridor_m], [kept.corridor_m], [height_m], [kept.yaw_rad]])
        return np.concatenate([begin, scaled.ravel(order="F"), [float(self.ground is not None)]])

    def off(self, states: Array) -> tuple[Array, Array, Array]:
        """How far states (..., 9 or more) are beside the line (...), above or below it, m, and off its yaw, rad."""
        off = (np.concatenate([self.flattened(states[..., :3]), states[..., 8:9]], axis=-1) - self.begin) @ self.rows.T
        return np.hypot(off[..., 0], off[..., 1]), np.abs(off[..., 2]), np.abs(off[..., 3])

    def within(self, limits: LegLimits) -> "LegLine":
        """The line with other limits in place of its defaults; what the scenario says stays."""
        corridor_m = self.limits.corridor_m if self.set_by_scenario[0] else limits.corridor_m
        height_m = self.limits.height_m if self.set_by_scenario[1] else limits.height_m
        return replace(self, limits=LegLimits(corridor_m, height_m, limits.yaw_rad))

    def opened(self, *, beside: bool, above: bool) -> "LegLine":
        """The line without its default limits, beside it or in height; what the scenario says stays."""
        corridor_m, height_m = self.limits.corridor_m, self.limits.height_m
        kept = LegLimits(np.inf if beside else corridor_m, np.inf if above else height_m, self.limits.yaw_rad)
        return self.within(kept)


def leg_lines(scenario: Scenario) -> tuple[LegLine, ...]:
    """The lines from the start through all points to the end; none without a route."""
    points = route_points(scenario)
    if not points:
        return ()
    places = scenario.start.position_m, *(point.position_m for point in points), scenario.end.position_m
    stops = np.array(places) * NED_FROM_UP
    above = [
        scenario.start.height_above_ground_m is not None,
        *(point.height_above_ground_m is not None for point in points),
        scenario.end.height_above_ground_m is not None,
    ]
    headings_deg = (
        scenario.start.roll_pitch_yaw_deg[2],
        *(point.heading_deg for point in points),
        scenario.end.roll_pitch_yaw_deg[2],
    )
    tolerance_rad = np.radians(_number(scenario.legs.heading_tolerance_deg))
    needs_m = _corners_m(scenario, stops)
    lines = []
    for leg, (begin, end) in enumerate(pairwise(stops)):
        own = points[leg] if leg < len(points) else None
        corridor, height = (
            getattr(scenario.legs, key) if own is None or getattr(own, key) is None else getattr(own, key)
            for key in ("corridor_m", "height_tolerance_m")
        )
        default_m = max(_LEAST_CORRIDOR_M, np.ceil(10.0 * max(needs_m[leg : leg + 2])) / 10.0)
        yaw_deg, then_deg = headings_deg[leg : leg + 2]
        same = yaw_deg is not None and then_deg is not None and (yaw_deg - then_deg) % 360.0 == 0.0
        limits = LegLimits(
            _number(default_m if corridor is None else corridor),
            _number(_HEIGHT_M if height is None else height),
            tolerance_rad if same else np.inf,
        )
        said = corridor is not None, height is not None
        ground = scenario.terrain if all(above[leg : leg + 2]) else None
        lines.append(LegLine(leg + 1, begin, end, _turned_rad(yaw_deg or 0.0), limits, said, ground))
    return tuple(lines)


def remaining_lines(lines: Sequence[LegLine], count: int) -> tuple[LegLine, ...]:
    """The lines of the last `count` legs for a flight that begins in the air, anywhere: its first leg is free."""
    rest = tuple(lines[len(lines) - count :])
    return (replace(rest[0], limits=NO_LIMITS, set_by_scenario=(False, False)), *rest[1:]) if rest else ()


def _number(value: float | str) -> float:
    return np.inf if isinstance(value, str) else float(value)


def _turned_rad(heading_deg: float) -> float:
    """A yaw in radians, at most half a turn either way, as the limit of yaw."""
    return float(np.angle(np.exp(1j * np.radians(heading_deg))))


def _corners_m(scenario: Scenario, stops: Array) -> Array:
    """How far (K + 1,) the leader leaves the lines to pass each stop at its speed; 0 where it rests.

    On a circle of radius v^2 / a through the corner, along the bisector of the lines, that is R (1 - cos(angle / 2)).
    From a start, or to an end, that is not at rest, R (1 - cos(angle)) from its velocity to the line.
    """
    points, limits = route_points(scenario), scenario.limits
    ways = np.diff(stops, axis=0)
    held_s = sum(point.hold_s or 0.0 for point in points)
    mean_mps = np.linalg.norm(ways, axis=1).sum() / max(scenario.time.flight_s - held_s, 1.0)
    usual_mps = min(_FASTER * float(mean_mps), float(np.hypot(*limits.speed_ned_mps[:2])))
    tilted_mps2 = quadrotor(scenario).gravity_mps2 * np.tan(np.radians(min(limits.roll_pitch_yaw_deg[:2])))
    turned_mps2 = quadrotor(scenario).gravity_mps2 * limits.load_factor_max
    accel_mps2 = min(limits.accel_max_mps2 or np.inf, float(tilted_mps2), turned_mps2)
    turning = next((c.most for c in coordinates(scenario) if c.free_end), (np.inf, np.inf))
    needs = np.zeros(len(stops))
    for stop, point in enumerate(points, start=1):
        speed_mps, angle_rad = point.speed_mps or usual_mps, _angle_rad(*ways[stop - 1 : stop + 1])
        # A formation that turns with its course takes its time for the angle, at its largest rate and acceleration.
        turn_s = max(angle_rad / turning[0], 2.0 * (angle_rad / turning[1]) ** 0.5)
        radius_m = max(speed_mps**2 / accel_mps2, speed_mps * turn_s / max(angle_rad, 1e-9))
        bend_m = 0.0 if point.hold_s else radius_m * (1.0 - np.cos(0.5 * angle_rad))
        needs[stop] = max(_EASE * float(bend_m) + _REST_M, point.radius_m or 0.0)
    for stop, boundary in ((0, scenario.start), (-1, scenario.end)):
        velocity = np.array(boundary.velocity_mps) * NED_FROM_UP
        if velocity.any():
            off = 1.0 - np.cos(_angle_rad(velocity, ways[stop]))
            needs[stop] = _EASE * float(velocity @ velocity) / accel_mps2 * off + _REST_M
    return needs


def _angle_rad(first: Array, second: Array) -> float:
    """The angle between two directions (3,), seen from above; half a turn where one has none."""
    a, b = first[:2], second[:2]
    lengths = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.arccos(np.clip(a @ b / lengths, -1.0, 1.0))) if lengths else np.pi
