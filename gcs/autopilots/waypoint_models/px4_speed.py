"""The speed limits of PX4's target on its leg to a waypoint, and the smoothing of its axes.

The speed is limited to what can be braked before the waypoint. The turn limits the speed at the waypoint, to that of a
circle that touches both legs within the acceptance radius. The waypoint after the next counts as a stop. The
vertical speed has the same kind of limit. The target flies straight at its goal, so with an altitude error near the
goal the vertical limit reduces the whole speed.
"""

import math
from dataclasses import dataclass

from gcs.autopilots.waypoint_models.navigator import Vector

_STRAIGHT_RAD = math.pi - 1.2e-7
_SAME_M = 1e-3
_LEVEL_M = 0.1  # level waypoints at some kilometres distance differ by so much in NED: the Earth is round
_SMALL_MPS = 0.5  # if a speed and its limit are below this, only that component is reduced
_TURNING_ABOVE_MPS = 0.2
_TURNING_BELOW = 0.98  # cosine of the angle between velocity and the direction of the goal
_AHEAD_M = 5.0  # distance of the point on the leg at which a turning target aims


@dataclass(frozen=True, kw_only=True)
class Approach:
    """The limits of the target's motion, with recorded defaults.

    MPC_ACC_HOR, _JERK_AUTO, _XY_TRAJ_P, NAV_ACC_RAD, NAV_MC_ALT_RAD, MPC_Z_V_AUTO_UP, _DN, MPC_ACC_UP_MAX, _DOWN_MAX.
    """

    acceleration_mps2: float = 3.0
    jerk_mps3: float = 4.0
    turn_share: float = 0.5  # of the acceleration: towards the centre of a turn
    radius_m: float = 2.0
    height_radius_m: float = 0.8
    climb_mps: float = 3.0
    sink_mps: float = 1.5
    up_mps2: float = 4.0
    down_mps2: float = 3.0

    def level_speed(self, position: Vector, goal: Vector, following: Vector, cruise_mps: float) -> float:
        """Return the horizontal speed limit at `position`."""
        beyond = self._speed_towards(goal, following, 0.0, cruise_mps)
        at_goal = 0.0
        if _level(goal, following) >= max(self.radius_m, _SAME_M):
            angle = _angle(_plan(position, goal), _plan(following, goal))
            turn_mps2 = self.turn_share * self.acceleration_mps2
            at_goal = min(_turn_speed(angle, turn_mps2, self.radius_m), beyond, cruise_mps)
        return self._speed_towards(position, goal, at_goal, cruise_mps)

    def climb_speed(self, position: Vector, goal: Vector, following: Vector, down: bool) -> float:
        """Return the vertical speed limit at `position`. The turn is that of altitude over distance from the origin."""
        acceleration, top = (self.down_mps2, self.sink_mps) if down else (self.up_mps2, self.climb_mps)
        at_goal = 0.0
        if abs(goal[2] - following[2]) > _LEVEL_M:
            here, there, beyond = ((math.hypot(p[0], p[1]), p[2]) for p in (position, goal, following))
            angle = _angle((there[0] - here[0], there[1] - here[1]), (there[0] - beyond[0], there[1] - beyond[1]))
            at_goal = min(_turn_speed(angle, acceleration, self.height_radius_m), top)
        return min(top, braking_speed(abs(goal[2] - position[2]), at_goal, acceleration, self.jerk_mps3))

    def turning(self, position: Vector, velocity: Vector, goal: Vector) -> bool:
        """Return whether the target does not yet fly towards its goal."""
        n, e = goal[0] - position[0], goal[1] - position[1]
        distance, speed = math.hypot(n, e), math.hypot(velocity[0], velocity[1])
        if speed <= _TURNING_ABOVE_MPS or distance <= self.radius_m:
            return False
        return velocity[0] * n + velocity[1] * e < _TURNING_BELOW * speed * distance

    def aim(self, position: Vector, origin: Vector, goal: Vector) -> Vector:
        """Return the point on the leg at which a turning target aims."""
        length = math.dist(origin, goal) or 1.0
        direction = tuple((goal[i] - origin[i]) / length for i in range(3))
        along = sum((position[i] - origin[i]) * direction[i] for i in range(3))
        foot = tuple(origin[i] + along * direction[i] for i in range(3))
        reach, aside = max(self.radius_m, _AHEAD_M), math.dist(foot, position)
        ahead = math.sqrt(max(reach * reach - aside * aside, 0.0))
        return foot[0] + ahead * direction[0], foot[1] + ahead * direction[1], foot[2] + ahead * direction[2]

    def _speed_towards(self, position: Vector, goal: Vector, at_goal_mps: float, cruise_mps: float) -> float:
        return min(
            cruise_mps, braking_speed(_level(position, goal), at_goal_mps, self.acceleration_mps2, self.jerk_mps3)
        )


def braking_speed(distance_m: float, end_mps: float, acceleration: float, jerk: float) -> float:
    """Return the speed from which it can brake to `end_mps` within a distance; the effect of jerk is estimated."""
    ramp = 4.0 * acceleration * acceleration / jerk
    inside = ramp * ramp + 4.0 * (2.0 * acceleration * distance_m + end_mps * end_mps)
    return max(0.5 * (math.sqrt(inside) - ramp), end_mps)


def towards(position: Vector, aim: Vector, level_mps: float, climb_mps: float) -> Vector:
    """Return the velocity straight at `aim`, as fast as both limits allow."""
    n, e, d = (aim[i] - position[i] for i in range(3))
    distance = math.sqrt(n * n + e * e + d * d)
    if distance == 0.0:
        return 0.0, 0.0, 0.0
    scale = math.hypot(level_mps, climb_mps) / distance
    n, e, d = n * scale, e * scale, d * scale
    level = math.hypot(n, e)
    if level > level_mps:
        cut = level_mps / level
        n, e = n * cut, e * cut
        if max(level_mps, level) >= _SMALL_MPS:
            d *= cut
    if abs(d) > climb_mps:
        cut, small = climb_mps / abs(d), max(climb_mps, abs(d)) < _SMALL_MPS
        d *= cut
        if not small:
            n, e = n * cut, e * cut
    return n, e, d


def _turn_speed(angle_rad: float, acceleration: float, radius_m: float) -> float:
    """Angle between the legs, pi for straight on."""
    return math.sqrt(acceleration * radius_m * math.tan(0.5 * min(angle_rad, _STRAIGHT_RAD)))


def _level(a: Vector, b: Vector) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])


def _plan(a: Vector, b: Vector) -> tuple[float, float]:
    return b[0] - a[0], b[1] - a[1]


def _angle(a: tuple[float, float], b: tuple[float, float]) -> float:
    size = math.hypot(*a) * math.hypot(*b)
    if size == 0.0:
        return 0.5 * math.pi  # a zero vector has no direction: its product with any is 0
    return math.acos(max(-1.0, min(1.0, (a[0] * b[0] + a[1] * b[1]) / size)))


_STILL = 1e-9


class Axis:
    """One coordinate of the target."""

    def __init__(self, position: float) -> None:
        self.position = position
        self.speed = 0.0
        self.acceleration = 0.0
        self._jerk = 0.0  # of the first phase; the last has the opposite
        self._phases_s = (0.0, 0.0, 0.0)

    @property
    def duration_s(self) -> float:
        """The time until the wanted speed is reached."""
        return sum(self._phases_s)

    def want(self, speed: float, acceleration_max: float, jerk_max: float) -> None:
        """Plan the fastest change to `speed`."""
        a = self.acceleration
        direction = math.copysign(1.0, speed - self.speed - 0.5 * a * abs(a) / jerk_max)
        self._wanted, self._acceleration_max = speed, acceleration_max
        self._jerk = direction * jerk_max
        missing, a = direction * (speed - self.speed), direction * a
        if missing == 0.0 and a == 0.0:
            self._phases_s = (0.0, 0.0, 0.0)
            return
        peak = min(math.sqrt(max(jerk_max * missing + 0.5 * a * a, 0.0)), acceleration_max)
        rise_s = max((peak - a) / jerk_max, 0.0)
        peak = a + jerk_max * rise_s
        fall_s = max(peak / jerk_max, 0.0)
        gained = rise_s * (a + 0.5 * jerk_max * rise_s) + 0.5 * peak * fall_s
        hold_s = max((missing - gained) / peak, 0.0) if abs(peak) > _STILL else 0.0
        self._phases_s = (rise_s, hold_s, fall_s)

    def take(self, duration_s: float) -> None:
        """Plan the change to the wanted speed with the same jerk in `duration_s`, which is longer than necessary."""
        jerk = abs(self._jerk)
        direction = math.copysign(1.0, self._jerk)
        a, missing = direction * self.acceleration, direction * (self._wanted - self.speed)
        spare = duration_s * jerk - a
        # rise² - rise * spare / jerk + (missing - a * duration + a² / 2 jerk) / jerk = 0, from the three phases.
        root = spare * spare - 4.0 * jerk * (missing - a * duration_s) - 2.0 * a * a
        rise_s = 0.0
        if root >= 0.0:
            for candidate in (spare - math.sqrt(root), spare + math.sqrt(root)):
                trial_s = max(0.5 * candidate / jerk, 0.0)
                if 0.0 <= trial_s + a / jerk <= duration_s - trial_s:
                    rise_s = trial_s
                    break
        limit = self._acceleration_max
        rise_s = max((max(min(a + jerk * rise_s, limit), -limit) - a) / jerk, 0.0)
        fall_s = max(rise_s + a / jerk, 0.0)
        self._phases_s = (rise_s, max(duration_s - rise_s - fall_s, 0.0), fall_s)

    def advance(self, step_s: float) -> None:
        """Advance along the planned change."""
        rise_s, hold_s, fall_s = self._phases_s
        rise_s, step_s = self._pass(rise_s, self._jerk, step_s)
        hold_s, step_s = self._pass(hold_s, 0.0, step_s)
        fall_s, step_s = self._pass(fall_s, -self._jerk, step_s)
        self._phases_s = (rise_s, hold_s, fall_s)
        if step_s > 0.0:
            self.acceleration = 0.0
            self.position += step_s * self.speed

    def _pass(self, phase_s: float, jerk: float, step_s: float) -> tuple[float, float]:
        """Advance within one phase. Return the remaining time of the phase and of the step."""
        dt = min(step_s, phase_s)
        if dt > 0.0:
            self.position += dt * (self.speed + dt * (0.5 * self.acceleration + jerk * dt / 6.0))
            self.speed += dt * (self.acceleration + 0.5 * jerk * dt)
            self.acceleration += jerk * dt
        return phase_s - dt, step_s - dt


def synchronize(axes: tuple[Axis, ...]) -> None:
    """Give all axes the duration of the slowest."""
    longest_s = max(axis.duration_s for axis in axes)
    for axis in axes:
        if axis.duration_s < longest_s:
            axis.take(longest_s)
