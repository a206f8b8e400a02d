"""filterpy's extended Kalman filter over stacks of matrices: V vehicles cost hardly more than one.

filterpy's `predict` and `update` run unchanged. Their operands are `Stack`s, whose `dot` and `T` act on each matrix
separately; `scipy.linalg.inv` does so anyway. Each NumPy call costs about a microsecond at any size, and filterpy
makes thirty of them for one measurement: for six vehicles that is most of the work.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from gcs.types import Array
from sim_bridge.dynamics.plant import Mask

Residual = Callable[[Array, Array], Array]


class Stack(np.ndarray):
    """Matrices (V, N, M) that are multiplied and transposed one by one."""

    @classmethod
    def of(cls, matrices: Array) -> Stack:
        """Return the same numbers as a stack."""
        return matrices.view(cls)

    @property
    def T(self) -> Stack:
        """Each matrix transposed."""
        return self.swapaxes(-1, -2)

    def dot(self, other: Any, out: Any = None) -> Any:
        """Return the products of each matrix with `other`, or with the corresponding matrix of another stack."""
        return np.matmul(self, other, out=out)

    def __array_function__(self, func: Any, types: Any, args: Iterable[Any], kwargs: Any) -> Any:
        """Make np.dot of stacks the product matrix by matrix."""
        if func is np.dot:
            return np.matmul(*args, **kwargs)
        return super().__array_function__(func, types, args, kwargs)


class BatchedEkf(ExtendedKalmanFilter):  # type: ignore[misc]
    """filterpy's EKF for V vehicles, whose means are propagated outside.

    `x` (V, N, 1) and `P` (V, N, N) are stacks. So are filterpy's results `y`, `S` and `K` of the last measurement, for
    the vehicles that used it.
    """

    def __init__(self, vehicles: int, states: int) -> None:
        super().__init__(states, 1)
        self.x = Stack.of(np.zeros((vehicles, states, 1)))
        self.P = Stack.of(np.zeros((vehicles, states, states)))

    @property
    def means(self) -> Array:
        """The means (V, N)."""
        return np.asarray(self.x)[..., 0]

    @property
    def variances(self) -> Array:
        """The variances (V, N) of each state."""
        return np.asarray(self.P).diagonal(axis1=1, axis2=2)

    def predict_x(self, u: Array) -> None:
        """Take u (V, N) as the predicted means (filterpy's hook for a nonlinear model)."""
        self.x = Stack.of(u[..., None])

    def carry_on(self, means: Array, transition: Array, noise: Array) -> None:
        """Predict: means (V, N) computed elsewhere, covariances by `transition` and `noise` (V, N, N)."""
        self.F, self.Q = Stack.of(transition), noise
        self.predict(means)

    def spread(self, h: Array) -> Array:
        """Return the variances (V, M) of the expected measurement, Jacobian h (M, N), without the sensor's noise."""
        return np.asarray((np.matmul(h, np.asarray(self.P)) * h).sum(axis=-1))

    def correct(self, which: Mask, measured: Array, h: Array, noise: Array, residual: Residual = np.subtract) -> None:
        """Update the vehicles `which` (V,) with their measurements (V, M): Jacobian h (M, N), noise (M, M)."""
        all_vehicles = which.all()
        if not all_vehicles and not which.any():
            return
        x, p = self.x, self.P
        if not all_vehicles:
            self.x, self.P, measured = Stack.of(x[which]), Stack.of(p[which]), measured[which]
        self.update(measured[..., None], _jacobian, _expected, noise, (h,), (h,), residual)
        if not all_vehicles:
            x, p = Stack.of(x.copy()), Stack.of(p.copy())
            x[which], p[which] = self.x, self.P
            self.x, self.P = x, p


def _jacobian(_: Array, h: Array) -> Array:
    return h


def _expected(x: Stack, h: Array) -> Stack:
    expected: Stack = np.matmul(h, x)
    return expected
