"""The straight lines between the points of a drawn route, and how far the leader may leave them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from gcs.plan.formation.coordinates import coordinates
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import NED_FROM_UP, quadrotor, route_points
from gcs.types import Array

_HEIGHT_M = 1.0
_LEAST_CORRIDOR_M = 1.0  # where no corner needs more
_EASE, _REST_M = 1.5, 0.5  # of what the corner's circle needs: attitude takes time to change
_FASTER = 1.25  # than the mean speed of the flight, where a point gives none


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

    @cached_property
    def rows(self) -> Array:
        """Rows (4, 4) that take a difference of place and yaw from the line's begin to what is off the line.

        The first two are beside it, the third below it, the fourth is the yaw. A leg that climbs or sinks more steeply
        than 45 degrees is left sideways only: its first two rows are north and east of the line at the same height.
        """
        north, east, down = self.to_ned_m - self.from_ned_m
        length_m = float(np.hypot(north, east))
        if abs(down) > length_m:
            return np.array(
                [[1.0, 0.0, -north / down, 0.0], [0.0, 1.0, -east / down, 0.0], [0.0] * 4, [0.0, 0.0, 0.0, 1.0]]
            )
        north, east, slope = north / length_m, east / length_m, down / length_m
        return np.array(
            [[-east, north, 0.0, 0.0], [0.0] * 4, [-slope * north, -slope * east, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
        )

    @property
    def begin(self) -> Array:
        """Place and yaw (4,) that differences are from."""
        return np.append(self.from_ned_m, self.yaw_ned_rad)

    @property
    def scaled_rows(self) -> Array:
        """The same rows (4, 4) over the limits: the leader keeps the line where all parts are within 1."""
        kept = self.limits
        return np.asarray(self.rows / np.array([[kept.corridor_m], [kept.corridor_m], [kept.height_m], [kept.yaw_rad]]))

    def off(self, states: Array) -> tuple[Array, Array, Array]:
        """How far states (..., 9 or more) are beside the line (...), above or below it, m, and off its yaw, rad."""
        off = (np.concatenate([states[..., :3], states[..., 8:9]], axis=-1) - self.begin) @ self.rows.T
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
        lines.append(LegLine(leg + 1, begin, end, _turned_rad(yaw_deg or 0.0), limits, said))
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
