"""A common start: the wait after the take-off ends at one GNSS second for all vehicles."""

from __future__ import annotations

import calendar
from dataclasses import replace

import pytest

from gcs.mission.model import Command, VehicleMission
from gcs.mission.waypoints.mission_items import starting_at


def test_the_wait_names_the_time_of_day(missions: tuple[VehicleMission, ...]) -> None:
    unix_s = calendar.timegm((2031, 5, 17, 23, 4, 59))
    for mission in missions:
        started = starting_at(mission, unix_s)
        assert started.items[1].command == Command.NAV_DELAY
        assert started.items[1].params == (-1.0, 23.0, 4.0, 59.0)
        assert started.items[2:] == mission.items[2:]
        assert len(started.arrival_s) == len(started.items)


def test_a_mission_without_a_wait_gets_one(missions: tuple[VehicleMission, ...]) -> None:
    mission = missions[0]
    without = replace(
        mission,
        items=(mission.items[0], *mission.items[2:]),
        arrival_s=(mission.arrival_s[0], *mission.arrival_s[2:]),
    )
    assert starting_at(without, 0).items[2:] == without.items[1:]


def test_only_missions_that_take_off_can_start_together(missions: tuple[VehicleMission, ...]) -> None:
    mission = missions[0]
    with pytest.raises(ValueError, match="take-off"):
        starting_at(replace(mission, items=mission.items[1:], arrival_s=mission.arrival_s[1:]), 0)
