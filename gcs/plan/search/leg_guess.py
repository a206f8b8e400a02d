"""First guesses of the legs of a drawn route: the times at its points with their bounds, and routes through them."""

import heapq
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from gcs.errors import Infeasible
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.ocp.problem import Problem
from gcs.plan.search.routes import MAX_ROUTES, Map, Route, is_clear, routes_between, survey
from gcs.types import Array
from gcs.util.long_work import report

_STOP_S = 2.0  # that a guess allows for each end at rest
_SLACK_S = 1e-6
_AXES = ("north", "east", "vertically")


def on_time(problem: Problem, route: Route) -> Problem:
    """The problem with a guess of its times at points, for the lengths of a route's legs. Raises as `check_legs`."""
    return replace(problem, point_s=first_times(problem, np.array([max(leg.length_m, 1.0) for leg in route.legs])))


def first_times(problem: Problem, lengths_m: Array) -> tuple[float, ...]:
    """A guess of `point_s`, for legs of these lengths (K,): every leg at one speed, where the times at points allow it.

    Raises Infeasible as `check_legs`.
    """
    if not problem.points:
        return ()
    check_legs(problem)
    rests, least_s = _at_rest(problem), _least_s(problem).max(axis=1)
    hold_s = np.array([point.hold_s for point in problem.points])
    total_s = problem.duration_s - hold_s.sum()
    wanted_s = np.maximum(lengths_m / (lengths_m.sum() / max(total_s, _STOP_S)), least_s)
    wanted_s += _STOP_S * (rests[:-1].astype(float) + rests[1:])
    earliest_s, latest_s, _ = zip(*_windows(problem), strict=True)
    durations = wanted_s * total_s / wanted_s.sum()
    if np.isfinite(earliest_s[:-1]).any() or np.isfinite(latest_s[:-1]).any():
        if problem.free_time is None:
            earliest_s = (*earliest_s[:-1], problem.end_s)
        held_s = problem.start_s + np.append(0.0, np.cumsum(hold_s))
        durations = _nearest(durations, least_s, np.array(earliest_s) - held_s, np.array(latest_s) - held_s)
    elif np.any(durations < least_s):
        durations = least_s + (total_s - least_s.sum()) * wanted_s / wanted_s.sum()
    ends_s = problem.start_s + np.cumsum(durations) + np.append(0.0, np.cumsum(hold_s))
    return tuple(ends_s[:-1].tolist())


def check_legs(problem: Problem) -> None:
    """Raises Infeasible where a leg has less time than it needs at the speed limits, and names the leg."""
    least_s = _least_s(problem).max(axis=1)
    limits = problem.state_high[VELOCITY]
    ready_s = problem.start_s  # when the next leg can begin, and the point or start that says so
    for number, (_, latest_s, key) in enumerate(_windows(problem)):
        needed_s = float(least_s[number])
        left_s = latest_s - ready_s
        if needed_s > left_s + _SLACK_S:
            axis = int(_least_s(problem)[number].argmax())
            most = problem.scenario.limits.accel_max_mps2
            at_rest = _at_rest(problem)[number : number + 2].any()
            accelerating = f" and {most:g} m/s2" if at_rest and most is not None else ""
            raise Infeasible.because(
                f"{problem.leg_words(number)} needs {_up(needed_s):g} s at "
                f"{limits[axis]:g} m/s {_AXES[axis]}{accelerating}, "
                f"{key} leaves {max(np.floor(10.0 * left_s) / 10.0, 0.0):g} s",
                hint=f"set {key} to {_up(ready_s + 1.05 * needed_s):g} or more, or raise [limits] speed_ned_mps",
            )
        earliest_s = _windows(problem)[number][0]
        hold_s = problem.points[number].hold_s if number < len(problem.points) else 0.0
        ready_s = max(ready_s + needed_s, earliest_s) + hold_s


def least_legs_s(problem: Problem) -> float:
    """The time that the straight legs need at the speed limits, with the holds between them."""
    return float(_least_s(problem).max(axis=1).sum() + sum(point.hold_s for point in problem.points))


def _least_s(problem: Problem) -> Array:
    """The time (K, 3) that each axis of each straight leg needs at its speed limit; less where a point is passed by.

    Where the leader is at rest, it also takes the time to change its speed, where `[limits] accel_max_mps2` is given.
    """
    away_m = np.abs(np.diff(problem.stops_ned_m, axis=0))
    radii = np.array([0.0, *(point.radius_m for point in problem.points), 0.0])
    way_m, fastest_mps = np.maximum(away_m - (radii[:-1] + radii[1:])[:, None], 0.0), problem.state_high[VELOCITY]
    accel_mps2 = problem.scenario.limits.accel_max_mps2
    if accel_mps2 is None or not problem.points:
        return np.asarray(way_m / fastest_mps)
    rests = _at_rest(problem)
    ends = (rests[:-1].astype(float) + rests[1:])[:, None]
    ramps_m = ends * fastest_mps**2 / (2.0 * accel_mps2)
    ramped_s = way_m / fastest_mps + ends * fastest_mps / (2.0 * accel_mps2)
    return np.asarray(np.where(way_m >= ramps_m, ramped_s, np.sqrt(2.0 * ends * way_m / accel_mps2)))


def _at_rest(problem: Problem) -> NDArray[np.bool_]:
    """Whether the leader rests (K + 1,) at the start, at each point and at the end."""
    stops = [point.hold_s > 0.0 for point in problem.points]
    start, end = (not state[VELOCITY].any() for state in (problem.start_state, problem.end_state))
    return np.array([start, *stops, end])


def _windows(problem: Problem) -> list[tuple[float, float, str]]:
    """The earliest and the latest arrival of each leg, plan time, and the key that sets the latest."""
    time = problem.free_time
    flight_key = "[time] flight_s" if time is None else "[time] latest_s"
    last_s = problem.end_s if time is None else problem.start_s + time.latest_s
    found = []
    for point in problem.points:
        key = "at_s" if point.earliest_s == point.latest_s else "by_s"
        latest_s, key = min((point.latest_s, f"{key} of {point.name}"), (last_s, flight_key))
        found.append((point.earliest_s, latest_s, key))
    end_s = -np.inf if time is None else problem.start_s + time.earliest_s
    return [*found, (end_s, last_s, flight_key)]


def _nearest(durations: Array, least_s: Array, earliest_s: Array, latest_s: Array) -> Array:
    """Durations (K,) that keep all times at points, with the least sum of changes, each over its wanted one.

    Each lasts at least `least_s` (K,); it arrives between `earliest_s` and `latest_s` (K,) after the start, without
    holds.
    """
    count = len(durations)
    before = np.tril(np.ones((count, count)))
    zero, eye = np.zeros((count, count)), np.eye(count)
    low, high = np.isfinite(earliest_s), np.isfinite(latest_s)
    found = linprog(
        np.concatenate([np.zeros(count), 1.0 / durations]),
        A_ub=np.block([[before[high], zero[high]], [-before[low], zero[low]], [eye, -eye], [-eye, -eye]]),
        b_ub=np.concatenate([latest_s[high], -earliest_s[low], durations, -durations]),
        bounds=[(float(least), None) for least in np.maximum(least_s, 0.1)] + [(0.0, None)] * count,
    )
    return np.asarray(found.x[:count]) if found.success else durations


def _up(seconds: float) -> float:
    return float(np.ceil(10.0 * seconds) / 10.0)


_BESIDE = 0.6  # of a leg's length: a leg's detours are first looked for no farther beside it
_LEAST_CELLS = 12


def routes_through(problem: Problem) -> tuple[Route, ...]:
    """Up to MAX_ROUTES routes from start to end through all points, shortest first.

    Raises Infeasible where a leg has none, and names the leg.
    """
    straight_m = np.linalg.norm(np.diff(problem.stops_ned_m, axis=0), axis=1)
    problem = replace(problem, point_s=first_times(problem, np.maximum(straight_m, 1.0)))
    whole, rigid = survey(problem), survey(problem, at_rest=True) if problem.coordinates else None
    moving = any(zone.moves for zone in problem.scenario.no_fly)
    legs = []
    for number, (start_s, _) in enumerate(problem.legs_s):
        report("searching ways past zones and high ground")
        leg = one_leg(problem, number)
        if moving:
            whole, rigid = survey(leg), survey(leg, at_rest=True) if problem.coordinates else None
        try:
            legs.append(_of_leg(leg, whole, rigid))
        except Infeasible as none:
            raise Infeasible.because(f"{problem.leg_at(start_s + 1e-6)}: {none.reason}", hint=none.hint) from none
    return tuple(_joined(legs, chosen) for chosen in _shortest_first(legs))


def one_leg(problem: Problem, number: int) -> Problem:
    """The flight of one leg alone, at its times."""
    start_s, end_s = problem.legs_s[number]
    states = [_state_at(problem, stop, number) for stop in (number, number + 1)]
    return replace(
        problem, start_s=start_s, end_s=end_s, start_state=states[0], end_state=states[1], points=(), point_s=()
    )


def _state_at(problem: Problem, stop: int, leg: int) -> Array:
    """The state (12,) at a stop of a leg: start, end, or a point, passed at the leg's mean velocity or at rest."""
    if stop == 0:
        return problem.start_state
    if stop > len(problem.points):
        return problem.end_state
    state = np.zeros(12)
    state[POSITION] = problem.stops_ned_m[stop]
    if not problem.points[stop - 1].hold_s:
        start_s, end_s = problem.legs_s[leg]
        state[VELOCITY] = (problem.stops_ned_m[leg + 1] - problem.stops_ned_m[leg]) / (end_s - start_s)
    return state


def _of_leg(leg: Problem, whole: Map, rigid: Map | None) -> tuple[Route, ...]:
    straight = Route(np.array([leg.start_state[:2], leg.end_state[:2]]), ())
    if is_clear(leg, whole if rigid is None else rigid):
        return (straight,)
    near = [None if area is None else _near(area, leg) for area in (whole, rigid)]
    assert near[0] is not None
    try:
        return routes_between(leg, near[0], near[1])
    except Infeasible:
        return routes_between(leg, whole, rigid)


def _near(area: Map, leg: Problem) -> Map:
    """The part of a map around a leg."""
    ends = np.array([leg.start_state[:2], leg.end_state[:2]])
    step_m = float(area.north_m[1] - area.north_m[0])
    beside_m = max(_BESIDE * float(np.linalg.norm(ends[1] - ends[0])), _LEAST_CELLS * step_m)
    low, high = ends.min(axis=0) - beside_m, ends.max(axis=0) + beside_m
    inside = [(axis >= a) & (axis <= b) for axis, a, b in zip((area.north_m, area.east_m), low, high, strict=True)]
    return area.part(*(slice(*np.flatnonzero(kept)[[0, -1]] + [0, 1]) for kept in inside))


def _shortest_first(legs: list[tuple[Route, ...]]) -> list[tuple[int, ...]]:
    """Which route of each leg, for the shortest combinations."""

    def length_m(chosen: tuple[int, ...]) -> float:
        return sum(routes[number].length_m for routes, number in zip(legs, chosen, strict=True))

    first = (0,) * len(legs)
    queue, seen = [(length_m(first), first)], {first}
    found: list[tuple[int, ...]] = []
    while queue and len(found) < MAX_ROUTES:
        _, chosen = heapq.heappop(queue)
        found.append(chosen)
        for leg, routes in enumerate(legs):
            other = (*chosen[:leg], chosen[leg] + 1, *chosen[leg + 1 :])
            if other[leg] < len(routes) and other not in seen:
                seen.add(other)
                heapq.heappush(queue, (length_m(other), other))
    return found


def _joined(legs: list[tuple[Route, ...]], chosen: tuple[int, ...]) -> Route:
    parts = [routes[number] for routes, number in zip(legs, chosen, strict=True)]
    points: list[Array] = [parts[0].points_m[:1]]
    ends: list[int] = []
    for part in parts:
        points.append(part.points_m[1:])
        ends.append(sum(map(len, points)) - 1)
    sides = tuple(side for part in parts for side in part.sides)
    return Route(np.vstack(points), sides, tuple(ends[:-1]))
