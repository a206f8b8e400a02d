"""The initial guess of the optimiser: a route at constant speed, above the ground below it. It need not be flyable."""

import itertools

import numpy as np
from scipy import sparse
from scipy.interpolate import PPoly
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.sparse.linalg import spsolve

from gcs.plan.ocp.active_vehicles import offsets_at
from gcs.plan.ocp.bounds import leader_state_bounds
from gcs.plan.ocp.problem import Problem
from gcs.plan.search.formation_poses import floor_m, from_zones_m, poses
from gcs.plan.search.routes import Route
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.environment.clearance_floor import coarse_floor_m
from gcs.types import Array

_POINTS = 201
_FINE_S = 0.05
_STEP_S, _FEWEST = 1.0, 8  # between the points of a leg, and how many steps it has at least
_IMPASSABLE_M = 1e3  # excess height of a place that is infeasible at every height
_CALM_S = 4.0  # turns of the course that are shorter than this are rounded off
_CREEPS_MPS = 0.3  # below this a course means nothing
_SMOOTHING = 4.0  # points: rounds the corners of a route and the slopes of its heights


def straight_route(problem: Problem) -> Route:
    """The straight route, whatever is in between."""
    return Route(problem.stops_ned_m[:, :2], (), tuple(range(1, len(problem.points) + 1)))


def along(problem: Problem, route: Route) -> Trajectory:
    """A flight along a route: constant speed, level attitude, twice the least clearance above all vehicles' ground.

    Coordinates of the shape take, at every place, the cheapest pose that is feasible under the ceiling.
    """
    times, states = _through(problem, route)
    chains = _chains(problem, times, states)
    low, high = leader_state_bounds(problem, times)
    states[:, 2] = np.minimum(states[:, 2], -height_over_ground_m(problem, times, np.hstack([states, chains])))
    states[:, 2] = np.clip(states[:, 2], low[:, 2], high[:, 2])
    states[:, 3:6] = np.gradient(states[:, :3], times, axis=0)
    states[:, 6:8] = 0.0
    states[:, 9:12] = 0.0
    controls = np.zeros((len(times), 4 + len(problem.coordinates)))
    controls[:, 0] = problem.quadrotor.weight_N
    return Trajectory(piecewise_linear(times, np.hstack([states, chains])), piecewise_linear(times, controls))


def _through(problem: Problem, route: Route) -> tuple[Array, Array]:
    """Times (N,) and states (N, 12) along a route: at constant speed on each leg, at rest in each hold."""
    stops = [problem.start_state, *(_at_point(problem, number) for number in range(len(problem.points)))]
    stops.append(problem.end_state)
    times, states = [], []
    for number, (leg, (start_s, end_s)) in enumerate(zip(route.legs, problem.legs_s, strict=True)):
        count = _POINTS if not problem.points else max(int(np.ceil((end_s - start_s) / _STEP_S)), _FEWEST) + 1
        share = np.linspace(0.0, 1.0, count)
        flown = stops[number] + share[:, None] * (stops[number + 1] - stops[number])
        flown[:, :2] = _rounded(problem, leg.place(share))
        if problem.lines and problem.lines[number].ground is not None:
            flown[:, 2] = problem.lines[number].places(share)[:, 2]
        again = bool(number and not problem.points[number - 1].hold_s)  # the end of the leg before
        times.append(np.linspace(start_s, end_s, count)[again:])
        states.append(flown[again:])
    return np.concatenate(times), np.vstack(states)


def _at_point(problem: Problem, number: int) -> Array:
    """The state (12,) of a guess at a point: its place, and a yaw between those that are given before and after."""
    point = problem.points[number]
    state = np.zeros(12)
    state[:3] = point.place_ned_m
    given = {n: p.yaw_ned_rad for n, p in enumerate(problem.points) if p.yaw_ned_rad is not None}
    known = {-1: float(problem.start_state[8]), **given, len(problem.points): float(problem.end_state[8])}
    state[8] = np.interp(number, list(known), list(known.values()))
    return state


def _chains(problem: Problem, times: Array, states: Array) -> Array:
    """Values and first three derivatives (N, 4 A) of the shape's coordinates."""
    if not problem.coordinates:
        return np.zeros((len(times), 0))
    values = _headings(problem, states) if problem.follows_course else _cheapest(problem, times, states)
    columns = []
    for c, value in enumerate(values.T):
        smooth = gaussian_filter1d(value, _SMOOTHING, mode="nearest")
        chain = [smooth]
        for _ in range(3):
            chain.append(np.gradient(chain[-1], times))
        most = np.array(problem.coordinates[c].most[:3])
        columns += [chain[0], *(np.clip(part, -limit, limit) for part, limit in zip(chain[1:], most, strict=True))]
    return np.column_stack(columns)


def facing_along(problem: Problem, flown: Trajectory, guess: Trajectory) -> Trajectory:
    """A flight of the leader (12 states, 4 controls) with the heading along its course; other coordinates as guessed.

    The heading minimises the squares of its distance to the course, by speed, and of its third derivative, and rests
    at both ends. So it is as calm as the formation can turn.
    """
    even = times = np.linspace(problem.start_s, problem.end_s, 2 * _POINTS)
    chain = [_calmest(*_course(problem, flown.state(even)[:, :12]), float(even[1] - even[0]))]
    for _ in range(3):
        chain.append(np.gradient(chain[-1], even))
    if problem.points:  # the flight changes quickly beside a hold: its own instants must survive
        times = np.union1d(np.arange(problem.start_s, problem.end_s, _FINE_S), flown.joints_s)
    states, chains = flown.state(times)[:, :12], guess.state(times)[:, 12:]
    controls = np.hstack([flown.control(times)[:, :4], np.zeros((len(times), len(problem.coordinates)))])
    number = [c.free_end for c in problem.coordinates].index(True)
    chains[:, 4 * number : 4 * number + 4] = np.column_stack([np.interp(times, even, part) for part in chain])
    return Trajectory(piecewise_linear(times, np.hstack([states, chains])), piecewise_linear(times, controls))


def _course(problem: Problem, states: Array) -> tuple[Array, Array]:
    """The leader's course (N,) from the formation's zero, without jumps, and the weight (N,) of each instant."""
    north, east = states[:, 3], states[:, 4]
    squared = north**2 + east**2
    turned = np.unwrap(np.arctan2(east, north) - problem.course_at_start_rad)
    first = int(np.argmax(squared > _CREEPS_MPS**2))
    turned -= 2.0 * np.pi * np.round(turned[first] / (2.0 * np.pi))
    return turned, squared / max(float(squared.max()), _CREEPS_MPS**2)


def _calmest(values: Array, weights: Array, step_s: float) -> Array:
    """The calmest curve (N,) near values (N,) with weights (N,): from 0, at rest at both ends."""
    count = len(values)
    third = sparse.diags([-1.0, 3.0, -3.0, 1.0], [0, 1, 2, 3], shape=(count - 3, count))
    # Three equal values at each end: neither rate nor acceleration.
    free = sparse.lil_matrix((count, count - 5))
    free[np.arange(3, count - 3), np.arange(count - 6)] = 1.0
    free[np.arange(count - 3, count), count - 6] = 1.0
    near = sparse.diags(weights) + (_CALM_S / step_s) ** 6 * third.T @ third
    inner = free.tocsc()
    return np.asarray(inner @ spsolve((inner.T @ near @ inner).tocsc(), inner.T @ (weights * values)))


def _headings(problem: Problem, states: Array) -> Array:
    """Coordinates (N, A): heading along the route, all others at rest."""
    step = np.gradient(states[:, :2], axis=0)
    turned = np.unwrap(np.arctan2(step[:, 1], step[:, 0]) - problem.course_at_start_rad)
    begins_rad = 0.0 if problem.heading is None else float(problem.heading.start[0])
    turned -= 2.0 * np.pi * np.round((turned[0] - begins_rad) / (2.0 * np.pi))
    return np.column_stack([turned if c.free_end else np.full(len(step), c.rest) for c in problem.coordinates])


def _cheapest(problem: Problem, times: Array, states: Array) -> Array:
    """Coordinates (N, A) of the cheapest pose that is feasible at each place; else of the least infeasible one."""
    values = np.empty((len(times), len(problem.coordinates)))
    ceiling_m = -leader_state_bounds(problem, times)[0][:, 2]
    stretches = np.concatenate([[problem.start_s], [end for _, end in problem.shape.moving_s], [problem.end_s]])
    for start, end in itertools.pairwise(stretches):
        inside = (times >= start) & (times <= end)
        choices = poses(problem, start)
        north, east = states[inside, 0], states[inside, 1]
        floors = np.array([floor_m(problem, pose.offsets_ned_m, north, east) for pose in choices])
        excess = np.minimum(np.maximum(floors - ceiling_m[inside], 0.0), _IMPASSABLE_M)
        price = np.array([pose.cost for pose in choices])[:, None] + excess
        best = price.argmin(axis=0)
        table = np.array([[pose.values[c.name] for c in problem.coordinates] for pose in choices])
        values[inside] = table[best]
    # Shrink early and grow late: the shape must have changed before it enters a gap.
    away = np.array([[abs(v - c.rest) for v, c in zip(row, problem.coordinates, strict=True)] for row in values])
    for c in range(values.shape[1]):
        ahead = maximum_filter1d(np.arange(len(times)) * 0.0 + away[:, c], int(4 * _SMOOTHING))
        sign = np.sign(values[np.argmax(away[:, c]), c] - problem.coordinates[c].rest)
        values[:, c] = problem.coordinates[c].rest + sign * ahead
    return values


def _rounded(problem: Problem, points: Array) -> Array:
    """The route with rounded corners and the same ends; rounded less where that would lead into a no-fly zone."""
    line = np.linspace(points[0], points[-1], len(points))
    offsets = problem.shape.at(problem.start_s)
    rounded = points
    for smoothing in _SMOOTHING * np.array([1.0, 0.5, 0.25]):
        rounded = line + gaussian_filter1d(points - line, smoothing, axis=0, mode="nearest")
        if from_zones_m(problem, offsets, *rounded.T).min() >= 0.0:
            break
    return np.asarray(rounded)


def height_over_ground_m(problem: Problem, times: Array, states: Array) -> Array:
    """Height (N,) of the leader at which all vehicles clear their ground; it rises before a slope begins."""
    scenario = problem.scenario
    places = offsets_at(problem, problem.shape.offsets(times), states)
    kept_m = scenario.limits.clearance_min_m
    north, east = (states[:, axis] + places[..., axis] for axis in (0, 1))
    needed = (coarse_floor_m(scenario.terrain, north, east, kept_m) + places[..., 2]).max(axis=0) + kept_m
    return np.asarray(gaussian_filter1d(maximum_filter1d(needed, int(4 * _SMOOTHING)), _SMOOTHING))


def piecewise_linear(times: Array, values: Array) -> PPoly:
    """Straight lines through values (N, ...) at times (N,)."""
    slopes = np.diff(values, axis=0) / np.diff(times)[:, None]
    return PPoly(np.stack([slopes, values[:-1]]), times)
