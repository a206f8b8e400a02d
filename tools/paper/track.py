"""A leader's flight from t = 0 to its arrival on a fine grid: the angles, radii and roughness of the sentences."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

import gcs
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Report
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.values.si import torque_limits
from gcs.types import Array

Mask = NDArray[np.bool_]
STEP_S = 0.05
ENDS_S = 15.0  # both simulations prescribe attitudes and a stop at their ends, which say nothing of the flight between
_LEVEL_M, _AROUND_M, _AROUND_STEP_M = 1.0, 40.0, 2.0


class Track:
    """Arrays over the mission's instants t_s (N,), the arrival included."""

    def __init__(self, plan: Plan) -> None:
        self.plan, self.end_s = plan, plan.flight_s
        self.t_s = np.append(np.arange(0.0, self.end_s, STEP_S), np.nextafter(self.end_s, 0.0))
        self.all_states, self.all_controls = plan.motion(self.t_s)  # (V, N, 12), (V, N, 4)
        self.states, self.controls = self.all_states[plan.leader], self.all_controls[plan.leader]
        self.places_ned_m = self.all_states[..., POSITION]  # (V, N, 3)
        self.height_m = -self.states[:, 2]
        self.velocity_ned_mps = self.states[:, VELOCITY]
        self.acceleration_ned_mps2 = plan.accelerations(self.t_s)[plan.leader]
        self.roll_deg, self.pitch_deg, self.yaw_deg = np.degrees(self.states[:, 6:9]).T
        self.course_deg = np.degrees(np.unwrap(np.arctan2(self.states[:, 4], self.states[:, 3])))
        self.speed_mps = np.linalg.norm(self.velocity_ned_mps, axis=1)
        self.cruise: Mask = (self.t_s > ENDS_S) & (self.t_s < self.end_s - ENDS_S)
        self.v_cruise, self.u_cruise = self.velocity_ned_mps[self.cruise], self.controls[self.cruise]
        self.limits, self.terrain = plan.scenario.limits, plan.scenario.terrain
        self.torque = np.array(torque_limits(self.limits, plan.quadrotor.arm_m))  # (3,) N, N, N m
        self.ground_m = ground_height_m(self.terrain, *np.moveaxis(self.places_ned_m[..., :2], -1, 0))  # (V, N)
        self.clearance_m = -self.places_ned_m[..., 2] - self.ground_m  # (V, N)

    @cached_property
    def report(self) -> Report:
        """The verifier's."""
        return gcs.verify(self.plan)

    def last(self, first_s: float, last_s: float = 0.0) -> Mask:
        """Mask from `first_s` to `last_s` before the arrival."""
        to_go = self.end_s - self.t_s
        return (to_go <= first_s) & (to_go >= last_s)

    def at_to_go(self, values: Array, seconds: float) -> float:
        """A value so long before the arrival."""
        return float(np.interp(self.end_s - seconds, self.t_s, values))

    @property
    def longer(self) -> float:
        """The way's length over the distance of its ends."""
        way = self.states[:, POSITION]
        return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum() / np.linalg.norm(way[-1] - way[0]))

    def aside_m(self, part: Mask | None = None) -> float:
        """How far the way, or a part, is from the straight line between its ends, seen from above."""
        places = self.states[:, :2] if part is None else self.states[part, :2]
        way = places[-1] - places[0]
        return float(np.abs((places - places[0]) @ np.array([-way[1], way[0]])).max() / np.linalg.norm(way))

    @cached_property
    def load_factor(self) -> Array:
        """Horizontal normal acceleration in units of g (N,)."""
        v, a = self.velocity_ned_mps, self.acceleration_ned_mps2
        normal = np.abs(v[:, 0] * a[:, 1] - v[:, 1] * a[:, 0]) / np.maximum(np.hypot(v[:, 0], v[:, 1]), 0.1)
        return np.asarray(normal / self.plan.quadrotor.gravity_mps2)

    @cached_property
    def level(self) -> tuple[float, float]:
        """The height, m, near which it stays longest without a break, and how long, s."""
        best = (0.0, 0.0)
        for height in np.arange(0.0, self.height_m.max() + _LEVEL_M, 0.25 * _LEVEL_M):
            edges = np.flatnonzero(np.diff(np.abs(self.height_m - height) <= _LEVEL_M, prepend=False, append=False))
            longest = float((edges[1::2] - edges[::2]).max(initial=0)) * STEP_S
            best = max(best, (height, longest), key=lambda found: found[1])
        return float(best[0]), best[1]

    @cached_property
    def mountain_aside_m(self) -> float:
        """Least horizontal distance between any vehicle and ground as high as it flies, as far as is looked."""
        around = np.arange(-_AROUND_M, _AROUND_M + 1.0, _AROUND_STEP_M)
        north, east = np.meshgrid(around, around, indexing="ij")
        distance, least = np.hypot(north, east), _AROUND_M
        for place in self.places_ned_m[:, :: int(2.0 / STEP_S)].reshape(-1, 3):
            high = ground_height_m(self.terrain, place[0] + north, place[1] + east) >= -place[2]
            least = min(least, float(distance[high].min(initial=_AROUND_M)))
        return least


def turns(values: Array) -> int:
    """How often a curve changes between rising and falling by more than a hundredth of its range."""
    least, count, direction, extreme = 0.01 * float(np.ptp(values)), 0, 0, float(values[0])
    for value in values:
        moved = float(value) - extreme
        if direction == 0:
            if abs(moved) > least:
                direction, extreme = (1 if moved > 0 else -1), float(value)
        elif moved * direction > 0:
            extreme = float(value)
        elif abs(moved) > least:
            direction, extreme, count = -direction, float(value), count + 1
    return count
