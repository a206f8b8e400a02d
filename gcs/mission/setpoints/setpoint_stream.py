"""Timed setpoints: what all vehicles should do at every tick.

Knows: sampling a plan on whole milliseconds. Does not know: files, links, each vehicle's own frame.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.mission.model import SetpointStream
from gcs.physics.quadrotor import POSITION, VELOCITY, Array, derivative

if TYPE_CHECKING:
    from gcs.mission.setpoints.bspline_smoothing import SmoothPath
    from gcs.plan.trajectory.plan import Plan

_DECIMALS = 6  # micrometres: far below what float32 on the wire keeps
_MS = 1000
EVERYONE = slice(None)


def build_stream(
    plan: Plan, rate_hz: float, smooth: SmoothPath | None = None, rows: slice = EVERYONE
) -> SetpointStream:
    """Setpoints from the end of the takeoff to the end of the hover after the arrival, of the smoothed path if given.

    Ticks are t = k / rate_hz, rounded to whole milliseconds, so one is at T0. The last setpoint is at rest with zero
    acceleration: an autopilot flies on with the last velocity and acceleration it was given.
    """
    if not 0 < rate_hz <= _MS:
        raise ValueError(f"a rate of {rate_hz} Hz has no ticks on whole milliseconds")
    start_s, end_s = plan.airborne_s, plan.phase("landing").start_s
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


def of_vehicle(stream: SetpointStream, row: int) -> SetpointStream:
    """The part of one vehicle, by its row."""
    one = slice(row, row + 1)
    return SetpointStream(
        stream.sysids[one],
        stream.t_s,
        stream.position_ned_m[one],
        stream.velocity_ned_mps[one],
        stream.acceleration_ned_mps2[one],
        stream.yaw_ned_rad[one],
    )


def _rounded(values: Array) -> Array:
    return np.asarray(np.round(values, _DECIMALS) + 0.0)  # + 0.0 turns -0.0 into 0.0
