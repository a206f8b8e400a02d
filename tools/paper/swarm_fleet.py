"""Vehicles planned by PSO one after another, each with the earlier tracks as obstacles; then looked at as a fleet.

Knows: the order, and what a set of tracks amounts to: times, energy, clearance, separation. Does not know: pymoo.
"""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass

import numpy as np

from gcs.physics.quadrotor import Array
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.si import NED_FROM_UP, offsets_ned_m
from tools.paper.swarm import Found, Search, search

GRID_S = 0.05


@dataclass(frozen=True)
class Fleet:
    """What became of every vehicle, in the order of planning."""

    scenario: Scenario
    found: list[Found]

    @property
    def tracks_m(self) -> list[Array]:
        """Places (T_v, 3), north, east and height."""
        return [f.track_m for f in self.found]


def plan(scenario: Scenario, seed: int, limit_s: float = np.inf, total_s: float = np.inf) -> Fleet:
    """One after another; `limit_s` is each one's time; when all together had `total_s`, the rest is not planned."""
    offsets_m = offsets_ned_m(scenario) * NED_FROM_UP
    began = time.process_time()
    start, end = np.array(scenario.start.position_m), np.array(scenario.end.position_m)
    found: list[Found] = []
    for number, offset in enumerate(offsets_m):
        if time.process_time() - began > total_s:
            break
        problem = Search(scenario, start + offset, end + offset, [f.track_m for f in found])
        found.append(search(problem, seed * 1000 + number, limit_s))
    return Fleet(scenario, found)


def clearance_m(fleet: Fleet) -> float:
    """Least height over the exact ground, of any vehicle at any instant."""
    terrain = fleet.scenario.terrain
    return min(float((t[:, 2] - ground_height_m(terrain, t[:, 0], t[:, 1])).min()) for t in fleet.tracks_m)


def separation_m(fleet: Fleet) -> float:
    """Least distance of two vehicles at the same time; a vehicle that has arrived waits at its end."""
    last = max(len(t) for t in fleet.tracks_m)
    places = np.stack([t[np.minimum(np.arange(last), len(t) - 1)] for t in fleet.tracks_m])
    return min(float(np.linalg.norm(a - b, axis=1).min()) for a, b in itertools.combinations(places, 2))


def energy_J(fleet: Fleet, arrival_s: float | None = None) -> float:
    """Eq. 32 summed over vehicles; with `arrival_s` each one's way flown at the constant speed that arrives then."""
    k_f = fleet.scenario.objective.drag_power_Ns2pm2
    total = 0.0
    for found in fleet.found:
        steps = np.linalg.norm(np.diff(found.track_m, axis=0), axis=1)
        durations = np.diff(np.append(np.arange(len(steps)) * GRID_S, found.arrival_s))
        if arrival_s is not None:
            durations = steps / (steps.sum() / arrival_s)
        counted = durations > 1e-9
        total += float((k_f * steps[counted] ** 3 / durations[counted] ** 2).sum())
    return total


def course_deg(track_m: Array) -> float:
    """Direction of the last metre."""
    away = np.linalg.norm(track_m - track_m[-1], axis=1)
    before = track_m[np.flatnonzero(away > 1.0)[-1]]
    north, east = track_m[-1, :2] - before[:2]
    return float(np.degrees(np.arctan2(east, north)))


def turn_deg(a_deg: float, b_deg: float) -> float:
    """Angle between two directions."""
    return abs((a_deg - b_deg + 180.0) % 360.0 - 180.0)
