"""LQR gains from a vehicle's constants and authority, by Bryson's rule; computed once per vehicle type.

No gain is tuned by hand. The weight of each state is one over the error that may use the whole authority reserved for
feedback. A strong vehicle is limited to the bandwidth that a GNSS-aided estimate and steps of 20 ms support.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_continuous_are

from gcs.physics.quadrotor import Quadrotor
from gcs.types import Array

FEEDBACK_SHARE = 0.3  # of each authority; a plan with a control margin of 0.3 leaves as much
POSITION_SCALE_M = 0.1
ANGLE_SCALE_RAD = 0.2
POSITION_BANDWIDTH_MAX_RADPS = 2.0
TILT_BANDWIDTH_MAX_RADPS = 10.0
YAW_BANDWIDTH_MAX_RADPS = 3.0
PUSH_BANDWIDTH_RADPS = 1.0  # that of a gust; a faster observer follows the noise of the estimate
TWIST_BANDWIDTH_RADPS = 20.0  # a failing motor acts at once, and gyro noise is small at this bandwidth
PUSH_MAX_MPS2 = 3.0


@dataclass(frozen=True, slots=True)
class ControlLimits:
    """The largest controls a vehicle uses: U1 (N); |U2|, |U3| (N, on the arm) and |U4| (N m)."""

    thrust_N: float
    torque: tuple[float, float, float]


def motor_limits(q: Quadrotor) -> ControlLimits:
    """Return the controls the rotors can produce: full thrust together, and each torque while they carry the weight."""
    top = q.rotor_max_radps**2
    hover = q.weight_N / (4.0 * q.thrust_coeff_Ns2)
    room = max(min(hover, top - hover), 0.0)
    tilt = 4.0 * float(np.sqrt(0.5)) * q.thrust_coeff_Ns2 * room
    return ControlLimits(4.0 * q.thrust_coeff_Ns2 * top, (tilt, tilt, 4.0 * q.moment_coeff_Nms2 * room))


def chain_gain(links: tuple[float, ...], scales: tuple[float, ...], authority: float) -> Array:
    """Return the LQR gain (n,) of x_1' = link_1 x_2, ..., x_n' = u; cost Σ (x_i / scale_i)² + (u / authority)²."""
    n = len(scales)
    b = np.zeros((n, 1))
    b[-1] = 1.0
    cost = np.diag((authority / np.array(scales)) ** 2)
    return np.asarray(solve_continuous_are(np.diag(links, 1), b, cost, np.eye(1))[-1])


@dataclass(frozen=True, slots=True)
class Gains:
    """State feedback of one vehicle type, to the acceleration (m/s² or rad/s²) at the end of each chain."""

    tilt: Array  # (4,) on distance, speed, angle, angular rate; roll and pitch alike
    height: Array  # (2,) on height, climb
    yaw: Array  # (2,) on angle, rate
    push_radps: Array  # (6,) observer bandwidth of forces along and torques about north, east, down
    push_max: Array  # (6,) the largest of them that are compensated, m/s² and rad/s²


def turn_authority_radps2(q: Quadrotor, limits: ControlLimits) -> Array:
    """Return the largest roll, pitch and yaw accelerations (3,); roll and pitch are both the weaker of the two."""
    turn = np.array(limits.torque) * [q.arm_m, q.arm_m, 1.0] / np.array(q.inertia_kgm2)
    turn[:2] = turn[:2].min()
    return np.asarray(turn)


def lqr_gains(q: Quadrotor, limits: ControlLimits) -> Gains:
    """Return the gains for the share of the authority reserved for feedback."""
    g = q.gravity_mps2
    turn, _, spin = FEEDBACK_SHARE * turn_authority_radps2(q, limits)
    outer = min((g * turn / POSITION_SCALE_M) ** 0.25, POSITION_BANDWIDTH_MAX_RADPS)
    inner = min(max((turn / ANGLE_SCALE_RAD) ** 0.5, outer), TILT_BANDWIDTH_MAX_RADPS)
    angle_scale = turn / inner**2 if inner > outer else np.inf  # a weak vehicle uses all authority for position
    climb = FEEDBACK_SHARE * (limits.thrust_N / q.mass_kg - g)
    height = min((climb / POSITION_SCALE_M) ** 0.5, POSITION_BANDWIDTH_MAX_RADPS)
    yaw = min((spin / ANGLE_SCALE_RAD) ** 0.5, YAW_BANDWIDTH_MAX_RADPS)
    return Gains(
        tilt=chain_gain((1.0, g, 1.0), (g * turn / (outer * inner) ** 2, np.inf, angle_scale, np.inf), turn),
        height=chain_gain((1.0,), (climb / height**2, climb / height), climb),
        yaw=chain_gain((1.0,), (spin / yaw**2, spin / yaw), spin),
        push_radps=np.array([PUSH_BANDWIDTH_RADPS] * 3 + [TWIST_BANDWIDTH_RADPS] * 3),
        push_max=np.concatenate([[PUSH_MAX_MPS2] * 3, turn_authority_radps2(q, motor_limits(q))]),
    )
