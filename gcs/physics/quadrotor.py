"""Eqs. 1 and 2: the rigid quadrotor, written once for the optimiser, the verification and the emulated vehicles.

The equations are plain arithmetic on components. `xp` supplies sin and cos, so that NumPy arrays of any batch shape
and CasADi symbols use the same lines.

State `(..., 12)`:   position_ned_m (3), velocity_ned_mps (3), roll, pitch, yaw (rad), their rates (rad/s).
Control `(..., 4)`:  U1 thrust (N); U2, U3 roll and pitch rotor force differences (N, acting on arm l);
                     U4 yaw moment (N m).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.physics.wind import STILL, SteadyWind
from gcs.types import Array, Maths, Scalar

_HALF_SQRT2 = np.sqrt(0.5)
# Eq. 2: rows U1/K_T, U2/K_T, U3/K_T, U4/K_M; columns the squared rotor speeds 1..4.
_MIXER = np.array(
    [
        [1.0, 1.0, 1.0, 1.0],
        [_HALF_SQRT2, -_HALF_SQRT2, -_HALF_SQRT2, _HALF_SQRT2],
        [_HALF_SQRT2, _HALF_SQRT2, -_HALF_SQRT2, -_HALF_SQRT2],
        [1.0, -1.0, 1.0, -1.0],
    ]
)
_UNMIXER = np.linalg.inv(_MIXER)
_ROUNDING = 1e-9  # rounding tolerance of a reachable control, as a share of the squared maximum speed
AIR_DENSITY_KGPM3 = 1.225  # at sea level, 15 degrees C
_LAPSE_PM, _EXPONENT = 2.25577e-5, 4.25588


@dataclass(frozen=True)
class Quadrotor:
    """The physical constants of one vehicle type (Table 1 of the paper)."""

    mass_kg: float
    arm_m: float
    inertia_kgm2: tuple[float, float, float]
    thrust_coeff_Ns2: float  # K_T
    moment_coeff_Nms2: float  # K_M
    drag_Nspm: tuple[float, float, float]  # K_1..K_3, linear
    drag_moment_Nms: tuple[float, float, float]  # K_4..K_6, linear
    rotor_max_radps: float
    gravity_mps2: float = 9.8
    wind: SteadyWind = STILL  # the planned wind; a caller that knows the present wind passes that instead

    @property
    def weight_N(self) -> float:
        """The thrust that balances gravity, N."""
        return self.mass_kg * self.gravity_mps2


def equations_of_motion(
    x: Sequence[Scalar], u: Sequence[Scalar], q: Quadrotor, wind_ned_mps: Sequence[Scalar] | None = None, xp: Maths = np
) -> tuple[Scalar, ...]:
    """Return the time derivatives of the twelve state components (Eq. 1). Drag opposes the air-relative velocity.

    `wind_ned_mps` None means the planned wind `q.wind`.
    """
    _, _, down, vx, vy, vz, roll, pitch, yaw, p, qq, r = x
    u1, u2, u3, u4 = u
    sr, sp, sy = xp.sin(roll), xp.sin(pitch), xp.sin(yaw)
    cr, cp, cy = xp.cos(roll), xp.cos(pitch), xp.cos(yaw)
    m, arm = q.mass_kg, q.arm_m
    ix, iy, iz = q.inertia_kgm2
    k1, k2, k3 = q.drag_Nspm
    k4, k5, k6 = q.drag_moment_Nms
    wx, wy, wz = q.wind.at(-down, xp) if wind_ned_mps is None else wind_ned_mps
    thrust = u1 / m
    return (
        vx,
        vy,
        vz,
        -(cy * sp * cr + sy * sr) * thrust - k1 / m * (vx - wx),
        -(sy * sp * cr - cy * sr) * thrust - k2 / m * (vy - wy),
        -(cp * cr) * thrust + q.gravity_mps2 - k3 / m * (vz - wz),
        p,
        qq,
        r,
        (arm * u2 + qq * r * (iy - iz) - k4 * p) / ix,
        (arm * u3 + p * r * (iz - ix) - k5 * qq) / iy,
        (u4 + qq * p * (ix - iy) - k6 * r) / iz,
    )


def derivative(state: Array, control: Array, q: Quadrotor, wind_ned_mps: Array | None = None) -> Array:
    """Return Eq. 1 on arrays (..., 12), from state (..., 12), control (..., 4), wind (..., 3; None: planned wind)."""
    wind = None if wind_ned_mps is None else tuple(np.moveaxis(wind_ned_mps, -1, 0))
    parts = equations_of_motion(tuple(np.moveaxis(state, -1, 0)), tuple(np.moveaxis(control, -1, 0)), q, wind)
    out = np.empty((*np.broadcast_shapes(state.shape[:-1], control.shape[:-1]), 12))
    for i, part in enumerate(parts):
        out[..., i] = part
    return out


def control_from_rotors(rotor_radps: Array, q: Quadrotor) -> Array:
    """Return controls (..., 4) of rotor speeds (..., 4) in rad/s (Eq. 2)."""
    k = np.array([q.thrust_coeff_Ns2] * 3 + [q.moment_coeff_Nms2])
    return np.asarray(np.square(rotor_radps) @ _MIXER.T * k)


def squared_rotor_speeds(control: Sequence[Scalar], q: Quadrotor) -> tuple[Scalar, ...]:
    """Return the four squared rotor speeds, (rad/s)^2, that Eq. 2 requires for control components; no motor limits."""
    k = (q.thrust_coeff_Ns2, q.thrust_coeff_Ns2, q.thrust_coeff_Ns2, q.moment_coeff_Nms2)
    wanted = [u * (1.0 / size) for u, size in zip(control, k, strict=True)]
    first, second, third, fourth = wanted
    return tuple(
        first * float(row[0]) + second * float(row[1]) + third * float(row[2]) + fourth * float(row[3])
        for row in _UNMIXER
    )


def rotors_from_control(control: Array, q: Quadrotor) -> Array:
    """Return rotor speeds (..., 4) in [0, rotor_max_radps] of controls (..., 4): Eq. 2 inverted, with motor limits.

    Reachable controls are met exactly. If a motor saturates, yaw is reduced first, then roll and pitch together, and
    thrust last: a vehicle that keeps its height but not its heading still keeps the formation.
    """
    k = np.array([q.thrust_coeff_Ns2] * 3 + [q.moment_coeff_Nms2])
    wanted = control / k
    top = q.rotor_max_radps**2
    squared = wanted @ _UNMIXER.T
    reachable = np.all((squared >= -_ROUNDING * top) & (squared <= (1.0 + _ROUNDING) * top), axis=-1, keepdims=True)
    if not reachable.all():
        squared = np.where(reachable, squared, _nearest_by_rank(wanted, top))
    return np.asarray(np.sqrt(np.clip(squared, 0.0, top)))


def _nearest_by_rank(wanted: Array, top: float) -> Array:
    """Squared rotor speeds (..., 4) that meet thrust, then roll and pitch, then yaw, as far as the limits allow."""
    base = np.clip(wanted[..., :1] * 0.25, 0.0, top) * np.ones(4)
    tilt = wanted[..., 1:3] @ _UNMIXER[:, 1:3].T
    tilted = base + tilt * _room(base, tilt, top)
    turn = wanted[..., 3:] @ _UNMIXER[:, 3:].T
    return np.asarray(tilted + turn * _room(tilted, turn, top))


def _room(base: Array, step: Array, top: float) -> Array:
    """The largest share (..., 1) in [0, 1] of `step` that keeps base + share * step within [0, top]."""
    limit = np.where(step > 0, top - base, base)
    size = np.maximum(np.abs(step), 1e-300)
    return np.asarray(np.clip(np.min(limit / size, axis=-1, keepdims=True), 0.0, 1.0))


def thrust_and_tilt(
    acceleration_ned_mps2: Array, air_velocity_ned_mps: Array, yaw_ned_rad: Array, q: Quadrotor
) -> tuple[Array, Array, Array]:
    """Return (thrust_N, roll_rad, pitch_rad), each (...): the translation of Eq. 1 solved for the control."""
    drag = np.array(q.drag_Nspm) * air_velocity_ned_mps
    force = q.mass_kg * (np.array([0.0, 0.0, q.gravity_mps2]) - acceleration_ned_mps2) - drag
    fx, fy, fz = np.moveaxis(force, -1, 0)
    sy, cy = np.sin(yaw_ned_rad), np.cos(yaw_ned_rad)
    thrust = np.sqrt(fx * fx + fy * fy + fz * fz)
    roll = np.arcsin(np.clip((sy * fx - cy * fy) / np.maximum(thrust, 1e-9), -1.0, 1.0))
    pitch = np.arctan2(cy * fx + sy * fy, fz)
    return thrust, roll, pitch


def hover_trim(height_m: float, yaw_ned_rad: float, q: Quadrotor) -> tuple[float, float, float]:
    """Return thrust (N), roll and pitch (rad) that hold position in the planned wind, at a height above height 0."""
    still = -np.array(q.wind.at(height_m))
    thrust, roll, pitch = thrust_and_tilt(np.zeros(3), still, np.asarray(yaw_ned_rad), q)
    return float(thrust), float(roll), float(pitch)


def level_flight_thrust_N(state: Array, q: Quadrotor) -> float:
    """The thrust (N) at which a state (12,) has no vertical acceleration."""
    return float((q.weight_N - q.drag_Nspm[2] * state[5]) / (np.cos(state[6]) * np.cos(state[7])))


def air_density_kgpm3(alt_amsl_m: Array | float) -> Array:
    """The air density (...) at altitudes AMSL (...), kg/m^3: standard atmosphere (ISO 2533) up to 11 km."""
    return np.asarray(AIR_DENSITY_KGPM3 * (1.0 - _LAPSE_PM * np.asarray(alt_amsl_m)) ** _EXPONENT)


def induced_power_W(
    thrust_N: Array | float, radius_m: float, density_kgpm3: Array | float = AIR_DENSITY_KGPM3
) -> Array:
    """The ideal power (...) of one rotor with thrust (...) N, W: T v = T^(3/2) / sqrt(2 rho A), by momentum theory.

    Inflow from climb and forward flight is neglected: below 6 m/s it changes less than the uncertainty of the figure
    of merit, by which propeller, motor and speed controller together divide it.
    """
    return np.asarray(np.asarray(thrust_N) ** 1.5 / np.sqrt(2.0 * np.asarray(density_kgpm3) * np.pi * radius_m**2))


def drawn_power_W(
    control: Array,
    q: Quadrotor,
    radius_m: float,
    figure_of_merit: float,
    density_kgpm3: Array | float = AIR_DENSITY_KGPM3,
) -> Array:
    """The power (...) that the four rotors of Eq. 2 draw together at controls (..., 4), W."""
    thrust_N = q.thrust_coeff_Ns2 * np.square(rotors_from_control(control, q))  # (..., 4)
    density = np.broadcast_to(density_kgpm3, thrust_N.shape[:-1])[..., None]
    return np.asarray(np.sum(induced_power_W(thrust_N, radius_m, density), axis=-1) / figure_of_merit)
