"""The greatest speed, acceleration and jerk of each vehicle of a plan, every 0.05 s and on both sides of joints."""

from dataclasses import dataclass

import numpy as np

from gcs.physics.quadrotor import derivative
from gcs.physics.states import VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array
from gcs.util.cache import once

_EVERY_S = 0.05
_BLOCK = 20_000  # vehicles times instants at a time


@dataclass(frozen=True)
class GreatestMotion:
    """Of every vehicle of a plan, in the order of its rows: sizes (speeds over ground), and when they are reached."""

    speed_horizontal_mps: Array  # (V,)
    speed_horizontal_t_s: Array  # (V,)
    speed_vertical_mps: Array  # (V,), upwards or downwards
    speed_vertical_t_s: Array  # (V,)
    accel_mps2: Array  # (V,)
    accel_t_s: Array  # (V,)
    jerk_mps3: Array  # (V,)
    jerk_t_s: Array  # (V,)

    def by_vehicle(self, sysids: tuple[int, ...]) -> list[dict[str, float]]:
        """One row for each vehicle: its system id, its greatest speeds, acceleration and jerk, and their times."""
        columns = {
            "speed_horizontal_max_mps": (self.speed_horizontal_mps, 3),
            "speed_horizontal_max_t_s": (self.speed_horizontal_t_s, 2),
            "speed_vertical_max_mps": (self.speed_vertical_mps, 3),
            "speed_vertical_max_t_s": (self.speed_vertical_t_s, 2),
            "accel_max_mps2": (self.accel_mps2, 4),
            "accel_max_t_s": (self.accel_t_s, 2),
            "jerk_max_mps3": (self.jerk_mps3, 4),
            "jerk_max_t_s": (self.jerk_t_s, 2),
        }
        return [
            {"sysid": sysid} | {name: round(float(values[row]), digits) for name, (values, digits) in columns.items()}
            for row, sysid in enumerate(sysids)
        ]


@once
def greatest_motion(plan: Plan) -> GreatestMotion:
    """The greatest of all four, from the ground to the ground."""
    joints = plan.joints_s
    count = int(np.ceil((plan.t_end_s - plan.t_start_s) / _EVERY_S)) + 1
    even = np.linspace(plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf), count)
    t_s = np.unique(np.concatenate([even, joints[:-1], np.nextafter(joints[1:], -np.inf)]))
    vehicles = len(plan.sysids)
    best = np.full((4, vehicles), -1.0)
    when = np.zeros((4, vehicles))
    for part in np.array_split(t_s, max(len(t_s) * vehicles // _BLOCK, 1)):
        states, controls = plan.motion(part)
        velocities = states[..., VELOCITY]
        accelerations = derivative(states, controls, plan.quadrotor)[..., VELOCITY]
        for kind, motion in enumerate((velocities[..., :2], velocities[..., 2:], accelerations, plan.jerks(part))):
            sizes = np.linalg.norm(motion, axis=-1)  # (V, N)
            at = sizes.argmax(axis=1)
            most = sizes[np.arange(vehicles), at]
            when[kind] = np.where(most > best[kind], part[at], when[kind])
            best[kind] = np.maximum(most, best[kind])
    return GreatestMotion(*(values for kind in range(4) for values in (best[kind], when[kind])))
