"""The solution of Eq. 1 as a power series of time, coefficient by coefficient.

Each coefficient of a product, a sine, a root or a power follows from the lower ones of its arguments (Taylor series
method; A. Jorba and M. Zou, A software package for the numerical integration of ODEs by high-order Taylor methods).
"""

import numpy as np

from gcs.physics.quadrotor import Quadrotor
from gcs.types import Array

_FLOOR_M = 1.0  # of `gcs.physics.wind`: below it the power law is smoothed


def motion_series(state: Array, control: Array, unit_s: Array, q: Quadrotor) -> Array:
    """Coefficients (K+1, 12, N) of the solution from states (12, N), under controls (K+1, 4, N).

    Time is counted in units (N,)."""
    top = len(control) - 1
    count = state.shape[1]
    x = np.zeros((top + 1, 12, count))
    x[0] = state
    sines, cosines = np.zeros((top + 1, 3, count)), np.zeros((top + 1, 3, count))
    lean = np.zeros((top + 1, 5, count))  # cy sp, sy sp, and the three components of the thrust's direction
    wind = _Wind(q, top, count)
    ix, iy, iz = q.inertia_kgm2
    for k in range(top):
        angles = x[: k + 1, 6:9]
        if k == 0:
            sines[0], cosines[0] = np.sin(angles[0]), np.cos(angles[0])
        else:
            steps = np.arange(1.0, k + 1.0)[:, None, None] * angles[1:]
            sines[k] = np.einsum("jan,jan->an", steps, cosines[k - 1 :: -1]) / k
            cosines[k] = -np.einsum("jan,jan->an", steps, sines[k - 1 :: -1]) / k
        (sr, sp, sy), (cr, cp, cy) = np.moveaxis(sines, 1, 0), np.moveaxis(cosines, 1, 0)
        lean[k, 0], lean[k, 1] = _product(cy, sp, k), _product(sy, sp, k)
        lean[k, 2] = _product(lean[:, 0], cr, k) + _product(sy, sr, k)
        lean[k, 3] = _product(lean[:, 1], cr, k) - _product(cy, sr, k)
        lean[k, 4] = _product(cp, cr, k)
        air = wind.coefficient(-x[:, 2], k)
        p, qq, r = x[:, 9], x[:, 10], x[:, 11]
        slope = np.empty((12, count))
        slope[0:3] = x[k, 3:6]
        for axis in range(3):
            slope[3 + axis] = -_product(lean[:, 2 + axis], control[:, 0], k) / q.mass_kg
            slope[3 + axis] -= q.drag_Nspm[axis] / q.mass_kg * (x[k, 3 + axis] - air[axis])
        if k == 0:
            slope[5] += q.gravity_mps2
        slope[6:9] = x[k, 9:12]
        moments = (q.arm_m * control[k, 1], q.arm_m * control[k, 2], control[k, 3])
        turns = (_product(qq, r, k) * (iy - iz), _product(p, r, k) * (iz - ix), _product(qq, p, k) * (ix - iy))
        for axis, inertia in enumerate((ix, iy, iz)):
            drag = q.drag_moment_Nms[axis] * x[k, 9 + axis]
            slope[9 + axis] = (moments[axis] + turns[axis] - drag) / inertia
        x[k + 1] = slope * unit_s / (k + 1)
    return x


def _product(a: Array, b: Array, k: int) -> Array:
    """The k-th coefficient (N,) of a product of series (K+1, N)."""
    return np.asarray(np.einsum("kn,kn->n", a[: k + 1], b[k::-1]))


class _Wind:
    """The planned wind at a height that is a series."""

    def __init__(self, q: Quadrotor, top: int, count: int) -> None:
        self._wind = q.wind
        self._root, self._rounded, self._share = (np.zeros((top + 1, count)) for _ in range(3))

    def coefficient(self, height: Array, k: int) -> tuple[Array | float, Array | float, float]:
        """The k-th coefficients of the air velocity, north, east and down."""
        wind = self._wind
        if not wind.has_shear:
            return (wind.north_mps, wind.east_mps, 0.0) if k == 0 else (0.0, 0.0, 0.0)
        root, rounded, share = self._root, self._rounded, self._share
        squared = _product(height, height, k)
        if k == 0:
            root[0] = np.sqrt(squared + _FLOOR_M**2)
            rounded[0] = 0.5 * (height[0] + root[0])
            share[0] = (rounded[0] / wind.reference_m) ** wind.exponent
        else:
            inner = sum((root[j] * root[k - j] for j in range(1, k)), start=np.zeros_like(root[0]))
            root[k] = (squared - inner) / (2.0 * root[0])
            rounded[k] = 0.5 * (height[k] + root[k])
            total = sum((wind.exponent * j - (k - j)) * rounded[j] * share[k - j] for j in range(1, k + 1))
            share[k] = total / (k * rounded[0])
        return share[k] * wind.north_mps, share[k] * wind.east_mps, 0.0
