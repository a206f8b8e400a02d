"""Two vehicles, and a smooth flight through everything a formation does: up, hover, run, turn, climb, stop, down."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gcs.physics.quadrotor import Quadrotor
from gcs.types import Array
from sim_bridge.dynamics import presets
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S, Airframes, Craft
from sim_bridge.dynamics.lqr_gains import ControlLimits
from sim_bridge.dynamics.sensors import SensorGrade
from sim_bridge.dynamics.wind_field import CALM, Wind

# Turns its roll rate by at most 0.17 rad/s², lifts 1.06 times its weight.
F150, F150_LIMITS = presets.F150.quadrotor, presets.F150.limits
# Lifts twice its weight and turns as such vehicles do.
FIELD, FIELD_LIMITS = presets.FIELD.quadrotor, presets.FIELD.limits

# Places of Simulation 1: the second and the fifth are 0.5 m apart.
PADS_NED_M = np.array(
    [[2.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [1.0, 0.5, 0.0], [0.0, 0.5, 0.0], [1.0, 1.5, 0.0]]
)
YAW_RAD = np.pi / 4


def flat_ground(north_m: Array, _: Array) -> Array:
    return np.zeros_like(north_m)


def reference_of(p: Array, v: Array, a: Array, j: Array, s: Array, yaw: Array, yaw_rate: Array) -> Array:
    """A reference (V, 5, 4) of position to snap, each (V, 3), and yaw and its rate, each (V,)."""
    flat = np.zeros((len(p), 5, 4))
    flat[:, :, :3] = np.stack((p, v, a, j, s), axis=1)
    flat[:, 0, 3], flat[:, 1, 3] = yaw, yaw_rate
    return flat


def hold(position_ned_m: Array, yaw_ned_rad: Array) -> Array:
    """The reference of a hover at positions (V, 3) with yaw (V,)."""
    still = np.zeros_like(position_ned_m)
    return reference_of(position_ned_m, still, still, still, still, yaw_ned_rad, np.zeros_like(yaw_ned_rad))


def _step_up(t_s: Array, start_s: float, duration_s: float) -> Array:
    """From 0 to 1 with four continuous derivatives."""
    s = np.clip((t_s - start_s) / duration_s, 0.0, 1.0)
    return np.asarray(s**5 * (126.0 - 420.0 * s + 540.0 * s**2 - 315.0 * s**3 + 70.0 * s**4))


def steps(seconds: float) -> int:
    """Control steps in so many seconds."""
    return round(seconds / CONTROL_PERIOD_S)


@dataclass(frozen=True)
class Course:
    """Flat outputs of the first vehicle relative to its pad, one row per control step."""

    t_s: Array
    derivatives: tuple[Array, ...]  # position to snap, each (N, 3)
    yaw_rad: Array
    yaw_rate_radps: Array

    def part(self, start_s: float, stop_s: float) -> Course:
        """The same course from one time to another."""
        cut = slice(steps(start_s), steps(stop_s))
        derivatives = tuple(d[cut] for d in self.derivatives)
        return Course(self.t_s[cut], derivatives, self.yaw_rad[cut], self.yaw_rate_radps[cut])

    def at(self, k: int, pads_ned_m: Array) -> Array:
        vehicles = len(pads_ned_m)
        p, v, a, j, s = (np.tile(d[k], (vehicles, 1)) for d in self.derivatives)
        yaw = np.full(vehicles, self.yaw_rad[k])
        return reference_of(pads_ned_m + p, v, a, j, s, yaw, np.full(vehicles, self.yaw_rate_radps[k]))


@lru_cache
def course(*, yaw_swing_rad: float) -> Course:
    """Up 3 m; to 5.6 m/s in 30 s; an S at a load factor of 0.1, climbing at 1 m/s; stop; down to below the pad."""
    fine_s = CONTROL_PERIOD_S / 10.0
    t = np.arange(0.0, 125.0, fine_s)
    height = 3.0 * _step_up(t, 1.0, 12.0) + 12.0 * _step_up(t, 45.0, 30.0) - 15.1 * _step_up(t, 100.0, 23.0)
    speed = 5.6 * (_step_up(t, 14.0, 30.0) - _step_up(t, 70.0, 28.0))
    heading = YAW_RAD + 0.9 * _step_up(t, 42.0, 13.0) - 0.9 * _step_up(t, 55.0, 13.0)
    velocity = np.stack([speed * np.cos(heading), speed * np.sin(heading), -np.gradient(height, fine_s)], axis=-1)
    derivatives = [np.cumsum(velocity, axis=0) * fine_s, velocity]
    for _ in range(3):
        derivatives.append(np.gradient(derivatives[-1], fine_s, axis=0))
    yaw = YAW_RAD + yaw_swing_rad * np.sin(0.1 * t) * _step_up(t, 10.0, 10.0)
    p, v, a, j, s = (d[::10] for d in derivatives)
    return Course(t[::10], (p, v, a, j, s), yaw[::10], np.gradient(yaw, fine_s)[::10])


@dataclass(frozen=True)
class Flight:
    """What was recorded; N control steps."""

    airframes: Airframes
    truth: Array  # (N, V, 12)
    estimate: Array  # (N, V, 12)
    wanted_ned_m: Array  # (N, V, 3)
    control: Array  # (N, V, 4)


def stand(
    q: Quadrotor, limits: ControlLimits | None, grade: SensorGrade, pads: Array, seed: int, wind: Wind = CALM
) -> Airframes:
    """Vehicles on their pads with aligned filters."""
    yaw = np.full(len(pads), YAW_RAD)
    airframes = Airframes(Craft(q, limits), flat_ground, pads, yaw, grade, seed=seed, wind=wind)
    while not airframes.healthy.all():
        airframes.step(hold(pads, yaw), np.zeros(len(pads), dtype=bool))
    return airframes


def fly(airframes: Airframes, flown: Course, pads: Array) -> Flight:
    motors_on = np.ones(len(pads), dtype=bool)
    truth, estimate, wanted, control = [], [], [], []
    for k in range(len(flown.t_s)):
        reference = flown.at(k, pads)
        truth.append(airframes.truth.copy())
        estimate.append(airframes.estimate.copy())
        wanted.append(reference[:, 0, :3])
        airframes.step(reference, motors_on)
        control.append(airframes.control)
    return Flight(airframes, np.array(truth), np.array(estimate), np.array(wanted), np.array(control))
