"""Tracking of a moving target: the autopilot's position and velocity loops, the lag of tilt, and drag.

Along each axis, with p, v, a of the target and x, u of the vehicle:

    e = v + position * (p - x) - u
    push = share * a + velocity * e + integral * ∫e + damping * (share_of_damping * a - u')
    lag * thrust' = push - thrust
    u' = lift * thrust - drag * u

`lift` is vertical thrust over weight. Tilt turns thrust sideways, so a descending vehicle gets less push than it
commands. Some autopilots then reduce the integral (`unwinding`), and stay slower than commanded.
"""

from dataclasses import dataclass

from gcs.autopilots.waypoint_models.navigator import NavigatorState, Vector, vector

_GRAVITY_MPS2 = 9.80665


@dataclass(frozen=True)
class Loop:
    """The gains of one axis."""

    position_ps: float
    velocity_ps: float
    integral_ps2: float
    damping: float
    damps_error: bool  # damps the error of acceleration; else acceleration itself


@dataclass(frozen=True)
class Following:
    """The loops of both kinds of axes, and the lag and drag of the vehicle."""

    horizontal: Loop
    vertical: Loop
    lag_s: float
    drag_ps: float  # deceleration over horizontal speed
    unwinding: float = 0.0  # reduction of the integral by the missing push, times the velocity gain


class Follower:
    """A vehicle in flight; `position`, `velocity`, `acceleration` are lists of three (NED)."""

    def __init__(self, following: Following, begins: NavigatorState) -> None:
        self._loops = (following.horizontal, following.horizontal, following.vertical)
        self._lag_s = following.lag_s
        self._drags = (following.drag_ps, following.drag_ps, 0.0)
        self._vertical_drag_ps = following.drag_ps
        self._unwinding = following.unwinding
        self.position = list(begins.position_ned_m)
        self.velocity = list(begins.velocity_ned_mps)
        self.acceleration = list(begins.acceleration_ned_mps2)
        self._thrust = [a + k * u for a, k, u in zip(self.acceleration, self._drags, self.velocity, strict=True)]
        self._integral = [0.0, 0.0, 0.0]

    def step(self, position: Vector, velocity: Vector, acceleration: Vector, step_s: float) -> None:
        """Follow, for `step_s`, a target with this motion."""
        sink = self._vertical_drag_ps * self.velocity[2] + self._thrust[2]
        lift = 1.0 - sink / _GRAVITY_MPS2
        for i in (0, 1, 2):
            loop, drag = self._loops[i], self._drags[i]
            x, u = self.position[i], self.velocity[i]
            error = velocity[i] + loop.position_ps * (position[i] - x) - u
            wanted = acceleration[i]
            felt = self._thrust[i] - drag * u
            damped = wanted - felt if loop.damps_error else -felt
            push = wanted + loop.velocity_ps * error + self._integral[i] + loop.damping * damped
            if self._unwinding and drag and lift < 1.0:
                error -= self._unwinding / loop.velocity_ps * (1.0 - lift) * push
            self._integral[i] += loop.integral_ps2 * error * step_s
            self._thrust[i] += (push - self._thrust[i]) * min(step_s / self._lag_s, 1.0)
            rate = (lift * self._thrust[i] if i < 2 else self._thrust[i]) - drag * u
            self.position[i] = x + step_s * (u + 0.5 * step_s * rate)
            self.velocity[i] = u + step_s * rate
            self.acceleration[i] = rate

    def state(self, t_s: float, completed: int | None, obeyed: float = 1.0) -> NavigatorState:
        """Return its present motion, with a time, a completed waypoint, and how the speed of its leg was obeyed."""
        motion = vector(*self.position), vector(*self.velocity), vector(*self.acceleration)
        return NavigatorState(t_s, *motion, completed, obeyed)
