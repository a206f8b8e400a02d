"""Routes through all points of a flight: those of each leg, combined; the shortest combinations first."""

from __future__ import annotations

import heapq
from dataclasses import replace

import numpy as np

from gcs.errors import Infeasible
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.ocp.problem import Problem
from gcs.plan.search.leg_schedule import first_times
from gcs.plan.search.routes import MAX_ROUTES, Map, Route, is_clear, routes_between, survey
from gcs.types import Array

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
        leg = one_leg(problem, number)
        if moving:
            whole, rigid = survey(leg), survey(leg, at_rest=True) if problem.coordinates else None
        try:
            legs.append(_of_leg(leg, whole, rigid))
        except Infeasible as none:
            text = none.message.removeprefix("no plan: ")
            raise Infeasible(f"no plan: {problem.leg_at(start_s + 1e-6)}: {text}", hint=none.hint) from none
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
    return Map(area.north_m[inside[0]], area.east_m[inside[1]], area.floor_m[np.ix_(*inside)], area.ceiling_m)


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
