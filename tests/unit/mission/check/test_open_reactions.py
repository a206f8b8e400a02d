"""A slow-down with about as much room as ArduCopter asks for: it may be made or not, by each vehicle of a formation."""

from __future__ import annotations

import pytest

from gcs.mission.check.findings import Rule
from gcs.mission.check.fleet_check import FleetReport, check_fleet
from gcs.mission.flight_limits import FlightLimits
from gcs.mission.predicted.autopilot_flight import AutopilotFlight
from tests.unit.mission.fleets import FLAT, at, mission, speed

AHEAD_M = 8.0


def follows(length_m: float) -> FleetReport:
    """Two vehicles, one 8 m ahead, slow down from 2.5 to 1.04 m/s on a leg of this length."""
    fleet = []
    for name, north_m in (("front", AHEAD_M), ("back", 0.0)):
        end_m = north_m + 20.0 + length_m
        legs = [at(22, north_m, 0, 10), speed(2.5), at(16, north_m + 20.0, 0, 10), speed(1.04), at(16, end_m, 0, 10)]
        fleet.append(mission([*legs, at(21, end_m, 0, 0)], name=name, home=(north_m, 0.0, 0.0)))
    modelled = AutopilotFlight()
    return check_fleet(fleet, FLAT, FlightLimits(separation_m=5.0), modelled, modelled.others)


@pytest.mark.parametrize("length_m", [16.0, 20.0])
def test_a_slow_down_that_is_surely_made_or_surely_not_leaves_nothing_open(length_m: float) -> None:
    report = follows(length_m)
    assert report.spread_s == 0.0
    assert report.errors == ()


@pytest.mark.parametrize("length_m", [17.5, 17.9])
def test_one_may_slow_down_and_the_other_not(length_m: float) -> None:
    """The predicted flights keep 8 m, whatever the model decides. The one behind may not slow down."""
    report = follows(length_m)
    assert report.closest is not None
    assert report.closest.distance_m > 7.5
    assert 3.5 < report.spread_s < 6.0
    (finding,) = report.errors
    assert finding.rule is Rule.SEPARATION
    assert finding.message.endswith("at least 5 m required, by what its autopilot may do")
