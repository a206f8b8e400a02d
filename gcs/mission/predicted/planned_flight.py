"""The predicted flight of a mission at its planned speeds: what each command does to position and time.

Legs are straight, and landings descend at the autopilot's own speeds. Missions of a formation start together: at the
end of its take-off each vehicle waits for the others (`together`). `autopilot_flight` lets a model of the autopilot fly
the legs instead.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gcs.autopilots.mission_commands import known_position
from gcs.frames import geodetic_to_ned
from gcs.mavlink import MavCommand, WireFrame
from gcs.mission.flight_limits import Surroundings
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.model import Home, MissionItem
from gcs.types import Array

ITEMS_FLOWN_MAX = 20_000  # jumps can make a mission endless
_TERRAIN_STEP_M, _TERRAIN_STEPS_MAX = 5.0, 2_000
ALTITUDE_MAX_M = 1e5  # higher altitudes are reported as errors, and flown at this one
_STILL_M = 1e-3
_VERTICAL_MPS2 = 4.0  # no autopilot has more: over centimetres none reaches its climb speed
_DAY_S = 86400.0
_HOLDING = frozenset({MavCommand.NAV_WAYPOINT, MavCommand.NAV_LOITER_TIME, MavCommand.NAV_SPLINE_WAYPOINT})
_PLACES = _HOLDING | {MavCommand.NAV_LOITER_UNLIM, MavCommand.NAV_LOITER_TURNS, MavCommand.NAV_LOITER_TO_ALT}
_OPEN = (
    "NAV_LOITER_TURNS NAV_SPLINE_WAYPOINT NAV_CONTINUE_AND_CHANGE_ALT NAV_VTOL_TAKEOFF NAV_VTOL_LAND NAV_GUIDED_ENABLE "
    "NAV_PAYLOAD_PLACE DO_SET_HOME JUMP_TAG DO_JUMP_TAG NAV_SCRIPT_TIME NAV_ATTITUDE_TIME"
)
_UNMODELLED = frozenset(MavCommand[name] for name in _OPEN.split())
_TERRAIN_FRAMES = frozenset({int(WireFrame.GLOBAL_TERRAIN_ALT), int(WireFrame.GLOBAL_TERRAIN_ALT_INT)})
_AMSL_FRAMES = frozenset({int(WireFrame.GLOBAL), int(WireFrame.GLOBAL_INT)})


@dataclass(frozen=True)
class PredictedFlight:
    """The motion of a vehicle: straight at constant speed between knots, at rest before the first and after the last.

    `item` is the index of the item that brought the vehicle to each knot. Take-off ends at `up_s`; the vertical
    descent of the landing begins at `down_s`. The flight of a model is bent: at no instant is it farther than `bent_m`
    from the straight pieces, nor faster than `fastest_mps` along each axis.
    """

    t_s: Array  # (K,)
    ned_m: Array  # (K, 3)
    item: Array  # (K,)
    up_s: float
    down_s: float
    ends_s: float  # on the ground again; infinity if it stays in the air
    remarks: tuple[tuple[int, str], ...] = ()  # item index, and what the model leaves out
    bends_m: Array | None = None  # (K - 1,); None where all pieces are straight
    top_mps: Array | None = None  # (K - 1, 3); None where speeds are constant on every piece

    @property
    def bent_m(self) -> Array:
        """How far (K - 1,) the vehicle may be from each straight piece at the same instant."""
        return np.zeros(len(self.t_s) - 1) if self.bends_m is None else self.bends_m

    @property
    def fastest_mps(self) -> Array:
        """The highest speeds (K - 1, 3) on each piece; 0 where a piece takes no time."""
        if self.top_mps is not None:
            return self.top_mps
        return np.abs(np.diff(self.ned_m, axis=0)) / np.where(np.diff(self.t_s) > 0, np.diff(self.t_s), np.inf)[:, None]


def surroundings(missions: Sequence[MissionFile]) -> Surroundings:
    """A frame with its origin at the first home, or else at the first position of any mission; no ground."""
    homes = [m.home for m in missions if m.home is not None]
    return Surroundings(homes[0] if homes else _first_place(missions))


def _first_place(missions: Sequence[MissionFile]) -> Home:
    for mission in missions:
        for item in mission.items:
            if known_position(item.command) and (item.lat_degE7 or item.lon_degE7):
                return Home(*item.place_deg, 0.0)
    return Home(0.0, 0.0, 0.0)


def home_of(mission: MissionFile, around: Surroundings) -> Home:
    """The file's home, or else the ground under the mission's first position (at the origin's height if unknown)."""
    if mission.home is not None:
        return mission.home
    first = _first_place([mission])
    at = geodetic_to_ned(first.lat_deg, first.lon_deg, around.origin.alt_amsl_m, around.origin)
    height = float(around.height_of_ground_m(at, 0.0))
    return Home(first.lat_deg, first.lon_deg, around.origin.alt_amsl_m + height)


def fly(mission: MissionFile, around: Surroundings) -> PredictedFlight:
    """The flight by the mission's speeds and delays, from the start at time 0, without waiting for other vehicles."""
    return Flying(mission, around).run()


def together(flights: Sequence[PredictedFlight]) -> tuple[PredictedFlight, ...]:
    """The same flights, all of which leave the end of their take-off when the last vehicle is there."""
    leave_s = max(f.up_s for f in flights)
    return tuple(_waiting(f, leave_s - f.up_s) for f in flights)


def _waiting(flight: PredictedFlight, wait_s: float) -> PredictedFlight:
    if wait_s <= 0.0:
        return flight
    top = int(np.searchsorted(flight.t_s, flight.up_s, side="right")) - 1
    t_s = np.concatenate([flight.t_s[: top + 1], flight.t_s[top:] + wait_s])
    rows = np.concatenate([np.arange(top + 1), np.arange(top, len(flight.t_s))])
    ends = (flight.up_s + wait_s, flight.down_s + wait_s, flight.ends_s + wait_s)
    bent_m, fastest_mps = np.insert(flight.bent_m, top, 0.0), np.insert(flight.fastest_mps, top, 0.0, axis=0)
    return PredictedFlight(t_s, flight.ned_m[rows], flight.item[rows], *ends, flight.remarks, bent_m, fastest_mps)


@dataclass
class Flying:
    """The state of a flight at planned speeds: position, speed, time, and the knots so far."""

    mission: MissionFile
    around: Surroundings
    knots: list[tuple[float, tuple[float, float, float], int]] = field(default_factory=list)
    remarks: dict[int, str] = field(default_factory=dict)
    clock_s: float | None = None  # time of day at time 0, from the first item that waits for one
    bends: dict[int, tuple[float, Array]] = field(default_factory=dict)  # by knot that ends a piece, and its top speeds

    def run(self) -> PredictedFlight:
        """The flight of the whole mission."""
        mission = self.mission
        home = home_of(mission, self.around)
        self.home_ned_m = geodetic_to_ned(home.lat_deg, home.lon_deg, home.alt_amsl_m, self.around.origin)
        self.places_ned_m = self._places(home)
        self.here, self.t_s = self.home_ned_m, 0.0
        support = mission.firmware.traits.missions
        self.speed_mps = mission.speed_mps or support.default_speed_mps
        self.climb_mps, self.sink_mps = support.climb_mps
        self.up_s: float | None = None
        self.down_s = self.ends_s = math.inf
        self._knot(0)
        self._follow()
        self._fly_pending()
        up_s = 0.0 if self.up_s is None else self.up_s
        down_s = min(self.down_s, self.t_s)
        t_s, ned_m, item = zip(*self.knots, strict=True)
        remarks = tuple(self.remarks.items())
        flight = PredictedFlight(np.array(t_s), np.array(ned_m), np.array(item), up_s, down_s, self.ends_s, remarks)
        if not self.bends:
            return flight
        bent_m, fastest_mps = flight.bent_m, flight.fastest_mps
        for knot, (bend_m, top_mps) in self.bends.items():
            bent_m[knot - 1], fastest_mps[knot - 1] = bend_m, top_mps
        return replace(flight, bends_m=bent_m, top_mps=fastest_mps)

    def _follow(self) -> None:
        items = self.mission.items
        left: dict[int, float] = {}  # how often each jump remains
        index = flown = 0
        while index < len(items) and math.isinf(self.ends_s):
            item = items[index]
            flown += 1
            if flown > ITEMS_FLOWN_MAX:
                self.remarks[index] = f"the mission does not end; the check stops after {ITEMS_FLOWN_MAX} items"
                return
            if item.command == MavCommand.DO_JUMP:
                target = self._jump(item, index, left)
                index = index + 1 if target is None else target
                continue
            if item.command in _UNMODELLED:
                self.remarks[index] = "the effect of this command on the flight is not modelled"
            self._do(item, index)
            if item.command == MavCommand.NAV_LOITER_UNLIM:
                return
            index += 1

    def _jump(self, item: MissionItem, index: int, left: dict[int, float]) -> int | None:
        """Index of the next item; None if the jump is used up or has no target."""
        number, times = item.params[:2]
        target = number - self.mission.jumps_from
        if not (math.isfinite(number) and number == round(number) and 0 <= target < len(self.mission.items)):
            return None
        left.setdefault(index, math.inf if times < 0 else times)
        if not left[index] >= 1:
            return None
        left[index] -= 1
        return int(target)

    def _do(self, item: MissionItem, index: int) -> None:
        p1, p2 = item.params[:2]
        if item.command in _PLACES:
            hold_s = p1 if item.command in _HOLDING else 0.0
            self._visit(self._place(index), index, hold_s, along_ground=item.frame in _TERRAIN_FRAMES)
        elif item.command == MavCommand.NAV_DELAY:
            self._delay(item, index)
        elif item.command == MavCommand.DO_CHANGE_SPEED:
            if p2 > 0 and math.isfinite(p2):
                if p1 == 2:
                    self.climb_mps = p2
                elif p1 == 3:
                    self.sink_mps = p2
                else:
                    self.speed_mps = p2
        elif item.command == MavCommand.NAV_TAKEOFF:
            self._take_off(item, index)
        elif item.command == MavCommand.NAV_LAND:
            self._land(item, index)
        elif item.command == MavCommand.NAV_RETURN_TO_LAUNCH:
            self._return(index)

    def _visit(self, place: Array, index: int, hold_s: float, *, along_ground: bool) -> None:
        """Fly to a position and hold there."""
        self._go(place, index, along_ground=along_ground)
        self._wait(hold_s, index)

    def _delay(self, item: MissionItem, index: int) -> None:
        """Wait for some seconds, or until a time of day; the first such time is assumed to come at once."""
        seconds, *clock = item.params
        if seconds > 0.0 or not min(clock) >= 0.0:
            self._wait(seconds, index)
            return
        self._fly_pending()
        until_s = clock[0] * 3600.0 + clock[1] * 60.0 + clock[2]
        if self.clock_s is None:
            self.clock_s = until_s - self.t_s
        left_s = (until_s - self.clock_s - self.t_s) % _DAY_S
        if left_s > 0.5 * _DAY_S:
            self.remarks[index] = f"reached {_DAY_S - left_s:.1f} s after the time of day that it waits for"
            left_s = 0.0
        self._hold(left_s, index)

    def _hold(self, seconds: float, index: int) -> None:
        """Hold after a stop."""
        self._wait(seconds, index)

    def _fly_pending(self) -> None:
        """Fly the waypoints that were collected; here there are none."""

    def _take_off(self, item: MissionItem, index: int) -> None:
        """Climb straight up, then fly to the item's position if the autopilot does so."""
        self._fly_pending()
        place = self._place(index)
        top = np.array([*self.here[:2], place[2]])
        if top[2] < self.here[2]:
            self.t_s += float(self.here[2] - top[2]) / self.climb_mps
            self.here = top
            self._knot(index)
        if self.up_s is None:
            self.up_s = self.t_s
        if self.mission.firmware.traits.missions.takeoff_goes_to_place:
            self._go(place, index)

    def _land(self, item: MissionItem, index: int) -> None:
        """Fly over the position at the present height, then descend."""
        self._fly_pending()
        place = self._place(index)
        self._go(np.array([*place[:2], self.here[2]]), index)
        self._down(index)

    def _return(self, index: int) -> None:
        self._fly_pending()
        height_m = self.mission.firmware.traits.returns.default_altitude_m
        top = min(self.here[2], self.home_ned_m[2] - height_m)
        self._go(np.array([*self.here[:2], top]), index)
        self._go(np.array([*self.home_ned_m[:2], top]), index)
        self._down(index)

    def _down(self, index: int) -> None:
        """Descend to the ground at the speeds of the autopilot's own landing; its heights count from home."""
        self.down_s = self.t_s
        home_m = -float(self.home_ned_m[2])
        ground_m = float(self.around.height_of_ground_m(self.here, home_m))
        profile = self.mission.firmware.traits.landing.profile(self.mission.parameters)
        times, heights = profile.knots(-float(self.here[2]) - home_m, ground_m - home_m)
        begin = min(1, len(times) - 1)  # its first knot is the present one
        for passed_s, height_m in zip(times[begin:].tolist(), heights[begin:].tolist(), strict=True):
            self.t_s = self.down_s + passed_s
            self.here = np.array([*self.here[:2], -(height_m + home_m)])
            self._knot(index)
        self.ends_s = self.t_s

    def _wait(self, seconds: float, index: int) -> None:
        if seconds > 0 and math.isfinite(seconds):
            self.t_s += seconds
            self._knot(index)

    def _go(self, there: Array, index: int, *, along_ground: bool = False) -> None:
        """Fly straight to a position; along the ground if its altitude counts from the ground."""
        start = self.here
        length_m = float(np.linalg.norm(there - start))
        if length_m < _STILL_M:
            return
        duration_s = self._duration_s(there - start, length_m)
        steps = 1
        if along_ground and self.around.ground is not None:
            steps = math.ceil(float(np.linalg.norm((there - start)[:2])) / _TERRAIN_STEP_M)
            steps = min(max(steps, 1), _TERRAIN_STEPS_MAX)
        shares = np.arange(1, steps + 1) / steps
        points = start + shares[:, None] * (there - start)
        if steps > 1:
            ends = np.stack([start, there])
            above = -ends[:, 2] - self.around.height_of_ground_m(ends, 0.0)
            points[:, 2] = -(self.around.height_of_ground_m(points, 0.0) + np.interp(shares, [0, 1], above))
        begin_s = self.t_s
        for share, point in zip(shares.tolist(), points, strict=True):
            self.t_s = begin_s + share * duration_s
            self.here = point
            self._knot(index)
        if self.up_s is None:
            self.up_s = begin_s  # without a take-off, the flight begins with the first leg

    def _duration_s(self, leg: Array, length_m: float) -> float:
        if math.hypot(leg[0], leg[1]) < _STILL_M:
            most_mps = self.climb_mps if leg[2] < 0 else self.sink_mps
            return length_m / min(most_mps, math.sqrt(_VERTICAL_MPS2 * length_m))
        return length_m / self.speed_mps

    def _place(self, index: int) -> Array:
        """The position of an item in NED; latitude and longitude 0 mean "here"."""
        item, place = self.mission.items[index], self.places_ned_m[index]
        return place if item.lat_degE7 or item.lon_degE7 else np.array([*self.here[:2], place[2]])

    def _places(self, home: Home) -> Array:
        """Positions (M, 3) of all items, in NED."""
        items, origin = self.mission.items, self.around.origin
        if not items:
            return np.zeros((0, 3))
        lat, lon = np.array([item.place_deg for item in items]).T
        alt = np.clip(np.nan_to_num([i.alt_m for i in items]), -ALTITUDE_MAX_M, ALTITUDE_MAX_M)
        amsl = np.array([i.frame in _AMSL_FRAMES for i in items])
        terrain = np.array([i.frame in _TERRAIN_FRAMES for i in items])
        # A frame without a position, or latitude 0 as "here", must not leave the Earth.
        nowhere = (np.abs(lat) > 90) | ((lat == 0) & (lon == 0))
        lat, lon = np.where(nowhere, home.lat_deg, lat), np.where(nowhere, home.lon_deg, lon)
        places = geodetic_to_ned(lat, lon, np.where(amsl, alt, home.alt_amsl_m + alt), origin)
        ground = self.around.height_of_ground_m(places, -float(self.home_ned_m[2]))
        places[terrain, 2] = -(ground + alt)[terrain]
        return places

    def _knot(self, index: int) -> None:
        n, e, d = self.here.tolist()
        self.knots.append((self.t_s, (n, e, d), index))
