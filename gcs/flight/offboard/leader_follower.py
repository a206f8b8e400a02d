"""Leader-following setpoints: the leader's reported state plus the formation's offsets (Eq. 22).

The planned position plus the leader's deviation from the plan equals the leader's position plus the offset. So a
follower's setpoint is the planned one moved by the leader's deviation. The deviation is predicted from the stamp of the
report to the time of the setpoint. A damped filter with bounded acceleration (`accel_bound_mps2`) smooths it: followers
go with a leader that the wind moves, not with noise or jumps of its position.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.flight.monitor import VehicleView
from gcs.flight.offboard.reference_trajectory import PlanReference, Values
from gcs.physics.quadrotor import POSITION, VELOCITY, Array
from gcs.plan.formation.changes.time_scaling import budget
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario

BANDWIDTH_RADPS = 0.5
SOFT_S = 0.3  # acceleration passes two lags of this: vehicles tilt for it, and some tilt slowly
IGNORED_M = 0.1  # estimates drift by this much: following that would shake the formation
REPORT_MAX_S = 1.0  # the velocity of an older report is not used
_STEP_S = 0.02


def accel_bound_mps2(scenario: Scenario) -> float:
    """The limit on acceleration added by following: that of a change of formation, or more if the vehicle is able.

    The larger limit is half of what the plan's turns may take (n_max of Eq. 17), within the jerk and snap that rates
    and torques allow a change of formation. A step through both lags has a jerk of 1 / (e SOFT_S) and a snap of
    1 / SOFT_S^2 of its size.
    """
    most = budget(scenario)
    turns_mps2 = 0.5 * scenario.limits.load_factor_max * scenario.vehicle.gravity_mps2
    return max(most.accel_mps2, min(turns_mps2, most.jerk_mps3 * math.e * SOFT_S, most.snap_mps4 * SOFT_S**2))


class LeaderDeviation:
    """The smoothed deviation of the leader from the plan, at rising plan times. `lead` may change the leader."""

    def __init__(self, plan: Plan, t0_unix_s: float) -> None:
        self._plan = plan
        self._t0_unix_s = t0_unix_s
        self._view: VehicleView | None = None
        self._row = 0
        self._reported_s = math.nan
        self._off, self._rate = np.zeros(3), np.zeros(3)  # as reported, not smoothed
        self.position_m, self.velocity_mps, self.acceleration_mps2 = np.zeros(3), np.zeros(3), np.zeros(3)
        self._soft = np.zeros(3)
        self._accel_mps2 = accel_bound_mps2(plan.scenario)
        self._t_s = math.nan

    def lead(self, view: VehicleView) -> None:
        """Make this vehicle the leader."""
        self._view, self._row, self._reported_s = view, self._plan.sysids.index(view.sysid), math.nan

    def advance(self, t_s: float) -> None:
        """Bring position, velocity and acceleration of the deviation to plan time `t_s`."""
        off, rate = self._reported(t_s)
        if math.isnan(self._t_s):
            self._t_s = t_s
        while self._t_s < t_s - 1e-9:
            step_s = min(_STEP_S, t_s - self._t_s)
            w = BANDWIDTH_RADPS
            pull = w * w * (off - self.position_m) + 2.0 * w * (rate - self.velocity_mps)
            size = float(np.linalg.norm(pull))
            wanted = pull * min(1.0, self._accel_mps2 / size) if size else pull
            share = -math.expm1(-step_s / SOFT_S)
            self._soft = self._soft + share * (wanted - self._soft)
            self.acceleration_mps2 = self.acceleration_mps2 + share * (self._soft - self.acceleration_mps2)
            self.position_m = self.position_m + self.velocity_mps * step_s + self.acceleration_mps2 * step_s**2 / 2
            self.velocity_mps = self.velocity_mps + self.acceleration_mps2 * step_s
            self._t_s += step_s

    def _reported(self, t_s: float) -> tuple[Array, Array]:
        """The deviation of the last report, predicted for `t_s`."""
        view = self._view
        if view is None or math.isnan(view.unix_s):
            return np.zeros(3), np.zeros(3)
        if view.unix_s != self._reported_s:
            self._reported_s = view.unix_s
            plan, seen_s = self._plan, view.unix_s - self._t0_unix_s
            at = np.clip(np.array([seen_s]), plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf))
            planned = plan.leader_trajectory.state(at)[0]
            self._off = view.position_ned_m - planned[POSITION] - plan.shape.offsets(at)[self._row, 0]
            self._rate = view.velocity_ned_mps - planned[VELOCITY] - plan.shape.offsets(at, 1)[self._row, 0]
        size = float(np.linalg.norm(self._off))
        if size <= IGNORED_M:
            return np.zeros(3), np.zeros(3)
        share = 1.0 - IGNORED_M / size
        age_s = max(t_s - (view.unix_s - self._t0_unix_s), 0.0)
        if age_s > REPORT_MAX_S:
            return share * self._off, np.zeros(3)
        return share * (self._off + self._rate * age_s), share * self._rate


class FollowReference:
    """One follower's planned setpoints, moved by the leader's deviation."""

    def __init__(self, base: PlanReference, leader: LeaderDeviation, last: int) -> None:
        self._base = base
        self._leader = leader
        self._last = last

    def at(self, k: int, t_s: float) -> Values:
        """Return the planned setpoint plus the leader's deviation; at rest from the plan's last one on."""
        values = self._base.at(k, t_s)
        self._leader.advance(t_s)
        off = self._leader.position_m
        place = (values[0] + float(off[0]), values[1] + float(off[1]), values[2] + float(off[2]))
        if k >= self._last:
            return (*place, *values[3:])
        motion = np.array(values[3:9])
        motion[:3] += self._leader.velocity_mps
        motion[3:] += self._leader.acceleration_mps2
        return (*place, *motion.tolist(), values[9])
