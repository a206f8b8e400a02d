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
    """
    minutes, second = divmod(unix_s % _DAY_S, 60)
    hour, minute = divmod(minutes, 60)
    wait = MissionItem(Command.NAV_DELAY, Frame.MISSION, (-1.0, float(hour), float(minute), float(second)), 0, 0, 0.0)
    first = mission.items[0]
    if first.command != Command.NAV_TAKEOFF:
        raise ValueError(f"a mission that starts together begins with a take-off, not with command {first.command}")
    after = 2 if mission.items[1].command == Command.NAV_DELAY else 1
    arrivals = mission.arrival_s
    return replace(
        mission, items=(first, wait, *mission.items[after:]), arrival_s=(arrivals[0], None, *arrivals[after:])
    )
