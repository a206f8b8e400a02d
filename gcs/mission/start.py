"""A common start for missions that fly themselves: everyone waits for the same GNSS time of day.

Knows: NAV_DELAY's two forms (for some seconds, until a time of day). Does not know: clocks, links.
A command to start reaches vehicles tens of milliseconds apart, and a formation with 0.5 m between its vehicles at
5 m/s has no room for that; their GNSS clocks agree to microseconds.
"""

from __future__ import annotations

from dataclasses import replace

from gcs.mission.model import Command, Frame, MissionItem, VehicleMission

_DAY_S = 86400


def starting_at(mission: VehicleMission, unix_s: int) -> VehicleMission:
    """The mission with its wait after the take-off ending at `unix_s` (whole seconds of GNSS unix time).

    ArduPilot reads NAV_DELAY without seconds as "until hour, minute, second UTC"; within a day that is one instant.
    Gates are left as many whole seconds after that as they are planned to be.
    """
    first = mission.items[0]
    if first.command != Command.NAV_TAKEOFF:
        raise ValueError(f"a mission that starts together begins with a take-off, not with command {first.command}")
    begins = 1 if mission.items[1].command == Command.NAV_DELAY else 0  # index of a delay to take the place of
    items, arrivals = list(mission.items), mission.arrival_s
    for index, leaves_s in mission.gates:
        items[index] = _until(unix_s + round(leaves_s - mission.leaves_s))
    shift = 1 - begins
    return replace(
        mission,
        items=(first, _until(unix_s), *items[1 + begins :]),
        arrival_s=(arrivals[0], None, *arrivals[1 + begins :]),
        gates=tuple((index + shift, leaves_s) for index, leaves_s in mission.gates),
    )


def _until(unix_s: int) -> MissionItem:
    minutes, second = divmod(unix_s % _DAY_S, 60)
    hour, minute = divmod(minutes, 60)
    return MissionItem(Command.NAV_DELAY, Frame.MISSION, (-1.0, float(hour), float(minute), float(second)), 0, 0, 0.0)
