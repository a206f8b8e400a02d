"""Turns mission items into a path, section by section, while the mission is flown.

Consecutive waypoints are flown together by the navigator of the path generator. Without a navigator (`--nav ideal`)
they are flown on time, as one smooth curve; a delay between two of them is part of it.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from gcs.autopilots.traits import Autopilot
from gcs.autopilots.waypoint_models.navigator import Navigator, NavigatorOrders, NavigatorState, vector
from gcs.frames import geodetic_to_ned
from gcs.mavlink import MavCommand
from gcs.mission.model import Command, Frame, MissionItem
from gcs.types import Array
from sim_bridge.autopilot.guidance.ideal_navigator import IdealLeg, fly_legs
from sim_bridge.autopilot.guidance.motion_primitives import brake, bridge
from sim_bridge.autopilot.guidance.path_generator import PathGenerator
from sim_bridge.autopilot.guidance.piece import DERIVATIVES, Mark, Piece, PiecePath, hold

_DAY_S = 86400.0
_NEAR_M = 1.0
_FASTEST_MPS = max(known.traits.missions.speed_mps[1] for known in Autopilot)  # PX4's own is part of its navigator
_MOVED_M = 0.05  # a target closer than this counts as reached
_AHEAD = 5  # pieces of a navigator's flight that are computed at once
_SETTLE_S = 8.0  # time to come to rest at the last waypoint of a mission that ends there
_PIECE_S = 0.2


@dataclass(frozen=True)
class _Waypoint:
    """Waypoint of item `seq`; a pause is a waypoint at the position of the one before."""

    seq: int
    place_ned_m: Array
    speed_mps: float
    hold_s: float = 0.0
    pause: bool = False


def fly_mission(
    path_generator: PathGenerator, t_s: float, flat: Array, items: Sequence[MissionItem], first: int, landed: bool
) -> PiecePath:
    """Return the path of the items from seq `first` on; item 0 is home.

    A vehicle on the ground starts with NAV_TAKEOFF.
    """
    sections = MissionGuidance(path_generator, t_s, flat, items).sections(first, landed)
    return replace(next(sections), continuation=sections)


class MissionGuidance:
    """Generates pieces and marks; keeps the time and motion at the end of the pieces generated so far."""

    def __init__(self, path_generator: PathGenerator, t_s: float, flat: Array, items: Sequence[MissionItem]) -> None:
        self._path_generator = path_generator
        self._items = items
        self._pieces: list[Piece] = []
        self._marks: list[Mark] = []
        self._t_s = t_s
        self._flat = flat
        self._item_ned_m: Array | None = None  # position of the last item that has one
        self._speed_mps = path_generator.speed_mps
        self._waypoints: list[_Waypoint] = []
        self._onward: Iterator[Piece] | None = None  # the pieces with which the navigator would continue
        self._airborne_from_s = -math.inf
        self._climbing_until_s = -math.inf
        self._landing_from_s = math.inf

    def sections(self, first: int, landed: bool) -> Iterator[PiecePath]:
        """Generate the path from item `first` on, section by section."""
        navs = [seq for seq in range(max(first, 1), len(self._items)) if is_navigation(self._items[seq].command)]
        self._marks.append(Mark(self._t_s, current=navs[0]))
        if landed:
            self._airborne_from_s = self._t_s
        else:
            self._follow(brake(self._t_s, self._flat, self._path_generator.limits))
        for seq in range(max(first, 1), len(self._items)):
            yield from self._take(seq, self._items[seq])
            if self._pieces:
                yield self._section()
        yield from self._fly_waypoints()
        if self._onward is not None:
            self._wait(_SETTLE_S)
            self._follow(brake(self._t_s, self._flat, self._path_generator.limits))
        if self._marks and not self._pieces:
            self._follow(brake(self._t_s, self._flat, self._path_generator.limits))
        if self._pieces:
            yield self._section()

    def _take(self, seq: int, item: MissionItem) -> Iterator[PiecePath]:
        command, (p1, p2, *_) = item.command, item.params
        ideal = self._path_generator.navigator is None
        if command == Command.DO_CHANGE_SPEED and p1 in (0.0, 1.0) and p2 > 0:
            self._speed_mps = min(p2, _FASTEST_MPS)
        elif command == Command.NAV_WAYPOINT:
            self._waypoints.append(_Waypoint(seq, self._place(item), self._speed_mps, max(p1, 0.0)))
            if ideal and p1 > 0:
                yield from self._fly_waypoints()
        elif command == Command.NAV_DELAY and p1 > 0 and self._waypoints and ideal:
            self._waypoints.append(_Waypoint(seq, self._waypoints[-1].place_ned_m, math.nan, p1, pause=True))
        elif command == Command.NAV_TAKEOFF:
            yield from self._fly_waypoints()
            self._climb(seq, self._place(item)[2])
            self._item_ned_m = self._place(item)
        elif command == Command.NAV_DELAY:
            yield from self._fly_waypoints()
            self._wait(p1 if p1 > 0 else self._until_time_of_day_s(item))
            self._completed(seq, self._t_s)
        elif command == Command.NAV_LAND:
            yield from self._fly_waypoints()
            self._land(item)
        elif command == MavCommand.NAV_RETURN_TO_LAUNCH:
            yield from self._fly_waypoints()
            self._take_over(self._path_generator.return_home(self._t_s, self._flat))

    def _fly_waypoints(self) -> Iterator[PiecePath]:
        waypoints, self._waypoints = self._waypoints, []
        if not waypoints:
            return
        navigator = self._path_generator.navigator
        if navigator is None:
            self._fly_on_time(waypoints)
        else:
            yield from self._fly_as(navigator, waypoints)
        self._item_ned_m = waypoints[-1].place_ned_m

    def _fly_on_time(self, waypoints: list[_Waypoint]) -> None:
        legs, origin = [], self._origin()
        for waypoint in waypoints:
            length_m = float(np.linalg.norm(waypoint.place_ned_m - origin))
            duration_s = waypoint.hold_s if waypoint.pause else length_m / waypoint.speed_mps
            legs.append(IdealLeg(waypoint.place_ned_m, duration_s))
            origin = waypoint.place_ned_m
        pieces, passed = fly_legs(self._t_s, self._flat[0], legs, self._path_generator.limits)
        for piece in pieces:
            self._follow(piece)
        last = waypoints[-1]
        if not last.pause:
            self._wait(last.hold_s)
        for waypoint, t_s in zip(waypoints, passed, strict=True):
            self._completed(waypoint.seq, self._t_s if waypoint is last else t_s)

    def _fly_as(self, navigator: Navigator, waypoints: list[_Waypoint]) -> Iterator[PiecePath]:
        orders = NavigatorOrders(
            vector(*self._origin()),
            tuple(vector(*waypoint.place_ned_m) for waypoint in waypoints),
            tuple(waypoint.speed_mps for waypoint in waypoints),
            tuple(waypoint.hold_s for waypoint in waypoints),
            self._t_s - self._airborne_from_s,
            motion(self._flat),
        )
        sections = follow(self._t_s, self._flat, navigator, orders)
        for piece, completed in sections:
            for index, t_s in completed:
                self._completed(waypoints[index].seq, t_s)
                if index + 1 == orders.count:
                    self._follow(_cut_at(piece, t_s))
                    self._onward = chain([piece], (following for following, _ in sections))
                    return
            self._follow(piece)
            if len(self._pieces) >= _AHEAD:
                yield self._section()

    def _origin(self) -> Array:
        """Return the start of the next leg: the position of the item before, unless the vehicle is far from it.

        So a small hover error does not change the leg.
        """
        here = self._flat[0, :3]
        known = self._item_ned_m
        return here if known is None or np.linalg.norm(known - here) > _NEAR_M else known

    def _climb(self, seq: int, down_m: float) -> None:
        target = self._flat[0].copy()
        target[2] = min(down_m, target[2])
        if self._flat[0, 2] - target[2] > _MOVED_M:
            grounded = self._t_s == self._airborne_from_s
            climb = self._path_generator.climb_out if grounded else self._path_generator.climb
            for piece in climb(self._t_s, self._flat, float(target[2])):
                self._follow(piece)
            self._climbing_until_s = self._t_s
        self._completed(seq, self._t_s)

    def _land(self, item: MissionItem) -> None:
        if item.lat_degE7 or item.lon_degE7:
            target = self._flat[0].copy()
            target[:2] = self._place(item)[:2]
            if np.linalg.norm(target - self._flat[0]) > _MOVED_M:
                self._take_over(self._path_generator.land_at(self._t_s, self._flat, target))
                return
        self._take_over(self._path_generator.land(self._t_s, self._flat))

    def _take_over(self, path: PiecePath) -> None:
        self._pieces += path.pieces
        self._landing_from_s = path.landing_from_s
        self._onward = None

    def _wait(self, duration_s: float) -> None:
        """Hold position for `duration_s`; a navigator meanwhile comes to rest."""
        until_s = self._t_s + duration_s
        if duration_s <= 0.0:
            return
        onwards: Iterable[Piece] = [hold(self._t_s, self._flat)] if self._onward is None else self._onward
        for piece in onwards:
            self._follow(_cut_at(piece, until_s), ends_run=False)
            if self._t_s >= until_s:
                return

    def _until_time_of_day_s(self, item: MissionItem) -> float:
        """Return the seconds until the UTC time of day in parameters 2 to 4, on the next day if it has passed."""
        hour, minute, second = item.params[1:]
        if min(hour, minute, second) < 0:
            return 0.0
        return (hour * 3600.0 + minute * 60.0 + second - self._path_generator.epoch_unix_s - self._t_s) % _DAY_S

    def _follow(self, piece: Piece, *, ends_run: bool = True) -> None:
        self._pieces.append(piece)
        self._t_s, self._flat = piece.end_s, piece.at(piece.end_s)
        if ends_run:
            self._onward = None

    def _section(self) -> PiecePath:
        section = PiecePath(tuple(self._pieces), tuple(self._marks), self._climbing_until_s, self._landing_from_s)
        self._pieces, self._marks = [], []
        return section

    def _completed(self, seq: int, t_s: float) -> None:
        """Mark item `seq` as completed at `t_s`, together with the DO_ items that follow: they act at the same time."""
        last = seq
        while last + 1 < len(self._items) and not is_navigation(self._items[last + 1].command):
            last += 1
        following = last + 1 if last + 1 < len(self._items) else None
        self._marks.append(Mark(t_s, reached=last if following else seq, current=following))

    def _place(self, item: MissionItem) -> Array:
        """Return the common local NED position of an item.

        An item without coordinates is where the vehicle is, at the altitude of the item.
        """
        path_generator = self._path_generator
        amsl_m = item.alt_m
        if item.frame != Frame.GLOBAL:
            amsl_m += path_generator.origin.alt_amsl_m - path_generator.home_ned_m[2]
        if not (item.lat_degE7 or item.lon_degE7):
            north, east = (self._waypoints[-1].place_ned_m if self._waypoints else self._flat[0])[:2]
            return np.array([north, east, path_generator.origin.alt_amsl_m - amsl_m])
        return geodetic_to_ned(*item.place_deg, amsl_m, path_generator.origin)


def is_navigation(command: int) -> bool:
    """Whether an item is a NAV_ item, which moves the vehicle or makes it wait, and not a DO_ item."""
    return command <= Command.NAV_DELAY


def _cut_at(piece: Piece, end_s: float) -> Piece:
    """Return the same polynomial, ending no later than `end_s`."""
    return Piece(piece.start_s, min(piece.end_s, end_s), piece.coefficients)


def follow(
    start_s: float, flat: Array, navigator: Navigator, orders: NavigatorOrders
) -> Iterator[tuple[Piece, list[tuple[int, float]]]]:
    """Generate the pieces of a navigator from a motion `flat` (DERIVATIVES, 4), without end; yaw is constant.

    With each piece come the waypoints completed within it: index and time.
    """
    steps = round(_PIECE_S / navigator.step_s)
    yaw_rad = flat[0, 3]
    begin_s, begin = start_s, flat.copy()
    begin[1:, 3] = 0.0
    completed: list[tuple[int, float]] = []
    for count, moment in enumerate(navigator.fly(orders), start=1):
        if moment.completed is not None:
            completed.append((moment.completed, start_s + moment.t_s))
        if count % steps:
            continue
        end_s, end = start_s + moment.t_s, _flat(moment, yaw_rad)
        yield bridge(begin_s, begin, end_s, end), completed
        begin_s, begin, completed = end_s, end, []


def motion(flat: Array) -> NavigatorState:
    """Return the motion `flat` (DERIVATIVES, 4) as the initial state of a navigator."""
    position, velocity, acceleration = (vector(*flat[k, :3]) for k in range(3))
    return NavigatorState(0.0, position, velocity, acceleration)


def _flat(moment: NavigatorState, yaw_rad: float) -> Array:
    flat = np.zeros((DERIVATIVES, 4))
    flat[:3, :3] = moment.position_ned_m, moment.velocity_ned_mps, moment.acceleration_ned_mps2
    flat[0, 3] = yaw_rad
    return flat
