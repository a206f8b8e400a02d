"""The setpoint stream: positions, velocities, accelerations and yaw of all vehicles, on whole milliseconds."""

from __future__ import annotations

import numpy as np

from gcs.mission.export.bspline_smoothing import SmoothPath
from gcs.mission.model import SetpointStream
from gcs.physics.quadrotor import derivative
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

_DECIMALS = 6  # micrometres: far below the resolution of float32 on links
_MS = 1000
ALL_VEHICLES = slice(None)


def build_stream(
    plan: Plan, rate_hz: float, smooth: SmoothPath | None = None, rows: slice = ALL_VEHICLES
) -> SetpointStream:
    """The setpoints from the end of the take-off to the end of the hover after the arrival, smoothed if given.

    Times are t = k / rate_hz, rounded to whole milliseconds, so one is T0. The last setpoint has zero velocity and
    acceleration: an autopilot continues with those of the last setpoint received.
    """
    if not 0 < rate_hz <= _MS:
        raise ValueError(f"a setpoint rate of {rate_hz} Hz is not between 0 and {_MS} Hz")
    start_s, end_s = plan.airborne_s, plan.phase(PhaseKind.LANDING).start_s
    ticks = np.arange(np.ceil(start_s * rate_hz - 1e-6), np.floor(end_s * rate_hz + 1e-6) + 1)
    t_ms = np.rint(ticks * _MS / rate_hz)
    last_ms = np.floor(end_s * _MS + 1e-6)
    t_s = np.append(t_ms[t_ms < last_ms], last_ms) / _MS
    if smooth is None:
        states, controls = plan.motion(t_s, rows)
        acceleration = derivative(states, controls, plan.quadrotor)[..., VELOCITY]
        parts = states[..., POSITION], states[..., VELOCITY], acceleration, states[..., 8]
    else:
        position, velocity, acceleration, yaw = smooth.at(t_s)
        parts = position[rows], velocity[rows], acceleration[rows], yaw[rows]
    position, velocity, acceleration, yaw = map(_rounded, parts)
    velocity[:, -1] = acceleration[:, -1] = 0.0
    return SetpointStream(plan.sysids[rows], t_s, position, velocity, acceleration, yaw)


def spliced(before: SetpointStream, after: SetpointStream) -> SetpointStream:
    """The setpoints of one stream until another one begins, and those of the other."""
    until = before.t_s < after.t_s[0]
    parts = [
        np.concatenate([getattr(before, name)[:, until], getattr(after, name)], axis=1)
        for name in ("position_ned_m", "velocity_ned_mps", "acceleration_ned_mps2", "yaw_ned_rad")
    ]
    return SetpointStream(before.sysids, np.concatenate([before.t_s[until], after.t_s]), *parts)


def of_vehicle(stream: SetpointStream, row: int) -> SetpointStream:
    """The stream of the vehicle in this row."""
    parts = (stream.position_ned_m, stream.velocity_ned_mps, stream.acceleration_ned_mps2, stream.yaw_ned_rad)
    return SetpointStream((stream.sysids[row],), stream.t_s, *(part[row : row + 1] for part in parts))


def _rounded(values: Array) -> Array:
    return np.asarray(np.round(values, _DECIMALS) + 0.0)  # + 0.0 turns -0.0 into 0.0
