"""Predicted flights against limits: separation, clearance, ceiling, speed, no-fly zones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.mission.check.findings import Level, Rule
from gcs.mission.check.fleet_check import as_on_the_wire, check_fleet
from gcs.mission.check.flight_checks import check_ground, check_limits, check_separation, check_zones
from gcs.mission.flight_limits import FlightLimits, Surroundings, limits_of, surroundings_of
from gcs.mission.predicted.planned_flight import fly
from gcs.scenario.schema.scenario import KeepIn, NoFlyZone, Scenario
from tests.unit.mission.fleets import FLAT, ORIGIN, UNKNOWN, at, mission, out_and_land, speed

HILL = Surroundings(ORIGIN, lambda north, east: 8.0 * np.exp(-(((north - 50) / 10) ** 2)) + 0.0 * east)


def test_two_vehicles_that_meet() -> None:
    """One flies north, the other back along the same line 3 m beside it."""
    there = mission(out_and_land(100.0), name="there.plan")
    back = mission(
        [at(22, 100, 3, 10), speed(5), at(16, 0, 3, 10), at(21, 0, 3, 0)], name="back.plan", home=(100, 3, 0)
    )
    flights = [fly(m, FLAT) for m in (there, back)]
    closest, found = check_separation([there, back], flights, FlightLimits(3.5))
    assert closest is not None
    assert closest.distance_m == pytest.approx(3.0, abs=0.02)
    assert closest.t_s == pytest.approx(14.0, abs=0.05)
    assert [(f.rule, f.level, f.source, f.item) for f in found] == [(Rule.SEPARATION, Level.ERROR, "there.plan", 3)]
    assert "3.00 m from the vehicle of back.plan; at least 3.5 m" in found[0].message
    assert check_separation([there, back], flights, FlightLimits(2.9))[1] == []


def test_vehicles_that_are_nearest_at_the_end_of_a_mission_in_the_air() -> None:
    arriving = mission(out_and_land(100.0)[:3], name="arriving.plan")
    waiting = mission([at(22, 103, 0, 10), at(16, 103, 0, 10)], name="waiting.plan", home=(103, 0, 0))
    missions = [arriving, waiting]
    closest, found = check_separation(missions, [fly(one, FLAT) for one in missions], FlightLimits(3.5))
    assert closest is not None
    assert closest.distance_m == pytest.approx(3.0, abs=0.02)
    assert [(f.source, f.item) for f in found] == [("arriving.plan", 3)]


@pytest.mark.parametrize(
    ("up_m", "asked_m", "message"),
    [
        (10.0, 1.9, None),
        (10.0, 2.5, "2.00 m above the ground; at least 2.5 m"),
        (7.0, 1.0, "into the ground, 1.00 m below its surface"),
    ],
)
def test_a_hill_in_the_way(up_m: float, asked_m: float, message: str | None) -> None:
    over = mission(out_and_land(100.0, up_m=up_m))
    low, found = check_ground(over, fly(over, HILL), HILL, FlightLimits(clearance_m=asked_m))
    assert low is not None
    assert low.clearance_m == pytest.approx(up_m - 8.0, abs=0.01)
    assert low.t_s == pytest.approx(up_m / 2.5 + 10.0, abs=0.15)
    assert [f.message for f in found] == ([] if message is None else [f.message for f in found if message in f.message])
    assert [(f.rule, f.item) for f in found] == ([] if message is None else [(Rule.TERRAIN, 3)])


def test_without_a_map_only_home_is_known() -> None:
    down = mission(out_and_land(100.0, up_m=-3.0), home=(0, 0, 20))
    low, found = check_ground(down, fly(down, UNKNOWN), UNKNOWN, FlightLimits())
    assert low is None
    assert [(f.rule, f.level) for f in found] == [(Rule.TERRAIN, Level.WARNING)]
    assert "3.0 m below the start" in found[0].message
    level = mission(out_and_land(100.0))
    assert check_ground(level, fly(level, UNKNOWN), UNKNOWN, FlightLimits()) == (None, [])


def test_ceiling_speed_and_closed_areas() -> None:
    zone = NoFlyZone(north_m=50.0, east_m=4.0, radius_m=6.0)
    limits = FlightLimits(height_max_m=9.0, speed_ned_mps=(4.0, 5.0, 2.0), no_fly=(zone,), tolerance_m=0.5)
    across = mission(out_and_land(100.0))
    nearest, entered = check_zones(across, fly(across, FLAT), limits)
    assert nearest is not None and nearest.distance_m == pytest.approx(-2.0, abs=0.02)
    found = [*check_limits(across, fly(across, FLAT), limits), *entered]
    assert [(f.rule, f.level) for f in found] == [
        (Rule.HEIGHT, Level.ERROR),
        (Rule.SPEED, Level.ERROR),
        (Rule.AREA, Level.ERROR),
    ]
    assert "1.00 m above the ceiling of 9 m" in found[0].message
    assert "5.00 m/s north; limit 4 m/s" in found[1].message
    assert "m inside no-fly zone 1" in found[2].message
    assert float(found[2].message.split()[0]) == pytest.approx(2.0, abs=0.02)
    steep = mission([at(22, 0, 0, 5), speed(5), at(16, 10, 0, 15), at(21, 10, 0, 0)])
    assert [
        "vertically" in f.message for f in check_limits(steep, fly(steep, FLAT), limits) if f.rule is Rule.SPEED
    ] == [True]
    free = FlightLimits(height_max_m=10.0, speed_ned_mps=(5.0, 5.0, 2.0), no_fly=(), tolerance_m=0.5)
    assert list(check_limits(across, fly(across, FLAT), free)) == []


def test_a_keep_in_area_is_not_left() -> None:
    """100 m north along east = 0: the area ends at north = 97 m, or has its edge 2 m beside the way."""
    across = mission(out_and_land(100.0))
    for corners, least_m, told in (
        (((-50.0, -50.0), (97.0, -50.0), (97.0, 50.0), (-50.0, 50.0)), -3.0, "m outside keep-in area 1"),
        (((-50.0, -50.0), (150.0, -50.0), (150.0, 2.0), (-50.0, 2.0)), 2.0, "m from the edge of keep-in area 1; at"),
    ):
        limits = FlightLimits(keep_in=(KeepIn(polygon_m=corners),), zone_margin_m=2.5)
        nearest, (found,) = check_zones(across, fly(across, FLAT), limits)
        assert nearest is not None and nearest.distance_m == pytest.approx(least_m, abs=0.02)
        assert str(nearest.zone) == "keep-in area 1"
        assert (found.rule, found.level) == (Rule.AREA, Level.ERROR)
        assert told in found.message
        wide = FlightLimits(keep_in=limits.keep_in, zone_margin_m=least_m - 0.1)
        assert check_zones(across, fly(across, FLAT), wide)[1] == []


def test_a_scenarios_limits(simulation1: Scenario) -> None:
    limits = limits_of(simulation1)
    assert limits.separation_m == simulation1.judge.separation_min_m
    assert limits.clearance_m == pytest.approx(simulation1.limits.clearance_min_m - simulation1.mission.tolerance_m)
    assert limits.height_max_m == simulation1.limits.height_m[1] + simulation1.mission.tolerance_m
    assert limits_of(simulation1, 7.0).separation_m == 7.0
    assert limits.speed_ned_mps == simulation1.limits.speed_ned_mps
    assert limits.no_fly == simulation1.no_fly
    around = surroundings_of(simulation1)
    assert around.origin.lat_deg == simulation1.origin.lat_deg
    assert float(around.height_of_ground_m(np.array([760.0, 750.0, 0.0]), 0.0)) == pytest.approx(48.0, abs=0.1)


@pytest.mark.parametrize(("velocity_mps", "leaves_s"), [((0.0, 0.0, 0.0), -4.0), ((0.0, 1.0, 0.0), -7.0)])
def test_vehicles_leave_the_take_off_before_their_hover_and_run_up(
    simulation1: Scenario, velocity_mps: tuple[float, float, float], leaves_s: float
) -> None:
    """A hover of 4 s ends at T0, or where the run-up of 3 s begins that a start in motion needs."""
    phases = simulation1.ground_phases.model_copy(update={"hover_s": 4.0, "run_up_s": 3.0})
    start = simulation1.start.model_copy(update={"velocity_mps": velocity_mps})
    moved = simulation1.model_copy(update={"ground_phases": phases, "start": start})
    assert limits_of(moved).leaves_s == leaves_s


def test_a_fleet_is_checked_as_the_wire_carries_it() -> None:
    third = mission([at(22, 0, 0, 1 / 3), at(16, 10, 0, 1 / 3, p1=0.1), at(21, 10, 0, 0)])
    wired = as_on_the_wire(third)
    assert wired.items[0].alt_m == 0.33
    assert as_on_the_wire(replace(third, firmware=Autopilot.PX4)).items[0].alt_m == float(np.float32(1 / 3))
    assert wired.items[1].params[0] == float(np.float32(0.1))
    assert as_on_the_wire(mission([at(16, 0, 0, 1e300)])).items[0].alt_m == float("inf")


def test_a_fleet_report() -> None:
    fleet = [
        mission(out_and_land(100.0), name="a.plan"),
        mission(
            [at(22, 0, 10, 10), speed(5), at(16, 100, 10, 10), at(21, 100, 10, 0)], name="b.plan", home_known=False
        ),
    ]
    report = check_fleet(fleet, FLAT, FlightLimits(3.0))
    assert report.ok
    assert report.errors == ()
    assert [(f.rule, f.source) for f in report.findings] == [(Rule.ASSUMED, "b.plan")]
    assert report.clearance_min_m == pytest.approx(10.0, abs=0.01)
    near = check_fleet(fleet, FLAT, FlightLimits(12.0))
    assert not near.ok
    assert [f.rule for f in near.errors] == [Rule.SEPARATION]
    alone = check_fleet(fleet[:1], UNKNOWN, FlightLimits(12.0))
    assert alone.ok
    assert alone.closest is None
    assert alone.clearance_min_m is None
