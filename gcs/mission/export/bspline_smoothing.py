"""The B-spline smoothing of §4: one quintic spline near the leader's planned path, verified for every vehicle.

The plan's jerk jumps where its polynomials join; the jerk of this path does not.

Its bounds hold at every instant. Splines are polynomials between their knots, so Taylor models bound them there.
Distances are bounded along chords; a path is never farther from a chord over h seconds than h^2 / 8 times its largest
acceleration.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline, PPoly
from scipy.sparse.linalg import spsolve

from gcs.errors import UsageError, VerificationError
from gcs.mission.check.between_samples import clearance_along, outside_along, parts_beside
from gcs.mission.check.flight_checks import LENGTH_TOLERANCE_M
from gcs.mission.machine_independent import on_grid
from gcs.physics.quadrotor import thrust_and_tilt
from gcs.physics.states import ATTITUDE, POSITION, RATES, VELOCITY
from gcs.plan.ocp import margins
from gcs.plan.trajectory.constraint_id import STATES
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof.polynomials import combined, enclosed
from gcs.plan.verification.proof.taylor import Taylor, stacked
from gcs.plan.verification.proof.verdict import ProofVerdict
from gcs.scenario.environment.ground_bounds import highest_ground
from gcs.scenario.environment.no_fly import zone_names, zones
from gcs.types import Array

DEGREE = 5
LONGEST_KNOT_S, SHORTEST_KNOT_S = 16.0, 0.25
# Of a limit's scale, ten times the verifier's: a spline oscillates a little where the plan is at a rate limit.
LIMIT_TOLERANCE = 1e-2
_COEFFICIENT_GRID = 2.0**-17  # m and rad: far above what solvers on two machines differ by
_GRID_S = 0.05
_AT_REST = 3  # coefficients at each end of a clamped quintic: they fix its position, velocity and acceleration there
_CHORD_S = 0.0125
_ORDER = 3


@dataclass(frozen=True)
class PathBounds:
    """What is violated, in words, and the clearance that no vehicle falls below."""

    violated: tuple[str, ...]
    clearance_m: float


def path_bounds(plan: Plan, spline: BSpline, limit_tolerance: float) -> PathBounds:
    """The bounds of the leader's spline (north, east, down, yaw) with the offsets of a plan.

    Lengths have the tolerance of every export, 1 cm; speeds a share `limit_tolerance` of their limit.
    """
    leader = _pieces(spline)
    edges_s = _edges(plan, leader)
    begin_s, end_s = edges_s[:-1], edges_s[1:]
    place, velocity, acceleration = (_motion(plan, leader, begin_s, end_s, order) for order in range(3))
    violated = [*_box(plan, place, begin_s), *_speeds(plan, velocity, limit_tolerance)]
    fastest_mps2 = np.sqrt(np.sum(acceleration.size() ** 2, axis=0))  # (V, N)
    bent_m = (end_s - begin_s) ** 2 / 8.0 * fastest_mps2
    at_edges = spline(edges_s)[:, :3] + plan.offsets(edges_s)  # (V, N+1, 3)
    begin_m, end_m = (at_edges[:, part].reshape(-1, 3) for part in (slice(None, -1), slice(1, None)))
    begins_s, ends_s = (np.tile(part, len(at_edges)) for part in (begin_s, end_s))
    slack, lasts_s = bent_m.ravel(), ends_s - begins_s
    margin_m = plan.scenario.limits.zone_margin_m or 0.0
    for name, zone in zip(zone_names(plan.scenario), zones(plan.scenario), strict=True):
        parts = parts_beside(zone, begin_m, end_m, begins_s, ends_s)
        outside = outside_along(zone, parts, margin_m - LENGTH_TOLERANCE_M, slack=slack[parts.piece])
        if outside.verdict is not ProofVerdict.PROVED:
            violated.append(f"{name} violated by {margin_m - outside.proved:.3g} m")
    required_m = plan.scenario.limits.clearance_min_m
    highest = highest_ground(plan.scenario.terrain)
    above = clearance_along(highest, begin_m, end_m, required_m - LENGTH_TOLERANCE_M, slack=slack, duration_s=lasts_s)
    if above.verdict is not ProofVerdict.PROVED:
        violated.append(f"clearance above ground violated by {required_m - above.proved:.3g} m")
    return PathBounds(tuple(violated), above.proved)


def _pieces(spline: BSpline) -> PPoly:
    """The spline as polynomials between its knots: Taylor's coefficients at the start of each."""
    knots = np.unique(spline.t)
    powers = range(spline.k, -1, -1)
    return PPoly(np.stack([spline(knots[:-1], nu=power) / math.factorial(power) for power in powers]), knots)


def _edges(plan: Plan, leader: PPoly) -> Array:
    """Instants between which all polynomials are the same, at most `_CHORD_S` apart."""
    start_s, end_s = float(leader.x[0]), float(leader.x[-1])
    count = int(np.ceil((end_s - start_s) / _CHORD_S)) + 1
    joints_s = np.concatenate([leader.x, plan.shape.joints_s])
    inner = joints_s[(joints_s > start_s) & (joints_s < end_s)]
    return np.unique(np.concatenate([np.linspace(start_s, end_s, count), inner]))


def _motion(plan: Plan, leader: PPoly, begin_s: Array, end_s: Array, order: int) -> Taylor:
    """Places (3, V, N) of all vehicles, or a derivative."""
    flown = enclosed(leader, begin_s, end_s, _ORDER, order)[:3]
    functions = enclosed(plan.shape.functions, begin_s, end_s, _ORDER, order)
    return flown[:, None] + stacked(combined(functions, plan.shape.basis_ned_m))


def _box(plan: Plan, place: Taylor, begin_s: Array) -> list[str]:
    limits, mission = plan.scenario.limits, plan.phase(PhaseKind.MISSION)
    flies = (begin_s >= mission.start_s) & (begin_s < mission.end_s)
    low, high = place.range()
    found = [("height", _outside(-high[2], -low[2], limits.height_m))]
    for axis, (name, bounds) in enumerate((("north position", limits.north_m), ("east position", limits.east_m))):
        found.append((name, _outside(low[axis][:, flies], high[axis][:, flies], bounds)))
    return [f"{name} violated by {off_m:.3g} m" for name, off_m in found if off_m > LENGTH_TOLERANCE_M]


def _outside(low: Array, high: Array, bounds: tuple[float, float]) -> float:
    return max(bounds[0] - float(low.min()), float(high.max()) - bounds[1])


def _speeds(plan: Plan, velocity: Taylor, tolerance: float) -> list[str]:
    names = ("north speed", "east speed", "vertical speed")
    fastest = velocity.size().max(axis=(1, 2))
    limits = plan.scenario.limits.speed_ned_mps
    return [
        f"{name} violated by {speed - limit:.3g} m/s"
        for name, speed, limit in zip(names, fastest.tolist(), limits, strict=True)
        if speed > limit * (1.0 + tolerance)
    ]


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
    start_s, end_s = plan.airborne_s, plan.phase(PhaseKind.LANDING).start_s
    t_s = np.linspace(start_s, end_s, int(np.ceil((end_s - start_s) / _GRID_S)) + 1)
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
            text = f"smoothing failed with knots {2.0 * knots_s:g} s apart: {'; '.join(violated)}"
            raise VerificationError(text, hint="do not smooth, or plan with more margin to this limit")


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
        if m.value.min() < -LIMIT_TOLERANCE * m.scale and m.constraint.kind not in STATES[VELOCITY]
    ]
    return [*bounds.violated, *violated], bounds.clearance_m
