"""PX4's smoothing of one axis: speed follows a wanted speed with bounded acceleration and jerk.

Knows: position, speed, acceleration, and three phases of constant jerk. Does not know: waypoints, other axes, save that
all take as long as the slowest.
"""

from __future__ import annotations

import math

_STILL = 1e-9


class Axis:
    """One coordinate of a moving target."""

    def __init__(self, position: float) -> None:
        self.position = position
        self.speed = 0.0
        self.acceleration = 0.0
        self._jerk = 0.0  # of the first phase; the last has the opposite
        self._phases_s = (0.0, 0.0, 0.0)

    @property
    def duration_s(self) -> float:
        """Until the wanted speed is reached."""
        return sum(self._phases_s)

    def want(self, speed: float, acceleration_max: float, jerk_max: float) -> None:
        """Plan the quickest way to `speed`."""
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
        """Reach what is wanted in `duration_s`, which is longer than needed, with the same jerk."""
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
        """Move along the plan."""
        rise_s, hold_s, fall_s = self._phases_s
        rise_s, step_s = self._pass(rise_s, self._jerk, step_s)
        hold_s, step_s = self._pass(hold_s, 0.0, step_s)
        fall_s, step_s = self._pass(fall_s, -self._jerk, step_s)
        self._phases_s = (rise_s, hold_s, fall_s)
        if step_s > 0.0:
            self.acceleration = 0.0
            self.position += step_s * self.speed

    def _pass(self, phase_s: float, jerk: float, step_s: float) -> tuple[float, float]:
        """Move within one phase; what is left of it, and of the step."""
        dt = min(step_s, phase_s)
        if dt > 0.0:
            self.position += dt * (self.speed + dt * (0.5 * self.acceleration + jerk * dt / 6.0))
            self.speed += dt * (self.acceleration + 0.5 * jerk * dt)
            self.acceleration += jerk * dt
        return phase_s - dt, step_s - dt


def synchronize(axes: tuple[Axis, ...]) -> None:
    """Let all axes take as long as the slowest."""
    longest_s = max(axis.duration_s for axis in axes)
    for axis in axes:
        if axis.duration_s < longest_s:
            axis.take(longest_s)
