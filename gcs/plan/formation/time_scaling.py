"""The time scaling of a change: one smooth step for all vehicles, its budget, and the shortest duration within it."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

from gcs.plan.formation.shape import Shape
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import torque_limits
from gcs.types import Array

# Share of a vehicle's turning authority: the leader's own motion, which every vehicle flies too, uses the rest.
SHARE = 0.2
JERK_SHARE = 0.3  # of the limit on jerk
VERTICAL_SHARE = 0.9  # of the limit on vertical speed: the leader's own climb needs the rest
LIMITS = ("speed", "acceleration", "turn rate", "torque", "vertical speed")
NOTHING = "nothing"
_STILL_M = 1e-9  # rounding, not motion
_GRID = 401  # samples for a peak: they miss at most 2e-4 of it, even in a third of the time
_CHUNK = 256  # vehicles at a time


@dataclass(frozen=True)
class Budget:
    """The largest motion of any vehicle in a change, in addition to the leader's own."""

    speed_mps: float
    accel_mps2: float
    jerk_mps3: float
    snap_mps4: float
    vertical_mps: float = np.inf  # a part of speed_mps


def smooth_step() -> PPoly:
    """The septic from 0 to 1 over [0, 1], at rest at both ends up to the third derivative.

    Thrust tilts with acceleration, so attitude rates follow jerk and torques follow snap. A quintic is at rest up to
    its second derivative alone: its jerk jumps, attitude rates would have to jump with it, and no control of Eq. 1
    does that.
    """
    return PPoly(np.array([-20.0, 70.0, -84.0, 35.0, 0.0, 0.0, 0.0, 0.0])[:, None], np.array([0.0, 1.0]))


def budget(scenario: Scenario) -> Budget:
    """The budget: speed and acceleration from the scenario, jerk and snap from rate and torque limits.

    A hovering vehicle accelerates by g times its tilt: its jerk is g times the attitude rate, its snap g times the
    angular acceleration.
    """
    limits, vehicle = scenario.limits, scenario.vehicle
    torque = torque_limits(limits, vehicle.arm_m)
    rate_radps = np.radians(min(limits.rates_degps[:2]))
    angular_radps2 = min(
        vehicle.arm_m * force / inertia for force, inertia in zip(torque[:2], vehicle.inertia_kgm2[:2], strict=True)
    )
    jerk_mps3 = float(SHARE * vehicle.gravity_mps2 * rate_radps)
    if limits.jerk_max_mps3 is not None:
        jerk_mps3 = min(jerk_mps3, JERK_SHARE * limits.jerk_max_mps3)
    return Budget(
        speed_mps=scenario.formation.change_speed_mps,
        accel_mps2=scenario.formation.change_accel_mps2,
        jerk_mps3=jerk_mps3,
        snap_mps4=SHARE * vehicle.gravity_mps2 * angular_radps2,
        vertical_mps=VERTICAL_SHARE * limits.speed_ned_mps[2],
    )


def shared(limit: Budget, parts: int, radius_m: float) -> Budget:
    """The budget of each of several simultaneous motions in a shape of this radius, rotations among them.

    A motion carried along by another accelerates by twice the product of both rates. Their common speed is such that
    this takes at most half of the acceleration; the rest is for speeding up.
    """
    together_mps = min(limit.speed_mps, float(np.sqrt(0.5 * limit.accel_mps2 * radius_m)))
    left_mps2 = limit.accel_mps2 - together_mps**2 / max(radius_m, _STILL_M)
    return Budget(
        together_mps / parts,
        left_mps2 / parts,
        0.5 * limit.jerk_mps3 / parts,
        0.5 * limit.snap_mps4 / parts,
        limit.vertical_mps / parts,
    )


def least_duration(unit_shape: Shape, budget: Budget) -> tuple[float, str]:
    """The shortest duration, s, in which a shape on [0, 1] keeps the budget, and the limit that sets it.

    The n-th derivative of O(t / T) is T^-n times that of O, so each limit requires T >= (peak_n / limit_n)^(1/n).
    0 s and "nothing" where nothing moves.
    """
    peaks = peak_derivatives(unit_shape)
    if peaks[0] < _STILL_M:
        return 0.0, NOTHING
    limits = np.array([budget.speed_mps, budget.accel_mps2, budget.jerk_mps3, budget.snap_mps4])
    upright = Shape(unit_shape.functions, unit_shape.basis_ned_m * [0.0, 0.0, 1.0])
    needed = np.append(
        (peaks / limits) ** (1.0 / np.arange(1, 5)), peak_derivatives(upright, orders=1)[0] / budget.vertical_mps
    )
    worst = int(needed.argmax())
    return float(needed[worst]), LIMITS[worst]


def peak_derivatives(shape: Shape, orders: int = 4) -> Array:
    """Largest |derivative| of any vehicle's offset at any time, orders 1 to `orders` (orders,), m/s to m/s^4."""
    joints = shape.joints_s
    # A snap may jump at a joint: both sides count.
    left = np.nextafter(joints[1:], joints[0])
    t_s = np.unique(np.concatenate([np.linspace(joints[0], joints[-1], _GRID), joints, left]))
    peaks = np.zeros(orders)
    for order in range(1, orders + 1):
        functions = shape.functions(t_s, nu=order)  # (N, K)
        for first in range(0, shape.basis_ned_m.shape[1], _CHUNK):
            values = np.tensordot(functions, shape.basis_ned_m[:, first : first + _CHUNK], axes=1)  # (N, chunk, 3)
            peaks[order - 1] = max(peaks[order - 1], np.einsum("nvi,nvi->nv", values, values).max())
    return np.sqrt(peaks)
