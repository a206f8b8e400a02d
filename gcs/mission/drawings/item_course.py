"""The route in mission items: points, holds and speeds. Every other item is reported as left out."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from gcs.autopilots.mission_commands import (
    SPEED_KEPT,
    SPEED_OWN,
    SpeedFault,
    changes_course_speed,
    has_position,
    name_of,
    speed_fault,
)
from gcs.autopilots.traits import Autopilot
from gcs.mavlink import FenceCommand, MavCommand
from gcs.mission.drawings.drawing import Datum, DrawnPoint, Place
from gcs.mission.drawings.labels import Label
from gcs.mission.drawings.sketch import Sketch
from gcs.mission.model import Home, MissionItem

HOLD_MAX_S = 3600.0  # of a point in a scenario
_HOLD_MIN_S = 0.1
# By the frame of an item; the second one of each is the _INT frame
_DATUMS = {0: Datum.SEA, 5: Datum.SEA, 3: Datum.HOME, 6: Datum.HOME, 10: Datum.GROUND, 11: Datum.GROUND}
_POINTS = {  # commands of route points: what is lost of them
    MavCommand.NAV_WAYPOINT: "",
    MavCommand.NAV_LOITER_TIME: "",
    MavCommand.NAV_LOITER_TO_ALT: "",
    MavCommand.NAV_SPLINE_WAYPOINT: "a point of the route; the planner chooses the curve through it",
    MavCommand.NAV_LOITER_TURNS: "a point of the route, without its turns",
    MavCommand.NAV_LOITER_UNLIM: "a point of the route; a flight does not hover without end",
    MavCommand.NAV_PAYLOAD_PLACE: "a point of the route, at its height; the payload stays on board",
}
_TAKEOFFS = (MavCommand.NAV_TAKEOFF, MavCommand.NAV_VTOL_TAKEOFF)
_LANDINGS = (MavCommand.NAV_LAND, MavCommand.NAV_VTOL_LAND)
_JUMPS = (MavCommand.DO_JUMP, MavCommand.DO_JUMP_TAG)
_AIMS = tuple(command for command in MavCommand if "_ROI" in command.name)


@dataclass(frozen=True)
class NumberedItem:
    """An item, the number by which its program shows it, and the pattern that it belongs to ("survey")."""

    number: int
    item: MissionItem
    pattern: str = ""
    line: int | None = None  # of the file: its own, or that of its pattern

    @property
    def label(self) -> Label:
        """How sentences call it."""
        return Label("item", self.number, f"({self.pattern or name_of(self.item.command)})", line=self.line)


@dataclass
class ItemCourse:
    """Follows the items in order, as an autopilot would, and adds to a sketch what it meets."""

    sketch: Sketch
    home: Home | None
    firmware: Autopilot | None = None  # whose rules count; None: not known
    takeoff_m: float = 0.0  # height of the take-off above home
    speed_mps: float | None = None  # that items have changed to
    end: Label | None = None  # the item after which nothing is flown
    returns: bool = False

    def follow(self, items: Iterable[NumberedItem]) -> None:
        """Add the points of items. Raises `FileFormatError` for a point whose place is not known."""
        for one in items:
            command = one.item.command
            if self.end is not None:
                self._leave(one, f"after {self.end}, where the route ends; not carried over")
            elif command in _POINTS:
                self._point(one)
            elif command == MavCommand.DO_CHANGE_SPEED:
                self._speed(one)
            elif command == MavCommand.NAV_DELAY:
                hold_s = self._hold(one, one.item.params[0])
                if not hold_s:
                    self._leave(one, "a delay until a time of day is not carried over")
                elif not self.sketch.points:
                    self._leave(one, "a delay before the first point is not carried over; start the flight later")
                else:
                    last = self.sketch.points[-1]
                    total_s = min(last.hold_s + hold_s, HOLD_MAX_S)
                    self.sketch.points[-1] = replace(last, hold_s=total_s, radius_m=0.0)
            elif command == MavCommand.NAV_RETURN_TO_LAUNCH:
                self.end, self.returns = one.label, True
                self._leave(one, "the route returns to its start, in formation, and lands there")
            elif command in _LANDINGS:
                self._landing(one)
            elif command in _TAKEOFFS:
                self.takeoff_m = one.item.alt_m
                self._leave(one, "not carried over; the formation takes off below its start")
            else:
                self._leave(one, _why_not(command))

    def _leave(self, one: NumberedItem, text: str) -> None:
        text = text if not one.pattern else f"{name_of(one.item.command)}: {text}"
        self.sketch.leave_out(one.label, text)

    def _point(self, one: NumberedItem) -> None:
        item, command = one.item, one.item.command
        place, height_m = self._place(one)
        p1, p2, p3, p4 = item.params
        hold_s, radius_m = 0.0, 0.0
        if command in (MavCommand.NAV_WAYPOINT, MavCommand.NAV_SPLINE_WAYPOINT, MavCommand.NAV_LOITER_TIME):
            hold_s = self._hold(one, p1)
        if command == MavCommand.NAV_WAYPOINT:
            radius_m = p2 if math.isfinite(p2) and p2 > 0.0 and not hold_s else 0.0
            if math.isfinite(p3) and p3:
                self._leave(one, "a pass at a distance is not carried over; the route leads through the point")
            if math.isfinite(p4) and p4:
                self._leave(one, "the yaw is not carried over; write heading_deg for the formation's leader")
        if lost := _POINTS[MavCommand(command)]:
            self._leave(one, lost)
        if not item.autocontinue:
            self._leave(one, "the flight does not wait there for an operator (autocontinue is off)")
        height_m, datum = self._height(one, height_m)
        point = DrawnPoint(place, height_m, datum, one.label, one.pattern, self.speed_mps, hold_s, radius_m)
        self.sketch.points.append(point)

    def _place(self, one: NumberedItem) -> tuple[Place, float]:
        """Where an item is; zeros for latitude and longitude mean the place before."""
        item = one.item
        if item.frame not in _DATUMS:
            raise self.sketch.refused(
                one.label, f"has frame {item.frame}, which is no place on Earth", "draw its points on a map"
            )
        place, height_m = item.place_deg, item.alt_m
        if any(place):
            return place, height_m
        if not self.sketch.points:
            if self.home is None:
                raise self.sketch.refused(
                    one.label,
                    "has no position, and there is none before it",
                    "give it one, or draw its points on a map",
                )
            self._leave(one, "without a position: above home")
            return (self.home.lat_deg, self.home.lon_deg), height_m
        before = self.sketch.points[-1]
        self._leave(one, f"without a position: at that of {before.label}")
        return before.place, height_m or before.height_m

    def _height(self, one: NumberedItem, height_m: float) -> tuple[float, Datum]:
        """The height of a point; where 0 stands for the height before, that one."""
        datum = _DATUMS[one.item.frame]
        if not math.isfinite(height_m):
            raise self.sketch.refused(one.label, "has no height", "give it one")
        keeps_height = self.firmware is not None and self.firmware.traits.missions.height_0_is_height_before
        if height_m or datum is not Datum.HOME or not keeps_height:
            return height_m, datum
        if self.sketch.points:
            before = self.sketch.points[-1]
            self._leave(one, "without a height: ArduPilot stays at the one before")
            return before.height_m, before.datum
        if self.takeoff_m > 0.0:
            self._leave(one, "without a height: ArduPilot stays at that of the take-off")
        return max(self.takeoff_m, 0.0), datum

    def _hold(self, one: NumberedItem, hold_s: float) -> float:
        if math.isnan(hold_s):
            self._leave(one, "the hold time is not a number; no hold")
        if not math.isfinite(hold_s) or hold_s < _HOLD_MIN_S:
            return 0.0
        if hold_s > HOLD_MAX_S:
            self._leave(one, f"a hold of {HOLD_MAX_S:g} s instead of {hold_s:g} s")
        return min(hold_s, HOLD_MAX_S)

    def _speed(self, one: NumberedItem) -> None:
        kind, speed_mps = one.item.params[:2]
        fault = speed_fault(kind, speed_mps, self.firmware)
        if changes_course_speed(kind) and speed_mps == SPEED_OWN:
            self.speed_mps = None
        elif fault is not None and fault[0] is not SpeedFault.TOO_FAST:
            self._leave(one, f"{fault[1]}; not carried over")
        elif not changes_course_speed(kind):
            self._leave(one, "the speed of climbs and descents is not carried over; limits.speed_ned_mps bounds it")
        elif speed_mps == SPEED_KEPT:
            self._leave(one, "changes no speed")
        else:
            self.speed_mps = speed_mps
            if fault is not None:
                self._leave(one, fault[1])

    def _landing(self, one: NumberedItem) -> None:
        item = one.item
        self.end = one.label
        if (item.lat_degE7 or item.lon_degE7) and item.frame in _DATUMS and self.sketch.points:
            before = self.sketch.points[-1]
            place = item.place_deg
            self.sketch.points.append(replace(before, place=place, label=one.label, name="", hold_s=0.0))
            self._leave(
                one, f"the route ends above it, at the height of {before.label}; the formation lands from there"
            )
        else:
            self._leave(one, "the formation lands below the last point")


def _why_not(command: int) -> str:
    """Why an item is not carried over."""
    if command in _JUMPS:
        return "the jump is not carried over; for several rounds write loops"
    if command in _AIMS:
        return "where cameras look is not carried over"
    if command in tuple(FenceCommand):
        return "belongs into a file with a fence or rally points; it is not carried over"
    if command == MavCommand.CONDITION_YAW:
        return "the yaw is not carried over; write heading_deg at a point of the route"
    if has_position(command):
        return "not carried over, with its position: a scenario has no such point"
    return "not carried over; a scenario has no such command"
