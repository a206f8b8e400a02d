"""The motion of vehicles as polynomials between instants, which the formats for other planners and shows hold."""

from dataclasses import dataclass

import numpy as np

from gcs.types import Array


@dataclass(frozen=True)
class VehicleCurve:
    """One vehicle's motion in the common local NED frame at the ends of the pieces, from its pad to its landing.

    The time counts from the start of the take-off.
    """

    sysid: int
    t_s: Array  # (N,)
    position_ned_m: Array  # (N, 3)
    velocity_ned_mps: Array  # (N, 3)
    acceleration_ned_mps2: Array  # (N, 3)
    yaw_ned_rad: Array  # (N,), without jumps
    yaw_rate_radps: Array  # (N,)


@dataclass(frozen=True)
class ShowFile:
    """The curves of all vehicles, with the name of the plan."""

    title: str
    plan_hash: str
    curves: tuple[VehicleCurve, ...]


def cubic(length_s: Array, value: Array, rate: Array) -> Array:
    """The coefficients (4, N - 1, ...) of cubics through values and rates (N, ...), the lowest power first."""
    h = length_s.reshape(-1, *[1] * (value.ndim - 1))
    slope = np.diff(value, axis=0) / h
    first, last = rate[:-1], rate[1:]
    return np.stack([value[:-1], first, (3.0 * slope - 2.0 * first - last) / h, (first + last - 2.0 * slope) / h**2])


def quintic(length_s: Array, value: Array, rate: Array, second: Array) -> Array:
    """The coefficients (6, N - 1, ...) of quintics through values, rates and second derivatives (N, ...)."""
    h = length_s.reshape(-1, *[1] * (value.ndim - 1))
    slope = np.diff(value, axis=0) / h
    v0, v1, a0, a1 = rate[:-1], rate[1:], second[:-1], second[1:]
    third = (10.0 * slope - 6.0 * v0 - 4.0 * v1) / h**2 - (3.0 * a0 - a1) / (2.0 * h)
    fourth = (-15.0 * slope + 8.0 * v0 + 7.0 * v1) / h**3 + (3.0 * a0 - 2.0 * a1) / (2.0 * h**2)
    fifth = (6.0 * slope - 3.0 * (v0 + v1)) / h**4 - (a0 - a1) / (2.0 * h**3)
    return np.stack([value[:-1], v0, 0.5 * a0, third, fourth, fifth])
