"""Predicts loss of separation between two vehicles within the next seconds, from their reports.

There are two hypotheses, and a conflict under either one counts:

- Each vehicle on the plan goes on as it is flown. With setpoints it continues along the plan with its present
  deviation, which drifts on for about half a second until its controller acts. With a mission of its own it continues
  along its own predicted track, from where it is and as much slower or faster as it is now. A vehicle off the plan
  continues straight on; that counts for `STRAIGHT_S` only, because orders make it brake and turn.
- Both vehicles on the plan go straight on. That counts for `STEERED_S` only where setpoints brake a vehicle that is off
  its place, or where both hover: there each comes back to its own place. Where the plan itself has two vehicles fly so
  towards each other that they would come within `PLANNED` times the limit, this hypothesis says nothing.

Before T0 a vehicle climbs on at its present rate up to its hover, as far to the side of its pad as it is: gusts move
it, and it comes back. A vehicle more than `COLUMN_M` to the side is off the plan.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.flight.monitoring.monitor import VehicleView
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.mission.predicted.closest_approach import least_distance
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.formation.shape import Rows
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

HORIZON_S, STEP_S = 6.0, 0.25
STRAIGHT_S = 3.0
STEERED_S = 1.0  # then a vehicle has the velocity that its setpoints, or its hover, ask for
_HOVERS_MPS = 0.5  # horizontally, and slower
PLANNED = 2.0
FADE_S = 0.5
COLUMN_M = 1.0
_GRAVITY_MPS2 = 9.81
_AT_ONCE = 512  # pairs: their arrays stay in the processor's cache
_LOOKS = 3  # checks in a row with a new report: one noisy sample is no conflict


@dataclass(frozen=True)
class Conflict:
    """Two vehicles that will be, or are, closer than the limit."""

    pair: tuple[int, int]  # system ids
    in_s: float
    distance_m: float  # the least within the horizon


class SeparationWatch:
    """Checks all pairs; it reports a conflict at every check while it lasts."""

    def __init__(
        self, plan: Plan, limit_m: float, tracks: PredictedTracks | None = None, *, streamed: bool = False
    ) -> None:
        """`tracks`: of vehicles that fly missions of their own. `streamed`: they fly setpoints."""
        self._plan = plan
        self._limit_m = limit_m
        self._tracks = tracks
        self._hover_down_m = plan.states(np.array([plan.airborne_s]))[:, 0, POSITION][:, 2]
        # checks of each pair in a row, and the times of the last reports
        self._seen: dict[tuple[int, int], tuple[int, tuple[float, float]]] = {}
        self._straight_s = STEERED_S if streamed else HORIZON_S
        self._ahead_s = np.arange(0.0, HORIZON_S + STEP_S / 2, STEP_S)

    def follow(self, plan: Plan) -> None:
        """The vehicles fly another plan."""
        self._plan = plan

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
        fly = np.array([i in on_plan and i not in starting for i in sysids], dtype=np.bool_)
        paths, lines, planned = self._motions([views[i] for i in sysids], t_s, unix_s, fly, starting, falling)
        late = self._ahead_s[:-1] >= STRAIGHT_S
        hovers = np.linalg.norm(planned[:, 1, :2], axis=-1) <= _HOVERS_MPS
        found: dict[tuple[int, int], Conflict] = {}
        for ones, others in _pairs(len(sysids)):
            between = paths[others] - paths[ones]
            # (P, T - 1): fast vehicles meet between samples.
            distances, _ = least_distance(between[:, :-1], between[:, 1:])
            both = fly[others] & fly[ones]
            distances[~both[:, None] & late] = np.inf
            straight_m, first_s = self._straight(
                lines[others] - lines[ones],
                planned[others] - planned[ones],
                np.where(hovers[others] & hovers[ones], STEERED_S, self._straight_s),
            )
            straight_m[~both] = np.inf
            near = distances < self._limit_m
            for n in np.flatnonzero(near.any(axis=1) | (straight_m < self._limit_m)).tolist():
                by_path_s = float(self._ahead_s[int(np.argmax(near[n]))]) if near[n].any() else np.inf
                by_line_s = float(first_s[n]) if straight_m[n] < self._limit_m else np.inf
                pair = sysids[int(ones[n])], sysids[int(others[n])]
                least_m = min(float(distances[n].min()), float(straight_m[n]))
                found[pair] = Conflict(pair, min(by_path_s, by_line_s), least_m)
        seen = {}
        for one, other in found:
            looks, last_s = self._seen.get((one, other), (0, None))
            reported_s = views[one].unix_s, views[other].unix_s
            seen[one, other] = looks + (reported_s != last_s), reported_s
        self._seen = seen
        return [conflict for pair, conflict in found.items() if seen[pair][0] >= _LOOKS]

    def off_pad_m(self, view: VehicleView) -> float:
        """Return how far to the side of its pad a vehicle is before T0."""
        pad_ned_m = self._plan.pads_ned_m[self._plan.sysids.index(view.sysid)]
        return float(np.hypot(*(view.place_ned_m - pad_ned_m)[:2]))

    def _straight(self, flown: Array, planned: Array, for_s: Array) -> tuple[Array, Array]:
        """The least distances (P,) of pairs that go straight on for times (P,), and when they come within the limit.

        Rows of `flown` and `planned` (P, 2, 3) are relative positions and velocities.
        """
        least_m, _ = least_distance(flown[:, 0], flown[:, 0] + for_s[:, None] * flown[:, 1])
        planned_m, _ = least_distance(planned[:, 0], planned[:, 0] + for_s[:, None] * planned[:, 1])
        least_m[planned_m < PLANNED * self._limit_m] = np.inf
        closing, squared = np.sum(flown[:, 0] * flown[:, 1], axis=-1), np.sum(flown[:, 1] ** 2, axis=-1)
        inside = np.sum(flown[:, 0] ** 2, axis=-1) - self._limit_m**2
        root = np.sqrt(np.maximum(closing**2 - squared * inside, 0.0))
        return least_m, np.maximum(-(closing + root) / np.maximum(squared, 1e-9), 0.0)

    def _motions(
        self,
        views: list[VehicleView],
        t_s: float,
        unix_s: float,
        fly: NDArray[np.bool_],
        starting: Collection[int],
        falling: Collection[int],
    ) -> tuple[Array, Array, Array]:
        """Predicted positions (V, T, 3); positions and velocities (V, 2, 3), as reported and as planned."""
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
        lines = np.empty((len(views), 2, 3))
        for n, view in enumerate(views):
            age_s = max(unix_s - view.unix_s, 0.0)
            lines[n] = view.position_ned_m + age_s * view.velocity_ned_mps, view.velocity_ned_mps
            if view.sysid in starting:
                paths[n] = self._climb(view, age_s)
            elif fly[n]:
                reported = len(ahead) + n
                off, off_rate = view.position_ned_m - places[n, reported], view.velocity_ned_mps - rates[n, reported]
                paths[n] = places[n, : len(ahead)] + off + np.outer(drift_s, off_rate)
            else:
                paths[n] = view.position_ned_m + np.outer(ahead + age_s, view.velocity_ned_mps)
                if view.sysid in falling:
                    paths[n, :, 2] += 0.5 * _GRAVITY_MPS2 * (ahead + age_s) ** 2
        if self._tracks is not None and fly.any():
            own = [view for view, flies in zip(views, fly, strict=True) if flies]
            paths[fly] = self._tracks.ahead(own, unix_s - t_s, unix_s, ahead)
        return paths, lines, np.stack([places[:, 0], rates[:, 0]], axis=1)

    def _climb(self, view: VehicleView, age_s: float) -> Array:
        """Predicted positions (T, 3) of a vehicle before T0, from a report of this age."""
        seconds = np.repeat(self._ahead_s[:, None] + age_s, 3, axis=1)
        if self.off_pad_m(view) <= COLUMN_M:
            seconds[:, :2] = 0.0
        path = view.place_ned_m + seconds * view.velocity_ned_mps
        hover_down_m = self._hover_down_m[self._plan.sysids.index(view.sysid)]
        path[:, 2] = np.maximum(path[:, 2], min(view.place_ned_m[2], hover_down_m))
        return np.asarray(path)


def _pairs(count: int) -> Iterator[tuple[Rows, Rows]]:
    """All pairs of so many vehicles, first and second ones, in order; of many vehicles `_AT_ONCE` at a time."""
    first, second = np.triu_indices(count, 1)
    for begin in range(0, len(first), _AT_ONCE):
        yield first[begin : begin + _AT_ONCE], second[begin : begin + _AT_ONCE]
