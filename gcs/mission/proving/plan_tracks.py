"""The vehicles of a plan as tracks: its own polynomials, not samples of them."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly

from gcs.mission.proving.track import PolynomialTrack
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof.polynomials import shifted_coefficients
from gcs.types import Array


def plan_tracks(plan: Plan) -> tuple[PolynomialTrack, ...]:
    """One track for each vehicle, named by its system id, from take-off to landing in the plan's time and frame."""
    return _tracks(plan, POSITION, plan.shape.functions)


def plan_velocities(plan: Plan) -> tuple[PolynomialTrack, ...]:
    """The velocities with which vehicles leave the plan, as tracks: the leader's are polynomials of their own."""
    return _tracks(plan, VELOCITY, plan.shape.functions.derivative())


def _tracks(plan: Plan, part: slice, functions: PPoly) -> tuple[PolynomialTrack, ...]:
    state = plan.leader_trajectory.state
    joints_s = np.union1d(state.x, functions.x)
    joints_s = joints_s[(joints_s >= plan.t_start_s) & (joints_s <= plan.t_end_s)]
    leader = _powers(PPoly(np.ascontiguousarray(state.c[:, :, part]), state.x), joints_s)
    factors = _powers(functions, joints_s)
    degree = max(len(leader), len(factors))
    found = []
    for row, sysid in enumerate(plan.sysids):
        c = np.zeros((degree, len(joints_s) - 1, 3))
        c[: len(leader)] += leader
        for number, table in enumerate(plan.shape.basis_ned_m[:, row]):
            c[: len(factors)] += factors[:, :, number, None] * table
        found.append(PolynomialTrack(str(sysid), PPoly(np.ascontiguousarray(c[::-1]), joints_s)))
    return tuple(found)


def _powers(polynomial: PPoly, joints_s: Array) -> Array:
    """Coefficients (D+1, N, n), the lowest power first, of the time since the begin of each of these pieces."""
    middle_s = 0.5 * (joints_s[:-1] + joints_s[1:])
    piece = np.clip(np.searchsorted(polynomial.x, middle_s, side="right") - 1, 0, len(polynomial.x) - 2)
    return shifted_coefficients(polynomial, piece, joints_s[:-1])
