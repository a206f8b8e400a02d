"""Who will come too near to whom within the next seconds, by what vehicles tell of themselves.

Knows: places and velocities, the plan for those who fly it. Does not know: truth, what is then done (`rules`).

Who flies the plan goes on along it, as far off as it is now: what is off drifts on with its velocity for about half a
second, because its controller is at work. Whoever does not goes straight on. Relative motion of two who fly the plan
is the formation's own, which was verified; only what they are off can bring them together.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from gcs.flight.monitor import VehicleView
from gcs.mission.predicted.closest_approach import least_distance
from gcs.physics.quadrotor import POSITION, VELOCITY, Array
from gcs.plan.trajectory.plan import Plan

HORIZON_S, STEP_S = 3.0, 0.25
FADE_S = 0.5
_LOOKS = 3  # in a row: one sample of noise is no conflict


@dataclass(frozen=True)
class Conflict:
    """Two vehicles that will be (or are) nearer than allowed."""

    pair: tuple[int, int]  # system ids
    in_s: float
    distance_m: float  # the least within the horizon


class SeparationWatch:
    """Looks at all pairs; a conflict is told again in every look as long as it lasts."""

    def __init__(self, plan: Plan, limit_m: float) -> None:
        self._plan = plan
        self._limit_m = limit_m
        self._seen: dict[tuple[int, int], int] = {}
        self._ahead_s = np.arange(0.0, HORIZON_S + STEP_S / 2, STEP_S)

    def look(
        self,
        views: Mapping[int, VehicleView],
        t_s: float,
        unix_s: float,
        on_plan: Collection[int],
        aloft: Collection[int],
    ) -> list[Conflict]:
        """Conflicts between vehicles `aloft` at plan time `t_s`, which is `unix_s`."""
        sysids = [i for i in aloft if np.isfinite(views[i].position_ned_m).all()]
        if len(sysids) < 2:
            return []
        paths = self._paths([views[i] for i in sysids], t_s, unix_s, [i in on_plan for i in sysids])
        found: dict[tuple[int, int], Conflict] = {}
        for a in range(len(sysids) - 1):
            between = paths[a + 1 :] - paths[a]
            distances, _ = least_distance(
                between[:, :-1], between[:, 1:]
            )  # (rest, T - 1): fast ones meet between looks
            for b in np.flatnonzero((distances < self._limit_m).any(axis=1)).tolist():
                first = int(np.argmax(distances[b] < self._limit_m))
                pair = sysids[a], sysids[a + 1 + b]
                found[pair] = Conflict(pair, float(self._ahead_s[first]), float(distances[b].min()))
        self._seen = {pair: self._seen.get(pair, 0) + 1 for pair in found}
        return [conflict for pair, conflict in found.items() if self._seen[pair] >= _LOOKS]

    def _paths(self, views: list[VehicleView], t_s: float, unix_s: float, planned: list[bool]) -> Array:
        """Where they will be: (V, T, 3)."""
        plan, ahead = self._plan, self._ahead_s
        latest_s = float(np.nextafter(plan.t_end_s, -np.inf))
        rows = [plan.sysids.index(v.sysid) for v in views]
        instants = np.clip(
            np.concatenate([t_s + ahead, [v.unix_s - unix_s + t_s for v in views]]), plan.t_start_s, latest_s
        )
        leader = plan.leader_trajectory.state(instants)
        places = leader[:, POSITION] + plan.shape.offsets(instants)[rows]
        rates = leader[:, VELOCITY] + plan.shape.offsets(instants, 1)[rows]
        drift_s = FADE_S * (1.0 - np.exp(-ahead / FADE_S))
        paths = np.empty((len(views), len(ahead), 3))
        for n, view in enumerate(views):
            if planned[n]:
                told = len(ahead) + n
                off, off_rate = view.position_ned_m - places[n, told], view.velocity_ned_mps - rates[n, told]
                paths[n] = places[n, : len(ahead)] + off + np.outer(drift_s, off_rate)
            else:
                age_s = max(unix_s - view.unix_s, 0.0)
                paths[n] = view.position_ned_m + np.outer(ahead + age_s, view.velocity_ned_mps)
        return paths
