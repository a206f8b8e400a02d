"""ArduCopter's corners: the next leg begins while this one still ends, so their speeds add up to a rounded corner.

Knows: two legs that follow one another. Does not know: who flies them, what comes after.

A leg that begins so late that the first is at rest makes a stop; the earlier it begins, the wider the corner is cut.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs.mission.navigator.leg import LegMotion
from gcs.mission.navigator.orders import Vector

Motion = tuple[Vector, Vector, Vector]  # position, velocity, acceleration


@dataclass(frozen=True)
class Leg:
    """A straight line with the motion along it."""

    origin: Vector
    destination: Vector
    way: Vector  # unit
    motion: LegMotion

    def now(self) -> Motion:
        """Position, velocity and acceleration as far as it has got."""
        return self.at(self.motion.elapsed_s)

    def at(self, t_s: float) -> Motion:
        """Position, velocity and acceleration at `t_s` since it began."""
        distance, speed, acceleration = self.motion.at(t_s)
        n, e, d = self.way
        north, east, down = self.origin
        return (
            (north + n * distance, east + e * distance, down + d * distance),
            (n * speed, e * speed, d * speed),
            (n * acceleration, e * acceleration, d * acceleration),
        )


@dataclass(frozen=True)
class Corner:
    """How far a corner may be cut."""

    radius_m: float
    acceleration_mps2: float

    def may_begin(self, this: Leg, following: Leg) -> bool:
        """Whether `following` may begin now, while `this` ends.

        Not before half the leg, nor so early that both would be at speed; and half way through the turn the vehicle
        must be near the waypoint, no faster than either leg is allowed, and not accelerate too much.
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
