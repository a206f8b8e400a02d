"""The B-spline smoothing of §4: one quintic spline near the leader's planned path, verified for every vehicle.

The plan's jerk jumps where its polynomials join; the jerk of this path does not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.sparse.linalg import spsolve

from gcs.errors import UsageError, VerificationError
from gcs.mission.machine_independent import on_grid
from gcs.mission.setpoints.path_bounds import path_bounds
from gcs.physics.quadrotor import ATTITUDE, POSITION, RATES, VELOCITY, Array, thrust_and_tilt
from gcs.plan.nlp import margins

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

DEGREE = 5
LONGEST_KNOT_S, SHORTEST_KNOT_S = 16.0, 0.25
# Of a limit's scale, ten times the verifier's: a spline oscillates a little where the plan is at a rate limit.
LIMIT_TOLERANCE = 1e-2
_COEFFICIENT_GRID = 2.0**-17  # m and rad: far above what solvers on two machines differ by
_GRID_S = 0.05
_AT_REST = 3  # coefficients at each end of a clamped quintic: they fix its position, velocity and acceleration there


@dataclass(frozen=True)
class SmoothPath:
    """The leader's north, east, down (m) and yaw (rad) as one spline over the setpoint stream of a plan."""

    plan: Plan
    spline: BSpline  # (4,)
    knots_every_s: float
    deviation_m: float  # of the leader, and thus of every vehicle, from the plan at equal time
    yaw_deviation_rad: float
    clearance_min_m: float  # proved: no vehicle has less, at any instant

    def at(self, t_s: Array) -> tuple[Array, Array, Array, Array]:
        """Position, velocity, acceleration (V, N, 3) and yaw (V, N) of all vehicles, in NED."""
        leader, speed, acceleration = (self.spline(t_s, nu=order) for order in range(3))
        position = leader[:, :3] + self.plan.offsets(t_s)
        vehicles = len(position)
        return (
            position,
            speed[:, :3] + self.plan.offsets(t_s, 1),
            acceleration[:, :3] + self.plan.offsets(t_s, 2),
            np.repeat(leader[None, :, 3], vehicles, axis=0),
        )


def smoothed(plan: Plan, tolerance_m: float) -> SmoothPath:
    """The path with the fewest evenly spaced knots that is within `tolerance_m` of the plan and keeps its limits.

    The knot interval is halved until both are true. Raises `UsageError` for a tolerance that is not positive. Raises
    `VerificationError` with the violated limits if the interval falls below `SHORTEST_KNOT_S`.
    """
    if not tolerance_m > 0:
        raise UsageError(f"the smoothing tolerance is {tolerance_m:g} m", hint="give --smooth a positive number")
    start_s, end_s = plan.airborne_s, plan.phase("landing").start_s
    t_s = np.linspace(start_s, np.nextafter(end_s, start_s), int(np.ceil((end_s - start_s) / _GRID_S)) + 1)
    planned = plan.states(t_s)[plan.leader][:, [0, 1, 2, 8]]
    knots_s = LONGEST_KNOT_S
    while True:
        spline = _fitted(t_s, planned, start_s, end_s, max(1, round((end_s - start_s) / knots_s)))
        off = spline(t_s) - planned
        deviation_m = float(np.linalg.norm(off[:, :3], axis=1).max())
        path = SmoothPath(plan, spline, knots_s, deviation_m, float(np.abs(off[:, 3]).max()), np.nan)
        violated, clearance_m = _violated_limits(path, t_s)
        if deviation_m > tolerance_m:
            violated.insert(0, f"{deviation_m:.3g} m from the plan (limit {tolerance_m:g} m)")
        if not violated:
            return replace(path, clearance_min_m=clearance_m)
        knots_s /= 2.0
        if knots_s < SHORTEST_KNOT_S:
            raise VerificationError(
                f"smoothing failed with knots {2.0 * knots_s:g} s apart: {'; '.join(violated)}",
                hint="do not smooth, or plan with more margin to this limit",
            )


def _fitted(t_s: Array, planned: Array, start_s: float, end_s: float, pieces: int) -> BSpline:
    """The least-squares spline through the samples (N, 4), at rest at both planned ends."""
    inner = np.linspace(start_s, end_s, pieces + 1)
    knots = np.concatenate([[start_s] * DEGREE, inner, [end_s] * DEGREE])
    count = len(knots) - DEGREE - 1
    coefficients = np.zeros((count, 4))
    coefficients[:_AT_REST], coefficients[-_AT_REST:] = planned[0], planned[-1]
    basis = sparse.csc_matrix(BSpline.design_matrix(t_s, knots, DEGREE))
    free = basis[:, _AT_REST:-_AT_REST]
    if free.shape[1]:
        missing = planned - basis @ coefficients
        solution = spsolve(sparse.csc_matrix(free.T @ free), free.T @ missing)
        coefficients[_AT_REST:-_AT_REST] = on_grid(solution.reshape(-1, 4), _COEFFICIENT_GRID)
    return BSpline(knots, coefficients, DEGREE)


def _violated_limits(path: SmoothPath, t_s: Array) -> tuple[list[str], float]:
    """The plan's limits that the path violates, in words, and its proved clearance, m.

    Attitude, rates, thrust and turning are sampled: they are no polynomials of time.
    """
    plan, scenario = path.plan, path.plan.scenario
    position, velocity, acceleration, yaw = path.at(t_s)
    states = np.zeros((*yaw.shape, 12))
    states[..., POSITION], states[..., VELOCITY] = position, velocity
    air = np.stack(np.broadcast_arrays(*plan.quadrotor.wind.at(-position[..., 2]), velocity[..., 0])[:3], axis=-1)
    thrust, roll, pitch = thrust_and_tilt(acceleration, velocity - air, yaw, plan.quadrotor)
    states[..., ATTITUDE] = np.stack([roll, pitch, yaw], axis=-1)
    states[..., RATES] = np.gradient(states[..., ATTITUDE], t_s, axis=1)
    controls = np.zeros((*yaw.shape, 4))
    controls[..., 0] = thrust
    bounds = path_bounds(plan, path.spline, LIMIT_TOLERANCE)
    sampled = (
        *margins.state_limits(scenario, states),
        margins.control_limits(scenario, controls)[0],
        margins.turning(scenario, states, controls),
    )
    violated = [
        f"{m.name} violated by {-m.value.min():.3g} {m.unit}"
        for m in sampled
        if m.value.min() < -LIMIT_TOLERANCE * m.scale and "speed" not in m.name
    ]
    return [*bounds.violated, *violated], bounds.clearance_m
