"""A course: everything a vehicle will do until somebody decides otherwise, worked out beforehand.

Knows: how manoeuvres follow one another, how a mission's items become motion. Does not know: modes, arming, clocks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.frames import Origin, from_degE7, geodetic_to_ned
from gcs.link.dialect import MavCommand
from gcs.mission.model import Command, Frame, MissionItem
from gcs.quadrotor import Array
from sim_bridge.guidance.legs import Leg, fly_legs
from sim_bridge.guidance.limits import MotionLimits
from sim_bridge.guidance.manoeuvres import Descent, brake, descend, transfer
from sim_bridge.guidance.piece import Piece, hold

_SLOW_BELOW_M = 10.0  # above home: ArduPilot's LAND_ALT_LOW
_DAY_S = 86400.0
_NEAR_M = 1.0
_FASTEST_MPS = 20.0  # ArduPilot's bound of WPNAV_SPEED
_MOVED_M = 0.05  # less is no reason to fly anywhere


@dataclass(frozen=True)
class Mark:
    """At `t_s` mission item `reached` was completed, and `current` begins; either may be absent."""

    t_s: float
    reached: int | None = None
    current: int | None = None


@dataclass(frozen=True)
class Course:
    """Pieces one after the other; after the last the vehicle stands where it ended."""

    pieces: tuple[Piece, ...]
    marks: tuple[Mark, ...] = ()
    climbing_until_s: float = -math.inf  # a take-off from the ground
    landing_from_s: float = math.inf


@dataclass(frozen=True)
class Guide:
    """What a vehicle needs to know to work out courses: its abilities, its speeds, its home."""

    limits: MotionLimits
    origin: Origin
    home_ned_m: Array  # (3,), common local NED
    speed_mps: float
    land_mps: float
    descend_mps: float
    rtl_height_m: float
    epoch_unix_s: float = 0.0  # GNSS time at simulated time 0
    return_wait_s: float = 0.0  # over home, before it descends

    def take_off(self, t_s: float, flat: Array, height_m: float) -> Course:
        """Straight up to `height_m` above home."""
        target = flat[0].copy()
        target[2] = self.home_ned_m[2] - height_m
        piece = transfer(t_s, flat, target, self.limits)
        return Course((piece,), climbing_until_s=piece.end_s)

    def stop(self, t_s: float, flat: Array) -> Course:
        """Brake and stand."""
        return Course((brake(t_s, flat, self.limits),))

    def go_to(self, t_s: float, flat: Array, target: Array) -> Course:
        """Fly to `target` (4,): north, east, down, yaw."""
        return Course((transfer(t_s, flat, target, self.limits),))

    def land(self, t_s: float, flat: Array) -> Course:
        """Brake, then straight down."""
        stop = brake(t_s, flat, self.limits)
        way = Descent(self.home_ned_m[2] - _SLOW_BELOW_M, self.descend_mps, self.land_mps)
        down = descend(stop.end_s, stop.at(stop.end_s), way, self.limits)
        return Course((stop, *down), landing_from_s=t_s)

    def return_home(self, t_s: float, flat: Array) -> Course:
        """Up to the return height, over home, down."""
        pieces = [brake(t_s, flat, self.limits)]
        top_ned_m = self.home_ned_m[2] - self.rtl_height_m
        over = pieces[-1].at(pieces[-1].end_s)[0].copy()
        over[2] = min(over[2], top_ned_m)
        for north_east in (over[:2].copy(), self.home_ned_m[:2]):
            over[:2] = north_east
            now = pieces[-1].at(pieces[-1].end_s)
            if np.linalg.norm(now[0] - over) > _MOVED_M:
                pieces.append(transfer(pieces[-1].end_s, now, over.copy(), self.limits))
        if self.return_wait_s > 0.0:
            start_s, now = pieces[-1].end_s, pieces[-1].at(pieces[-1].end_s)
            pieces.append(Piece(start_s, start_s + self.return_wait_s, hold(start_s, now).coefficients))
        down = self.land(pieces[-1].end_s, pieces[-1].at(pieces[-1].end_s))
        return Course((*pieces, *down.pieces), landing_from_s=down.landing_from_s)

    def fly_mission(self, t_s: float, flat: Array, items: Sequence[MissionItem], first: int, landed: bool) -> Course:
        """The items from seq `first` on; item 0 is home. A vehicle on the ground starts with NAV_TAKEOFF."""
        return _MissionCourse(self, t_s, flat, items).build(first, landed)


class _MissionCourse:
    """Turns items into pieces and marks, with the vehicle's motion at the end of what is there so far.

    Waypoints up to the next stop form one smooth curve, so they are gathered first and flown when it comes.
    """

    def __init__(self, guide: Guide, t_s: float, flat: Array, items: Sequence[MissionItem]) -> None:
        self._guide = guide
        self._items = items
        self._pieces: list[Piece] = []
        self._marks: list[Mark] = []
        self._t_s = t_s
        self._flat = flat
        self._item_ned_m: Array | None = None  # where the last item with a position was
        self._speed_mps = guide.speed_mps
        self._legs: list[Leg] = []
        self._leg_seqs: list[int] = []
        self._climbing_until_s = -math.inf
        self._landing_from_s = math.inf

    def build(self, first: int, landed: bool) -> Course:
        navs = [seq for seq in range(max(first, 1), len(self._items)) if is_navigation(self._items[seq].command)]
        self._marks.append(Mark(self._t_s, current=navs[0]))
        if not landed:
            self._follow(brake(self._t_s, self._flat, self._guide.limits))
        for seq in range(max(first, 1), len(self._items)):
            self._take(seq, self._items[seq])
        self._fly_legs()
        return Course(tuple(self._pieces), tuple(self._marks), self._climbing_until_s, self._landing_from_s)

    def _take(self, seq: int, item: MissionItem) -> None:
        command, (p1, p2, *_) = item.command, item.params
        if command == Command.DO_CHANGE_SPEED and p1 in (0.0, 1.0) and p2 > 0:
            self._speed_mps = min(p2, _FASTEST_MPS)
        elif command == Command.NAV_WAYPOINT:
            self._add_leg(seq, self._place(item))
            if p1 > 0:
                self._fly_legs(p1)
        elif command == Command.NAV_DELAY and p1 > 0 and self._legs:
            self._legs.append(Leg(self._legs[-1].to_ned_m, p1))
            self._leg_seqs.append(seq)
        elif command == Command.NAV_TAKEOFF:
            self._fly_legs()
            self._climb(seq, self._place(item)[2])
            self._item_ned_m = self._place(item)
        elif command == Command.NAV_DELAY:
            self._fly_legs()
            self._wait(p1 if p1 > 0 else self._until_time_of_day_s(item))
            self._completed(seq, self._t_s)
        elif command == Command.NAV_LAND:
            self._fly_legs()
            self._land(item)
        elif command == MavCommand.NAV_RETURN_TO_LAUNCH:
            self._fly_legs()
            home = self._guide.return_home(self._t_s, self._flat)
            self._pieces += home.pieces
            self._landing_from_s = home.landing_from_s

    def _add_leg(self, seq: int, place: Array) -> None:
        """A leg's time counts from the item before it: a hover some centimetres off must not change it."""
        here = self._flat[0, :3]
        origin = self._legs[-1].to_ned_m if self._legs else self._item_ned_m
        if origin is None or (not self._legs and np.linalg.norm(origin - here) > _NEAR_M):
            origin = here
        self._legs.append(Leg(place, float(np.linalg.norm(place - origin)) / self._speed_mps))
        self._leg_seqs.append(seq)

    def _fly_legs(self, wait_s: float = 0.0) -> None:
        pieces, passed = fly_legs(self._t_s, self._flat[0], self._legs, self._guide.limits)
        for piece in pieces:
            self._follow(piece)
        self._wait(wait_s)
        for seq, t_s in zip(self._leg_seqs, passed, strict=True):
            self._completed(seq, t_s if seq != self._leg_seqs[-1] else self._t_s)
        if self._legs:
            self._item_ned_m = self._legs[-1].to_ned_m
        self._legs, self._leg_seqs = [], []

    def _climb(self, seq: int, down_m: float) -> None:
        target = self._flat[0].copy()
        target[2] = min(down_m, target[2])
        if self._flat[0, 2] - target[2] > _MOVED_M:
            self._follow(transfer(self._t_s, self._flat, target, self._guide.limits))
            self._climbing_until_s = self._t_s
        self._completed(seq, self._t_s)

    def _land(self, item: MissionItem) -> None:
        if item.lat_degE7 or item.lon_degE7:
            target = self._flat[0].copy()
            target[:2] = self._place(item)[:2]
            if np.linalg.norm(target - self._flat[0]) > _MOVED_M:
                self._follow(transfer(self._t_s, self._flat, target, self._guide.limits))
        down = self._guide.land(self._t_s, self._flat)
        self._pieces += down.pieces
        self._landing_from_s = down.landing_from_s

    def _wait(self, duration_s: float) -> None:
        if duration_s > 0:
            still = hold(self._t_s, self._flat)
            self._follow(Piece(self._t_s, self._t_s + duration_s, still.coefficients))

    def _until_time_of_day_s(self, item: MissionItem) -> float:
        """Seconds until the UTC time of day that parameters 2 to 4 name; a time just gone by is tomorrow's."""
        hour, minute, second = item.params[1:]
        if min(hour, minute, second) < 0:
            return 0.0
        return (hour * 3600.0 + minute * 60.0 + second - self._guide.epoch_unix_s - self._t_s) % _DAY_S

    def _follow(self, piece: Piece) -> None:
        self._pieces.append(piece)
        self._t_s, self._flat = piece.end_s, piece.at(piece.end_s)

    def _completed(self, seq: int, t_s: float) -> None:
        """ArduPilot reports the last of the DO_ items that follow, because they are done in the same moment."""
        last = seq
        while last + 1 < len(self._items) and not is_navigation(self._items[last + 1].command):
            last += 1
        following = last + 1 if last + 1 < len(self._items) else None
        self._marks.append(Mark(t_s, reached=last if following else seq, current=following))

    def _place(self, item: MissionItem) -> Array:
        """Common local NED of an item; without coordinates it is where the vehicle is, at the item's height."""
        guide = self._guide
        amsl_m = item.alt_m
        if item.frame != Frame.GLOBAL:
            amsl_m += guide.origin.alt_amsl_m - guide.home_ned_m[2]
        if not (item.lat_degE7 or item.lon_degE7):
            north, east = (self._legs[-1].to_ned_m if self._legs else self._flat[0])[:2]
            return np.array([north, east, guide.origin.alt_amsl_m - amsl_m])
        return geodetic_to_ned(from_degE7(item.lat_degE7), from_degE7(item.lon_degE7), amsl_m, guide.origin)


def is_navigation(command: int) -> bool:
    """Whether a mission item moves the vehicle or makes it wait (NAV_ items), rather than changing something."""
    return command <= Command.NAV_DELAY
