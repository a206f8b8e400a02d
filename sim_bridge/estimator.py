"""What the vehicles believe: dead reckoning with an inertial unit, corrected by one filterpy EKF each.

Knows: samples, the sensors' error figures, and a contact switch on the landing gear. Does not know: true states,
forces, wind, motors, references; what pushes a vehicle is what its accelerometer feels.

The means of the whole fleet are carried on in one batch at every inertial sample (50 Hz), as inertial units are
mechanised. Every UPDATE_PERIOD_S filterpy predicts each vehicle's covariance and updates it, one sensor after the
other: barometer (10 Hz), then GNSS or compass by turns (5 Hz each).

Gate: a group (`Ratios`) more than GATE_SIGMA standard deviations off is left out. Where GNSS has been left out for
GATE_TIMEOUT_S on end, the filter is held to be in the wrong and takes its place from the next fix. Without fixes it
coasts, and says how sure it is (`Accuracy`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from gcs.quadrotor import Array
from sim_bridge.error_model import (
    GNSS_ERROR,
    H_BARO,
    H_COMPASS,
    H_GNSS,
    POSITION,
    STATES,
    UPDATE_PERIOD_S,
    VELOCITY,
    YAW,
    ErrorModel,
)
from sim_bridge.motion import Turn
from sim_bridge.plant import Mask
from sim_bridge.sensors import GNSS_PERIOD_S, INERTIAL_PERIOD_S, SensorGrade

ALIGN_S = 2.0
GATE_SIGMA = 5.0
GATE_TIMEOUT_S = 5.0
COASTING_AFTER_S = 1.0
LOST_SIGMA_M = 5.0  # a vehicle less sure of its place than this is not healthy

Residual = Callable[[Array, Array], Array]

_VELOCITY, _HORIZONTAL, _VERTICAL, _COMPASS, _BARO = range(5)  # columns of the ratios
_GROUP_OF_FIX = np.array([_HORIZONTAL, _HORIZONTAL, _VERTICAL, _VELOCITY, _VELOCITY, _VELOCITY])


def wrapped(angle_rad: Array) -> Array:
    """Angles in [-π, π)."""
    return np.asarray(np.remainder(angle_rad + np.pi, 2.0 * np.pi) - np.pi)


class VehicleFilter(ExtendedKalmanFilter):  # type: ignore[misc]
    """filterpy's EKF, whose mean is carried on outside, for all vehicles at once."""

    def predict_x(self, u: Array) -> None:
        """Take u as the predicted mean (filterpy's hook for a nonlinear model)."""
        self.x = u


@dataclass(frozen=True, slots=True)
class Ratios:
    """Innovation over gate of the last sample, each (V,): above 1 it was refused."""

    velocity: Array
    position_horizontal: Array
    position_vertical: Array
    compass: Array
    baro: Array


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Standard deviations the filters give themselves, each (V,)."""

    position_horizontal_m: Array  # of the worse of two axes
    position_vertical_m: Array
    velocity_horizontal_mps: Array
    velocity_vertical_mps: Array
    yaw_rad: Array


class Estimator:
    """Filters of V vehicles, which begin level on the ground and average ALIGN_S of measurements there.

    `aligned` (V,): who has begun. `healthy` (V,): who has, agrees with its sensors and is sure enough of its place.
    `filters`: filterpy's objects by row, for those who study them.
    """

    def __init__(self, grade: SensorGrade, vehicles: int, gravity_mps2: float) -> None:
        self._model = ErrorModel.of(grade)
        self._baro = _Scalar(H_BARO, self._model.baro, np.subtract)
        self._compass = _Scalar(H_COMPASS, self._model.compass, _off_course)
        self._gravity_mps2 = gravity_mps2
        self._state = np.zeros((12, vehicles))
        self._slow = np.zeros((STATES - 9, vehicles))  # biases and slow errors
        self._velocity_before = np.zeros((3, vehicles))  # after the last update
        self.filters = [VehicleFilter(STATES, 6) for _ in range(vehicles)]
        self._ratio = np.zeros((vehicles, 5))
        self._refused_s = np.zeros((vehicles, 5))
        self._unaided_s = np.zeros(vehicles)
        self._variance = np.zeros((vehicles, STATES))
        self._pad = _PadMeans(vehicles)
        self.aligned: Mask = np.zeros(vehicles, dtype=bool)
        self.healthy: Mask = self.aligned

    @property
    def state(self) -> Array:
        """Estimated states (12, V) in the order of `gcs.quadrotor`; rates are the gyro's less its bias."""
        return self._state

    @property
    def mean(self) -> Array:
        """Filter means (V, 19), in the order of `sim_bridge.error_model`."""
        return np.concatenate((self._state[:9], self._slow)).T

    @property
    def covariance(self) -> Array:
        """Covariances (V, 19, 19) after the last update."""
        return np.array([ekf.P for ekf in self.filters])

    @property
    def ratios(self) -> Ratios:
        """Innovation test ratios of the last samples."""
        return Ratios(*self._ratio.T)

    @property
    def accuracy(self) -> Accuracy:
        """How sure the filters are of place, velocity and heading."""
        sigma = np.sqrt(self._variance)
        return Accuracy(sigma[:, :2].max(axis=1), sigma[:, 2], sigma[:, 3:5].max(axis=1), sigma[:, 5], sigma[:, YAW])

    @property
    def coasting(self) -> Mask:
        """Vehicles (V,) that have gone without GNSS, missing or refused, for longer than COASTING_AFTER_S."""
        return np.asarray(self.aligned & (self._unaided_s > COASTING_AFTER_S))

    def propagate(self, inertial: Array, landed: Mask, *, any_landed: bool) -> None:
        """Carry the means on by one inertial sample (6, V), as `Sensors` gives it."""
        h, state = INERTIAL_PERIOD_S, self._state
        felt = inertial - self._slow[:6]
        rates = state[9:] + felt[:3]
        acceleration = Turn.of(state[6:9] + (0.25 * h) * rates).to_ned(felt[3:])
        acceleration[2] += self._gravity_mps2
        gained = h * acceleration
        velocity = state[3:6]
        moved = np.empty(state.shape)
        np.add(state[:3], h * (velocity + 0.5 * gained), out=moved[:3])
        np.add(velocity, gained, out=moved[3:6])
        np.add(state[6:9], (0.5 * h) * rates, out=moved[6:9])
        moved[9:] = felt[:3]
        if any_landed:
            moved[:, landed] = state[:, landed]
            moved[3:8, landed] = 0.0
            moved[9:, landed] = 0.0
            if not self.aligned.all():
                self._pad.inertial(inertial)
        self._state = moved

    def update(self, landed: Mask, baro: Array, *, compass: Array | None = None, gnss: Array | None = None) -> None:
        """Correct the means by height (V,) and, where it is their turn, heading (V,) and GNSS fix (6, V)."""
        if not self.aligned.all():
            self._align(baro, compass, gnss)
            if not self.aligned.any():
                return
        self._predict(landed)
        self._take_scalar(_BARO, baro, self._baro)
        if compass is not None:
            self._take_scalar(_COMPASS, compass, self._compass)
        if gnss is not None:
            self._take_fix(gnss)
        means = np.array([ekf.x for ekf in self.filters]).T
        self._state[:9], self._slow = means[:9], means[9:].copy()
        if landed.any():
            self._state[3:8, landed] = 0.0
        self._velocity_before = means[3:6]
        self._variance = np.array([ekf.P.diagonal() for ekf in self.filters])
        sure = self._variance[:, :3].max(axis=1) < LOST_SIGMA_M**2
        self.healthy = self.aligned & sure & (self._ratio < 1.0).all(axis=1)

    def _predict(self, landed: Mask) -> None:
        state = self._state
        force = (state[3:6] - self._velocity_before) / UPDATE_PERIOD_S
        force[2] -= self._gravity_mps2
        transition = self._model.transition(Turn.of(state[6:9]), force, landed)
        self._slow[6:] *= self._model.fading
        noise = (self._model.flying, self._model.standing)
        for ekf, f, stands, mean in zip(self.filters, transition, landed.tolist(), self.mean, strict=True):
            ekf.F, ekf.Q = f, noise[stands]
            ekf.predict(mean.copy())

    def _take_fix(self, gnss: Array) -> None:
        self._unaided_s += GNSS_PERIOD_S
        there = self.aligned & ~np.isnan(gnss[0])
        fix, noise = gnss.T.copy(), self._model.gnss
        means, covariances = np.array([ekf.x for ekf in self.filters]), self.covariance
        spread = (H_GNSS @ covariances @ H_GNSS.T).diagonal(axis1=1, axis2=2) + noise.diagonal()
        off = np.abs(fix - means @ H_GNSS.T) / (GATE_SIGMA * np.sqrt(spread))
        ratio = np.stack((off[:, 3:].max(axis=1), off[:, :2].max(axis=1), off[:, 2]), axis=1)
        ratio[~there] = 0.0  # nothing is refused where there is nothing
        self._ratio[:, :3] = ratio
        refused = ratio > 1.0
        self._refused_s[:, :3] = np.where(refused, self._refused_s[:, :3] + GNSS_PERIOD_S, 0.0)
        accepted = ~refused[:, _GROUP_OF_FIX]
        for i in np.flatnonzero(there).tolist():
            ekf = self.filters[i]
            if accepted[i].all():
                ekf.update(fix[i], _jacobian, _expected, noise, (H_GNSS,), (H_GNSS,))
                self._unaided_s[i] = 0.0
            elif (self._refused_s[i, :3] >= GATE_TIMEOUT_S).any():
                self._start_again(ekf, fix[i])
                self._refused_s[i, :3] = self._unaided_s[i] = 0.0
            elif accepted[i].any():
                rows = np.flatnonzero(accepted[i])
                h = H_GNSS[rows]
                ekf.update(fix[i, rows], _jacobian, _expected, noise[np.ix_(rows, rows)], (h,), (h,))

    def _start_again(self, ekf: VehicleFilter, fix: Array) -> None:
        """Take place and velocity from a fix. They are then wrong as the fix is, in the opposite sense."""
        ekf.x[POSITION], ekf.x[VELOCITY] = fix[:3] - ekf.x[GNSS_ERROR], fix[3:]
        p = ekf.P.copy()
        p[VELOCITY], p[:, VELOCITY] = 0.0, 0.0
        p[POSITION] = -p[GNSS_ERROR]
        p[:, POSITION] = -p[:, GNSS_ERROR]
        p[:6, :6] += self._model.gnss
        ekf.P = p

    def _take_scalar(self, group: int, measured: Array, sensor: _Scalar) -> None:
        """Let each filter have its measurement (V,), if that passes the gate."""
        values, ratio, passed = measured[:, None], self._ratio, self.aligned.tolist()
        for i, ekf in enumerate(self.filters):
            if passed[i]:
                x, p, spread = ekf.x, ekf.P, sensor.variance
                for row, column, weight in sensor.pairs:
                    spread += weight * p[row, column]
                off = sensor.residual(values[i], sensor.h.dot(x))
                ratio[i, group] = off_gates = abs(off[0]) / (GATE_SIGMA * math.sqrt(spread))
                if off_gates <= 1.0:
                    h = (sensor.h,)
                    ekf.update(values[i], _jacobian, _expected, sensor.noise, h, h, sensor.residual)

    def _align(self, baro: Array, compass: Array | None, gnss: Array | None) -> None:
        """Let those begin who have stood still with a fix for ALIGN_S."""
        pad = self._pad
        pad.height(baro)
        if compass is not None:
            pad.heading(compass)
        if gnss is not None:
            pad.place(gnss)
        begin = ~self.aligned & (pad.fixes * GNSS_PERIOD_S >= ALIGN_S - 1e-9)
        if not begin.any():
            return
        place, heading, height, rates, force = pad.means()
        self._state[:3, begin] = place[:, begin]
        self._state[YAW, begin] = heading[begin]
        self._slow[:3, begin] = rates[:, begin]
        self._slow[3:6, begin] = force[:, begin] + np.array([[0.0], [0.0], [self._gravity_mps2]])
        self._slow[6, begin] = height[begin] + place[2, begin]
        for i in np.flatnonzero(begin).tolist():
            self.filters[i].P = self._model.aligned(ALIGN_S)
        self.aligned = self.aligned | begin


class _Scalar:
    """A sensor with one number: its row of the Jacobian, its noise, and how to subtract."""

    def __init__(self, h: Array, noise: Array, residual: Residual) -> None:
        self.h, self.noise, self.residual = h, noise, residual
        self.variance = float(noise[0, 0])
        used = np.flatnonzero(h[0]).tolist()
        self.pairs = [(a, b, float(h[0, a] * h[0, b])) for a in used for b in used]  # of h P h'


class _PadMeans:
    """Running means of what V vehicles measure while they stand."""

    def __init__(self, vehicles: int) -> None:
        self.fixes = np.zeros(vehicles)
        self._inertial, self._place = np.zeros((6, vehicles)), np.zeros((3, vehicles))
        self._height, self._turned = np.zeros(vehicles), np.zeros(vehicles)
        self._first_yaw: Array | None = None
        self._samples = self._heights = self._headings = 0

    def inertial(self, sample: Array) -> None:
        self._inertial += sample
        self._samples += 1

    def height(self, sample: Array) -> None:
        self._height += sample
        self._heights += 1

    def heading(self, sample: Array) -> None:
        if self._first_yaw is None:
            self._first_yaw = sample
        self._turned += wrapped(sample - self._first_yaw)
        self._headings += 1

    def place(self, fix: Array) -> None:
        there = ~np.isnan(fix[0])
        self._place[:, there] += fix[:3, there]
        self.fixes += there

    def means(self) -> tuple[Array, Array, Array, Array, Array]:
        """Place (3, V), heading (V,), height (V,), rates (3, V), specific force (3, V)."""
        assert self._first_yaw is not None
        heading = self._first_yaw + self._turned / self._headings
        inertial = self._inertial / self._samples
        place = self._place / np.maximum(self.fixes, 1.0)
        return place, heading, self._height / self._heights, inertial[:3], inertial[3:]


def _jacobian(_: Array, h: Array) -> Array:
    return h


def _expected(x: Array, h: Array) -> Array:
    return np.asarray(h.dot(x))


def _off_course(measured: Array, expected: Array) -> Array:
    return np.array([math.remainder(measured[0] - expected[0], math.tau)])
