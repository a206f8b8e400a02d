"""Reference trajectories of a setpoint stream, in plan time and the common local NED frame.

A setpoint is ten numbers: position, velocity, acceleration (NED) and yaw. Every reference ends, and pauses, at rest:
autopilots fly on with the last velocity and acceleration they received.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from gcs.mission.model import SetpointStream

Values = Sequence[float]  # x, y, z, vx, vy, vz, ax, ay, az, yaw
_STILL = (0.0,) * 6


class ReferenceTrajectory(Protocol):
    """Anything with a setpoint for every deadline."""

    def at(self, k: int, t_s: float) -> Values | None:
        """Return the setpoint number `k` of the grid, at plan time `t_s`; None: nothing is sent."""


class PlanReference:
    """One vehicle's setpoints of the plan; before and after the plan, its ends at rest."""

    def __init__(self, stream: SetpointStream, row: int) -> None:
        columns = (
            stream.position_ned_m[row],
            stream.velocity_ned_mps[row],
            stream.acceleration_ned_mps2[row],
            stream.yaw_ned_rad[row][:, None],
        )
        self._rows: list[list[float]] = np.hstack(columns).tolist()

    def at(self, k: int, t_s: float) -> Values:
        """The planned setpoint."""
        del t_s
        last = len(self._rows) - 1
        if 0 <= k <= last:
            return self._rows[k]
        end = self._rows[max(0, min(k, last))]
        return (*end[:3], *_STILL, end[9])
