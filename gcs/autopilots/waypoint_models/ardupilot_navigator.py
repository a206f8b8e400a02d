"""A model of ArduCopter's waypoint navigator.

The target moves along legs that go from rest to rest and overlap at corners. The next leg is calculated one leg ahead,
with the speed that is then set. A change of speed takes effect when its leg becomes the present one, and so reaches a
leg that has already begun (see `ardupilot_leg`): there a slow-down is made or not by the room for it, and `reactions`
are the navigators that ask for a little less and a little more of it. The slope of the path limits speeds. If the
vehicle falls behind, the time of the target passes more slowly.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from gcs.autopilots.waypoint_models.ardupilot_leg import (
    ROOM_FACTOR,
    Corner,
    LegMotion,
    Motion,
    NavigatorLeg,
    limit_along,
)
from gcs.autopilots.waypoint_models.disturbance_gain import disturbance_gain_s2
from gcs.autopilots.waypoint_models.navigator import Ability, NavigatorOrders, NavigatorState, Vector, vector
from gcs.autopilots.waypoint_models.scurve import RampLimits, ramp_up
from gcs.autopilots.waypoint_models.tracking import Follower, Following

_NOWHERE_M = 1e-3
_CM = 100.0  # in a metre
_SLACK = 0.05  # a speed lower by this share does not count as falling behind


@dataclass(frozen=True)
class ArduPilotNavigator:
    """The parameters, with recorded defaults: WPNAV_ACCEL, _JERK, _RADIUS, _ACCEL_Z, _SPEED_UP, _DN.

    Two limits are not parameters. Snap is half of what reverses jerk within ATC_INPUT_TC. The acceleration in corners
    (WPNAV_ACCEL_C of 0) is twice that along a leg.
    """

    following: Following
    acceleration_mps2: float = 2.5
    jerk_mps3: float = 1.0
    radius_m: float = 2.0
    climb_mps: float = 2.5
    sink_mps: float = 1.5
    vertical_mps2: float = 1.0
    input_time_s: float = 0.15
    fastest_mps: float = math.inf
    snap_max_mps4: float = math.inf
    slow_down_room: float = 1.0  # factor on the room that a slow-down takes
    step_s: float = 0.02

    @property
    def delay_begins_m(self) -> float:
        """A delay begins when the target has come to rest at the waypoint."""
        return 0.0

    @property
    def reactions(self) -> tuple[ArduPilotNavigator, ...]:
        """A slow-down with about as much room as it takes may be made, by the first, or not, by the second."""
        return replace(self, slow_down_room=1.0 / ROOM_FACTOR), replace(self, slow_down_room=ROOM_FACTOR)

    @property
    def least_obedient(self) -> ArduPilotNavigator:
        """Slow-downs in doubt are not made."""
        return self.reactions[-1]

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters on board that arrival times rest on."""
        return {
            "WPNAV_ACCEL": _CM * self.acceleration_mps2,
            "WPNAV_ACCEL_C": 0.0,
            "WPNAV_ACCEL_Z": _CM * self.vertical_mps2,
            "WPNAV_JERK": self.jerk_mps3,
            "WPNAV_RADIUS": _CM * self.radius_m,
            "WPNAV_SPEED_UP": _CM * self.climb_mps,
            "WPNAV_SPEED_DN": _CM * self.sink_mps,
            "ATC_INPUT_TC": self.input_time_s,
        }

    @property
    def snap_mps4(self) -> float:
        """The limit of snap along a leg."""
        return min(0.25 * math.pi * self.jerk_mps3 / self.input_time_s, self.snap_max_mps4)

    def within(self, ability: Ability) -> ArduPilotNavigator:
        """Return the same navigator for a vehicle with this ability."""
        return replace(
            self,
            acceleration_mps2=min(self.acceleration_mps2, ability.horizontal_mps2),
            jerk_mps3=min(self.jerk_mps3, ability.horizontal_mps3),
            snap_max_mps4=min(self.snap_max_mps4, ability.horizontal_mps4),
            climb_mps=min(self.climb_mps, ability.vertical_mps),
            sink_mps=min(self.sink_mps, ability.vertical_mps),
            vertical_mps2=min(self.vertical_mps2, ability.vertical_mps2),
            fastest_mps=min(self.fastest_mps, ability.horizontal_mps),
        )

    def disturbance_gain_s2(self, drag_ps: float) -> float:
        """See `Navigator`."""
        return disturbance_gain_s2(self.following, drag_ps)

    def sustained_mps(self, length_m: float) -> float:
        """Return the speed that a ramp reaches in half a leg: legs go from rest to rest and overlap."""
        limits = RampLimits(self.acceleration_mps2, self.jerk_mps3, self.snap_mps4)
        return ramp_up(0.0, self.fastest_mps, 0.5 * length_m, limits).end_mps

    def fly(self, orders: NavigatorOrders) -> Iterator[NavigatorState]:
        """Yield every state from the start, without end."""
        target = _Target(self, orders)
        vehicle = Follower(self.following, orders.begins)
        step_s, t_s, hold_until_s = self.step_s, 0.0, math.inf
        time_rate, time_constant_s = 1.0, self.acceleration_mps2 / self.jerk_mps3
        motion = target.motion
        steps = 0
        while True:
            time_rate += (self._pace(motion, vehicle) - time_rate) * step_s / time_constant_s
            vehicle.step(*motion, step_s)
            motion = target.advance(time_rate * step_s)
            steps += 1
            t_s = steps * step_s
            completed, obeyed = None, 1.0
            if target.arrived and math.isinf(hold_until_s):
                index = target.index
                if not orders.stops_at(index) or math.dist(vehicle.position, target.leg_end) <= self.radius_m:
                    hold_until_s = t_s + orders.holds_s[index]
            if t_s >= hold_until_s and not target.finished:
                completed, obeyed, hold_until_s = target.index, target.obeyed, math.inf
                target.next_leg()
            yield vehicle.state(t_s, completed, obeyed, doubtful=target.doubtful)

    def _pace(self, motion: Motion, vehicle: Follower) -> float:
        """Return the share of the target's speed that the vehicle sustains, at most 1."""
        position, velocity, _ = motion
        speed = math.hypot(*velocity)
        if speed <= 0.0:
            return 1.0
        kept, position_ps, at, moving = 0.0, self.following.horizontal.position_ps, vehicle.position, vehicle.velocity
        for i in (0, 1, 2):
            kept += (moving[i] - position_ps * (position[i] - at[i])) * velocity[i]
        return min(max(_SLACK + kept / (speed * speed), 0.0), 1.0)


class _Target:
    """The target of the vehicle. Up to three legs add up: the previous, the present and the next."""

    def __init__(self, navigator: ArduPilotNavigator, orders: NavigatorOrders) -> None:
        self._navigator = navigator
        self._orders = orders
        self._corner = Corner(navigator.radius_m, 2.0 * navigator.acceleration_mps2)
        self._points = (orders.start_ned_m, *orders.waypoints_ned_m)
        self.index = 0
        self._before: NavigatorLeg | None = None
        self._this = self._leg_to(0, 0)
        self._next = self._leg_ahead()
        self.arrived = self.finished = self.doubtful = False
        self.motion: Motion = (orders.start_ned_m, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    @property
    def leg_end(self) -> Vector:
        """The waypoint at the end of the present leg."""
        return self._this.destination

    @property
    def obeyed(self) -> float:
        """The speed of the present leg's cruise over the speed set for it."""
        return self._this.motion.obeyed

    def advance(self, step_s: float) -> Motion:
        """Advance the target by `step_s` and return its motion."""
        this, following, before = self._this, self._next, self._before
        this.motion.advance(step_s)
        position, velocity, acceleration = this.now()
        if before is not None:
            before.motion.advance(step_s)
            if before.motion.remaining_s <= 0.0:
                self._before = None
            else:
                p, v, a = before.now()
                position = _plus(position, _minus(p, this.origin))
                velocity, acceleration = _plus(velocity, v), _plus(acceleration, a)
        turned = False
        if following is not None:
            begun = following.motion.elapsed_s > 0.0
            if begun or self._corner.may_begin(this, following):
                following.motion.advance(step_s)
                p, v, a = following.now()
                position = _plus(position, _minus(p, following.origin))
                velocity, acceleration = _plus(velocity, v), _plus(acceleration, a)
                turned = begun and following.motion.elapsed_s >= this.motion.remaining_s
        self.arrived = self.arrived or turned or this.motion.remaining_s <= 0.0
        self.motion = position, velocity, acceleration
        return self.motion

    def next_leg(self) -> None:
        """Change to the next leg: the present waypoint is completed."""
        if self.index + 1 >= self._orders.count:
            self.finished = True
            return
        self.index += 1
        self.arrived = False
        self._before = self._this
        if self._next is None:
            self._this = self._leg_to(self.index, self.index)
        else:
            self._this = self._next
            for leg in (self._before, self._this):
                leg.motion.set_top(self._top(leg.direction, self.index))
                self.doubtful = self.doubtful or leg.motion.doubtful
        self._next = self._leg_ahead()

    def _leg_ahead(self) -> NavigatorLeg | None:
        return None if self._orders.stops_at(self.index) else self._leg_to(self.index + 1, self.index)

    def _leg_to(self, index: int, speed_of: int) -> NavigatorLeg:
        """Return the leg to a waypoint, at the speed set for the leg to `speed_of`."""
        navigator = self._navigator
        origin, destination = self._points[index], self._points[index + 1]
        length = max(math.dist(origin, destination), _NOWHERE_M)
        direction = vector(*((b - a) / length for a, b in zip(origin, destination, strict=True)))
        vertical = navigator.vertical_mps2
        acceleration = limit_along(direction, navigator.acceleration_mps2, vertical, vertical)
        limits = RampLimits(acceleration, navigator.jerk_mps3, navigator.snap_mps4)
        motion = LegMotion(length, self._top(direction, speed_of), limits, navigator.slow_down_room)
        return NavigatorLeg(origin, destination, direction, motion)

    def _top(self, direction: Vector, speed_of: int) -> float:
        navigator = self._navigator
        speed = min(self._orders.speeds_mps[speed_of], navigator.fastest_mps)
        return limit_along(direction, speed, navigator.climb_mps, navigator.sink_mps)


def _plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]
