"""List the returns (RTL) to verify: start, end, altitude datum, highest ground, no-fly zones on the track."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from gcs.autopilots.traits import FleetFirmware, one_each
from gcs.mission.failsafe.rtl_motion import Returning, ReturnSpeeds
from gcs.physics.quadrotor import POSITION, Array
from gcs.scenario.environment.no_fly import displacement_m, outline
from gcs.scenario.environment.terrain import ground_envelope_m

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

_LOOKS_M = 5.0  # between samples of the (smooth) ground under a return track
_LOOKS_MAX = 3_000_000


@dataclass(frozen=True)
class Crossing:
    """A no-fly zone that straight returns of some vehicles cross when they begin in [from_s, to_s] of plan time."""

    zone: int
    ends: str
    from_s: float
    to_s: float
    sysids: tuple[int, ...]


def return_cases(
    plan: Plan,
    firmware: FleetFirmware,
    speeds: ReturnSpeeds,
    period_s: float,
    within: tuple[float, float] | None = None,
    rally_ned_m: Array | None = None,
) -> list[Returning]:
    """Two cases: returns to homes, and to the nearest of home and rally points, from instants `period_s` apart.

    `rally_ned_m` (V, R, 3) are the rally points; without it, the landing points are.
    """
    begin_s, end_s = within or (plan.t_start_s, plan.t_end_s)
    count = max(2, math.ceil((end_s - begin_s) / period_s) + 1)
    t_s = np.clip(np.linspace(begin_s, end_s, count), plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf))
    start = plan.leader_trajectory.state(t_s)[:, POSITION] + plan.offsets(t_s)
    homes = np.broadcast_to(plan.pads_ned_m[:, None], start.shape)
    rally = plan.landing_points_ned_m[:, None] if rally_ned_m is None else rally_ned_m
    ends = np.concatenate([plan.pads_ned_m[:, None], rally], axis=1)
    away_m = np.linalg.norm(start[:, :, None, :2] - ends[:, None, :, :2], axis=-1)
    nearest = np.take_along_axis(ends, np.argmin(away_m, axis=-1)[..., None], axis=1)
    rows = [known.traits.returns for known in one_each(firmware, len(start))]
    above_home = np.array([row.altitude_above_home for row in rows])[:, None]
    datum = [-homes[..., 2], -np.where(above_home, homes[..., 2], nearest[..., 2])]
    waits_s = np.array([row.wait_s for row in rows])
    return [
        Returning(name, t_s, start, end, height, speeds, waits_s)
        for name, end, height in zip(("home", "nearest"), (homes, nearest), datum, strict=True)
    ]


def highest_ground_m(plan: Plan, cases: list[Returning]) -> float:
    """The highest ground under all return tracks, above the origin's height, sampled every `_LOOKS_M`."""
    start = cases[0].from_ned_m[..., :2]
    longest_m = max(float(np.linalg.norm(c.to_ned_m[..., :2] - start, axis=-1).max()) for c in cases)
    looks = max(2, math.ceil(longest_m / _LOOKS_M))
    terrain = plan.scenario.terrain
    if len(cases) * start[..., 0].size * looks > _LOOKS_MAX:
        # Too many tracks to sample each: all of them stay inside this rectangle.
        everywhere = np.concatenate([start, *(c.to_ned_m[..., :2] for c in cases)], axis=1).reshape(-1, 2)
        low, high = everywhere.min(axis=0), everywhere.max(axis=0)
        north, east = (np.arange(a, b + _LOOKS_M, _LOOKS_M) for a, b in zip(low, high, strict=True))
        return float(np.max(ground_envelope_m(terrain, *np.meshgrid(north, east))))
    shares = np.linspace(0.0, 1.0, looks)[:, None, None]
    highest = -np.inf
    for case in cases:
        track = case.to_ned_m[..., :2] - start
        north, east = (start[..., axis] + shares * track[..., axis] for axis in range(2))
        highest = max(highest, float(np.max(ground_envelope_m(terrain, north, east))))
    return highest


def crossings(plan: Plan, case: Returning) -> list[Crossing]:
    """The intervals in which a return of any vehicle would cross a no-fly zone."""
    found = []
    for number, zone in enumerate(plan.scenario.no_fly, start=1):
        # A moving zone is taken where it is when the return begins: a return is short against the zone's motion.
        moved = displacement_m(zone, case.t_s)
        ends = np.broadcast_arrays(case.from_ned_m[..., :2] - moved, case.to_ned_m[..., :2] - moved)
        tracks = shapely.linestrings(np.stack(ends, axis=-2))
        area = outline(zone).buffer(-plan.scenario.mission.tolerance_m)
        shapely.prepare(area)
        inside = shapely.intersects(area, tracks)
        through = np.flatnonzero(np.diff(np.concatenate([[False], inside.any(axis=0), [False]])))
        found += [
            Crossing(
                number,
                case.name,
                float(case.t_s[a]),
                float(case.t_s[b - 1]),
                tuple(n for n, row in zip(plan.sysids, inside[:, a:b].any(axis=1).tolist(), strict=True) if row),
            )
            for a, b in through.reshape(-1, 2).tolist()
        ]
    return found
