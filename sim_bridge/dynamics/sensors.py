"""Sensor models with seeded errors: inertial unit, compass, barometer, GNSS receiver.

White noise is added to each sample; slow errors are Gauss-Markov processes or random walks. The gyro measures Euler
rates, because Eq. 1 takes Euler rates as body rates. Each vehicle and sensor has its own random stream. So the errors
of a vehicle depend on the seed and on its row, never on the number of vehicles. Failures (`effects`) change samples,
not streams: after an outage the errors are those of a flight without one.
"""

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from gcs.types import Array
from sim_bridge.dynamics.failures import Effects, Sensor
from sim_bridge.dynamics.plant import Mask

INERTIAL_PERIOD_S = 0.02
BARO_PERIOD_S = 0.1
COMPASS_PERIOD_S = GNSS_PERIOD_S = 0.2  # alternating

_BLOCK = 256  # samples drawn at once


class Steps(NamedTuple):
    """A slow error as x_0 = start n, x_k = keep x_{k-1} + add n_k with standard normal n."""

    start: float
    keep: float
    add: float


@dataclass(frozen=True, slots=True)
class GaussMarkov:
    """A slowly varying error with zero mean: stationary standard deviation and correlation time."""

    sigma: float
    time_s: float

    def steps(self, period_s: float) -> Steps:
        """Return the process at samples `period_s` apart."""
        keep = math.exp(-period_s / self.time_s)
        return Steps(self.sigma, keep, self.sigma * math.sqrt(1.0 - keep * keep))


@dataclass(frozen=True, slots=True)
class RandomWalk:
    """A drifting bias: standard deviation at power-on, and its growth per square root of a second."""

    start: float
    per_root_s: float

    def steps(self, period_s: float) -> Steps:
        """Return the process at samples `period_s` apart."""
        return Steps(self.start, 1.0, self.per_root_s * math.sqrt(period_s))


NO_DRIFT = GaussMarkov(0.0, 1.0)


@dataclass(frozen=True, slots=True)
class SensorGrade:
    """One set of sensors; standard deviations of white errors are per sample."""

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
    gyro_bias_radps: RandomWalk = RandomWalk(0.003, 1e-5)
    accel_mps2: float = 0.05
    accel_bias_mps2: RandomWalk = RandomWalk(0.05, 2e-4)
    compass_rad: float = 0.02

    @property
    def gnss_white(self) -> Array:
        """Of north, east, down (m) and their rates (m/s), (6,)."""
        place = [self.gnss_horizontal_m] * 2 + [self.gnss_vertical_m]
        return np.array(place + [self.gnss_horizontal_mps] * 2 + [self.gnss_vertical_mps])

    @property
    def gnss_drift(self) -> tuple[GaussMarkov, ...]:
        """Of north, east, down."""
        return (self.gnss_horizontal_drift_m, self.gnss_horizontal_drift_m, self.gnss_vertical_drift_m)


RTK = SensorGrade("rtk", 0.01, 0.015, 0.02, 0.03)
GNSS = SensorGrade("gnss", 0.1, 0.2, 0.05, 0.08, GaussMarkov(1.0, 60.0), GaussMarkov(1.5, 60.0))
GRADES = MappingProxyType({grade.name: grade for grade in (RTK, GNSS)})


class _Errors:
    """White and slow errors of C channels for V vehicles, drawn and summed in blocks for speed."""

    def __init__(self, seeds: list[np.random.SeedSequence], white: Array, slow: list[Steps]) -> None:
        self._generators = [np.random.default_rng(seed) for seed in seeds]
        self._white = white[:, None]
        self._steps = slow
        first = np.stack([g.standard_normal(len(slow)) for g in self._generators], axis=1)
        self.slow = np.array([s.start for s in slow])[:, None] * first  # (C, V) of the last sample
        self._next = _BLOCK
        self._all = self._slow = np.empty((0, *self.slow.shape))

    def draw(self) -> Array:
        """Return the errors (C, V) of the next sample."""
        if self._next == _BLOCK:
            channels, vehicles = self.slow.shape
            normals = np.empty((_BLOCK, 2, channels, vehicles))
            for i, generator in enumerate(self._generators):
                normals[..., i] = generator.standard_normal((_BLOCK, 2, channels))
            slow = np.zeros((_BLOCK, channels, vehicles))
            for c, (start, keep, add) in enumerate(self._steps):
                if start or add:
                    slow[:, c], _ = lfilter([add], [1.0, -keep], normals[:, 1, c], axis=0, zi=keep * self.slow[None, c])
            self._slow, self._all = slow, slow + self._white * normals[:, 0]
            self._next = 0
        now = self._next
        self._next += 1
        self.slow = self._slow[now]
        return np.asarray(self._all[now])


class Sensors:
    """The sensors of V vehicles; every call is one sample period. `effects` are the present failures."""

    def __init__(self, grade: SensorGrade, vehicles: int, seed: int) -> None:
        children = [child.spawn(4) for child in np.random.SeedSequence(seed).spawn(vehicles)]
        inertial, baro, compass, gnss = ([child[k] for child in children] for k in range(4))
        g, still = grade, Steps(0.0, 0.0, 0.0)
        walks = [g.gyro_bias_radps.steps(INERTIAL_PERIOD_S)] * 3 + [g.accel_bias_mps2.steps(INERTIAL_PERIOD_S)] * 3
        self._inertial = _Errors(inertial, np.repeat([g.gyro_radps, g.accel_mps2], 3), walks)
        self._baro = _Errors(baro, np.array([g.baro_m]), [g.baro_drift_m.steps(BARO_PERIOD_S)])
        self._compass = _Errors(compass, np.array([g.compass_rad]), [still])
        drifts = [drift.steps(GNSS_PERIOD_S) for drift in g.gnss_drift]
        self._gnss = _Errors(gnss, g.gnss_white, drifts + [still] * 3)
        self._last_inertial, self._last_gnss = np.zeros((6, vehicles)), np.zeros((6, vehicles))
        self._last_number = dict.fromkeys((Sensor.BAROMETER, Sensor.COMPASS), np.zeros(vehicles))
        self.effects = Effects.of([()] * vehicles)

    def suffer(self, effects: Effects) -> None:
        """Have these effects of failures from now on."""
        self.effects = effects

    @property
    def slow_errors(self) -> Array:
        """The slow errors that filters estimate, (10, V): gyro (3), accelerometer (3), barometer, GNSS position (3)."""
        return np.concatenate((self._inertial.slow, self._baro.slow, self._gnss.slow[:3]))

    @property
    def gnss(self) -> Array:
        """The last GNSS measurements (V, 6): position (m) and velocity (m/s), NED."""
        return np.asarray(self._last_gnss.T)

    def read_inertial(self, truth: Array, specific_force_mps2: Array) -> Array:
        """True states (12, V) and force (3, V) in body axes -> (6, V): gyro (rad/s), accelerometer (m/s²)."""
        z = np.concatenate((truth[9:], specific_force_mps2))
        z += self._inertial.draw()
        if not self.effects.sound:
            stuck = self.effects.stuck.T
            self._hold(z[:3], self._last_inertial[:3], stuck[Sensor.GYRO])
            self._hold(z[3:], self._last_inertial[3:], stuck[Sensor.ACCELEROMETER])
        self._last_inertial = z
        return z

    def read_baro(self, truth: Array) -> Array:
        """True states (12, V) -> barometric height (V,), m."""
        return self._number(Sensor.BAROMETER, self._baro.draw()[0] - truth[2])

    def read_compass(self, truth: Array) -> Array:
        """True states (12, V) -> magnetic yaw (V,), rad."""
        return self._number(Sensor.COMPASS, self._compass.draw()[0] + truth[8])

    def read_gnss(self, truth: Array) -> Array:
        """True states (12, V) -> (6, V): position (m) and velocity (m/s), NED; NaN where there is no fix."""
        z = truth[:6] + self._gnss.draw()
        if not self.effects.sound:
            z[:3] += self.effects.gnss_offset_ned_m.T
            self._hold(z, self._last_gnss, self.effects.stuck[:, Sensor.GNSS])
            self._last_gnss = z.copy()
            z[:, self.effects.gnss_lost] = np.nan
        else:
            self._last_gnss = z
        return np.asarray(z)

    def _number(self, sensor: Sensor, z: Array) -> Array:
        if not self.effects.sound:
            self._hold(z, self._last_number[sensor], self.effects.stuck[:, sensor])
        self._last_number[sensor] = z
        return z

    @staticmethod
    def _hold(z: Array, last: Array, stuck: Mask) -> None:
        z[..., stuck] = last[..., stuck]
