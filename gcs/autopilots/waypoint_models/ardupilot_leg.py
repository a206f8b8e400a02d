"""Motion of ArduCopter along one straight leg: from rest to rest, and the effect of a change of speed during the leg.

A leg begins with a ramp from rest, may change its speed once, cruises, and ends with a ramp to rest. A ramp up has at
most half the leg, so short legs are slow. A change of speed during the leg does not alter a ramp that has begun. There
is one exception: a start whose acceleration is still held is cut short. Any other change waits for the end of the
start. It is made if the leg's cruise would take long enough, and then as far as half of the cruise has room for it. So
a slow-down can come late, in part, or never.
"""

import math
from dataclasses import dataclass, replace

from gcs.autopilots.waypoint_models.navigator import Vector
from gcs.autopilots.waypoint_models.scurve import Ramp, RampLimits, State, constant_speed, ramp_up

# A change of speed is made only if the cruise has room for so many times its ease at the old speed: 3.6 s by default.
_EASINGS_PER_CHANGE = 12.0
_LONGEST_EASE_S = 1.0  # that is counted
# By so much may the room differ at which an autopilot makes a slow-down: through other parameters, or by rounding.
ROOM_FACTOR = 1.1
_SAME_MPS = 1e-6


class LegMotion:
    """Motion along a leg of `length_m`, at most at `top_mps`. `elapsed_s` of `duration_s` have passed."""

    def __init__(self, length_m: float, top_mps: float, limits: RampLimits, slow_down_room: float = 1.0) -> None:
        """From rest. A slow-down is made if there is `slow_down_room` times the room that it takes."""
        self.length_m = length_m
        self.top_mps = top_mps
        self.elapsed_s = 0.0
        self.doubtful = False  # whether a slow-down was asked for in about the room that it takes
        self._limits = limits
        self._slow_down_room = slow_down_room
        self._plan_from_rest()

    @property
    def remaining_s(self) -> float:
        """The time until rest."""
        return self.duration_s - self.elapsed_s

    @property
    def obeyed(self) -> float:
        """The speed of the cruise over the speed limit."""
        return self._change.end_mps / self.top_mps

    @property
    def started_s(self) -> float:
        """The time at which the first ramp ends."""
        return self._begin_s + self._start.duration_s

    @property
    def stopping_s(self) -> float:
        """The time at which the last ramp begins."""
        return self._cruise_end_s

    def advance(self, step_s: float) -> None:
        """Advance by `step_s`."""
        self.elapsed_s = min(self.elapsed_s + step_s, self.duration_s)

    def at(self, t_s: float) -> State:
        """Return distance from the origin, speed and acceleration at `t_s` after the start of the leg."""
        if t_s >= self.duration_s:
            return self.length_m, 0.0, 0.0
        if t_s >= self._cruise_end_s:
            distance, speed, acceleration = self._stop.at(t_s - self._cruise_end_s)
            return self._cruise_end_m + distance, speed, acceleration
        if t_s >= self._changed_s:
            speed = self._change.end_mps
            return self._changed_m + speed * (t_s - self._changed_s), speed, 0.0
        if t_s >= self.started_s:
            distance, speed, acceleration = self._change.at(t_s - self.started_s)
            return self._started_m + distance, speed, acceleration
        distance, speed, acceleration = self._start.at(max(t_s - self._begin_s, 0.0))
        return self._begin_m + distance, speed, acceleration

    def set_top(self, top_mps: float) -> None:
        """Set another speed limit, as far as the ramps that have begun allow it."""
        if top_mps == self.top_mps:
            return
        self.top_mps = top_mps
        if self.elapsed_s >= self._cruise_end_s:
            return
        if self.elapsed_s == 0.0:
            self._plan_from_rest()
            return
        self._forget_what_is_over()
        self._cut_start_short()
        self._begin_change(self._change_within(self._cruise_end_m - self._started_m))

    def _plan_from_rest(self) -> None:
        self._begin_s = self._begin_m = 0.0
        self._start = ramp_up(0.0, self.top_mps, 0.5 * self.length_m, self._limits)
        self._change = constant_speed(self._start.end_mps)
        self._stop_after(self._start.reversed())

    def _stop_after(self, stop: Ramp) -> None:
        self._stop = stop
        self._started_m = self._begin_m + self._start.distance_m
        self._changed_m = self._started_m + self._change.distance_m
        self._changed_s = self.started_s + self._change.duration_s
        self._cruise_end_m = max(self.length_m - stop.distance_m, self._changed_m)
        self._cruise_end_s = self._changed_s + (self._cruise_end_m - self._changed_m) / self._change.end_mps
        self.duration_s = self._cruise_end_s + stop.duration_s

    def _forget_what_is_over(self) -> None:
        """Make room for one more change: the last change, or the present cruise, becomes the start."""
        if self.started_s <= self.elapsed_s <= self._changed_s:
            self._begin_s, self._begin_m, self._start = self.started_s, self._started_m, self._change
        elif self.elapsed_s > self._changed_s:
            self._begin_m, speed, _ = self.at(self.elapsed_s)
            self._begin_s, self._start = self.elapsed_s, constant_speed(speed)
        else:
            return
        self._change = constant_speed(self._start.end_mps)
        self._started_m = self._begin_m + self._start.distance_m

    def _cut_start_short(self) -> None:
        start = self._start
        risen_s = self._begin_s + start.rise_s
        held_s = risen_s + start.hold_s - max(self.elapsed_s, risen_s)
        if not start.rises or start.hold_s <= 0.0 or held_s < 0.0 or self.top_mps >= start.end_mps:
            return
        slowest = start.end_mps - start.peak_mps2 * held_s
        half_m = 0.5 * self.length_m
        self._start = ramp_up(start.start_mps, max(slowest, self.top_mps), half_m, self._limits)
        self._change = constant_speed(self._start.end_mps)
        self._stop_after(ramp_up(0.0, self._start.end_mps, half_m, self._limits).reversed())

    def _change_within(self, room_m: float) -> Ramp:
        now, limits = self._start.end_mps, self._limits
        wait_s = _EASINGS_PER_CHANGE * min(_LONGEST_EASE_S, limits.ease_s)
        slower = self.top_mps < now - _SAME_MPS
        if slower and (1.0 / ROOM_FACTOR) * wait_s * now < room_m <= ROOM_FACTOR * wait_s * now:
            self.doubtful = True
        if slower and self._slow_down_room * wait_s * now < room_m:
            # The speed falls by what it would gain from the new speed in half the room: by less where that is short.
            rise = ramp_up(self.top_mps, now, 0.5 * room_m, limits)
            return replace(rise, start_mps=now, end_mps=now - (rise.end_mps - rise.start_mps))
        if self.top_mps > now + _SAME_MPS and room_m > wait_s * now:
            return ramp_up(now, min(self.top_mps, room_m / wait_s), 0.5 * room_m, limits)
        return constant_speed(now)

    def _begin_change(self, change: Ramp) -> None:
        for attempt in (change, constant_speed(change.start_mps)):
            self._change = attempt
            room_m = self.length_m - self._started_m - attempt.distance_m
            stop = ramp_up(0.0, attempt.end_mps, room_m, self._limits)
            if abs(stop.end_mps - attempt.end_mps) < _SAME_MPS:
                self._stop_after(stop.reversed())
                return
        self._stop_after(self._stop)


def limit_along(direction: Vector, horizontal: float, up: float, down: float) -> float:
    """The largest speed (or acceleration) along a unit vector whose parts keep to the limits."""
    level_part, climb = math.hypot(direction[0], direction[1]), -direction[2]
    limits = [horizontal / level_part] if level_part > 0.0 else []
    if climb:
        limits.append(up / climb if climb > 0.0 else down / -climb)
    return min(limits, default=horizontal)


Motion = tuple[Vector, Vector, Vector]  # position, velocity, acceleration


@dataclass(frozen=True)
class NavigatorLeg:
    """A straight line, and the motion along it."""

    origin: Vector
    destination: Vector
    direction: Vector  # unit
    motion: LegMotion

    def now(self) -> Motion:
        """Return position, velocity and acceleration at present."""
        return self.at(self.motion.elapsed_s)

    def at(self, t_s: float) -> Motion:
        """Return position, velocity and acceleration at `t_s` after the start of the leg."""
        distance, speed, acceleration = self.motion.at(t_s)
        n, e, d = self.direction
        north, east, down = self.origin
        return (
            (north + n * distance, east + e * distance, down + d * distance),
            (n * speed, e * speed, d * speed),
            (n * acceleration, e * acceleration, d * acceleration),
        )


@dataclass(frozen=True)
class Corner:
    """The limits of a corner that is cut."""

    radius_m: float
    acceleration_mps2: float

    def may_begin(self, this: NavigatorLeg, following: NavigatorLeg) -> bool:
        """Return whether the leg `following` may begin now, while `this` ends.

        It does not begin before half of `this`, nor so early that both legs would be at full speed. Halfway through the
        turn the vehicle must be near the waypoint, no faster than either leg allows, and below the acceleration limit.
        """
        motion, next_motion = this.motion, following.motion
        left_s = motion.remaining_s
        if motion.elapsed_s < motion.stopping_s - next_motion.started_s or left_s >= 0.5 * next_motion.duration_s:
            return False
        if motion.at(motion.elapsed_s)[0] < 0.5 * motion.length_m:
            return False
        (p1, v1, a1), (p2, v2, a2) = this.at(motion.elapsed_s + 0.5 * left_s), following.at(0.5 * left_s)
        off = [p1[i] + p2[i] - following.origin[i] - this.destination[i] for i in range(3)]
        return (
            math.hypot(*off) < self.radius_m
            and math.hypot(v1[0] + v2[0], v1[1] + v2[1]) < min(motion.top_mps, next_motion.top_mps)
            and math.hypot(a1[0] + a2[0], a1[1] + a2[1]) < self.acceleration_mps2
        )
