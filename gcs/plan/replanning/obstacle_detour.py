"""Initial guesses of a re-plan: back to the old trajectory from the leader's state, and around new no-fly disks.

A guess need not be flyable.
"""

import itertools
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gcs.physics.quadrotor import thrust_and_tilt
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.ocp.bounds import leader_state_bounds
from gcs.plan.ocp.problem import Problem
from gcs.plan.search.formation_poses import floor_m
from gcs.plan.search.initial_guess import height_over_ground_m, piecewise_linear
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.environment.no_fly import displacement_m, outside_m
from gcs.scenario.schema.scenario import NoFlyZone
from gcs.types import Array

_EVERY_S = 0.5
_BACK_S, _BACK_MPS = 6.0, 1.0  # the return to the plan takes this time, and its distance over this speed
_ROOM_M = 2.0  # distance from the edge of a disk
_SMOOTHING_S = 2.0
_IMPASSABLE_M = 1e3  # excess height of a place that is infeasible at every height
_BLOCKED_M = 5.0  # with so much excess over the ceiling the solver finds no flight
_MOVED_M = 1.0  # at this distance from the old path the height is computed anew
_SIDES = (1, -1)


def detours(problem: Problem, old: Trajectory, new: tuple[NoFlyZone, ...]) -> list[Trajectory]:
    """Guesses for a flight from `problem.start_state`, the shortest first: one for each side of the new disks.

    Sides that other zones, or ground above the ceiling, block are left out; so the list may be empty.
    """
    times = np.linspace(problem.start_s, problem.end_s, max(int(problem.duration_s / _EVERY_S), 40) + 1)
    inside = np.clip(times, old.start_s, np.nextafter(old.end_s, -np.inf))
    planned, controls = old.state(inside)[:, :12], old.control(inside)[:, :4]
    off = problem.start_state - planned[0]
    path = planned[:, POSITION] + _faded(times, off)
    found: list[Array] = []
    for sides in itertools.product(_SIDES, repeat=len(new)):
        around = path
        for zone, side in zip(new, sides, strict=True):
            around = _around(problem, times, around, zone, side)
        if not any(np.array_equal(around, known) for known in found):
            found.append(around)
    known = problem.scenario.no_fly[: len(problem.scenario.no_fly) - len(new)]
    before = replace(problem, scenario=problem.scenario.model_copy(update={"no_fly": known}))
    priced = sorted(((_price(before, around), number) for number, around in enumerate(found)))
    return [
        _trajectory(problem, times, planned, controls, found[number], off)
        for (_, blocked), number in priced
        if not (new and blocked)
    ]


def _faded(times: Array, off: Array) -> Array:
    """A displacement (N, 3) from an offset and its speed to zero, without acceleration at both ends."""
    remaining_s = float(times[-1] - times[0])
    back_s = min(_BACK_S + float(np.linalg.norm(off[POSITION])) / _BACK_MPS, 0.8 * remaining_s)
    r = np.clip((times - times[0]) / back_s, 0.0, 1.0)[:, None]
    place = 1.0 - r**3 * (10.0 - 15.0 * r + 6.0 * r**2)
    speed = r - r**3 * (6.0 - 8.0 * r + 3.0 * r**2)
    return np.asarray(place * off[POSITION] + back_s * speed * off[VELOCITY])


def _around(problem: Problem, times: Array, path: Array, zone: NoFlyZone, side: int) -> Array:
    """The path (N, 3), around a disk on one side where it enters it."""
    assert zone.north_m is not None and zone.east_m is not None and zone.radius_m is not None
    offsets = problem.shape.offsets(times)[..., :2]  # (V, N, 2)
    inside = np.any(outside_m(zone, times, path[:, 0] + offsets[..., 0], path[:, 1] + offsets[..., 1]) < 0.0, axis=0)
    if not inside.any():
        return path
    middle = offsets.mean(axis=0)
    reach = np.linalg.norm(offsets - middle, axis=2).max(axis=0)
    centre = np.array([zone.north_m, zone.east_m]) + displacement_m(zone, times) - middle
    radius = zone.radius_m + reach + _ROOM_M
    away = path[:, :2] - centre
    distance = np.linalg.norm(away, axis=1)
    near = np.flatnonzero(distance < radius)
    first, last = max(int(near[0]) - 1, 0), min(int(near[-1]) + 1, len(times) - 1)
    bearing = np.arctan2(away[:, 1], away[:, 0])
    turn = float(np.angle(np.exp(1j * (bearing[last] - bearing[first]))))
    if turn * side < 0.0:
        turn += 2.0 * np.pi * side
    share = np.linspace(0.0, 1.0, last - first + 1)
    arc = bearing[first] + turn * share
    part = slice(first, last + 1)
    out = np.maximum(radius[part], np.interp(share, [0.0, 1.0], distance[[first, last]]))
    # From inside the circle the path leaves gradually.
    out = np.minimum(out, distance[first] + (radius[part] + 1.0) * share * 8.0)
    out = np.minimum(out, distance[last] + (radius[part] + 1.0) * (1.0 - share) * 8.0)
    pushed = path.copy()
    pushed[part, :2] = centre[part] + out[:, None] * np.column_stack([np.cos(arc), np.sin(arc)])
    return _evenly(times, path, pushed)


def _evenly(times: Array, path: Array, pushed: Array) -> Array:
    """The longer path (N, 3) at the old speeds, all scaled up alike; its corners are rounded."""
    old, new = _lengths(path), _lengths(pushed)
    at = np.interp(old / old[-1] * new[-1], new, np.arange(len(times)))
    moved = np.column_stack([np.interp(at, np.arange(len(times)), column) for column in pushed.T])
    line = np.linspace(moved[0], moved[-1], len(moved))
    sigma = _SMOOTHING_S / (times[1] - times[0])
    return np.asarray(line + gaussian_filter1d(moved - line, sigma, axis=0, mode="nearest"))


def _lengths(path: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1) + 1e-6)])


def _price(problem: Problem, path: Array) -> tuple[float, bool]:
    """Length in m, plus the excess of ground over the ceiling; and whether the path is blocked."""
    ceiling_m = float(-problem.state_low[2])
    floor = floor_m(problem, problem.shape.at(problem.start_s), path[:, 0], path[:, 1])
    excess = np.minimum(np.maximum(floor - ceiling_m, 0.0), _IMPASSABLE_M)
    length_m = float(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1).sum())
    return length_m + float(excess.sum()), bool(excess.max() > _BLOCKED_M)


def _trajectory(problem: Problem, times: Array, planned: Array, controls: Array, path: Array, off: Array) -> Trajectory:
    """States and controls that fly a path (N, 3); where it is the planned one, those of the plan (N, 12), (N, 4)."""
    change = path - planned[:, POSITION]
    speed = np.gradient(change, times, axis=0)
    push = np.gradient(speed, times, axis=0)
    states, controls = planned.copy(), controls.copy()
    states[:, POSITION] += change
    states[:, VELOCITY] += speed
    q = problem.quadrotor
    before = np.gradient(planned[:, VELOCITY], times, axis=0)
    wind = np.stack([np.broadcast_to(part, times.shape) for part in q.wind.at(-planned[:, 2])], axis=-1)
    yaw = planned[:, 8]
    old = thrust_and_tilt(before, planned[:, VELOCITY] - wind, yaw, q)
    new = thrust_and_tilt(before + push, states[:, VELOCITY] - wind, yaw, q)
    states[:, 6] += new[1] - old[1]
    states[:, 7] += new[2] - old[2]
    fade = np.exp(-(times - times[0]) / _BACK_S)[:, None]
    states[:, 8:9] += fade * off[8]
    controls[:, 0] += new[0] - old[0]
    moved = np.clip(np.linalg.norm(change[:, :2], axis=1) / _MOVED_M - 0.5, 0.0, 1.0)
    if moved.any():
        highest = -height_over_ground_m(problem, times, states)
        states[:, 2] += moved * (np.minimum(states[:, 2], highest) - states[:, 2])
        low, high = leader_state_bounds(problem, times)
        states[:, 2] = np.clip(states[:, 2], low[:, 2], high[:, 2])
    states[0] = problem.start_state
    return Trajectory(piecewise_linear(times, states), piecewise_linear(times, controls))
