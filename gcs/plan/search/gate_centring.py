"""Centres a drawn route between two no-fly zones: the optimum first, then room beside the nearer zone for 0.1 % of it.

The shortest way through a gate touches the zone on the inner side of the turn, however much room is left beyond. The
flight is solved once more, from the optimum, with that zone wider by half of the difference.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
import shapely

from gcs.errors import PlanningError
from gcs.physics.states import POSITION
from gcs.plan.nlp.mesh_refinement import Optimum, with_end, with_times
from gcs.plan.ocp.problem import Problem
from gcs.plan.search.shape_schedule import optimise_on_schedule
from gcs.plan.trajectory.plan import MeshRound
from gcs.scenario.environment.no_fly import outline, signed_distance_m, widened
from gcs.types import Array

COST_SHARE = 1e-3  # of the optimum that room may cost
_TOUCHES_M = 0.6  # from a zone, as the planner avoids it: what the flight keeps to its smooth edge at most
_WIDEST_M = 30.0  # beyond the fleet, a zone makes no gate
_NOTICEABLE_M = 0.2
_EVERY_S = 0.1
_TOLERATED_M = 0.05
_CORRIDOR_SHARE = 0.9  # of a corridor that is used
_ROUNDED = 0.98  # of what the cost allows: solutions are exact to less than that
_WORTH = 40  # iterations: from the optimum, solves that succeed take 5 to 20


@dataclass(frozen=True)
class OneSidedGate:
    """A no-fly zone that the fleet touches while there is room between it and another one."""

    zone: int  # by index
    aside_m: float  # to the middle, or as far as the corridor of the leg allows


def centred(problem: Problem, best: Optimum, on_round: Callable[[MeshRound], None]) -> Optimum:
    """The flight with room on both sides in the gates of its route, where that costs next to nothing; else `best`."""
    gates = list(_gates(problem, best))
    if not gates or best.last is None:
        return best
    most, share = best.objective + COST_SHARE * abs(best.objective), 1.0
    while share > 0.0:
        try:
            found = _aside(problem, best, gates, share, on_round)
        except PlanningError:
            return best
        if found.objective <= most:
            return replace(found, history=(*best.history, *found.history))
        # Near an optimum the cost is convex: a share of the way costs no more than that share of its price.
        allowed = (most - best.objective) / (found.objective - best.objective)
        share = _ROUNDED * allowed if share == 1.0 else 0.0
    return best


def _aside(
    problem: Problem, best: Optimum, gates: list[OneSidedGate], share: float, on_round: Callable[[MeshRound], None]
) -> Optimum:
    """The best flight near the optimum, farther from the zones that it touches."""
    zones = list(problem.scenario.no_fly)
    for gate in gates:
        zones[gate.zone] = widened(problem.scenario.no_fly[gate.zone], share * gate.aside_m)
    scenario = problem.scenario.model_copy(update={"no_fly": tuple(zones)})
    end_s, time = best.trajectory.end_s, problem.free_time
    same = replace(problem, scenario=scenario, lines=best.lines)
    if time is not None:
        same = replace(with_end(same, end_s), free_time=replace(time, earliest_s=end_s, latest_s=end_s))
    same = with_times(same, end_s, best.point_s)
    return optimise_on_schedule(same, best.trajectory, on_round, warm=best.last, most=_WORTH)


def _gates(problem: Problem, best: Optimum) -> Iterator[OneSidedGate]:
    """The gates of a drawn route in which the fleet touches one side only."""
    still = [number for number, zone in enumerate(problem.scenario.no_fly) if not zone.moves]
    if not problem.points or len(still) < 2:
        return
    times = np.arange(problem.start_s, best.trajectory.end_s, _EVERY_S)
    states = best.trajectory.state(times)
    places = states[:, POSITION] + best.shape.offsets(times)  # (V, N, 3)
    zones = problem.scenario.no_fly
    away_m = {k: signed_distance_m(zones[k], places[..., 0], places[..., 1]) for k in still}
    aside_m: dict[int, float] = {}
    for near, far in permutations(still, 2):
        vehicle, at = np.unravel_index(away_m[near].argmin(), away_m[near].shape)
        here_m, there_m = float(away_m[near].min()), float(away_m[far].min())
        if not here_m < _TOUCHES_M < _NOTICEABLE_M + there_m < _WIDEST_M:
            continue
        place = places[vehicle, at, :2]
        away = _towards(outline(zones[near]), place)
        if away @ _towards(outline(zones[far]), place) >= 0.0:
            continue  # both are on one side
        wanted_m = min(0.5 * (there_m - here_m), _corridor_left_m(best, float(times[at]), states[at], away))
        if wanted_m > _NOTICEABLE_M:
            aside_m[near] = min(wanted_m, aside_m.get(near, np.inf))
    for zone, most_m in aside_m.items():
        yield OneSidedGate(zone, most_m)


def _towards(area: shapely.Polygon, place: Array) -> Array:
    """The direction (2,) from the nearest point of an area to a place (2,) outside of it."""
    core = area.buffer(-_TOLERATED_M)  # a place that touches the edge may be a hair inside
    nearest = shapely.shortest_line(area if core.is_empty else core, shapely.Point(place)).coords[0]
    away = place - np.array(nearest)
    return np.asarray(away / max(float(np.linalg.norm(away)), 1e-9))


def _corridor_left_m(best: Optimum, t_s: float, state: Array, direction: Array) -> float:
    """How far the leader may move in a direction (2,) within the corridor of its leg."""
    leg = int(np.searchsorted(best.point_s, t_s))
    line = best.lines[leg] if best.lines else None
    if line is None or np.isinf(line.limits.corridor_m):
        return np.inf
    along = (line.to_ned_m - line.from_ned_m)[:2]
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    across = np.array([-along[1], along[0]])
    side = float(direction @ across)
    off_m = float((state[:2] - line.from_ned_m[:2]) @ across) * np.sign(side)
    return float((_CORRIDOR_SHARE * line.limits.corridor_m - off_m) / max(abs(side), 1e-9))
