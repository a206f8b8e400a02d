"""A model of PX4's waypoint navigator for multicopters.

A smoothed target flies to one waypoint after the other. A waypoint is passed as soon as the vehicle is within the
acceptance radius. The target then turns to the next one, and the speed of that leg takes effect at once. If the vehicle
is behind its target, the time of the target passes more slowly. For some time after take-off the autopilot still
corrects home's altitude. This acts as an altitude error: the vehicle brakes before level waypoints.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from gcs.autopilots.waypoint_models.disturbance_gain import disturbance_gain_s2
from gcs.autopilots.waypoint_models.navigator import Ability, NavigatorOrders, NavigatorState, Vector
from gcs.autopilots.waypoint_models.px4_speed import Approach, Axis, braking_speed, synchronize, towards
from gcs.autopilots.waypoint_models.tracking import Follower, Following

# Recorded arrivals lie between those without an error of height and those with this one, but for 0.2 s (RMS). Above
# NAV_MC_ALT_RAD, 0.8 m, no waypoint would be reached.
_HEIGHT_ERROR_MAX_M = 0.7


@dataclass(frozen=True)
class Px4Navigator(Approach):
    """The parameters, with recorded defaults: MPC_XY_ERR_MAX, _XY_VEL_MAX, and those of `Approach`."""

    following: Following
    height_error_m: float = 0.0  # while home's altitude is being corrected
    behind_max_m: float = 2.0
    fastest_mps: float = 12.0
    home_settles_s: float = 120.0  # after take-off
    switch_s: float = 0.05  # from arrival to the next leg
    step_s: float = 0.04

    @property
    def delay_begins_m(self) -> float:
        """A waypoint is reached, and its delay begins, at the acceptance radius."""
        return self.radius_m

    @property
    def reactions(self) -> tuple[Px4Navigator, ...]:
        """Without an error of height no level waypoint is braked for; with the largest, every one is."""
        return replace(self, height_error_m=0.0), replace(self, height_error_m=_HEIGHT_ERROR_MAX_M)

    @property
    def least_obedient(self) -> Px4Navigator:
        """A new speed holds from the change of the leg, up or down."""
        return self

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters on board that arrival times rest on."""
        return {
            "MPC_ACC_HOR": self.acceleration_mps2,
            "MPC_ACC_UP_MAX": self.up_mps2,
            "MPC_ACC_DOWN_MAX": self.down_mps2,
            "MPC_JERK_AUTO": self.jerk_mps3,
            "MPC_XY_ERR_MAX": self.behind_max_m,
            "MPC_XY_TRAJ_P": self.turn_share,
            "MPC_XY_VEL_MAX": self.fastest_mps,
            "MPC_Z_V_AUTO_UP": self.climb_mps,
            "MPC_Z_V_AUTO_DN": self.sink_mps,
            "NAV_ACC_RAD": self.radius_m,
            "NAV_MC_ALT_RAD": self.height_radius_m,
        }

    def within(self, ability: Ability) -> Px4Navigator:
        """Return the same navigator for a vehicle with this ability."""
        acceleration = min(self.acceleration_mps2, ability.horizontal_mps2)
        # Jerk that rises over the time needed to reach the acceleration stays within the limit of snap.
        eased = math.sqrt(2.0 * ability.horizontal_mps4 * acceleration / math.pi)
        return replace(
            self,
            acceleration_mps2=acceleration,
            jerk_mps3=min(self.jerk_mps3, ability.horizontal_mps3, eased),
            fastest_mps=min(self.fastest_mps, ability.horizontal_mps),
            climb_mps=min(self.climb_mps, ability.vertical_mps),
            sink_mps=min(self.sink_mps, ability.vertical_mps),
            up_mps2=min(self.up_mps2, ability.vertical_mps2),
            down_mps2=min(self.down_mps2, ability.vertical_mps2),
        )

    def disturbance_gain_s2(self, drag_ps: float) -> float:
        """See `Navigator`."""
        return disturbance_gain_s2(self.following, drag_ps)

    def sustained_mps(self, length_m: float) -> float:
        """Return the speed from which it can stop within a leg: the waypoint after the next counts as a stop."""
        return min(self.fastest_mps, braking_speed(length_m, 0.0, self.acceleration_mps2, self.jerk_mps3))

    def fly(self, orders: NavigatorOrders) -> Iterator[NavigatorState]:
        """Yield every state from the start, without end."""
        target = _Target(self, orders.start_ned_m)
        vehicle = Follower(self.following, orders.begins)
        points = (orders.start_ned_m, *orders.waypoints_ned_m)
        index, leave_s, steps = 0, math.inf, 0
        doubtful = orders.airborne_s < self.home_settles_s
        while True:
            goal = points[index + 1]
            following = goal if orders.stops_at(index) else points[index + 2]
            unsettled = orders.airborne_s + steps * self.step_s < self.home_settles_s
            target.off_m = self.height_error_m if unsettled else 0.0
            speed = min(orders.speeds_mps[index], self.fastest_mps)
            state = target.state
            target.step(vehicle, (points[index], goal, following), speed)
            vehicle.step(*state, self.step_s)
            steps += 1
            t_s = steps * self.step_s
            if math.isinf(leave_s) and self._is_there(vehicle, goal):
                leave_s = t_s + orders.holds_s[index] + self.switch_s
            completed = None
            if t_s >= leave_s:
                completed, leave_s = index, math.inf
                if index + 1 < orders.count:
                    index += 1
                else:
                    leave_s = math.nan  # the last waypoint: it stays
            yield vehicle.state(t_s, completed, doubtful=doubtful)

    def _is_there(self, vehicle: Follower, goal: Vector) -> bool:
        n, e, d = (goal[i] - vehicle.position[i] for i in range(3))
        return math.hypot(n, e) < self.radius_m and abs(d) < self.height_radius_m


class _Target:
    """The target of the vehicle. `off_m` is the altitude error that the autopilot sees."""

    def __init__(self, navigator: Px4Navigator, start: Vector) -> None:
        self._navigator = navigator
        self._axes = (Axis(start[0]), Axis(start[1]), Axis(start[2]))
        self._straight_mps = math.inf
        self._sinking = True
        self.off_m = 0.0

    @property
    def state(self) -> tuple[Vector, Vector, Vector]:
        """Its position, velocity and acceleration."""
        x, y, z = self._axes
        return (
            (x.position, y.position, z.position),
            (x.speed, y.speed, z.speed),
            (x.acceleration, y.acceleration, z.acceleration),
        )

    def step(self, vehicle: Follower, leg: tuple[Vector, Vector, Vector], cruise_mps: float) -> None:
        """Advance by one step along a leg: from its first point to its second, and then to its third."""
        position, velocity, _ = self.state
        wanted = self._wanted(position, velocity, leg, cruise_mps)
        pace = self._pace(position, velocity, vehicle)
        navigator = self._navigator
        self._sinking = wanted[2] >= 0.0
        vertical, top = (
            (navigator.down_mps2, navigator.sink_mps) if self._sinking else (navigator.up_mps2, navigator.climb_mps)
        )
        limits = (navigator.acceleration_mps2, navigator.acceleration_mps2, vertical)
        for axis in self._axes:
            axis.advance(navigator.step_s * pace)
        bounded = (wanted[0], wanted[1], min(max(wanted[2], -top), top))
        for axis, speed, limit in zip(self._axes, bounded, limits, strict=True):
            axis.want(speed, limit, navigator.jerk_mps3)
        synchronize(self._axes)

    def _wanted(
        self, position: Vector, velocity: Vector, leg: tuple[Vector, Vector, Vector], cruise_mps: float
    ) -> Vector:
        origin, goal, following = leg
        approach = self._navigator
        level_mps = approach.level_speed(position, goal, following, cruise_mps)
        aim = goal
        if approach.turning(position, velocity, goal):
            aim = approach.aim(position, origin, goal)
            level_mps = min(level_mps, self._straight_mps)
        else:
            self._straight_mps = level_mps
        climb_mps = approach.climb_speed(position, goal, following, self._sinking)
        wanted = towards(position, aim, level_mps, climb_mps)
        if self.off_m == 0.0:
            return wanted
        seen = (position[0], position[1], position[2] - self.off_m)
        climb_mps = approach.climb_speed(seen, goal, following, self._sinking)
        slowed = towards(seen, aim, level_mps, climb_mps)
        return slowed[0], slowed[1], wanted[2]

    def _pace(self, position: Vector, velocity: Vector, vehicle: Follower) -> float:
        """Return the rate of the target's time: 1 if the vehicle is not behind."""
        n, e = position[0] - vehicle.position[0], position[1] - vehicle.position[1]
        if n * velocity[0] + e * velocity[1] < 0.0:
            return 1.0
        return 1.0 - min(math.hypot(n, e) / self._navigator.behind_max_m, 1.0)
