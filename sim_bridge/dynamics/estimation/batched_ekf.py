"""filterpy's extended Kalman filter over stacks of matrices: one per vehicle, for hardly more than the price of one.

Knows: how to hand filterpy V means and covariances where it expects one of each. Does not know: states, sensors.

filterpy's `predict` and `update` run as they are. What they multiply are `Stack`s, whose `dot` and `T` act on each
matrix by itself; `scipy.linalg.inv` does so anyway. Calls of NumPy cost a microsecond each whatever they work on, and
filterpy makes thirty of them for one measurement: for six vehicles that is most of the work.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from gcs.physics.quadrotor import Array
from sim_bridge.dynamics.body.plant import Mask

Residual = Callable[[Array, Array], Array]


class Stack(np.ndarray):
    """Matrices (V, N, M) that are multiplied and transposed one by one."""

    @classmethod
    def of(cls, matrices: Array) -> Stack:
        """The same numbers."""
        return matrices.view(cls)

    @property
    def T(self) -> Any:
        """Each matrix transposed."""
        return self.swapaxes(-1, -2)

    def dot(self, other: Any, out: Any = None) -> Any:
        """Products of each matrix with `other`, or with its own one of another stack."""
        return np.matmul(self, other, out=out)

    def __array_function__(self, func: Any, types: Any, args: Iterable[Any], kwargs: Any) -> Any:
        """np.dot of stacks is their product matrix by matrix."""
        if func is np.dot:
            return np.matmul(*args, **kwargs)
        return super().__array_function__(func, types, args, kwargs)


class BatchedEkf(ExtendedKalmanFilter):  # type: ignore[misc]
    """filterpy's EKF for V vehicles, whose means are carried on outside.

    `x` (V, N, 1) and `P` (V, N, N) are stacks; so is what else filterpy leaves behind: `y`, `S`, `K` of the last
    measurement, for those who took it.
    """

    def __init__(self, vehicles: int, states: int) -> None:
        super().__init__(states, 1)
        self.x = Stack.of(np.zeros((vehicles, states, 1)))
        self.P = Stack.of(np.zeros((vehicles, states, states)))

    @property
    def means(self) -> Array:
        """(V, N)."""
        return np.asarray(self.x)[..., 0]

    @property
    def variances(self) -> Array:
        """(V, N), of each state."""
        return np.asarray(self.P).diagonal(axis1=1, axis2=2)

    def predict_x(self, u: Array) -> None:
        """Take u (V, N) as the predicted means (filterpy's hook for a nonlinear model)."""
        self.x = Stack.of(u[..., None])

    def carry_on(self, means: Array, transition: Array, noise: Array) -> None:
        """Predict: means (V, N) worked out elsewhere, covariances by `transition` and `noise` (V, N, N)."""
        self.F, self.Q = Stack.of(transition), noise
        self.predict(means)

    def spread(self, h: Array) -> Array:
        """Variances (V, M) of what a sensor with Jacobian h (M, N) is expected to show, but for its own noise."""
        return np.asarray((np.matmul(h, np.asarray(self.P)) * h).sum(axis=-1))

    def correct(self, who: Mask, measured: Array, h: Array, noise: Array, residual: Residual = np.subtract) -> None:
        """Update the vehicles `who` (V,) by what they measured (V, M): Jacobian h (M, N), noise (M, M)."""
        everyone = who.all()
        if not everyone and not who.any():
            return
        x: Any = self.x
        p: Any = self.P
        if not everyone:
            self.x, self.P, measured = x[who], p[who], measured[who]
        self.update(measured[..., None], _jacobian, _expected, noise, (h,), (h,), residual)
        if not everyone:
            x, p = x.copy(), p.copy()
            x[who], p[who] = self.x, self.P
            self.x, self.P = x, p


def _jacobian(_: Array, h: Array) -> Array:
    return h


def _expected(x: Stack, h: Array) -> Stack:
    expected: Stack = np.matmul(h, x)
    return expected
