"""What the vehicles believe: one filterpy ExtendedKalmanFilter each, fed with what a real one is fed with.

Knows: Eq. 1 as prediction with the commanded controls as known input, the sensors' error figures, and a contact
switch on the landing gear. Does not know: true states, wind, references.

State (15): the twelve of `gcs.quadrotor` and three gyro biases. At every control step the means of the whole
fleet are propagated in one batch, at every inertial sample (50 Hz) the Jacobians; filterpy then predicts and
updates each vehicle: GNSS (6) where there is a fix, then gyro, magnetometer and barometer as one vector (5).

Gate: a measurement group (`Ratios`) more than five standard deviations off is given no weight, until it has
been refused for five seconds on end; then the filter is held to be in the wrong. The gyro is not gated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from gcs.quadrotor import Array, Quadrotor
from sim_bridge.gains import ControlLimits, turn_authority_radps2
from sim_bridge.motion import derivative, jacobian
from sim_bridge.plant import Mask
from sim_bridge.sensors import GNSS_PERIOD_S, INERTIAL_PERIOD_S, SensorGrade

STATES = 15
ALIGN_S = 2.0
GATE_SIGMA = 5.0
GATE_TIMEOUT_S = 5.0

# What Eq. 1 in still air leaves out, as white noise; the angular part is a share of what the vehicle can do.
ACCELERATION_NOISE = 0.02  # m/s² per square root of a hertz
TURN_NOISE_SHARE = 0.02

_STANDS = np.array([1.0, 1.0, 1.0] + [0.0] * 5 + [1.0] + [0.0] * 3 + [1.0] * 3)  # states kept in ground contact
_STANDS_SIGMA = 1e-4  # of the states that contact holds at zero
_NO_WEIGHT = 1e8

_H_GNSS = np.eye(6, STATES)
_H_INERTIAL = np.zeros((5, STATES))
_H_INERTIAL[(0, 1, 2), (9, 10, 11)] = 1.0
_H_INERTIAL[(0, 1, 2), (12, 13, 14)] = 1.0
_H_INERTIAL[3, 8] = 1.0
_H_INERTIAL[4, 2] = -1.0


def wrapped(angle_rad: Array) -> Array:
    """Angles in [-π, π)."""
    return np.asarray(np.remainder(angle_rad + np.pi, 2.0 * np.pi) - np.pi)


class VehicleFilter(ExtendedKalmanFilter):  # type: ignore[misc]
    """filterpy's EKF, whose mean is propagated outside, for all vehicles at once."""

    def predict_x(self, u: Array) -> None:
        """Take u as the mean that Eq. 1 predicts (filterpy's hook for a nonlinear model)."""
        self.x = u


@dataclass(frozen=True, slots=True)
class Ratios:
    """Innovation over gate of the last sample, each (V,): above 1 it was refused. For EKF_STATUS_REPORT."""

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


class Estimator:
    """Filters of V vehicles, which begin level on the ground and average ALIGN_S of measurements there."""

    def __init__(self, q: Quadrotor, limits: ControlLimits, grade: SensorGrade, vehicles: int) -> None:
        self._q = q
        self._noise = _Noise.of(q, limits, grade)
        self._control = np.zeros((4, vehicles))
        self._mean = np.zeros((STATES, vehicles))
        self._rates = np.zeros((12, vehicles))
        self._filters = [VehicleFilter(STATES, 6) for _ in range(vehicles)]
        self._ratio = np.zeros((vehicles, 5))
        self._refused_s = np.zeros((vehicles, 5))
        self._pad_samples: tuple[list[Array], list[Array]] = ([], [])
        self._baro_zero_m = np.zeros(vehicles)
        self.aligned = False

    @property
    def state(self) -> Array:
        """Estimated states (V, 12)."""
        return self._mean[:12].T

    @property
    def mean(self) -> Array:
        """Filter means (V, 15): states and gyro biases."""
        return self._mean.T

    @property
    def covariance(self) -> Array:
        """Covariances (V, 15, 15) after the last inertial sample."""
        return np.array([ekf.P for ekf in self._filters])

    @property
    def ratios(self) -> Ratios:
        """Innovation test ratios of the last samples."""
        return Ratios(*self._ratio.T)

    @property
    def accuracy(self) -> Accuracy:
        """What the filters think of their own position and velocity."""
        sigma = np.sqrt(np.array([ekf.P.diagonal()[:6] for ekf in self._filters]))
        return Accuracy(sigma[:, :2].max(axis=1), sigma[:, 2], sigma[:, 3:5].max(axis=1), sigma[:, 5])

    @property
    def healthy(self) -> Mask:
        """Vehicles (V,) whose filter is aligned and whose measurements pass their gates."""
        return np.asarray((self._ratio < 1.0).all(axis=1) & self.aligned)

    def propagate(self, control: Array, landed: Mask, step_s: float) -> None:
        """Advance the means by step_s under the controls (V, 4) just commanded.

        Midpoint rule; the midpoint is guessed with the rates of the step before, which saves every second
        evaluation of Eq. 1 and keeps the order.
        """
        if not self.aligned:
            return
        self._control = control.T
        x = self._mean[:12]
        self._rates = derivative(x + 0.5 * step_s * self._rates, self._control, self._q)
        if landed.any():
            x *= np.where(landed, _STANDS[:12, None], 1.0)
            self._rates[:, landed] = 0.0
        x += step_s * self._rates

    def measure(self, inertial: Array, gnss: Array | None, landed: Mask) -> None:
        """Take an inertial sample (V, 5) and, if there is one, a GNSS fix (V, 6), as `Sensors` gives them."""
        if not self.aligned:
            self._average(inertial, gnss)
            return
        inertial = inertial.copy()
        inertial[:, 4] -= self._baro_zero_m
        self._predict(landed)
        gnss_weight, inertial_weight = self._gate(inertial, gnss)
        noise = self._noise
        for i, ekf in enumerate(self._filters):
            if gnss is not None:
                r = noise.gnss if gnss_weight is None else noise.gnss + np.diag(gnss_weight[i])
                ekf.update(gnss[i], _gnss_jacobian, _expected_gnss, r)
            r = noise.inertial if inertial_weight is None else noise.inertial + np.diag(inertial_weight[i])
            ekf.update(inertial[i], _inertial_jacobian, _expected_inertial, r, residual=_inertial_residual)
            self._mean[:, i] = ekf.x

    def _average(self, inertial: Array, gnss: Array | None) -> None:
        inertials, fixes = self._pad_samples
        inertials.append(inertial)
        if gnss is not None:
            fixes.append(gnss)
        if len(inertials) * INERTIAL_PERIOD_S < ALIGN_S or not fixes:
            return
        yaw = np.array([sample[:, 3] for sample in inertials])
        self._mean[:3] = np.mean(fixes, axis=0)[:, :3].T
        self._mean[8] = yaw[0] + np.mean(wrapped(yaw - yaw[0]), axis=0)
        self._mean[12:] = np.mean(inertials, axis=0)[:, :3].T
        self._baro_zero_m = np.mean(inertials, axis=0)[:, 4] + self._mean[2]
        for ekf, mean in zip(self._filters, self._mean.T, strict=True):
            ekf.x, ekf.P = mean.copy(), self._noise.aligned(len(inertials), len(fixes))
        self.aligned = True

    def _predict(self, landed: Mask) -> None:
        dt = INERTIAL_PERIOD_S
        transition = np.tile(np.eye(STATES), (len(self._filters), 1, 1))
        transition[:, :12, :12] += dt * jacobian(self._mean[:12], self._control, self._q)
        transition[landed] = np.diag(_STANDS)
        for i, (ekf, mean) in enumerate(zip(self._filters, self._mean.T.copy(), strict=True)):
            ekf.F = transition[i]
            ekf.Q = self._noise.standing if landed[i] else self._noise.flying
            ekf.predict(mean)

    def _gate(self, inertial: Array, gnss: Array | None) -> tuple[Array | None, Array | None]:
        """Judge the samples; return the variance to add to each component, or None where all are accepted."""
        variance = np.array([ekf.P.diagonal() for ekf in self._filters])
        mean, noise = self._mean.T, self._noise
        if gnss is not None:
            off = np.abs(gnss - mean[:, :6]) / (GATE_SIGMA * np.sqrt(variance[:, :6] + noise.gnss_gate))
            self._ratio[:, 0] = off[:, 3:].max(axis=1)
            self._ratio[:, 1] = off[:, :2].max(axis=1)
            self._ratio[:, 2] = off[:, 2]
        self._ratio[:, 3] = np.abs(wrapped(inertial[:, 3] - mean[:, 8]))
        self._ratio[:, 4] = np.abs(inertial[:, 4] + mean[:, 2])
        self._ratio[:, 3:] /= GATE_SIGMA * np.sqrt(variance[:, (8, 2)] + noise.inertial_gate)
        refused = self._ratio > 1.0
        self._refused_s = np.where(refused, self._refused_s + INERTIAL_PERIOD_S, 0.0)
        if not refused.any():
            return None, None
        extra = np.where(refused & (self._refused_s < GATE_TIMEOUT_S), _NO_WEIGHT, 0.0)
        return extra[:, (1, 1, 2, 0, 0, 0)], np.pad(extra[:, 3:], ((0, 0), (3, 0)))


@dataclass(frozen=True, slots=True)
class _Noise:
    """Every covariance the filters need, made once."""

    gnss: Array  # (6, 6)
    gnss_gate: Array  # (6,)
    inertial: Array  # (5, 5)
    inertial_gate: Array  # (2,) compass, baro
    flying: Array  # (15, 15)
    standing: Array  # (15, 15)
    grade: SensorGrade

    @classmethod
    def of(cls, q: Quadrotor, limits: ControlLimits, grade: SensorGrade) -> _Noise:
        g, dt = grade, INERTIAL_PERIOD_S
        white = np.square(
            [g.gnss_horizontal_m] * 2 + [g.gnss_vertical_m] + [g.gnss_horizontal_mps] * 2 + [g.gnss_vertical_mps]
        )
        drifts = (g.gnss_horizontal_drift_m, g.gnss_horizontal_drift_m, g.gnss_vertical_drift_m)
        slow = np.array([d.equivalent_variance(GNSS_PERIOD_S) for d in drifts] + [0.0] * 3)
        at_once = np.array([d.sigma**2 for d in drifts] + [0.0] * 3)
        baro_slow = g.baro_drift_m.equivalent_variance(dt)
        inertial = [g.gyro_radps**2] * 3 + [g.mag_rad**2, g.baro_m**2 + baro_slow]
        turn = TURN_NOISE_SHARE * turn_authority_radps2(q, limits)
        bias = [g.gyro_bias_walk_radps**2 * dt] * 3
        flying = np.concatenate([[0.0] * 3, [ACCELERATION_NOISE**2 * dt] * 3, [0.0] * 3, turn**2 * dt, bias])
        standing = np.concatenate([(1.0 - _STANDS[:12]) * _STANDS_SIGMA**2, bias])
        return cls(
            gnss=np.diag(white + slow),
            gnss_gate=white + at_once,
            inertial=np.diag(inertial),
            inertial_gate=np.array([g.mag_rad**2, g.baro_m**2 + g.baro_drift_m.sigma**2]),
            flying=np.diag(flying),
            standing=np.diag(standing),
            grade=g,
        )

    def aligned(self, inertials: int, fixes: int) -> Array:
        """Covariance (15, 15) of a mean over so many samples on the pad; slow errors do not average out."""
        g = self.grade
        position = [g.gnss_horizontal_m**2 / fixes + g.gnss_horizontal_drift_m.sigma**2] * 2
        position.append(g.gnss_vertical_m**2 / fixes + g.gnss_vertical_drift_m.sigma**2)
        still = (1.0 - _STANDS[:12]) * _STANDS_SIGMA**2
        still[:3] = position
        still[8] = g.mag_rad**2 / inertials
        return np.diag(np.concatenate([still, [g.gyro_radps**2 / inertials] * 3]))


def _gnss_jacobian(_: Array) -> Array:
    return _H_GNSS


def _expected_gnss(x: Array) -> Array:
    return x[:6]


def _inertial_jacobian(_: Array) -> Array:
    return _H_INERTIAL


def _expected_inertial(x: Array) -> Array:
    return np.asarray(_H_INERTIAL @ x)


def _inertial_residual(measured: Array, expected: Array) -> Array:
    off = measured - expected
    off[3] = (off[3] + np.pi) % (2.0 * np.pi) - np.pi
    return off
