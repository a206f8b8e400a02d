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

from gcs.autopilots.waypoint_models.navigator import NavigatorState, Vector

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
        drags = (following.drag_ps, following.drag_ps, 0.0)
        loops = (following.horizontal, following.horizontal, following.vertical)
        self._axes = tuple(
            (i, loop.position_ps, loop.velocity_ps, loop.integral_ps2, loop.damping, loop.damps_error, drag)
            for i, (loop, drag) in enumerate(zip(loops, drags, strict=True))
        )
        self._lag_s = following.lag_s
        self._vertical_drag_ps = following.drag_ps
        self._unwinding = following.unwinding
        self.position = list(begins.position_ned_m)
        self.velocity = list(begins.velocity_ned_mps)
        self.acceleration = list(begins.acceleration_ned_mps2)
        self._thrust = [a + k * u for a, k, u in zip(self.acceleration, drags, self.velocity, strict=True)]
        self._integral = [0.0, 0.0, 0.0]

    def step(self, position: Vector, velocity: Vector, acceleration: Vector, step_s: float) -> None:
        """Follow, for `step_s`, a target with this motion."""
        at, moving, thrust, integral = self.position, self.velocity, self._thrust, self._integral
        sink = self._vertical_drag_ps * moving[2] + thrust[2]
        lift = 1.0 - sink / _GRAVITY_MPS2
        tilted = min(step_s / self._lag_s, 1.0)
        for i, position_ps, velocity_ps, integral_ps2, damping, damps_error, drag in self._axes:
            x, u = at[i], moving[i]
            error = velocity[i] + position_ps * (position[i] - x) - u
            wanted = acceleration[i]
            felt = thrust[i] - drag * u
            damped = wanted - felt if damps_error else -felt
            push = wanted + velocity_ps * error + integral[i] + damping * damped
            if self._unwinding and drag and lift < 1.0:
                error -= self._unwinding / velocity_ps * (1.0 - lift) * push
            integral[i] += integral_ps2 * error * step_s
            thrust[i] += (push - thrust[i]) * tilted
            rate = (lift * thrust[i] if i < 2 else thrust[i]) - drag * u
            at[i] = x + step_s * (u + 0.5 * step_s * rate)
            moving[i] = u + step_s * rate
            self.acceleration[i] = rate

    def state(
        self, t_s: float, completed: int | None, obeyed: float = 1.0, *, doubtful: bool = False
    ) -> NavigatorState:
        """Return its present motion, with the other fields of a state."""
        position, velocity, acceleration = self.position, self.velocity, self.acceleration
        return NavigatorState(
            t_s,
            (position[0], position[1], position[2]),
            (velocity[0], velocity[1], velocity[2]),
            (acceleration[0], acceleration[1], acceleration[2]),
            completed,
            obeyed,
            doubtful,
        )
