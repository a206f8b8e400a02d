"""Initial alignment: the means of the measurements on the pad, from which a filter starts."""

from __future__ import annotations

import numpy as np

from gcs.physics.quadrotor import Array


def wrapped(angle_rad: Array) -> Array:
    """Return the angles in [-π, π)."""
    return np.asarray(np.remainder(angle_rad + np.pi, 2.0 * np.pi) - np.pi)


class InitialAlignment:
    """Running sums over the samples of V vehicles; `fixes` (V,) counts GNSS fixes."""

    def __init__(self, vehicles: int) -> None:
        self.fixes = np.zeros(vehicles)
        self._inertial, self._place = np.zeros((6, vehicles)), np.zeros((3, vehicles))
        self._height, self._turned = np.zeros(vehicles), np.zeros(vehicles)
        self._first_yaw: Array | None = None
        self._samples = self._heights = self._headings = 0

    def inertial(self, sample: Array) -> None:
        """Add a sample (6, V) of the inertial units."""
        self._inertial += sample
        self._samples += 1

    def height(self, sample: Array) -> None:
        """Add a height (V,) of the barometers."""
        self._height += sample
        self._heights += 1

    def heading(self, sample: Array) -> None:
        """Add a heading (V,) of the compasses."""
        if self._first_yaw is None:
            self._first_yaw = sample
        self._turned += wrapped(sample - self._first_yaw)
        self._headings += 1

    def place(self, fix: Array) -> None:
        """Add a fix (6, V), NaN for vehicles without one."""
        there = ~np.isnan(fix[0])
        self._place[:, there] += fix[:3, there]
        self.fixes += there

    def means(self) -> tuple[Array, Array, Array, Array, Array]:
        """Return position (3, V), heading (V,), height (V,), rates (3, V), specific force (3, V)."""
        assert self._first_yaw is not None
        heading = self._first_yaw + self._turned / self._headings
        inertial = self._inertial / self._samples
        place = self._place / np.maximum(self.fixes, 1.0)
        return place, heading, self._height / self._heights, inertial[:3], inertial[3:]
