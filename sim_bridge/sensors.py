"""What the vehicles can know of themselves: GNSS, barometer, gyro and magnetometer, with seeded errors.

Knows: the error model of every sensor, and a grade for each kind of receiver. Does not know: what an
estimator makes of it. White noise is added to each sample; slow errors are first-order Gauss-Markov processes.
The gyro measures Euler rates, because Eq. 1 takes Euler rates as body rates. One random stream per vehicle and
sensor: a vehicle's errors depend on the seed and on its place in the fleet, never on how many others fly.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from gcs.quadrotor import Array

INERTIAL_PERIOD_S = 0.02  # gyro, magnetometer and barometer are read together at 50 Hz
GNSS_PERIOD_S = 0.1

_BLOCK = 256


@dataclass(frozen=True, slots=True)
class GaussMarkov:
    """A slowly varying error: stationary standard deviation and correlation time."""

    sigma: float
    time_s: float

    def equivalent_variance(self, period_s: float) -> float:
        """Variance of white samples with the same power at low frequency: sigma² (1 + 2 time_s / period_s).

        What a filter that takes the samples for independent must assume, not to trust their average too much.
        """
        return self.sigma**2 * (1.0 + 2.0 * self.time_s / period_s) if self.sigma > 0 else 0.0


NO_DRIFT = GaussMarkov(0.0, 1.0)


@dataclass(frozen=True, slots=True)
class SensorGrade:
    """Standard deviations of one sensor fit, per sample where white."""

    name: str
    gnss_horizontal_m: float
    gnss_vertical_m: float
    gnss_horizontal_mps: float
    gnss_vertical_mps: float
    gnss_horizontal_drift_m: GaussMarkov = NO_DRIFT
    gnss_vertical_drift_m: GaussMarkov = NO_DRIFT
    baro_m: float = 0.1
    baro_drift_m: GaussMarkov = GaussMarkov(0.5, 300.0)
    gyro_radps: float = 0.002
    gyro_bias_radps: float = 0.003  # when switched on
    gyro_bias_walk_radps: float = 1e-5  # growth per square root of a second
    mag_rad: float = 0.02


RTK = SensorGrade("rtk", 0.01, 0.015, 0.02, 0.03)
GNSS = SensorGrade("gnss", 0.1, 0.2, 0.05, 0.08, GaussMarkov(1.0, 60.0), GaussMarkov(1.5, 60.0))
GRADES = MappingProxyType({grade.name: grade for grade in (RTK, GNSS)})


class _Normals:
    """Standard normal numbers for V vehicles, one generator each, drawn ahead in blocks for speed."""

    def __init__(self, seeds: list[np.random.SeedSequence], channels: int) -> None:
        self._generators = [np.random.default_rng(seed) for seed in seeds]
        self._block = np.empty((_BLOCK, len(seeds), channels))
        self._next = _BLOCK

    def draw(self) -> Array:
        """Next sample (V, channels)."""
        if self._next == _BLOCK:
            for i, generator in enumerate(self._generators):
                self._block[:, i] = generator.standard_normal((_BLOCK, self._block.shape[2]))
            self._next = 0
        self._next += 1
        return np.asarray(self._block[self._next - 1])


class _Drift:
    """Gauss-Markov errors of V vehicles on several axes, advanced by numbers drawn elsewhere."""

    def __init__(self, axes: tuple[GaussMarkov, ...], period_s: float, start: Array) -> None:
        sigma = np.array([axis.sigma for axis in axes])
        self._keep = np.exp(-period_s / np.array([axis.time_s for axis in axes]))
        self._add = sigma * np.sqrt(1.0 - self._keep**2)
        self.value = sigma * start  # (V, axes)

    def advance(self, normals: Array) -> Array:
        self.value = self._keep * self.value + self._add * normals
        return self.value


class Sensors:
    """The sensors of V vehicles; every call to a read_ method is one sample period."""

    def __init__(self, grade: SensorGrade, vehicles: int, seed: int) -> None:
        children = [child.spawn(2) for child in np.random.SeedSequence(seed).spawn(vehicles)]
        self._inertial = _Normals([pair[0] for pair in children], 9)
        self._gnss = _Normals([pair[1] for pair in children], 9)
        g = grade
        self._inertial_sigma = np.array([g.gyro_radps] * 3 + [g.mag_rad, g.baro_m])
        self._gnss_sigma = np.array(
            [g.gnss_horizontal_m] * 2 + [g.gnss_vertical_m] + [g.gnss_horizontal_mps] * 2 + [g.gnss_vertical_mps]
        )
        first = self._inertial.draw()
        self.gyro_bias_radps = g.gyro_bias_radps * first[:, 6:]  # (V, 3), truth for tests
        self._bias_step = g.gyro_bias_walk_radps * np.sqrt(INERTIAL_PERIOD_S)
        self._baro_drift = _Drift((g.baro_drift_m,), INERTIAL_PERIOD_S, first[:, 5:6])
        position = (g.gnss_horizontal_drift_m, g.gnss_horizontal_drift_m, g.gnss_vertical_drift_m)
        self._gnss_drift = _Drift(position, GNSS_PERIOD_S, self._gnss.draw()[:, 6:])

    def read_inertial(self, truth: Array) -> Array:
        """True states (V, 12) -> (V, 5): gyro (3, rad/s), magnetic yaw (rad), barometric height (m)."""
        normals = self._inertial.draw()
        self.gyro_bias_radps = self.gyro_bias_radps + self._bias_step * normals[:, 6:]
        z = self._inertial_sigma * normals[:, :5]
        z[:, :3] += truth[:, 9:12] + self.gyro_bias_radps
        z[:, 3] += truth[:, 8]
        z[:, 4] += self._baro_drift.advance(normals[:, 5:6])[:, 0] - truth[:, 2]
        return np.asarray(z)

    def read_gnss(self, truth: Array) -> Array:
        """True states (V, 12) -> (V, 6): position NED (m) and velocity NED (m/s)."""
        normals = self._gnss.draw()
        z = truth[:, :6] + self._gnss_sigma * normals[:, :6]
        z[:, :3] += self._gnss_drift.advance(normals[:, 6:])
        return np.asarray(z)
