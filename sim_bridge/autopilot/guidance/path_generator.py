"""Generates complete paths: take-off, flight to a position, stop, landing and return."""

import math
from dataclasses import dataclass

import numpy as np

from gcs.autopilots.waypoint_models.navigator import Navigator
from gcs.frames import Origin
from gcs.types import Array
from sim_bridge.autopilot.guidance.motion_primitives import (
    MotionLimits,
    Speeds,
    brake,
    descend,
    descend_towards,
    rise,
    transfer,
    travel,
)
from sim_bridge.autopilot.guidance.piece import Piece, PiecePath, hold

_MOVED_M = 0.05  # a target closer than this counts as reached
_LEVEL_MPS = 0.05
_SLOWER = 6  # speeds of a descent that slows down, the first and the last included
_LOOKS = 101  # sample points to find where the vehicle is within `arrive_m` of its landing point
_FLOAT_M = np.array([0.0, 0.0, 0.05, 0.0])


@dataclass(frozen=True)
class PathGenerator:
    """The limits, speeds and home of a vehicle, from which paths are generated.

    Its `navigator` flies the waypoints of missions; without one they are flown on time.
    """

    limits: MotionLimits
    origin: Origin
    home_ned_m: Array  # (3,), common local NED
    speed_mps: float = 1.0  # speeds and heights until parameters set them
    land_mps: float = 1.0
    descend_mps: float = 1.0
    rtl_height_m: float = 1.0
    epoch_unix_s: float = 0.0  # GNSS time at simulated time 0
    climb_mps: float = math.inf
    takeoff_mps: float = math.inf
    liftoff_pause_s: float = 0.0  # just above the ground, before a take-off climbs
    return_wait_s: float = 0.0  # above home, before the descent
    slow_m: tuple[float, float] = (10.0, 10.0)  # between these heights above home it slows down to `land_mps`
    crawl_below_m: float = 0.0  # above home: below this height it descends at `crawl_mps`
    crawl_mps: float = 0.0
    arrive_m: float = 0.0  # within this distance the vehicle counts as above its landing point
    rally_ned_m: tuple[Array, ...] = ()  # each (2,): the vehicle returns to the nearest one if it is nearer than home
    navigator: Navigator | None = None

    @property
    def home_amsl_m(self) -> float:
        """The altitude of home."""
        return self.origin.alt_amsl_m - float(self.home_ned_m[2])

    def take_off(self, t_s: float, flat: Array, height_m: float) -> PiecePath:
        """Return the path straight up to `height_m` above home."""
        pieces = self.climb_out(t_s, flat, self.home_ned_m[2] - height_m)
        return PiecePath(tuple(pieces), climbing_until_s=pieces[-1].end_s)

    def climb_out(self, t_s: float, flat: Array, down_m: float) -> list[Piece]:
        """Return the pieces off the ground and straight up to `down_m`."""
        if self.liftoff_pause_s <= 0.0:
            return self.climb(t_s, flat, down_m)
        off = transfer(t_s, flat, flat[0] - _FLOAT_M, self.limits)
        now = off.at(off.end_s)
        float_s = max(t_s + self.liftoff_pause_s, off.end_s)
        floating = Piece(off.end_s, float_s, hold(off.end_s, now).coefficients)
        return [off, floating, *self.climb(float_s, now, down_m)]

    def climb(self, t_s: float, flat: Array, down_m: float) -> list[Piece]:
        """Return the pieces straight up to `down_m`, at take-off speed."""
        return rise(t_s, flat, down_m, self.takeoff_mps, self.limits)

    def stop(self, t_s: float, flat: Array) -> PiecePath:
        """Return the path that brakes and holds."""
        return PiecePath((brake(t_s, flat, self.limits),))

    def go_to(self, t_s: float, flat: Array, target: Array) -> PiecePath:
        """Return the path to `target` (4,): north, east, down, yaw."""
        return PiecePath(tuple(self._travel(t_s, flat, target)))

    def land(self, t_s: float, flat: Array) -> PiecePath:
        """Return the path that brakes, then descends straight down."""
        stop = brake(t_s, flat, self.limits)
        down = self._descend(stop.end_s, stop.at(stop.end_s))
        return PiecePath((stop, *down), landing_from_s=t_s)

    def land_at(self, t_s: float, flat: Array, target: Array) -> PiecePath:
        """Return the path to above `target` (4,) at its height, then down.

        Within `arrive_m` of the target the vehicle already descends.
        """
        *before, level = self._travel(t_s, flat, target)
        t_s = level.start_s
        near = (
            s
            for s in np.linspace(t_s, level.end_s, _LOOKS)
            if math.dist(level.at(s)[0, :2], target[:2]) <= self.arrive_m
        )
        from_s = float(next(near, level.end_s))
        if self.arrive_m <= 0.0 or abs(level.at(from_s)[1, 2]) > _LEVEL_MPS:
            down = self.land(level.end_s, level.at(level.end_s))
            return PiecePath((*before, level, *down.pieces), landing_from_s=down.landing_from_s)
        straight = self._descend(from_s, hold(from_s, level.at(from_s)).at(from_s))
        first = Piece(t_s, from_s, level.coefficients)
        return PiecePath((*before, first, *descend_towards(level, straight)), landing_from_s=from_s)

    def _travel(self, t_s: float, flat: Array, target: Array) -> list[Piece]:
        speeds = Speeds(self.speed_mps, self.climb_mps, self.descend_mps)
        return travel(t_s, flat, target, speeds, self.limits)

    def _descend(self, t_s: float, flat: Array) -> list[Piece]:
        high_m, low_m = self.slow_m
        heights_m = np.linspace(high_m, low_m, _SLOWER if high_m > low_m else 1)[-(_SLOWER - 1) :]
        speeds_mps = np.linspace(self.descend_mps, self.land_mps, len(heights_m) + 1)[1:]
        slower = [
            (self.home_ned_m[2] - height_m, mps)
            for height_m, mps in zip(heights_m.tolist(), speeds_mps.tolist(), strict=True)
        ]
        if self.crawl_below_m > 0.0:
            slower.append((self.home_ned_m[2] - self.crawl_below_m, min(self.crawl_mps, self.land_mps)))
        return descend(t_s, flat, self.descend_mps, slower, self.limits)

    def return_point(self, flat: Array) -> Array:
        """The point (2,) that the vehicle returns to: home or the nearest rally point."""
        places = (self.home_ned_m[:2], *self.rally_ned_m)
        return min(places, key=lambda place: math.dist(place, flat[0, :2]))

    def return_home(self, t_s: float, flat: Array) -> PiecePath:
        """Return the path of an RTL: up to the return altitude, to above home or a rally point, down."""
        pieces = [brake(t_s, flat, self.limits)]
        top_ned_m = self.home_ned_m[2] - self.rtl_height_m
        over = pieces[-1].at(pieces[-1].end_s)[0].copy()
        over[2] = min(over[2], top_ned_m)
        now = pieces[-1].at(pieces[-1].end_s)
        if now[0, 2] - over[2] > _MOVED_M:
            pieces += rise(pieces[-1].end_s, now, over[2], self.climb_mps, self.limits)
        over[:2] = self.return_point(flat)
        now = pieces[-1].at(pieces[-1].end_s)
        away = np.linalg.norm(now[0] - over) > _MOVED_M
        if away and self.return_wait_s <= 0.0:
            home = self.land_at(pieces[-1].end_s, now, over)
            return PiecePath((*pieces, *home.pieces), landing_from_s=home.landing_from_s)
        if away:
            pieces += self._travel(pieces[-1].end_s, now, over)
        if self.return_wait_s > 0.0:
            start_s, now = pieces[-1].end_s, pieces[-1].at(pieces[-1].end_s)
            pieces.append(Piece(start_s, start_s + self.return_wait_s, hold(start_s, now).coefficients))
        down = self.land(pieces[-1].end_s, pieces[-1].at(pieces[-1].end_s))
        return PiecePath((*pieces, *down.pieces), landing_from_s=down.landing_from_s)
