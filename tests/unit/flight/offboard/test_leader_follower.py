"""Followers go where their leader is: predicted over the delay, softly, and deaf to noise."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.flight.monitor import VehicleView
from gcs.flight.offboard.leader_follower import IGNORED_M, FollowReference, LeaderDeviation
from gcs.flight.offboard.reference_trajectory import PlanReference
from gcs.mission.setpoints.setpoint_stream import build_stream
from gcs.physics.quadrotor import POSITION, VELOCITY, Array
from gcs.plan.trajectory.plan import Plan

T0 = 1_700_000_000.0


def leader_view(plan: Plan, t_s: float, off_m: Array, off_mps: Array) -> VehicleView:
    state = plan.leader_trajectory.state(np.array([t_s]))[0]
    return VehicleView(1, state[POSITION] + off_m, state[VELOCITY] + off_mps, T0 + t_s)


def run(plan: Plan, off_at: object, delay_s: float, until_s: float = 80.0) -> tuple[Array, Array]:
    """Times and deviations (N, 3) sent to a follower while the leader is off by `off_at(t)`, told `delay_s` late."""
    stream = build_stream(plan, 25.0)
    leader = LeaderDeviation(plan, T0)
    base = PlanReference(stream, 3)
    course = FollowReference(base, leader, len(stream.t_s) - 1)
    first = int(np.searchsorted(stream.t_s, 20.0))
    sent, times = [], []
    view = leader_view(plan, 20.0 - delay_s, np.zeros(3), np.zeros(3))
    leader.lead(view)
    for k in range(first, len(stream.t_s)):
        t_s = float(stream.t_s[k])
        if t_s > until_s:
            break
        if k % 3 == 0:
            told_s = t_s - delay_s
            off, rate = off_at(told_s)  # type: ignore[operator]
            new = leader_view(plan, told_s, off, rate)
            view.position_ned_m, view.velocity_ned_mps, view.unix_s = (
                new.position_ned_m,
                new.velocity_ned_mps,
                new.unix_s,
            )
        values, planned = course.at(k, t_s), base.at(k, t_s)
        sent.append(np.subtract(values, planned)[:9])
        times.append(t_s)
    return np.array(times), np.array(sent)


def test_a_leader_5_m_off_is_followed(simulation1_plan: Plan) -> None:
    push = np.array([3.0, 4.0, 0.0])
    t_s, sent = run(simulation1_plan, lambda t: (push * (t > 25.0), np.zeros(3)), 0.3)
    assert np.abs(sent[t_s < 25.2]).max() == 0.0
    settled = sent[t_s > 60.0]
    np.testing.assert_allclose(
        settled[:, :2], np.broadcast_to(push[:2] * (1 - IGNORED_M / 5.0), (len(settled), 2)), atol=0.05
    )
    np.testing.assert_allclose(settled[:, 3:], 0.0, atol=0.02)
    limit = simulation1_plan.scenario.formation.change_accel_mps2
    assert np.linalg.norm(sent[:, 6:], axis=1).max() <= limit + 1e-9
    jerk = np.diff(sent[:, 6:], axis=0) / 0.04
    assert np.linalg.norm(jerk, axis=1).max() < 0.5  # m/s^3


def test_a_leader_that_drifts_is_met_where_it_is_now_not_where_it_was(simulation1_plan: Plan) -> None:
    """Half a metre a second, told half a second late: without prediction followers would be 0.25 m behind."""
    drift = np.array([0.5, 0.0, 0.0])
    t_s, sent = run(simulation1_plan, lambda t: (drift * max(t - 25.0, 0.0), drift * (t > 25.0)), 0.5)
    late = t_s > 70.0
    now = np.outer(t_s[late] - 25.0, drift)
    assert np.abs(sent[late, :3] - now).max() < IGNORED_M + 0.05


def test_noise_is_not_followed(simulation1_plan: Plan) -> None:
    rng = np.random.default_rng(3)
    _, sent = run(simulation1_plan, lambda t: (rng.normal(0.0, 0.02, 3), rng.normal(0.0, 0.05, 3)), 0.2)
    assert np.abs(sent).max() == 0.0


def test_a_leader_that_is_not_heard_is_where_it_was_off_last(simulation1_plan: Plan) -> None:
    leader = LeaderDeviation(simulation1_plan, T0)
    leader.lead(leader_view(simulation1_plan, 30.0, np.array([2.0, 0.0, 0.0]), np.array([0.5, 0.0, 0.0])))
    leader.advance(30.0)
    for t_s in np.arange(30.0, 70.0, 0.04):
        leader.advance(t_s)
    assert leader.position_m == pytest.approx([2.0 - IGNORED_M, 0.0, 0.0], abs=0.05)
