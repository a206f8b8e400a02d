"""Predicts loss of separation between two vehicles within the next seconds, from their reports.

A vehicle on the plan continues along it with its present deviation, which drifts on for about half a second until its
controller acts. A vehicle off the plan continues straight on. The relative motion of two vehicles on the plan was
verified, so only their deviations bring them too close.

Before T0 a vehicle climbs on at its present rate up to its hover, as far to the side of its pad as it is: gusts move
it, and it comes back. A vehicle more than `COLUMN_M` to the side is off the plan.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from gcs.flight.monitoring.monitor import VehicleView
from gcs.mission.predicted.closest_approach import least_distance
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

HORIZON_S, STEP_S = 3.0, 0.25
FADE_S = 0.5
COLUMN_M = 1.0
_GRAVITY_MPS2 = 9.81
_LOOKS = 3  # checks in a row: one noisy sample is no conflict


@dataclass(frozen=True)
class Conflict:
    """Two vehicles that will be, or are, closer than the limit."""

    pair: tuple[int, int]  # system ids
    in_s: float
    distance_m: float  # the least within the horizon


class SeparationWatch:
    """Checks all pairs; it reports a conflict at every check while it lasts."""

    def __init__(self, plan: Plan, limit_m: float) -> None:
        self._plan = plan
        self._limit_m = limit_m
        self._hover_down_m = plan.states(np.array([plan.airborne_s]))[:, 0, POSITION][:, 2]
        self._seen: dict[tuple[int, int], int] = {}
        self._ahead_s = np.arange(0.0, HORIZON_S + STEP_S / 2, STEP_S)

    def look(
        self,
        views: Mapping[int, VehicleView],
        t_s: float,
        unix_s: float,
        on_plan: Collection[int],
        aloft: Collection[int],
        starting: Collection[int] = (),
        falling: Collection[int] = (),
    ) -> list[Conflict]:
        """Return the conflicts between vehicles `aloft` at plan time `t_s`, which is `unix_s`.

        Vehicles `on_plan` fly it; those `starting` climb over their pads, or stand on them; those `falling` have no
        motors.
        """
        sysids = [i for i in aloft if np.isfinite(views[i].position_ned_m).all()]
        paths = self._paths([views[i] for i in sysids], t_s, unix_s, on_plan, starting, falling)
        found: dict[tuple[int, int], Conflict] = {}
        for a in range(len(sysids) - 1):
            between = paths[a + 1 :] - paths[a]
            distances, _ = least_distance(
                between[:, :-1], between[:, 1:]
            )  # (rest, T - 1): fast vehicles meet between samples
            for b in np.flatnonzero((distances < self._limit_m).any(axis=1)).tolist():
                first = int(np.argmax(distances[b] < self._limit_m))
                pair = sysids[a], sysids[a + 1 + b]
                found[pair] = Conflict(pair, float(self._ahead_s[first]), float(distances[b].min()))
        self._seen = {pair: self._seen.get(pair, 0) + 1 for pair in found}
        return [conflict for pair, conflict in found.items() if self._seen[pair] >= _LOOKS]

    def off_pad_m(self, view: VehicleView) -> float:
        """Return how far to the side of its pad a vehicle is before T0."""
        pad_ned_m = self._plan.pads_ned_m[self._plan.sysids.index(view.sysid)]
        return float(np.hypot(*(view.place_ned_m - pad_ned_m)[:2]))

    def _paths(
        self,
        views: list[VehicleView],
        t_s: float,
        unix_s: float,
        on_plan: Collection[int],
        starting: Collection[int],
        falling: Collection[int],
    ) -> Array:
        """Predicted positions (V, T, 3)."""
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
            if view.sysid in starting:
                paths[n] = self._climb(view, max(unix_s - view.unix_s, 0.0))
            elif view.sysid in on_plan:
                reported = len(ahead) + n
                off, off_rate = view.position_ned_m - places[n, reported], view.velocity_ned_mps - rates[n, reported]
                paths[n] = places[n, : len(ahead)] + off + np.outer(drift_s, off_rate)
            else:
                age_s = max(unix_s - view.unix_s, 0.0)
                paths[n] = view.position_ned_m + np.outer(ahead + age_s, view.velocity_ned_mps)
                if view.sysid in falling:
                    paths[n, :, 2] += 0.5 * _GRAVITY_MPS2 * (ahead + age_s) ** 2
        return paths

    def _climb(self, view: VehicleView, age_s: float) -> Array:
        """Predicted positions (T, 3) of a vehicle before T0, from a report of this age."""
        seconds = np.repeat(self._ahead_s[:, None] + age_s, 3, axis=1)
        if self.off_pad_m(view) <= COLUMN_M:
            seconds[:, :2] = 0.0
        path = view.place_ned_m + seconds * view.velocity_ned_mps
        hover_down_m = self._hover_down_m[self._plan.sysids.index(view.sysid)]
        path[:, 2] = np.maximum(path[:, 2], min(view.place_ned_m[2], hover_down_m))
        return np.asarray(path)
