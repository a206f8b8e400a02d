"""Followers fly where their leader is, not where it should be: its telemetered state plus the formation's offsets.

Knows: the leader's last report, the plan, smoothing. Does not know: links, who leads (it is told).

A place beside the leader, plus what the leader is off its plan, is the leader's own place plus the offset; so a
follower's setpoint is the planned one moved by the leader's deviation. That is predicted over the time from the
report's stamp to the instant of the setpoint, and smoothed by a damped filter whose acceleration is soft, and bounded
(`accel_bound_mps2`): a leader that is blown off takes its followers along, noise and jumps of its position do not.
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
SOFT_S = 0.3  # acceleration goes through two lags of this: vehicles tilt for it, and some turn slowly
IGNORED_M = 0.1  # estimates wander by so much: to follow that would shake the formation, not hold it
LONGEST_S = 1.0  # a report older than this says nothing about velocity any more
_STEP_S = 0.02


def accel_bound_mps2(scenario: Scenario) -> float:
    """The most that following may add to a vehicle's acceleration: that of a change of formation, or more if it can.

    More is half of what the plan's turns may take (n_max of Eq. 17), and what its rates and torques allow a change of
    formation, for a step that goes through both lags: its jerk is 1 / (e SOFT_S) of it, its snap 1 / SOFT_S^2.
    """
    most = budget(scenario)
    turns_mps2 = 0.5 * scenario.limits.load_factor_max * scenario.vehicle.gravity_mps2
    return max(most.accel_mps2, min(turns_mps2, most.jerk_mps3 * math.e * SOFT_S, most.snap_mps4 * SOFT_S**2))


class LeaderDeviation:
    """How far the leader is off its plan, smoothed, at rising plan times. `lead` may name another one at any time."""

    def __init__(self, plan: Plan, t0_unix_s: float) -> None:
        self._plan = plan
        self._t0_unix_s = t0_unix_s
        self._view: VehicleView | None = None
        self._row = 0
        self._told_s = math.nan
        self._off, self._rate = np.zeros(3), np.zeros(3)  # as told, unsmoothed
        self.position_m, self.velocity_mps, self.acceleration_mps2 = np.zeros(3), np.zeros(3), np.zeros(3)
        self._soft = np.zeros(3)
        self._accel_mps2 = accel_bound_mps2(plan.scenario)
        self._t_s = math.nan

    def lead(self, view: VehicleView) -> None:
        """From now on this vehicle leads."""
        self._view, self._row, self._told_s = view, self._plan.sysids.index(view.sysid), math.nan

    def advance(self, t_s: float) -> None:
        """Bring position, velocity and acceleration of the deviation to plan time `t_s`."""
        off, rate = self._told(t_s)
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

    def _told(self, t_s: float) -> tuple[Array, Array]:
        """The deviation by the last report, predicted for `t_s`."""
        view = self._view
        if view is None or math.isnan(view.unix_s):
            return np.zeros(3), np.zeros(3)
        if view.unix_s != self._told_s:
            self._told_s = view.unix_s
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
        if age_s > LONGEST_S:
            return share * self._off, np.zeros(3)
        return share * (self._off + self._rate * age_s), share * self._rate


class FollowReference:
    """One follower's share of the stream, moved along with its leader."""

    def __init__(self, base: PlanReference, leader: LeaderDeviation, last: int) -> None:
        self._base = base
        self._leader = leader
        self._last = last

    def at(self, k: int, t_s: float) -> Values:
        """The planned setpoint plus the leader's deviation; from the plan's last one on it stands."""
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
