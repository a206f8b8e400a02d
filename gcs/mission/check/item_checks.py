"""Checks of a mission's items one by one: commands, frames, values, speeds, jumps, order."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

from gcs.autopilots.columns import CommandSource
from gcs.autopilots.mission_commands import (
    SpeedFault,
    command_source,
    known_position,
    name_of,
    refusal,
    speed_fault,
)
from gcs.frames import from_degE7, to_degE7
from gcs.mavlink import MavCommand
from gcs.mission.check.findings import Finding, Level, Rule
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.model import Command, Frame, MissionItem
from gcs.mission.predicted.planned_flight import ALTITUDE_MAX_M

_NO_POSITION = frozenset({int(Frame.MISSION)})
_ENDLESS = frozenset({MavCommand.NAV_LOITER_UNLIM})
_ENDS = frozenset({MavCommand.NAV_LAND, MavCommand.NAV_LOITER_UNLIM, MavCommand.NAV_RETURN_TO_LAUNCH})
_HOLDS = frozenset(  # parameter 1 is a time, s
    {MavCommand.NAV_WAYPOINT, MavCommand.NAV_LOITER_TIME, MavCommand.NAV_SPLINE_WAYPOINT, MavCommand.NAV_DELAY}
)
FAR_M = 100_000.0  # no quadrotor flies so far
_EARTH_M = 6_371_000.0
_Said = Iterator[tuple[Rule, Level, str]]
Degrees = tuple[int, int]  # latitude, longitude, degE7
# How two numbers, written as they are here, become latitude and longitude.
_QUESTIONS: tuple[tuple[str, Callable[[int, int], Degrees]], ...] = (
    ("swapped latitude and longitude?", lambda lat, lon: (lon, lat)),
    ("has the latitude lost its sign?", lambda lat, lon: (-lat, lon)),
    ("has the longitude lost its sign?", lambda lat, lon: (lat, -lon)),
    ("have both lost their signs?", lambda lat, lon: (-lat, -lon)),
    ("swapped latitude and longitude, without a sign?", lambda lat, lon: (lon, -lat)),
    ("swapped latitude and longitude, without a sign?", lambda lat, lon: (-lon, lat)),
)


def check_items(mission: MissionFile) -> Iterator[Finding]:
    """Findings that follow from the items alone."""
    yield from (found(mission, *one) for one in _whole(mission))
    for index, item in enumerate(mission.items):
        for rule in (_taken, _values, _speed, _jump):
            yield from (found(mission, *one, index) for one in rule(mission, index, item))


def found(
    mission: MissionFile, rule: Rule, level: Level, message: str, index: int | None = None, t_s: float | None = None
) -> Finding:
    """A finding about an item of a mission, or about the mission."""
    if index is None:
        return Finding(rule, level, message, mission.source, t_s=t_s)
    return Finding(rule, level, message, mission.source, mission.line(index), mission.seq(index), t_s)


def _whole(mission: MissionFile) -> Iterator[tuple[Rule, Level, str] | tuple[Rule, Level, str, int]]:
    firmware, items = mission.firmware, mission.items
    count, most = len(items) + firmware.home_is_item_0, firmware.traits.missions.items_max
    if count > most:
        yield Rule.ITEMS, Level.ERROR, f"{count} items; {firmware.title} stores at most {most}"
    if not items:
        yield Rule.ITEMS, Level.ERROR, "the mission has no items"
        return
    jumps, jumps_max = sum(i.command == Command.DO_JUMP for i in items), firmware.traits.missions.jumps_max
    if jumps_max is not None and jumps > jumps_max:
        text = f"{jumps} jumps; boards with little memory store {jumps_max} and ignore the others"
        yield Rule.JUMP, Level.WARNING, text
    flown = [n for n, i in enumerate(items) if i.command <= MavCommand.NAV_LAST]
    if not flown or items[flown[0]].command != Command.NAV_TAKEOFF:
        text = "the first navigation command is not a take-off"
        yield Rule.ORDER, Level.WARNING, text, flown[0] if flown else 0
    if flown and items[flown[-1]].command not in _ENDS:
        text = f"the mission ends in the air, with {name_of(items[flown[-1]].command)}"
        yield Rule.ORDER, Level.WARNING, text, flown[-1]
    for index, item in enumerate(items[1:], start=1):
        if item.command == Command.NAV_TAKEOFF and items[index - 1].command != Command.NAV_LAND:
            yield Rule.ORDER, Level.WARNING, "take-off in the air", index


def _taken(mission: MissionFile, _: int, item: MissionItem) -> _Said:
    if why := refusal(item.command, mission.firmware):
        absent = command_source(item.command, mission.firmware) is CommandSource.ABSENT
        mild = absent and item.command > MavCommand.NAV_LAST
        yield Rule.COMMAND, Level.WARNING if mild else Level.ERROR, why
    if not known_position(item.command):
        return
    if item.frame in _NO_POSITION:
        yield Rule.FRAME, Level.ERROR, f"{name_of(item.command)} has a position, but frame {item.frame} has none"
    elif item.frame not in mission.firmware.traits.missions.frames:
        yield Rule.FRAME, Level.ERROR, f"{mission.firmware.title} refuses altitudes in frame {item.frame}"


def _values(mission: MissionFile, index: int, item: MissionItem) -> _Said:
    if known_position(item.command) and not abs(item.alt_m) <= ALTITUDE_MAX_M:
        yield Rule.VALUE, Level.ERROR, f"altitude {item.alt_m:g} m; limit {ALTITUDE_MAX_M:g} m"
    hold_s = item.params[0]
    if item.command in _HOLDS and math.isnan(hold_s):
        yield Rule.VALUE, Level.ERROR, "the hold time is not a number"
    if item.command == Command.NAV_DELAY and hold_s < 0:
        if mission.firmware.traits.flight.waits_for_time_of_day:
            yield Rule.ASSUMED, Level.NOTE, "waits until a time of day; the check assumes that it is the common start"
        else:
            yield Rule.VALUE, Level.ERROR, f"{mission.firmware.title} cannot wait until a time of day, only for seconds"
    if index + 1 < len(mission.items) and not item.autocontinue:
        yield Rule.ORDER, Level.WARNING, "the mission stops here until an operator continues it (autocontinue is off)"
    if index + 1 < len(mission.items) and item.command in _ENDLESS:
        yield Rule.ORDER, Level.WARNING, "the vehicle never flies the items after this one"


def _speed(mission: MissionFile, _: int, item: MissionItem) -> _Said:
    if item.command == Command.DO_CHANGE_SPEED and (fault := speed_fault(*item.params[:2], mission.firmware)):
        yield Rule.VALUE if fault[0] is SpeedFault.KIND else Rule.SPEED, Level.ERROR, fault[1]


def _jump(mission: MissionFile, index: int, item: MissionItem) -> _Said:
    number, times = item.params[:2]
    first, last = mission.jumps_from, mission.jumps_from + len(mission.items) - 1
    if item.command != Command.DO_JUMP:
        return
    if not (math.isfinite(number) and number == round(number) and first <= number <= last):
        yield Rule.JUMP, Level.ERROR, f"jumps to item {number:g}; the mission has items {first} to {last}"
        return
    target = round(number) - first
    if target == index:
        yield Rule.JUMP, Level.ERROR, "jumps to itself"
    elif math.isnan(times):
        yield Rule.JUMP, Level.ERROR, "the number of jumps is not a number"
    elif times < 0 and target < index:
        yield Rule.JUMP, Level.WARNING, "jumps back without end; the vehicle never flies the items after this one"
    elif target < index and not any(i.command <= MavCommand.NAV_LAST for i in mission.items[target:index]):
        yield Rule.JUMP, Level.ERROR, "jumps back without a navigation command in between"


def check_places(mission: MissionFile) -> tuple[MissionFile, list[Finding]]:
    """The mission without its far places, and an error for each.

    An item that is too far from the one before it to be meant so stays at the place of that one.
    """
    last: tuple[int, int] | None = None
    name = "the item before it"
    if mission.home is not None:
        last, name = (to_degE7(mission.home.lat_deg), to_degE7(mission.home.lon_deg)), "home"
    items, findings = [], []
    for index, item in enumerate(mission.items):
        place = (item.lat_degE7, item.lon_degE7)
        if not known_position(item.command) or not any(place):
            items.append(item)
        elif last is None or _apart_m(place, last) <= FAR_M:
            last, name = place, "the item before it"
            items.append(item)
        else:
            items.append(replace(item, lat_degE7=last[0], lon_degE7=last[1]))
            meant = next((text for text, turn in _QUESTIONS if _apart_m(turn(*place), last) <= FAR_M), "")
            it = f"{meant} It" if meant else "this place"
            message = f"{it} is {_apart_m(place, last) / 1000.0:,.0f} km from {name}; the check leaves it out"
            findings.append(found(mission, Rule.PLACE, Level.ERROR, message, index))
    return (replace(mission, items=tuple(items)) if findings else mission), findings


def _apart_m(first: Degrees, second: Degrees) -> float:
    """The distance of two places on a sphere."""
    (lat_a, lon_a), (lat_b, lon_b) = ((math.radians(from_degE7(value)) for value in place) for place in (first, second))
    half_lat, half_lon = 0.5 * (lat_b - lat_a), 0.5 * (lon_b - lon_a)
    share = math.sin(half_lat) ** 2 + math.cos(lat_a) * math.cos(lat_b) * math.sin(half_lon) ** 2
    return 2.0 * _EARTH_M * math.asin(min(math.sqrt(share), 1.0))
