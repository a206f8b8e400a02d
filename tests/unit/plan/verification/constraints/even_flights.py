"""Flights whose margins are known by hand: the leader flies straight on at one velocity, from the first pad on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import PPoly

from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.verify import Check, _Proofs


def even(
    plan: Plan,
    at_ned_m: Sequence[float],
    velocity_mps: Sequence[float],
    attitude_rad: Sequence[float] = (0.0, 0.0, 0.0),
    control: Sequence[float] | None = None,
) -> Plan:
    """The plan with another motion of its leader: at a place at T0, with one velocity, attitude and control."""
    joints = np.array([plan.t_start_s, plan.t_end_s])
    state = np.zeros((2, 1, 12))
    state[0, 0, :3] = velocity_mps
    state[1, 0, :3] = np.array(at_ned_m) + plan.t_start_s * np.array(velocity_mps)
    state[1, 0, 3:9] = [*velocity_mps, *attitude_rad]
    u = np.zeros((1, 1, 4))
    u[0, 0] = [plan.quadrotor.weight_N, 0.0, 0.0, 0.0] if control is None else control
    return replace(plan, leader_trajectory=Trajectory(PPoly(state, joints), PPoly(u, joints)))


def check_of(plan: Plan, name: str, phase: str = "mission") -> Check:
    """The one check of a name in a phase; without Eq. 1 in windows, which takes longest and fails."""
    proofs = _Proofs(plan)
    checks = [*proofs.motion(), *proofs.places(), *proofs.separation()]
    (found,) = (check for check in checks if (check.name, check.phase) == (name, phase))
    assert found.proved is not None
    return found


def assert_margin(check: Check, margin: float, close: float = 1.5e-3, exact_m: float = 1e-9) -> None:
    """What is proved is no more than there is, and what is shown no less; both are close to it (see `subdivision`)."""
    assert check.proved is not None
    assert check.proved <= margin + exact_m
    assert check.worst >= margin - exact_m
    most = max(close, 0.021 * abs(margin))
    assert check.worst - check.proved <= most, str(check)
