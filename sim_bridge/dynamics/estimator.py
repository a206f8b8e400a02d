"""State estimator: dead reckoning with an inertial unit, corrected by filterpy's EKF.

It uses the sensor samples, their error figures and a contact switch on the landing gear, nothing else.

The means of the whole fleet are propagated in one batch at every inertial sample (50 Hz), as in a strapdown system.
Every UPDATE_PERIOD_S filterpy predicts each vehicle's covariance and updates it, one sensor after the other: barometer
(10 Hz), then GNSS or compass alternately (5 Hz each).

Gate: a group (`Ratios`) more than GATE_SIGMA standard deviations off is rejected. If GNSS has been rejected for
GATE_TIMEOUT_S without a break, the filter is assumed to be wrong and is reset to the next fix. Without fixes it coasts,
and reports its accuracy (`Accuracy`).
"""

from dataclasses import dataclass

import numpy as np

from gcs.types import Array
from sim_bridge.dynamics.batched_ekf import BatchedEkf, Residual
from sim_bridge.dynamics.error_model import (
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
from sim_bridge.dynamics.integrator import Turn
from sim_bridge.dynamics.plant import Mask
from sim_bridge.dynamics.sensors import GNSS_PERIOD_S, INERTIAL_PERIOD_S, SensorGrade

ALIGN_S = 2.0
GATE_SIGMA = 5.0
GATE_TIMEOUT_S = 5.0
COASTING_AFTER_S = 1.0
LOST_SIGMA_M = 5.0  # above this position uncertainty a vehicle is not healthy

_VELOCITY, _HORIZONTAL, _VERTICAL, _COMPASS, _BARO = range(5)  # columns of the ratios
_GROUP_OF_FIX = np.array([_HORIZONTAL, _HORIZONTAL, _VERTICAL, _VELOCITY, _VELOCITY, _VELOCITY])


@dataclass(frozen=True, slots=True)
class Ratios:
    """Innovation over gate of the last sample, each (V,): above 1 it was rejected."""

    velocity: Array
    position_horizontal: Array
    position_vertical: Array
    compass: Array
    baro: Array


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Standard deviations as estimated by the filters, each (V,)."""

    position_horizontal_m: Array  # of the worse of two axes
    position_vertical_m: Array
    yaw_rad: Array


class Estimator:
    """Filters of V vehicles, which start level on the ground and average ALIGN_S of measurements there.

    `aligned` (V,): the filter has started. `healthy` (V,): it also agrees with its sensors and is sure enough of its
    position. `ekf` is filterpy's object, open to inspection.
    """

    def __init__(self, grade: SensorGrade, vehicles: int, gravity_mps2: float) -> None:
        self._model = ErrorModel.of(grade)
        self._gravity_mps2 = gravity_mps2
        self._state = np.zeros((12, vehicles))
        self._slow = np.zeros((STATES - 9, vehicles))  # biases and slow errors
        self._velocity_before = np.zeros((3, vehicles))  # after the last update
        self.ekf = BatchedEkf(vehicles, STATES)
        self._ratio = np.zeros((vehicles, 5))
        self._refused_s = np.zeros((vehicles, 5))
        self._unaided_s = np.zeros(vehicles)
        self._variance = np.zeros((vehicles, STATES))
        self._pad = InitialAlignment(vehicles)
        self.aligned: Mask = np.zeros(vehicles, dtype=bool)
        self.healthy: Mask = self.aligned

    @property
    def state(self) -> Array:
        """Estimated states (12, V) in the order of `gcs.physics.quadrotor`; rates are the gyro's less its bias."""
        return self._state

    @property
    def mean(self) -> Array:
        """Filter means (V, 19), in the order of `sim_bridge.dynamics.error_model`."""
        return np.concatenate((self._state[:9], self._slow)).T

    @property
    def ratios(self) -> Ratios:
        """Innovation test ratios of the last samples."""
        return Ratios(*self._ratio.T)

    @property
    def accuracy(self) -> Accuracy:
        """Standard deviations of position and heading."""
        sigma = np.sqrt(self._variance)
        return Accuracy(sigma[:, :2].max(axis=1), sigma[:, 2], sigma[:, YAW])

    @property
    def coasting(self) -> Mask:
        """Vehicles (V,) without accepted GNSS for longer than COASTING_AFTER_S: missing or rejected."""
        return np.asarray(self.aligned & (self._unaided_s > COASTING_AFTER_S))

    def propagate(self, inertial: Array, landed: Mask, *, any_landed: bool) -> None:
        """Propagate the means by one inertial sample (6, V) of `Sensors`."""
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
        """Correct the means by height (V,) and, when they are due, heading (V,) and GNSS fix (6, V)."""
        if not self.aligned.all():
            self._align(baro, compass, gnss)
            if not self.aligned.any():
                return
        self._predict(landed)
        self._take_number(_BARO, baro, H_BARO, self._model.baro)
        if compass is not None:
            self._take_number(_COMPASS, compass, H_COMPASS, self._model.compass, _heading_residual)
        if gnss is not None:
            self._take_fix(gnss)
        means = self.ekf.means.T
        self._state[:9], self._slow = means[:9], means[9:].copy()
        if landed.any():
            self._state[3:8, landed] = 0.0
        self._velocity_before = means[3:6]
        self._variance = self.ekf.variances
        sure = self._variance[:, :3].max(axis=1) < LOST_SIGMA_M**2
        self.healthy = self.aligned & sure & (self._ratio < 1.0).all(axis=1)

    def _predict(self, landed: Mask) -> None:
        state = self._state
        force = (state[3:6] - self._velocity_before) / UPDATE_PERIOD_S
        force[2] -= self._gravity_mps2
        transition = self._model.transition(Turn.of(state[6:9]), force, landed)
        self._slow[6:] *= self._model.fading
        noise = self._model.flying
        if landed.any():
            noise = np.where(landed[:, None, None], self._model.standing, noise)
        self.ekf.carry_on(self.mean, transition, noise)

    def _take_fix(self, gnss: Array) -> None:
        self._unaided_s += GNSS_PERIOD_S
        there = self.aligned & ~np.isnan(gnss[0])
        ekf, fix, noise = self.ekf, gnss.T, self._model.gnss
        spread = ekf.spread(H_GNSS) + noise.diagonal()
        off = np.abs(fix - ekf.means.dot(H_GNSS.T)) / (GATE_SIGMA * np.sqrt(spread))
        ratio = np.stack((off[:, 3:].max(axis=1), off[:, :2].max(axis=1), off[:, 2]), axis=1)
        ratio[~there] = 0.0  # without a fix nothing is rejected
        self._ratio[:, :3] = ratio
        refused = ratio > 1.0
        self._refused_s[:, :3] = np.where(refused, self._refused_s[:, :3] + GNSS_PERIOD_S, 0.0)
        agrees = there & ~refused.any(axis=1)
        ekf.correct(agrees, fix, H_GNSS, noise)
        self._unaided_s[agrees] = 0.0
        for i in np.flatnonzero(there & ~agrees).tolist():
            if (self._refused_s[i, :3] >= GATE_TIMEOUT_S).any():
                self._reset_to_fix(i, fix[i])
                self._refused_s[i, :3] = self._unaided_s[i] = 0.0
            else:
                rows = np.flatnonzero(~refused[i, _GROUP_OF_FIX])
                if rows.size:
                    me = np.arange(len(fix)) == i
                    ekf.correct(me, fix[:, rows], H_GNSS[rows], noise[np.ix_(rows, rows)])

    def _reset_to_fix(self, row: int, fix: Array) -> None:
        """Set position and velocity to a fix. Their error is then that of the fix, with opposite sign."""
        mean, p = self.ekf.means[row], np.array(self.ekf.P[row])
        mean[POSITION], mean[VELOCITY] = fix[:3] - mean[GNSS_ERROR], fix[3:]
        p[VELOCITY], p[:, VELOCITY] = 0.0, 0.0
        p[POSITION] = -p[GNSS_ERROR]
        p[:, POSITION] = -p[:, GNSS_ERROR]
        p[:6, :6] += self._model.gnss
        self.ekf.P[row] = p

    def _take_number(
        self, group: int, measured: Array, h: Array, noise: Array, residual: Residual = np.subtract
    ) -> None:
        """Update each filter with its measurement (V,), if that passes the gate."""
        ekf, value = self.ekf, measured[:, None]
        sigma = np.sqrt(ekf.spread(h) + noise[0])
        off = np.abs(residual(value, ekf.means.dot(h.T))) / (GATE_SIGMA * sigma)
        self._ratio[:, group] = np.where(self.aligned, off[:, 0], self._ratio[:, group])
        ekf.correct(self.aligned & (off[:, 0] <= 1.0), value, h, noise, residual)

    def _align(self, baro: Array, compass: Array | None, gnss: Array | None) -> None:
        """Start the filters that have stood still with a fix for ALIGN_S."""
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
            self.ekf.P[i] = self._model.aligned(ALIGN_S)
        self.aligned = self.aligned | begin


def _heading_residual(measured: Array, expected: Array) -> Array:
    off = measured - expected
    return np.asarray(off - 2.0 * np.pi * np.rint(off / (2.0 * np.pi)))


def wrapped(angle_rad: Array) -> Array:
    """Return the angles in [-π, π)."""
    return np.asarray(np.remainder(angle_rad + np.pi, 2.0 * np.pi) - np.pi)


class InitialAlignment:
    """The means of the measurements on the pad, from which a filter starts.

    Running sums over the samples of V vehicles; `fixes` (V,) counts GNSS fixes.
    """

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
