"""One change of speed along a line, as fast as limits of acceleration, jerk and snap allow.

Acceleration rises, is held, and falls again. The fall mirrors the rise, and the second half of the rise mirrors the
first. In the first half jerk rises along a cosine for `ease_s` and is then constant. So the distance of a ramp is
its duration times the mean of its two speeds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

_HALVINGS = 50
_SAME_MPS = 1e-9

State = tuple[float, float, float]  # distance, speed, acceleration


@dataclass(frozen=True)
class RampLimits:
    """The largest derivatives of speed: acceleration, jerk and snap."""

    mps2: float
    mps3: float
    mps4: float

    @cached_property
    def ease_s(self) -> float:
        """The time in which jerk rises to its limit: the steepest slope of the cosine is the limit of snap."""
        return self.mps3 * math.pi / (2.0 * self.mps4)


@dataclass(frozen=True)
class Ramp:
    """A change of speed from `start_mps` to `end_mps`."""

    start_mps: float
    end_mps: float
    peak_mps2: float = 0.0
    ease_s: float = 0.0
    flat_s: float = 0.0
    hold_s: float = 0.0

    @cached_property
    def rise_s(self) -> float:
        """The time until acceleration is at its peak."""
        return 2.0 * self.ease_s + self.flat_s

    @cached_property
    def duration_s(self) -> float:
        """The duration of the whole change."""
        return 2.0 * self.rise_s + self.hold_s

    @cached_property
    def distance_m(self) -> float:
        """The distance flown during the change."""
        return 0.5 * (self.start_mps + self.end_mps) * self.duration_s

    @property
    def rises(self) -> bool:
        """Whether the speed rises."""
        return self.end_mps > self.start_mps

    def reversed(self) -> Ramp:
        """Return the same change in the other direction."""
        return replace(self, start_mps=self.end_mps, end_mps=self.start_mps)

    def at(self, t_s: float) -> State:
        """Return distance, speed and acceleration `t_s` after the start; 0 <= `t_s` <= `duration_s`."""
        if self.duration_s <= 0.0:
            return 0.0, self.end_mps, 0.0
        if self.start_mps <= self.end_mps:
            return self._gaining(t_s, self.start_mps)
        distance, speed, acceleration = self._gaining(self.duration_s - t_s, self.end_mps)
        return self.distance_m - distance, speed, -acceleration

    def _gaining(self, t_s: float, slow_mps: float) -> State:
        left_s = self.duration_s - t_s
        distance, gained, acceleration = self._first_half(min(t_s, left_s))
        if t_s <= left_s:
            return slow_mps * t_s + distance, slow_mps + gained, acceleration
        both_mps = self.start_mps + self.end_mps
        before_m = slow_mps * left_s + distance
        return self.distance_m - both_mps * left_s + before_m, both_mps - slow_mps - gained, acceleration

    def _first_half(self, t_s: float) -> State:
        rise_s, peak = self.rise_s, self.peak_mps2
        if t_s <= 0.5 * rise_s:
            return self._easing(t_s)
        rise_m = self._rise_m
        if t_s >= rise_s:
            held_s = t_s - rise_s
            speed = 0.5 * peak * rise_s
            return rise_m + held_s * (speed + 0.5 * peak * held_s), speed + peak * held_s, peak
        left_s = rise_s - t_s
        distance, speed, acceleration = self._easing(left_s)
        all_mps = 0.5 * peak * rise_s
        return (
            rise_m - all_mps * left_s + 0.5 * peak * left_s**2 - distance,
            all_mps - peak * left_s + speed,
            peak - acceleration,
        )

    @cached_property
    def _rise_m(self) -> float:
        middle_m, _, _ = self._easing(0.5 * self.rise_s)
        return 2.0 * middle_m + 0.125 * self.peak_mps2 * self.rise_s**2

    @cached_property
    def _eased(self) -> State:
        return self._cosine(self.ease_s)

    def _easing(self, t_s: float) -> State:
        if t_s <= self.ease_s:
            return self._cosine(t_s)
        distance, speed, acceleration = self._eased
        jerk, flat_s = self.peak_mps2 / (self.ease_s + self.flat_s), t_s - self.ease_s
        return (
            distance + flat_s * (speed + flat_s * (0.5 * acceleration + jerk * flat_s / 6.0)),
            speed + flat_s * (acceleration + 0.5 * jerk * flat_s),
            acceleration + jerk * flat_s,
        )

    def _cosine(self, t_s: float) -> State:
        half = 0.5 * self.peak_mps2 / (self.ease_s + self.flat_s)
        rate = math.pi / self.ease_s
        sine, cosine = math.sin(rate * t_s), math.cos(rate * t_s)
        return (
            half * (t_s**3 / 6.0 - (t_s - sine / rate) / rate**2),
            half * (0.5 * t_s * t_s - (1.0 - cosine) / rate**2),
            half * (t_s - sine / rate),
        )


def constant_speed(speed_mps: float) -> Ramp:
    """Return a ramp without change of speed."""
    return Ramp(speed_mps, speed_mps)


def ramp_up(start_mps: float, wanted_mps: float, room_m: float, limits: RampLimits) -> Ramp:
    """Return the fastest ramp up to `wanted_mps`, or to the speed that can be reached within `room_m`.

    From rest, a small change has a shorter rise of jerk. In motion the rise keeps its full `ease_s`, and a small change
    has a lower peak of jerk. If even the shortest ramp does not fit into `room_m`, the speed does not change.
    """
    wanted = wanted_mps - start_mps

    def ramp(peak_mps2: float, hold_s: float = 0.0) -> Ramp:
        ease_s = limits.ease_s
        if start_mps == 0.0:
            ease_s = min(ease_s, math.sqrt(0.5 * math.pi * peak_mps2 / limits.mps4))
        flat_s = max(peak_mps2 / limits.mps3 - ease_s, 0.0)
        gained = peak_mps2 * (2.0 * ease_s + flat_s + hold_s)
        return Ramp(start_mps, start_mps + gained, peak_mps2, ease_s, flat_s, hold_s)

    def fits(candidate: Ramp) -> bool:
        return candidate.end_mps <= wanted_mps and candidate.distance_m <= room_m

    if wanted <= _SAME_MPS or 4.0 * start_mps * limits.ease_s >= room_m:
        return constant_speed(start_mps)
    steepest = ramp(limits.mps2)
    if fits(steepest):
        hold_s = min(wanted / limits.mps2 - steepest.rise_s, _hold_for(steepest, room_m))
        return ramp(limits.mps2, max(hold_s, 0.0))
    low, high = 0.0, limits.mps2
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fits(ramp(middle)) else (low, middle)
    return ramp(low) if low > 0.0 else constant_speed(start_mps)


def _hold_for(steepest: Ramp, room_m: float) -> float:
    """Return how long the peak can be held until the distance is `room_m`: it is quadratic in that time."""
    peak, rise_s, start = steepest.peak_mps2, steepest.rise_s, steepest.start_mps
    linear = 2.0 * start + 3.0 * peak * rise_s
    missing = 2.0 * (room_m - steepest.distance_m)
    return (math.sqrt(linear * linear + 4.0 * peak * missing) - linear) / (2.0 * peak)
