"""Gates of a route: two no-fly zones with the fleet between them, and how far it passes from each."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import shapely

from gcs.physics.states import POSITION
from gcs.plan.formation.shape import Shape
from gcs.plan.trajectory.leg_lines import LegLine
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.trajectory.zone_margin import kept_margin
from gcs.scenario.environment.no_fly import outline, signed_distance_m
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array

_TOUCHES_M = 0.6  # from a zone, as the planner avoids it: what the flight keeps to its smooth edge at most
_WIDEST_M = 30.0  # beyond the fleet, a zone makes no gate
_NOTICEABLE_M = 0.2
_EVERY_S = 0.1
_TOLERATED_M = 0.05
_CORRIDOR_SHARE = 0.9  # of a corridor that is used


@dataclass(frozen=True)
class OneSidedGate:
    """A no-fly zone that the fleet touches while there is room between it and another one."""

    zone: int  # by index
    far_zone: int  # by index: the other side
    aside_m: float  # to the middle, or as far as the corridor of the leg allows


def one_sided_gates(
    scenario: Scenario, trajectory: Trajectory, shape: Shape, lines: tuple[LegLine, ...], point_s: tuple[float, ...]
) -> list[OneSidedGate]:
    """The gates in which the fleet touches one side only, one for each zone that it touches.

    `lines` are the drawn lines of the legs, `point_s` the times at which the leader is at the points between them, s.
    """
    zones = scenario.no_fly
    still = [number for number, zone in enumerate(zones) if not zone.moves]
    if not point_s or len(still) < 2:
        return []
    times = np.arange(trajectory.start_s, trajectory.end_s, _EVERY_S)
    states = trajectory.state(times)
    places = states[:, POSITION] + shape.offsets(times)  # (V, N, 3)
    away_m = {k: signed_distance_m(zones[k], places[..., 0], places[..., 1]) for k in still}
    gates: dict[int, OneSidedGate] = {}
    for near, far in permutations(still, 2):
        vehicle, at = np.unravel_index(away_m[near].argmin(), away_m[near].shape)
        here_m, there_m = float(away_m[near].min()), float(away_m[far].min())
        if not here_m < _TOUCHES_M < _NOTICEABLE_M + there_m < _WIDEST_M:
            continue
        place = places[vehicle, at, :2]
        away = _towards(outline(zones[near]), place)
        if away @ _towards(outline(zones[far]), place) >= 0.0:
            continue  # both are on one side
        left_m = _corridor_left_m(lines, point_s, float(times[at]), states[at], away)
        aside_m = min(0.5 * (there_m - here_m), left_m)
        if aside_m > _NOTICEABLE_M and (near not in gates or aside_m < gates[near].aside_m):
            gates[near] = OneSidedGate(near, far, aside_m)
    return list(gates.values())


def gates_of(plan: Plan) -> Iterator[tuple[OneSidedGate, float, float]]:
    """The one-sided gates of a plan, with the least distances of its vehicles to the near and to the far zone, m."""
    for gate in one_sided_gates(kept_margin(plan), plan.leader_trajectory, plan.shape, plan.lines, plan.route_s):
        places = plan.states(np.arange(plan.t_start_s, plan.t_end_s, _EVERY_S))[..., POSITION]
        near_m, far_m = (
            float(signed_distance_m(plan.scenario.no_fly[number], places[..., 0], places[..., 1]).min())
            for number in (gate.zone, gate.far_zone)
        )
        yield gate, near_m, far_m


def _towards(area: shapely.Polygon, place: Array) -> Array:
    """The direction (2,) from the nearest point of an area to a place (2,) outside of it."""
    core = area.buffer(-_TOLERATED_M)  # a place that touches the edge may be a hair inside
    nearest = shapely.shortest_line(area if core.is_empty else core, shapely.Point(place)).coords[0]
    away = place - np.array(nearest)
    return np.asarray(away / max(float(np.linalg.norm(away)), 1e-9))


def _corridor_left_m(
    lines: tuple[LegLine, ...], point_s: tuple[float, ...], t_s: float, state: Array, direction: Array
) -> float:
    """How far the leader may move in a direction (2,) within the corridor of its leg."""
    leg = int(np.searchsorted(point_s, t_s))
    line = lines[leg] if lines else None
    if line is None or np.isinf(line.limits.corridor_m):
        return np.inf
    along = (line.to_ned_m - line.from_ned_m)[:2]
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    across = np.array([-along[1], along[0]])
    side = float(direction @ across)
    off_m = float((state[:2] - line.from_ned_m[:2]) @ across) * np.sign(side)
    return float((_CORRIDOR_SHARE * line.limits.corridor_m - off_m) / max(abs(side), 1e-9))
