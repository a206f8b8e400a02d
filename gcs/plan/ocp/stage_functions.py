"""Path constraints (Eqs. 18, 20, 21, 23-25, 51), motion (Eq. 1) and cost rate (Eq. 35) of one instant.

Path constraints are those of the active vehicles in the leader's variables: turning radius (Eq. 18, Eq. 25), clearance
(Eq. 20, Eq. 23), no-fly zones (Eq. 21, Eq. 24), limits (Eq. 51). CasADi makes exact derivatives.
"""

import math
from dataclasses import astuple, dataclass, replace
from typing import TypeVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from gcs.physics.quadrotor import equations_of_motion
from gcs.physics.states import NU, NX, VELOCITY
from gcs.plan.formation.coordinates import bent
from gcs.plan.formation.follower_equations import jerk
from gcs.plan.ocp.active_vehicles import FOOT, LIFT, LINE, MOVED, RADIUS, SLOT, ActiveVehicles, zone_pieces
from gcs.plan.ocp.margins import REST_SPEED_MPS
from gcs.plan.ocp.objective_sum import cost_rate, share_rows
from gcs.plan.ocp.objectives import speed_across_and_along
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.constraint_id import STATES, ConstraintId, Form, Kind
from gcs.scenario.environment.clearance_floor import FEET
from gcs.scenario.environment.convex_pieces import Disk, Piece
from gcs.scenario.environment.terrain import ground_envelope_m
from gcs.scenario.schema.heightmap import Envelope
from gcs.types import Array

# Smooths the load factor at rest. At no speed does it let the optimiser exceed the verifier's limit by over 0.05 %.
REST_SMOOTHING_MPS = 0.03 * REST_SPEED_MPS
# Below this speed a vehicle may fly in any direction; above it the formation must face along its course.
COURSE_FLOOR_MPS = 0.3
# Edges of a polygon are moved outwards by this, so that its corners can be rounded.
CORNER_M = 0.3
# Limits that vehicles reach before the leader where the wind at their height is another.
_LEAN = (Kind.ROLL, Kind.PITCH, Kind.LEAST_THRUST, Kind.LARGEST_THRUST)
_STEEPEST_DEG = 89.0
_SPLINE_DEGREE = 3  # of the smooth envelope of an elevation model
# Of the leader these are bounds of its state.
_BOUNDED = STATES[:6]
# A row is left out of the program where a vehicle is farther from ground or zone, or its size is below 0.7 limits.
_NEAR_LIMIT = 0.5
_BETWEEN_M = 2.0  # from the ground, at instants between nodes
# The jerk that a turning thrust takes, and the one that its size takes, across and along the thrust: both together
# take less than the whole limit.
TURN_SHARE, THRUST_SHARE = 0.9, 0.3

_LINE_KINDS = (Kind.LEG_CORRIDOR, Kind.LEG_HEIGHT, Kind.LEG_YAW)

_Symbol = TypeVar("_Symbol", ca.SX, ca.MX)


@dataclass(frozen=True)
class RowReach:
    """How far from ground and zones a vehicle may be so that the program has rows about them at its nodes."""

    ground_m: float
    zone_m: float


EVERYWHERE = RowReach(math.inf, math.inf)


@dataclass(frozen=True)
class StageFunctions:
    """CasADi functions of z (nz). The cost also takes its shares (`objective_sum.cost_shares`); the path takes
    the numbers of the active vehicles (`gcs.plan.ocp.active_vehicles`)."""

    motion: ca.Function  # z -> (nx)
    motion_jacobian: ca.Function  # z -> (nx, nz)
    cost: ca.Function  # z, shares -> ()
    cost_gradient: ca.Function  # z, shares -> (nz)
    motion_hessian: ca.Function  # z, shares, sigma, costate (nx) -> (nz, nz): of sigma * cost + costate . motion
    path: ca.Function  # z, parameters -> (P), each >= 0
    path_jacobian: ca.Function  # z, parameters -> (P, nz)
    path_hessian: ca.Function  # z, parameters, multipliers (P) -> (nz, nz)


def functions(problem: Problem, near_ground: int = 1, near_zone: int = 1, moving: int = 1) -> StageFunctions:
    """The functions of one problem, for these numbers of active vehicles of each kind; by default the leader alone."""
    chains = len(problem.coordinates)
    nx = NX + 4 * chains
    z = ca.SX.sym("z", nx + NU + chains)
    x, u = ca.vertsplit(z[:nx]), ca.vertsplit(z[nx:])
    flight = equations_of_motion(x[:NX], u[:NU], problem.quadrotor, xp=ca)
    chain = [part for c in range(chains) for part in (*x[NX + 4 * c + 1 : NX + 4 * c + 4], u[NU + c])]
    motion = ca.vertcat(*flight, *chain)
    shares = ca.SX.sym("shares", share_rows(problem))
    cost = cost_rate(problem, x, u, shares)
    active = SLOT * (near_ground + near_zone * len(zone_pieces(problem)) + moving)
    slots = ca.SX.sym("slots", active + LINE * bool(problem.lines))
    path, path_jacobian, path_hessian = _path_functions(problem, z, motion, slots, near_ground, near_zone)
    sigma, costate = ca.SX.sym("sigma"), ca.SX.sym("costate", nx)

    def function(name: str, inputs: list[ca.SX], output: ca.SX) -> ca.Function:
        return ca.Function(name, inputs, [output])

    return StageFunctions(
        motion=function("motion", [z], motion),
        motion_jacobian=function("motion_jacobian", [z], ca.jacobian(motion, z)),
        cost=function("cost", [z, shares], cost),
        cost_gradient=function("cost_gradient", [z, shares], ca.gradient(cost, z)),
        motion_hessian=function(
            "motion_hessian", [z, shares, sigma, costate], ca.hessian(sigma * cost + ca.dot(costate, motion), z)[0]
        ),
        path=path,
        path_jacobian=path_jacobian,
        path_hessian=path_hessian,
    )


def _path_functions(
    problem: Problem, z: ca.SX, motion: ca.SX, slots: ca.SX, near_ground: int, near_zone: int
) -> tuple[ca.Function, ca.Function, ca.Function]:
    """The path constraints with their first and second derivatives."""
    terrain, x = problem.scenario.terrain, ca.vertsplit(z)
    count = slots.size1() - LINE * bool(problem.lines)
    each = [*ca.vertsplit(slots[:count], SLOT), *[slots[count:]] * bool(problem.lines)]
    places = []
    for slot in each[:near_ground]:
        north, east, _ = _place(problem, x, slot)
        places.append((x[0] + north + slot[FOOT][0], x[1] + east + slot[FOOT][1]))
    if problem.follows_ground:
        places.append((x[0], x[1]))
    if terrain.relief is None:
        heights = [ground_envelope_m(terrain, north, east, ca) for north, east in places]
        return _with_derivatives(z, slots, ca.vertcat(*_path(problem, z, motion, each, heights, near_zone)))
    # A spline takes no scalar symbols (SX): here the path is a function of matrix symbols (MX).
    ground = ca.SX.sym("ground", len(places))
    values = ca.vertcat(*_path(problem, z, motion, each, ca.vertsplit(ground), near_zone))
    with_ground = ca.Function("with_ground", [z, slots, ground], [values])
    below = ca.Function("below", [z, slots], [ca.horzcat(*(ca.vertcat(*place) for place in places))])
    at, active = ca.MX.sym("z", z.size1()), ca.MX.sym("slots", slots.size1())
    heights_m = spline(terrain.relief.envelope)(below(at, active))
    return _with_derivatives(at, active, with_ground(at, active, heights_m.T))


def _with_derivatives(z: _Symbol, slots: _Symbol, path: _Symbol) -> tuple[ca.Function, ca.Function, ca.Function]:
    multipliers = type(path).sym("multipliers", path.size1())
    return (
        ca.Function("path", [z, slots], [path]),
        ca.Function("path_jacobian", [z, slots], [ca.jacobian(path, z)]),
        ca.Function("path_hessian", [z, slots, multipliers], [ca.hessian(ca.dot(multipliers, path), z)[0]]),
    )


def path_ids(problem: Problem, chosen: ActiveVehicles) -> list[list[ConstraintId]]:
    """The constraints (T, P) that the rows of the path are at each instant."""
    ids, kinds, form = problem.scenario.formation.sysids, _moving_kinds(problem), Form.ROW
    feet = [[ConstraintId(Kind.CLEARANCE, form, part=foot, vehicle=sysid) for sysid in ids] for foot in range(FEET)]
    beside = [[replace(piece, form=form, vehicle=sysid) for sysid in ids] for piece, _, _ in zone_pieces(problem)]
    moving = [[ConstraintId(kind, form, vehicle=sysid) for kind in kinds] for sysid in ids]
    last = [ConstraintId(Kind.JERK, form)] * (problem.jerk_left_mps3 is not None)
    last += [ConstraintId(Kind.COURSE, form), ConstraintId(Kind.FORWARDS)] * problem.follows_course
    lines = [[ConstraintId(kind, form, of=line.number) for kind in _LINE_KINDS] for line in problem.lines]
    rows = []
    for t in range(len(chosen.ground)):
        row = [feet[foot % FEET][v] for foot, v in enumerate(chosen.ground[t])]
        for zone, near in zip(beside, chosen.zones, strict=True):
            row += [zone[v] for v in near[t]]
        for v in chosen.moving[t]:
            row += moving[v]
        rows.append([*row, *last, *(lines[chosen.legs[t]] if lines else ())])
    return rows


def path_is_free(problem: Problem, chosen: ActiveVehicles) -> NDArray[np.bool_]:
    """Mask (T, P) of rows of the path without effect, because another row is the same constraint."""
    before = chosen.ground.shape[1] + sum(near.shape[1] for near in chosen.zones)
    masks = [~(chosen.leaning if kind in _LEAN else chosen.moving_used) for kind in _moving_kinds(problem)]
    spare = np.stack(masks, axis=2).reshape(len(chosen.moving), -1)
    spare = np.pad(spare, ((0, 0), (before, 2 * problem.follows_course + (problem.jerk_left_mps3 is not None))))
    if not problem.lines:
        return spare
    limits = np.array([astuple(line.limits) for line in problem.lines])
    return np.hstack([spare, np.isinf(limits)[chosen.legs] | (chosen.legs < 0)[:, None]])


def path_may_bind(
    problem: Problem, chosen: ActiveVehicles, values: Array, reach: RowReach, nodes: int
) -> NDArray[np.bool_]:
    """Mask (T, P) of the rows of the path that can bind near the last known states, where they have `values` (T, P).

    The first `nodes` instants are nodes. Every row of a limit is 1 - (size / limit)^2. The leader's own place and speed
    are bounds. What is left out here is checked after each solve like all else (`violations`), and then has a value
    that brings it in.
    """
    kinds, ground = _moving_kinds(problem), chosen.ground.shape[1]
    near = sum(zone.shape[1] for zone in chosen.zones)
    extra = np.arange(len(values))[:, None] >= nodes
    used = np.ones(values.shape, dtype=bool)
    used[:, :ground] = values[:, :ground] < np.where(extra, min(_BETWEEN_M, reach.ground_m), reach.ground_m)
    active = chosen.parameters[:, : chosen.parameters.shape[1] - LINE * bool(problem.lines)]
    slots = active.reshape(len(values), -1, SLOT)[:, :ground, FOOT.start :]
    used[:, 1:ground:FEET] &= np.any(slots[:, 1::FEET] != slots[:, ::FEET], axis=2)  # both feet on flat ground
    used[:, ground : ground + near] = values[:, ground : ground + near] < reach.zone_m
    moving = slice(ground + near, ground + near + chosen.moving.shape[1] * len(kinds))
    if problem.follows_course:
        leaders = chosen.moving == problem.leader
        rows = (values[:, moving] < _NEAR_LIMIT).reshape(*leaders.shape, len(kinds))
        bounded = np.array([kind in _BOUNDED for kind in kinds])
        used[:, moving] = np.where(leaders[..., None], ~bounded, rows).reshape(len(values), -1)
    else:
        used[:, moving] = ~extra | (values[:, moving] < _NEAR_LIMIT)
    return used & ~path_is_free(problem, chosen)


def _path(
    problem: Problem, z: ca.SX, motion: ca.SX, slots: list[ca.SX], ground: list[ca.SX], near_zone: int
) -> list[ca.SX]:
    """Path constraints of the active vehicles in the leader's variables: each value must be >= 0."""
    scenario = problem.scenario
    x, nx = ca.vertsplit(z), NX + 4 * len(problem.coordinates)
    line = slots[-1] if problem.lines else None
    remaining = iter(slots if line is None else slots[:-1])
    values: list[ca.SX] = []
    # Clearance: Eq. 20 for the leader, Eq. 23 for a follower. `height` is that of the ground's nearest point.
    below_leader = ground[-1] if problem.follows_ground else 0.0
    for height in ground[:-1] if problem.follows_ground else ground:
        slot = next(remaining)
        _, _, down = _place(problem, x, slot)
        values.append(-(x[2] + down) - height - slot[LIFT])
    # No-fly zones: Eq. 21 for the leader, Eq. 24 for a follower.
    zones = zone_pieces(problem)
    for number, (_, _, piece) in enumerate(zones):
        for _ in range(near_zone):
            slot = next(remaining)
            offset_north, offset_east, _ = _place(problem, x, slot)
            north, east = x[0] + offset_north - slot[MOVED][0], x[1] + offset_east - slot[MOVED][1]
            if number < len(zones) - problem.spare_disks:
                values.append(_outside(piece, north, east))
            else:
                values.append((north**2 + east**2 - slot[RADIUS] ** 2) / (2.0 * slot[RADIUS]))
    for slot in remaining:
        values += _own_motion(problem, z, motion, slot)
    if (most := problem.jerk_left_mps3) is not None:
        # The rate of U1 is no variable: it adds up to THRUST_SHARE of the jerk along the thrust.
        turned = jerk(x[:NX], ca.vertsplit(z[nx : nx + NU]), 0.0, problem.quadrotor, ca)
        values.append(1.0 - sum(part**2 for part in turned) / (TURN_SHARE * most) ** 2)
    if problem.follows_course:
        lateral, ahead = speed_across_and_along(problem, x)
        sine = float(np.sin(np.radians(scenario.formation.course_tolerance_deg)))
        floor = COURSE_FLOOR_MPS
        squared = x[3] ** 2 + x[4] ** 2
        slow = floor**2 * ca.exp(-squared / floor**2)
        values.append((sine**2 * squared + slow - lateral**2) / problem.objective.speed_ref_mps**2)
        values.append((ahead + floor) / problem.objective.speed_ref_mps)
    if line is not None:
        down = x[2] + line[LINE - 1] * below_leader
        off = ca.mtimes(ca.reshape(line[4 : LINE - 1], 4, 4), ca.vertcat(*x[:2], down, x[8]) - line[:4])
        values += [1.0 - off[0] ** 2 - off[1] ** 2, 1.0 - off[2] ** 2, 1.0 - off[3] ** 2]
    return values


def _outside(piece: Piece, north: ca.SX, east: ca.SX) -> ca.SX:
    """Smooth distance outside, never more than the true one: Eq. 21 squared, or the rounded largest edge distance."""
    if isinstance(piece, Disk):
        squared = (north - piece.centre_m[0]) ** 2 + (east - piece.centre_m[1]) ** 2
        return (squared - piece.radius_m**2) / (2.0 * piece.radius_m)
    edges = [n * north + e * east - off for (n, e), off in zip(piece.normals, piece.offsets_m, strict=True)]
    if len(edges) == 1:
        return edges[0]
    sharpness = math.log(len(edges)) / CORNER_M
    largest = edges[0]
    for edge in edges[1:]:
        largest = ca.fmax(largest, edge)
    beside = ca.SX(0)
    for edge in edges:
        beside += ca.exp(sharpness * (edge - largest))
    return largest + ca.log(beside) / sharpness - CORNER_M


def _place(problem: Problem, x: list[ca.SX], slot: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    values = {c.name: x[NX + 4 * i] for i, c in enumerate(problem.coordinates)}
    return bent(values, ca.vertsplit(slot[0:3]), ca.vertsplit(slot[9:12]), ca)


def _moving_kinds(problem: Problem) -> tuple[Kind, ...]:
    kinds: tuple[Kind, ...] = (Kind.TURNING,)
    if problem.scenario.limits.accel_max_mps2 is not None:
        kinds += (Kind.ACCELERATION,)
    if problem.coordinates:
        kinds += (*STATES[: 2 * problem.has_box], *STATES[VELOCITY])
        kinds += (Kind.HEIGHT,) * problem.has_heights
    return kinds + _LEAN * problem.winds_differ


def _own_motion(problem: Problem, z: ca.SX, motion: ca.SX, slot: ca.SX) -> list[ca.SX]:
    """Turning radius (Eq. 18; Eq. 25 of a follower), acceleration and, with coordinates, the limits of Eq. 51."""
    scenario = problem.scenario
    place, speed, acceleration = _motion_of(problem, z, slot)
    v = z[3:6] + speed
    a = motion[3:6] + acceleration
    bound = (scenario.limits.load_factor_max - problem.turning_reserve_g) * problem.quadrotor.gravity_mps2
    turn = v[0] * a[1] - v[1] * a[0]
    values = [1.0 - (turn / bound) ** 2 / (v[0] ** 2 + v[1] ** 2 + REST_SMOOTHING_MPS**2)]
    if (most := scenario.limits.accel_max_mps2) is not None:
        values.append(1.0 - ca.dot(a, a) / (most - problem.accel_reserve_mps2) ** 2)
    if problem.coordinates:
        if problem.has_box:
            for axis, (low, high) in enumerate((scenario.limits.north_m, scenario.limits.east_m)):
                values.append(1.0 - ((z[axis] + place[axis] - 0.5 * (low + high)) / (0.5 * (high - low))) ** 2)
        values += [1.0 - (v[axis] / most) ** 2 for axis, most in enumerate(scenario.limits.speed_ned_mps)]
        if problem.has_heights:
            low, high = scenario.limits.height_m
            values.append(1.0 - ((z[2] + place[2] + 0.5 * (low + high)) / (0.5 * (high - low))) ** 2)
    if problem.winds_differ:
        values += _lean(problem, z[8], v, a, z[2] + place[2])
    return values


def _lean(problem: Problem, yaw: ca.SX, v: ca.SX, a: ca.SX, down: ca.SX) -> list[ca.SX]:
    """Tilt and thrust of a vehicle in the wind at its own height against their limits: Eq. 1 solved for the thrust."""
    q, limits = problem.quadrotor, problem.scenario.limits
    air = v - ca.vertcat(*q.wind.at(-down, ca))
    force = q.mass_kg * (ca.DM([0.0, 0.0, q.gravity_mps2]) - a) - ca.DM(q.drag_Nspm) * air
    ahead = ca.cos(yaw) * force[0] + ca.sin(yaw) * force[1]
    aside = ca.sin(yaw) * force[0] - ca.cos(yaw) * force[1]
    squared = ca.dot(force, force)
    roll, pitch = (math.radians(min(limit, _STEEPEST_DEG)) for limit in limits.roll_pitch_yaw_deg[:2])
    low, high = limits.thrust_N
    return [
        (squared - (aside / math.sin(roll)) ** 2) / q.weight_N**2,
        (force[2] ** 2 - (ahead / math.tan(pitch)) ** 2) / q.weight_N**2,
        (squared - low**2) / q.weight_N**2,
        (high**2 - squared) / q.weight_N**2,
    ]


def _motion_of(problem: Problem, z: ca.SX, slot: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The offset of an active vehicle, and its first two derivatives by the chain rule."""
    base, rate, acceleration = slot[0:3], slot[3:6], slot[6:9]
    if not problem.coordinates:
        return base, rate, acceleration
    chains = range(NX, NX + 4 * len(problem.coordinates), 4)
    q0, q1, q2 = (ca.vertcat(*(z[i + k] for i in chains)) for k in range(3))
    place = ca.vertcat(*_place(problem, ca.vertsplit(z), slot))
    speed = ca.jtimes(place, q0, q1) + ca.jtimes(place, base, rate)
    second = ca.jtimes(speed, q0, q1) + ca.jtimes(speed, q1, q2)
    second += ca.jtimes(speed, base, rate) + ca.jtimes(speed, rate, acceleration)
    return place, speed, second


def spline(envelope: Envelope) -> ca.Function:
    """The function places (2, K), north and east in m -> heights (1, K) in m; constant beyond the edge of its table."""
    count = envelope.coefficients_m.shape
    # In units of the step, coefficient i is at i, and its basis function reaches from i - 2 to i + 2.
    knots = [(np.arange(n + _SPLINE_DEGREE + 1) - 2.0).tolist() for n in count]
    coefficients = envelope.coefficients_m.ravel(order="F").tolist()
    surface = ca.Function.bspline("surface", knots, coefficients, [_SPLINE_DEGREE, _SPLINE_DEGREE], 1)
    place = ca.MX.sym("place", 2)
    index = (place - ca.DM(envelope.first_m)) / envelope.step_m
    inside = ca.fmax(1.0, ca.fmin(index, ca.DM(np.array(count) - 2.0)))
    return ca.Function("ground", [place], [surface(inside)])
