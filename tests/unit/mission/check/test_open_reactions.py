"""What an autopilot may do or not, by each vehicle of a formation: slow down with scarce room, brake at waypoints."""

from __future__ import annotations

import re

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.mission.check.findings import Rule
from gcs.mission.check.fleet_check import FleetReport, check_apart, check_fleet
from gcs.mission.flight_limits import FlightLimits
from gcs.mission.predicted.arrival_spread import ArrivalSpread
from gcs.mission.predicted.autopilot_flight import AutopilotFlight
from gcs.mission.predicted.planned_flight import PredictedFlight
from tests.unit.mission.fleets import FLAT, at, mission, speed

AHEAD_M = 8.0
ARDUPILOT, PX4 = Autopilot.ARDUPILOT, Autopilot.PX4


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


@pytest.mark.parametrize("length_m", [17.5, pytest.param(17.9, marks=pytest.mark.slow)])
def test_one_may_slow_down_and_the_other_not(length_m: float) -> None:
    """The predicted flights keep 8 m, whatever the model decides. The one behind may not slow down."""
    report = follows(length_m)
    assert report.closest is not None
    assert report.closest.distance_m > 7.5
    assert 3.5 < report.spread_s < 6.0
    (finding,) = report.errors
    assert finding.rule is Rule.SEPARATION
    assert finding.message.endswith("at least 5 m required, by what its autopilot may do")


@pytest.mark.parametrize(
    ("known", "may_s", "nearest_m"),
    [(ARDUPILOT, 0.0, None), (ARDUPILOT, 1.0, None), (ARDUPILOT, 2.0, 2.77), (ARDUPILOT, 6.0, 0.0), (PX4, 0.0, 2.26)],
)
def test_who_may_be_early_may_meet_who_crosses(known: Autopilot, may_s: float, nearest_m: float | None) -> None:
    """Both fly 4 m/s; one crosses the other's path 3 s behind it. Six seconds early it is far away again."""
    t_s, item = np.array([0.0, 40.0]), np.array([1, 1])
    north, east = np.array([[-40.0, 0.0, -9.0], [120.0, 0.0, -9.0]]), np.array([[0.0, -52.0, -9.0], [0.0, 108.0, -9.0]])
    flights = tuple(PredictedFlight(t_s, ned_m, item, 0.0, 40.0, 50.0) for ned_m in (north, east))
    spreads = tuple(ArrivalSpread(t_s, np.full(2, early_s), np.zeros(2)) for early_s in (0.0, -may_s))
    fleet = [mission([], name=name, firmware=known) for name in ("north", "east")]
    report = FleetReport((), None, (), 50.0, flights, (), spreads)
    findings = list(check_apart(fleet, report, FlightLimits(separation_m=3.0)))
    assert [finding.rule for finding in findings] == [Rule.SEPARATION] * (nearest_m is not None)
    for finding in findings:
        near_m, early_s = re.findall(r"within ([\d.]+) m of the vehicle of east .* up to ([\d.]+) s", finding.message)[
            0
        ]
        assert float(near_m) == pytest.approx(nearest_m, abs=0.1)
        assert float(early_s) == pytest.approx(known.traits.apart_s + may_s, abs=0.01)
