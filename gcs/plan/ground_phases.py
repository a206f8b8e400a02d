"""The phases the paper leaves out and that need no optimiser: straight up from the ground, hovering, straight down.

Knows: polynomials that solve Eq. 1 exactly for a level vehicle. Does not know: who calls them when.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly

from gcs.plan.trajectory import Trajectory
from gcs.quadrotor import Array, Quadrotor

# s(r) = 10 r^3 - 15 r^4 + 6 r^5: from rest to rest with zero acceleration at both ends, highest power first.
_SMOOTH_STEP = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])


def vertical(
    start_s: float,
    end_s: float,
    position_ned_m: Array,
    end_down_m: float,
    yaw_ned_rad: float,
    quadrotor: Quadrotor,
) -> Trajectory:
    """From rest at `position_ned_m` (3,) to rest at `end_down_m` straight above or below, level all the way.

    The quintic in z makes thrust a quintic too, m (g - z'') - K_3 z', so Eq. 1 holds exactly.
    """
    down = smooth_step(start_s, end_s, float(position_ned_m[2]), end_down_m)
    joints = down.x
    state = np.zeros((6, 1, 12))
    state[-1, 0, :3] = position_ned_m
    state[-1, 0, 8] = yaw_ned_rad
    state[:, 0, 2] = down.c[:, 0]
    state[1:, 0, 5] = down.derivative().c[:, 0]
    control = np.zeros((6, 1, 4))
    control[2:, 0, 0] -= quadrotor.mass_kg * down.derivative(2).c[:, 0]
    control[1:, 0, 0] -= quadrotor.drag_Nspm[2] * down.derivative().c[:, 0]
    control[-1, 0, 0] += quadrotor.weight_N
    return Trajectory(PPoly(state, joints), PPoly(control, joints))


def smooth_step(start_s: float, end_s: float, start: float, end: float) -> PPoly:
    """The C² quintic between two values at rest; its peak speed is 15/8 of the mean."""
    duration = end_s - start_s
    coefficients = _SMOOTH_STEP * (end - start) / duration ** np.arange(5, -1, -1)
    coefficients[-1] += start
    return PPoly(coefficients[:, None], [start_s, end_s])
