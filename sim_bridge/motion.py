"""Eq. 1 for a whole fleet at once: its rates, one integration step, its Jacobian.

Knows: `gcs.quadrotor` on arrays with components first, (12, V), so that each component is one contiguous row and a
step of six vehicles costs hardly more than one of one. Does not know: ground, motors, estimates.
"""

from __future__ import annotations

import numpy as np

from gcs.quadrotor import Array, Quadrotor, equations_of_motion

_STILL = np.zeros((3, 1))


def derivative(state: Array, control: Array, q: Quadrotor, wind_ned_mps: Array = _STILL) -> Array:
    """Eq. 1: state (12, V), control (4, V), wind (3, V or 1) -> (12, V)."""
    return np.array(equations_of_motion(tuple(state), tuple(control), q, tuple(wind_ned_mps)))


def rk4(state: Array, control: Array, q: Quadrotor, wind_ned_mps: Array, step_s: float) -> Array:
    """One classical Runge-Kutta step of Eq. 1 with control and wind held; shapes as for `derivative`."""
    k1 = derivative(state, control, q, wind_ned_mps)
    k2 = derivative(state + 0.5 * step_s * k1, control, q, wind_ned_mps)
    k3 = derivative(state + 0.5 * step_s * k2, control, q, wind_ned_mps)
    k4 = derivative(state + step_s * k3, control, q, wind_ned_mps)
    return np.asarray(state + step_s / 6.0 * (k1 + 2.0 * (k2 + k3) + k4))


def jacobian(state: Array, control: Array, q: Quadrotor) -> Array:
    """∂(Eq. 1)/∂state for states (12, V) and controls (4, V) -> (V, 12, 12)."""
    roll, pitch, yaw, p, qq, r = state[6:12]
    sr, cr, sp, cp, sy, cy = (
        np.sin(roll),
        np.cos(roll),
        np.sin(pitch),
        np.cos(pitch),
        np.sin(yaw),
        np.cos(yaw),
    )
    thrust = control[0] / q.mass_kg
    ix, iy, iz = q.inertia_kgm2
    a = np.zeros((state.shape[1], 12, 12))
    for i in range(3):
        a[:, i, 3 + i] = 1.0
        a[:, 6 + i, 9 + i] = 1.0
        a[:, 3 + i, 3 + i] = -q.drag_Nspm[i] / q.mass_kg
        a[:, 9 + i, 9 + i] = -q.drag_moment_Nms[i] / q.inertia_kgm2[i]
    a[:, 3, 6] = (cy * sp * sr - sy * cr) * thrust
    a[:, 3, 7] = -cy * cp * cr * thrust
    a[:, 3, 8] = (sy * sp * cr - cy * sr) * thrust
    a[:, 4, 6] = (sy * sp * sr + cy * cr) * thrust
    a[:, 4, 7] = -sy * cp * cr * thrust
    a[:, 4, 8] = -(cy * sp * cr + sy * sr) * thrust
    a[:, 5, 6] = cp * sr * thrust
    a[:, 5, 7] = sp * cr * thrust
    a[:, 9, 10], a[:, 9, 11] = r * ((iy - iz) / ix), qq * ((iy - iz) / ix)
    a[:, 10, 9], a[:, 10, 11] = r * ((iz - ix) / iy), p * ((iz - ix) / iy)
    a[:, 11, 9], a[:, 11, 10] = qq * ((ix - iy) / iz), p * ((ix - iy) / iz)
    return a
