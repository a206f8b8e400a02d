"""Position and time errors at each point of the route."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gcs.flight.assessment.criterion import Criterion, CriterionName
from gcs.physics.states import POSITION
from gcs.plan.trajectory.passages import Passage
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array, JsonObject

Track = tuple[Array, Array]  # plan times (N,) and positions (N, 3), NED, of one vehicle
_NEAR_M = 1.0  # beyond its nearest point: a vehicle that stops has arrived
_STEP_S = 0.05
_LATE_S = 3.0


@dataclass(frozen=True)
class PointPassed:
    """The passing of one route point by each vehicle; NaN where a vehicle's track does not tell."""

    passage: Passage
    distance_m: dict[int, float]  # least distance from its place there, near the planned time
    late_s: dict[int, float]  # then, or on its arrival where the leader holds

    def data(self, leader: int) -> JsonObject:
        """The values for `--json`, null where one is not known."""
        return {
            "point": self.passage.number,
            "name": self.passage.point.name,
            "planned_s": self.passage.arrives_s,
            "hold_s": self.passage.point.hold_s,
            "leader_late_s": _known(self.late_s[leader]),
            "leader_distance_m": _known(self.distance_m[leader]),
            "distance_m": {str(sysid): _known(metres) for sysid, metres in self.distance_m.items()},
            "late_s": {str(sysid): _known(seconds) for sysid, seconds in self.late_s.items()},
        }

    @property
    def farthest(self) -> tuple[int, float] | None:
        """The vehicle that stayed farthest from its place, and how far, m; None where none is known."""
        known = {sysid: metres for sysid, metres in self.distance_m.items() if np.isfinite(metres)}
        return max(known.items(), key=lambda item: item[1]) if known else None


def counted_s(plan: Plan) -> float:
    """How early or late a vehicle may pass a point: 3 s, or as much as at the arrival where that is more."""
    return max(plan.scenario.judge.arrival_time_s, _LATE_S)


def points_passed(plan: Plan, tracks: Mapping[int, Track]) -> tuple[PointPassed, ...]:
    """Return them in order, for the vehicles of `tracks` by system id.

    A vehicle's place at a point is where the plan has it when the leader is due there. Only what it flew within
    `counted_s` of that time counts, or of the hold there.
    """
    found = []
    for passage in plan.passages:
        distance_m, late_s = {}, {}
        for sysid, track in tracks.items():
            distance_m[sysid], late_s[sysid] = _passing(plan, plan.sysids.index(sysid), passage, track)
        found.append(PointPassed(passage, distance_m, late_s))
    return tuple(found)


def route_criterion(plan: Plan, t_s: Array, flown: Array, within_m: Array) -> Criterion:
    """The largest distance of any vehicle at any point, of positions (V, N, 3) at plan times (N,), known to (V, N) m.

    The limit is that of the arrival; a leader that passes by a point within a radius is judged by the plan's own place.
    """
    passed = points_passed(plan, {sysid: (t_s, track) for sysid, track in zip(plan.sysids, flown, strict=True)})
    around_s, leader = counted_s(plan), plan.sysids[plan.leader]
    worst, lowest, highest = (-np.inf, leader, 0.0), -np.inf, -np.inf
    for each in passed:
        arrives_s, leaves_s = each.passage.arrives_s, each.passage.leaves_s
        window = (t_s >= arrives_s - around_s) & (t_s <= leaves_s + around_s)
        known = {sysid: metres for sysid, metres in each.distance_m.items() if np.isfinite(metres)} or {leader: np.inf}
        for sysid, metres in known.items():
            off_m = float(within_m[plan.sysids.index(sysid), window].max(initial=0.0))
            worst = max(worst, (metres, sysid, arrives_s), key=lambda one: one[0])
            lowest, highest = max(lowest, metres - off_m), max(highest, metres + off_m)
    metres, sysid, when_s = worst
    name, limit_m = CriterionName.ROUTE_POINTS, plan.scenario.judge.arrival_position_m
    return Criterion(name, "m", metres, limit_m, False, sysid, when_s, lowest=lowest, highest=highest)


def _passing(plan: Plan, row: int, passage: Passage, track: Track) -> tuple[float, float]:
    """The least distance of a vehicle from its place, and how late it was there; NaN without positions."""
    around_s = counted_s(plan)
    place = plan.motion(np.array([passage.arrives_s]), slice(row, row + 1))[0][0, 0, POSITION]
    t_s, positions = track
    window = (t_s >= passage.arrives_s - around_s) & (t_s <= passage.leaves_s + around_s)
    if window.sum() < 2:
        return np.nan, np.nan
    nearest_m, at_s = _nearest(t_s[window], positions[window] - place)
    if passage.point.hold_s is None:
        return nearest_m, at_s - passage.arrives_s
    within_m = nearest_m + _NEAR_M
    due_s = np.arange(passage.arrives_s - around_s, passage.arrives_s + _STEP_S, _STEP_S)
    due_s = due_s[due_s >= plan.t_start_s]
    planned = plan.motion(due_s, slice(row, row + 1))[0][0, :, POSITION]
    return nearest_m, _entry_s(t_s[window], positions[window] - place, within_m) - _entry_s(
        due_s, planned - place, within_m
    )


def _nearest(t_s: Array, away_m: Array) -> tuple[float, float]:
    """The least distance from 0 of a polyline (K, 3) at times (K,), and when."""
    steps = np.diff(away_m, axis=0)
    along = -np.sum(away_m[:-1] * steps, axis=1) / np.maximum(np.sum(steps * steps, axis=1), 1e-12)
    share = np.clip(along, 0.0, 1.0)
    distance_m = np.linalg.norm(away_m[:-1] + share[:, None] * steps, axis=1)
    best = int(np.argmin(distance_m))
    return float(distance_m[best]), float(t_s[best] + share[best] * (t_s[best + 1] - t_s[best]))


def _entry_s(t_s: Array, away_m: Array, within_m: float) -> float:
    return float(t_s[int(np.argmax(np.linalg.norm(away_m, axis=1) <= within_m))])


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
