"""What a vehicle is told at an instant of the grid: courses that a stream can follow.

Knows: plan time, the common local NED frame. Does not know: links, when to send. A setpoint is ten numbers: position,
velocity, acceleration (NED) and yaw. Every course ends, and pauses, at rest: autopilots fly on with the last velocity
and acceleration they were given.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from gcs.mission.model import SetpointStream
from gcs.physics.quadrotor import Array

Values = Sequence[float]  # x, y, z, vx, vy, vz, ax, ay, az, yaw
_STILL = (0.0,) * 6


class ReferenceTrajectory(Protocol):
    """Anything with a setpoint for every instant."""

    def at(self, k: int, t_s: float) -> Values | None:
        """The setpoint for instant `k` of the grid, plan time `t_s`; None: nothing is to be sent."""


class PlanReference:
    """One vehicle's share of the plan's stream; before and after it, its ends at rest."""

    def __init__(self, stream: SetpointStream, row: int) -> None:
        columns = (
            stream.position_ned_m[row],
            stream.velocity_ned_mps[row],
            stream.acceleration_ned_mps2[row],
            stream.yaw_ned_rad[row][:, None],
        )
        self._rows: list[list[float]] = np.hstack(columns).tolist()

    def at(self, k: int, t_s: float) -> Values:
        """As planned."""
        del t_s
        last = len(self._rows) - 1
        if 0 <= k <= last:
            return self._rows[k]
        end = self._rows[max(0, min(k, last))]
        return (*end[:3], *_STILL, end[9])


class HoldReference:
    """Stand at one place."""

    def __init__(self, position_ned_m: Array, yaw_ned_rad: float) -> None:
        self._values = (*np.asarray(position_ned_m).tolist(), *_STILL, yaw_ned_rad)

    def at(self, k: int, t_s: float) -> Values:
        """Always the same, at rest."""
        del k, t_s
        return self._values
