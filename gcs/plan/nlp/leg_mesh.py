"""The first mesh of a flight of several legs: even intervals on each leg, short ones where the leader is at rest."""

from __future__ import annotations

import numpy as np

from gcs.physics.states import VELOCITY
from gcs.plan.nlp.mesh import HOLD, Mesh, end_refined
from gcs.plan.ocp.problem import Problem
from gcs.types import Array

_LEG_S = 7.0  # longest interval of a leg
_GROWTH = 1.5


def first_mesh(problem: Problem, longest_s: float, shortest_s: float, degree: int) -> Mesh:
    """The mesh on which a flight is solved first; intervals are `longest_s` at most, `shortest_s` at its ends."""
    if not problem.points:
        return end_refined(problem.start_s, problem.end_s, longest_s, shortest_s, degree)
    joints: list[float] = [problem.start_s]
    degrees: list[int] = []
    legs: list[int] = []
    rests = _rests(problem)
    for leg, (start_s, end_s) in enumerate(problem.legs_s):
        if leg and problem.points[leg - 1].hold_s:
            joints.append(start_s)
            degrees.append(0)
            legs.append(HOLD)
        lengths = _lengths(end_s - start_s, min(longest_s, _LEG_S), shortest_s, rests[leg])
        joints += [*(start_s + np.cumsum(lengths[:-1])).tolist(), end_s]
        degrees += [degree] * len(lengths)
        legs += [leg] * len(lengths)
    return Mesh(np.array(joints), tuple(degrees), legs=tuple(legs))


def _rests(problem: Problem) -> list[tuple[bool, bool]]:
    """Whether the leader is at rest at the begin and at the end of each leg."""
    stops = [point.hold_s > 0.0 for point in problem.points]
    ends = [not state[VELOCITY].any() for state in (problem.start_state, problem.end_state)]
    return list(zip([ends[0], *stops], [*stops, ends[1]], strict=True))


def _lengths(duration_s: float, longest_s: float, shortest_s: float, rests: tuple[bool, bool]) -> Array:
    """Lengths of a leg's intervals: equal, but growing from `shortest_s` where the leader is at rest."""
    growing: list[float] = []
    step = shortest_s
    while step < longest_s:
        growing.append(step)
        step *= _GROWTH
    ramps = [np.array(growing if rest else []) for rest in rests]
    most_s = 0.4 * duration_s if all(rests) else 0.7 * duration_s
    ramps = [ramp[np.cumsum(ramp) <= most_s] for ramp in ramps]
    middle_s = duration_s - sum(float(ramp.sum()) for ramp in ramps)
    count = max(int(np.ceil(middle_s / longest_s)), 1)
    return np.concatenate([ramps[0], np.full(count, middle_s / count), ramps[1][::-1]])
