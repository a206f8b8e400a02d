"""Checks of a mission's items one by one: commands, frames, values, speeds, jumps, order."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

from gcs.autopilots.columns import CommandSource
from gcs.autopilots.mission_commands import command_source, known_position, name_of, refusal
from gcs.frames import from_degE7, to_degE7
from gcs.mavlink import MavCommand
from gcs.mission.check.findings import Finding, Level, Rule
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.model import Command, Frame, MissionItem
from gcs.mission.predicted.planned_flight import ALTITUDE_MAX_M

_NO_POSITION = frozenset({int(Frame.MISSION)})
_ENDLESS = frozenset({MavCommand.NAV_LOITER_UNLIM})
_ENDS = frozenset({MavCommand.NAV_LAND, MavCommand.NAV_LOITER_UNLIM, MavCommand.NAV_RETURN_TO_LAUNCH})
_KMH = 3.6  # of 1 m/s
_HOLDS = frozenset(  # parameter 1 is a time, s
    {MavCommand.NAV_WAYPOINT, MavCommand.NAV_LOITER_TIME, MavCommand.NAV_SPLINE_WAYPOINT, MavCommand.NAV_DELAY}
)
FAR_M = 100_000.0  # no quadrotor flies so far
_EARTH_M = 6_371_000.0
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
    yield from _whole(mission)
    for index, item in enumerate(mission.items):
        yield from _taken(mission, index, item)
        yield from _values(mission, index, item)
        if item.command == Command.DO_CHANGE_SPEED:
            yield from _speed(mission, index, item)
        elif item.command == Command.DO_JUMP:
            yield from _jump(mission, index, item)


def found(
    mission: MissionFile, rule: Rule, level: Level, message: str, index: int | None = None, t_s: float | None = None
) -> Finding:
    """A finding about an item of a mission, or about the mission."""
    if index is None:
        return Finding(rule, level, message, mission.source, t_s=t_s)
    return Finding(rule, level, message, mission.source, mission.line(index), mission.seq(index), t_s)


def _whole(mission: MissionFile) -> Iterator[Finding]:
    firmware, items = mission.firmware, mission.items
    count = len(items) + firmware.home_is_item_0
    most = firmware.traits.missions.items_max
    if count > most:
        message = f"{count} items; {firmware.title} stores at most {most}"
        yield found(mission, Rule.ITEMS, Level.ERROR, message)
    if not items:
        yield found(mission, Rule.ITEMS, Level.ERROR, "the mission has no items")
        return
    jumps = [i for i in items if i.command == Command.DO_JUMP]
    jumps_max = firmware.traits.missions.jumps_max
    if jumps_max is not None and len(jumps) > jumps_max:
        message = f"{len(jumps)} jumps; boards with little memory store {jumps_max} and ignore the others"
        yield found(mission, Rule.JUMP, Level.WARNING, message)
    first = next((n for n, i in enumerate(items) if i.command <= MavCommand.NAV_LAST), None)
    if first is None or items[first].command != Command.NAV_TAKEOFF:
        yield found(mission, Rule.ORDER, Level.WARNING, "the first navigation command is not a take-off", first or 0)
    last = [n for n, i in enumerate(items) if i.command <= MavCommand.NAV_LAST]
    if last and items[last[-1]].command not in _ENDS:
        message = f"the mission ends in the air, with {name_of(items[last[-1]].command)}"
        yield found(mission, Rule.ORDER, Level.WARNING, message, last[-1])
    for index, item in enumerate(items[1:], start=1):
        if item.command == Command.NAV_TAKEOFF and items[index - 1].command != Command.NAV_LAND:
            yield found(mission, Rule.ORDER, Level.WARNING, "take-off in the air", index)


def _taken(mission: MissionFile, index: int, item: MissionItem) -> Iterator[Finding]:
    why = refusal(item.command, mission.firmware)
    if why:
        absent = command_source(item.command, mission.firmware) is CommandSource.ABSENT
        mild = absent and item.command > MavCommand.NAV_LAST
        yield found(mission, Rule.COMMAND, Level.WARNING if mild else Level.ERROR, why, index)
    if not known_position(item.command):
        return
    if item.frame in _NO_POSITION:
        message = f"{name_of(item.command)} has a position, but frame {item.frame} has none"
        yield found(mission, Rule.FRAME, Level.ERROR, message, index)
    elif item.frame not in mission.firmware.traits.missions.frames:
        message = f"{mission.firmware.title} refuses altitudes in frame {item.frame}"
        yield found(mission, Rule.FRAME, Level.ERROR, message, index)


def _values(mission: MissionFile, index: int, item: MissionItem) -> Iterator[Finding]:
    if known_position(item.command) and not abs(item.alt_m) <= ALTITUDE_MAX_M:
        yield found(mission, Rule.VALUE, Level.ERROR, f"altitude {item.alt_m:g} m; limit {ALTITUDE_MAX_M:g} m", index)
    hold_s = item.params[0]
    if item.command in _HOLDS and math.isnan(hold_s):
        yield found(mission, Rule.VALUE, Level.ERROR, "the hold time is not a number", index)
    if item.command == Command.NAV_DELAY and hold_s < 0:
        if mission.firmware.traits.flight.waits_for_time_of_day:
            message = "waits until a time of day; the check assumes that it is the common start"
            yield found(mission, Rule.ASSUMED, Level.NOTE, message, index)
        else:
            message = f"{mission.firmware.title} cannot wait until a time of day, only for seconds"
            yield found(mission, Rule.VALUE, Level.ERROR, message, index)
    if not item.autocontinue and index + 1 < len(mission.items):
        message = "the mission stops here until an operator continues it (autocontinue is off)"
        yield found(mission, Rule.ORDER, Level.WARNING, message, index)
    if item.command in _ENDLESS and index + 1 < len(mission.items):
        yield found(mission, Rule.ORDER, Level.WARNING, "the vehicle never flies the items after this one", index)


def _speed(mission: MissionFile, index: int, item: MissionItem) -> Iterator[Finding]:
    kind, speed_mps = item.params[0], item.params[1]
    slowest, fastest = mission.firmware.traits.missions.speed_mps
    if kind not in (0, 1, 2, 3):
        yield found(mission, Rule.VALUE, Level.ERROR, f"unknown speed type {kind:g}", index)
    elif math.isnan(speed_mps):
        yield found(mission, Rule.SPEED, Level.ERROR, "the speed is not a number", index)
    elif speed_mps == -1 or kind > 1:
        return  # no change; climbing and sinking have limits of their own
    elif speed_mps < slowest - 1e-6:
        message = f"{mission.firmware.title} ignores {speed_mps:g} m/s; its minimum is {slowest:g} m/s"
        yield found(mission, Rule.SPEED, Level.ERROR, message, index)
    elif speed_mps > fastest:
        message = f"{speed_mps:g} m/s; {mission.firmware.title} allows at most {fastest:g} m/s"
        if speed_mps / _KMH <= fastest:
            message += f". Is it in km/h? {speed_mps:g} km/h are {speed_mps / _KMH:.1f} m/s"
        yield found(mission, Rule.SPEED, Level.ERROR, message, index)


def _jump(mission: MissionFile, index: int, item: MissionItem) -> Iterator[Finding]:
    number, times = item.params[:2]
    first, last = mission.jumps_from, mission.jumps_from + len(mission.items) - 1
    if not (math.isfinite(number) and number == round(number) and first <= number <= last):
        message = f"jumps to item {number:g}; the mission has items {first} to {last}"
        yield found(mission, Rule.JUMP, Level.ERROR, message, index)
        return
    target = round(number) - first
    if target == index:
        yield found(mission, Rule.JUMP, Level.ERROR, "jumps to itself", index)
    elif math.isnan(times):
        yield found(mission, Rule.JUMP, Level.ERROR, "the number of jumps is not a number", index)
    elif times < 0 and target < index:
        message = "jumps back without end; the vehicle never flies the items after this one"
        yield found(mission, Rule.JUMP, Level.WARNING, message, index)
    elif target < index and not any(i.command <= MavCommand.NAV_LAST for i in mission.items[target:index]):
        yield found(mission, Rule.JUMP, Level.ERROR, "jumps back without a navigation command in between", index)


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
