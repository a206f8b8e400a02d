"""List the returns (RTL) to verify: start, end, altitude datum, highest ground."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs.autopilots.traits import FleetFirmware, one_each
from gcs.mission.failsafe.rtl_motion import Returning, ReturnSpeeds
from gcs.physics.quadrotor import POSITION, Array
from gcs.scenario.environment.no_fly import ZoneName
from gcs.scenario.environment.terrain import ground_envelope_m

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

_LOOKS_M = 5.0  # between samples of the (smooth) ground under a return track
_LOOKS_MAX = 3_000_000


@dataclass(frozen=True)
class Crossing:
    """A zone that straight returns of some vehicles cross only if they begin in [from_s, to_s] of plan time."""

    zone: int
    ends: str
    from_s: float
    to_s: float
    sysids: tuple[int, ...]
    keep_in: bool = False  # the zone is what is outside a keep-in area

    @property
    def name(self) -> ZoneName:
        """The name of the zone."""
        return ZoneName(self.zone, self.keep_in)


@dataclass(frozen=True)
class ReturnEnds:
    """Where each vehicle may return to (V, E, 3): its home, then its rally points. Waits above the ends (V,)."""

    ned_m: Array
    above_home: NDArray[np.bool_]  # (V,) whether return altitudes count from home, wherever the vehicle returns to
    waits_s: Array

    def datum_m(self, to_ned_m: Array, *, to_rally: bool) -> Array:
        """The heights (V, N) that return altitudes count from, of returns to (V, N, 3)."""
        homes = np.broadcast_to(self.ned_m[:, :1, 2], to_ned_m.shape[:2])
        return np.asarray(-np.where(self.above_home[:, None] | (not to_rally), homes, to_ned_m[..., 2]))


def return_ends(plan: Plan, firmware: FleetFirmware, rally_ned_m: Array | None = None) -> ReturnEnds:
    """The ends of a fleet's returns; the rally points (V, R, 3) are the landing points if they are not given."""
    rows = [known.traits.returns for known in one_each(firmware, len(plan.sysids))]
    rally = plan.landing_points_ned_m[:, None] if rally_ned_m is None else rally_ned_m
    ends = np.concatenate([plan.pads_ned_m[:, None], rally], axis=1)
    above_home = np.array([row.altitude_above_home for row in rows])
    return ReturnEnds(ends, above_home, np.array([row.wait_s for row in rows]))


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
    ends = return_ends(plan, firmware, rally_ned_m)
    homes = np.broadcast_to(plan.pads_ned_m[:, None], start.shape)
    away_m = np.linalg.norm(start[:, :, None, :2] - ends.ned_m[:, None, :, :2], axis=-1)
    nearest = np.take_along_axis(ends.ned_m, np.argmin(away_m, axis=-1)[..., None], axis=1)
    return [
        Returning(name, t_s, start, end, ends.datum_m(end, to_rally=to_rally), speeds, ends.waits_s)
        for name, end, to_rally in (("home", homes, False), ("nearest", nearest, True))
    ]


def highest_ground_m(plan: Plan, cases: list[Returning]) -> float:
    """The highest envelope of the ground under all return tracks, above the origin's height, every `_LOOKS_M`."""
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
