"""The error model of the filter: how the errors of dead reckoning grow, and their size at the start.

The error figures are exactly those of `sim_bridge.dynamics.sensors`. Slow errors are states, so no figure is
tuned.

States (19): position, velocity, Euler angles; biases of gyro and accelerometer; slow errors of barometer and of GNSS
position. With R the rotation from body axes and f the specific force in NED, errors grow as

    position' = velocity      velocity' = (∂ R/∂ angles) f angles - R accelerometer bias      angles' = - gyro bias

which is a nilpotent system: its exponential over a period is a polynomial of degree 3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.types import Array
from sim_bridge.dynamics.integrator import Turn
from sim_bridge.dynamics.plant import Mask
from sim_bridge.dynamics.sensors import (
    BARO_PERIOD_S,
    COMPASS_PERIOD_S,
    GNSS_PERIOD_S,
    INERTIAL_PERIOD_S,
    GaussMarkov,
    SensorGrade,
)

UPDATE_PERIOD_S = BARO_PERIOD_S
STATES = 19
POSITION, VELOCITY, ANGLES = slice(0, 3), slice(3, 6), slice(6, 9)
GYRO_BIAS, ACCEL_BIAS, BARO_ERROR, GNSS_ERROR = slice(9, 12), slice(12, 15), 15, slice(16, 19)
YAW, DOWN = 8, 2
HELD = slice(3, 8)  # velocity, roll and pitch: known to be zero in ground contact

H_GNSS = np.eye(6, STATES)
H_GNSS[(0, 1, 2), (16, 17, 18)] = 1.0
H_COMPASS = np.eye(1, STATES, YAW)
H_BARO = np.eye(1, STATES, BARO_ERROR) - np.eye(1, STATES, DOWN)

_HELD_SIGMA = 1e-4


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """Covariances and transitions of one sensor grade, over one UPDATE_PERIOD_S."""

    gnss: Array  # (6, 6)
    compass: Array  # (1, 1)
    baro: Array  # (1, 1)
    flying: Array  # (19, 19) process noise
    standing: Array  # (19, 19)
    fading: Array  # (4, 1) remaining share of the slow errors of barometer and GNSS
    grade: SensorGrade
    _base: Array  # (19, 19) transition in flight, without the parts that depend on attitude
    _at_rest: Array  # (19, 19) transition in ground contact

    @classmethod
    def of(cls, grade: SensorGrade) -> ErrorModel:
        """Return the model of a sensor grade."""
        t = UPDATE_PERIOD_S
        slow = [grade.baro_drift_m, *grade.gnss_drift]
        keep, renewed = np.ones(STATES), np.zeros(STATES)
        keep[BARO_ERROR:] = [drift.steps(t).keep for drift in slow]
        renewed[BARO_ERROR:] = [drift.steps(t).add ** 2 for drift in slow]
        renewed[GYRO_BIAS] = grade.gyro_bias_radps.steps(t).add ** 2
        renewed[ACCEL_BIAS] = grade.accel_bias_mps2.steps(t).add ** 2
        base = np.diag(keep)
        base[POSITION, VELOCITY] = t * np.eye(3)
        base[ANGLES, GYRO_BIAS] = -t * np.eye(3)
        at_rest = np.diag(keep)
        at_rest[HELD] = 0.0
        standing = np.diag(renewed)
        standing[HELD, HELD] = _HELD_SIGMA**2 * np.eye(5)
        flying = np.diag(renewed)
        push, turn = INERTIAL_PERIOD_S * np.square([grade.accel_mps2, grade.gyro_radps])
        flying[POSITION, POSITION] = push * t**3 / 3.0 * np.eye(3)
        flying[POSITION, VELOCITY] = flying[VELOCITY, POSITION] = push * t**2 / 2.0 * np.eye(3)
        flying[VELOCITY, VELOCITY] = push * t * np.eye(3)
        flying[ANGLES, ANGLES] = turn * t * np.eye(3)
        return cls(
            gnss=np.diag(grade.gnss_white**2),
            compass=np.array([[grade.compass_rad**2]]),
            baro=np.array([[grade.baro_m**2]]),
            flying=flying,
            standing=standing,
            fading=keep[BARO_ERROR:, None],
            grade=grade,
            _base=base,
            _at_rest=at_rest,
        )

    def transition(self, turn: Turn, force_ned_mps2: Array, landed: Mask) -> Array:
        """Return the transitions (V, 19, 19) at attitudes `turn` under mean specific forces (3, V)."""
        t = UPDATE_PERIOD_S
        sr, sp, sy, cr, cp, cy = turn
        x, y, z = force_ned_mps2
        vehicles = len(z)
        lean, sway = sp * sr, sp * cr
        out = np.empty((3, 3, vehicles))  # rows of R
        out[0] = cy * cp, cy * lean - sy * cr, cy * sway + sy * sr
        out[1] = sy * cp, sy * lean + cy * cr, sy * sway - cy * sr
        out[2] = -sp, cp * sr, cp * cr
        swing = np.empty((3, 3, vehicles))  # columns: f rotated about the axes of roll, pitch and yaw
        n, e, d = out[:, 0]
        swing[:, 0] = e * z - d * y, d * x - n * z, n * y - e * x
        swing[:, 1] = cy * z, sy * z, -(sy * y + cy * x)
        swing[:2, 2] = -y, x
        swing[2, 2] = 0.0
        rotation, swing = out.transpose(2, 0, 1), swing.transpose(2, 0, 1)
        full = np.empty((vehicles, STATES, STATES))
        full[:] = self._base
        full[:, VELOCITY, ANGLES] = t * swing
        full[:, POSITION, ANGLES] = (t**2 / 2.0) * swing
        full[:, VELOCITY, GYRO_BIAS] = (-(t**2) / 2.0) * swing
        full[:, POSITION, GYRO_BIAS] = (-(t**3) / 6.0) * swing
        full[:, VELOCITY, ACCEL_BIAS] = -t * rotation
        full[:, POSITION, ACCEL_BIAS] = (-(t**2) / 2.0) * rotation
        if landed.any():
            full[landed] = self._at_rest
        return full

    def aligned(self, seconds: float) -> Array:
        """Return the covariance (19, 19) of means over this duration on the pad; slow errors do not average out."""
        g = self.grade
        fixes, samples = seconds / GNSS_PERIOD_S, seconds / INERTIAL_PERIOD_S
        p = np.zeros((STATES, STATES))
        p[HELD, HELD] = _HELD_SIGMA**2 * np.eye(5)
        for axis, drift in enumerate(g.gnss_drift):
            mean, both = _variance_of_mean(drift, seconds), _covariance_of_mean_and_last(drift, seconds)
            p[axis, axis] = mean + g.gnss_white[axis] ** 2 / fixes
            p[axis, 16 + axis] = p[16 + axis, axis] = -both  # a GNSS error goes into the position with opposite sign
            p[16 + axis, 16 + axis] = drift.sigma**2
        p[YAW, YAW] = g.compass_rad**2 * COMPASS_PERIOD_S / seconds
        p[GYRO_BIAS, GYRO_BIAS] = g.gyro_radps**2 / samples * np.eye(3)
        p[ACCEL_BIAS, ACCEL_BIAS] = g.accel_mps2**2 / samples * np.eye(3)
        # The barometer is set to the GNSS height, so both have the same error.
        p[BARO_ERROR] = p[DOWN]
        p[:, BARO_ERROR] = p[:, DOWN]
        p[BARO_ERROR, BARO_ERROR] = p[DOWN, DOWN] + g.baro_m**2 * BARO_PERIOD_S / seconds
        return p


def _variance_of_mean(drift: GaussMarkov, seconds: float) -> float:
    """Return the variance of a Gauss-Markov process averaged over a time that is short against its correlation time."""
    return drift.sigma**2 * (1.0 - seconds / (3.0 * drift.time_s))


def _covariance_of_mean_and_last(drift: GaussMarkov, seconds: float) -> float:
    return drift.sigma**2 * (1.0 - seconds / (2.0 * drift.time_s))
