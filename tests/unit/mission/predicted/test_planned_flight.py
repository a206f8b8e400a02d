"""Planned flights of a mission's items, against times and places worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.mission.flight_limits import Surroundings
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.model import MissionItem
from gcs.mission.predicted.planned_flight import ITEMS_FLOWN_MAX, PredictedFlight, fly, surroundings, together
from tests.unit.mission.fleets import FLAT, ORIGIN, UNKNOWN, at, do, mission, out_and_land, speed

DOWN_S = 0.75 + 10.0 / 0.5  # of ArduCopter from 10 m above home


def where(flight: PredictedFlight, t_s: float) -> list[float]:
    return [float(np.interp(t_s, flight.t_s, flight.ned_m[:, axis])) for axis in range(3)]


def flown(*items: MissionItem, firmware: Autopilot = Autopilot.ARDUPILOT) -> PredictedFlight:
    return fly(mission(items, firmware=firmware), FLAT)


def test_up_across_and_down() -> None:
    """10 m up at 2.5 m/s, 50 m at 5 m/s, 10 m down at 0.5 m/s (LAND_SPEED)."""
    flight = flown(*out_and_land(30.0, 40.0))
    assert (flight.up_s, flight.down_s) == pytest.approx((4.0, 14.0), abs=0.01)
    assert flight.ends_s == pytest.approx(14.0 + DOWN_S, abs=0.01)
    assert where(flight, 2.0) == pytest.approx([0.0, 0.0, -5.0], abs=0.02)
    assert where(flight, 9.0) == pytest.approx([15.0, 20.0, -10.0], abs=0.02)
    assert where(flight, 99.0) == pytest.approx([30.0, 40.0, 0.0], abs=0.02)
    assert np.unique(flight.item).tolist() == [0, 2, 3]


def test_speeds_up_and_down_and_the_autopilots_own() -> None:
    flight = flown(do(178, 2.0, 5.0), do(178, 3.0, 1.0), at(22, 0, 0, 10), at(16, 100, 0, 10), at(21, 100, 0, 0))
    assert flight.up_s == pytest.approx(2.0, abs=0.01)
    assert flight.down_s - flight.up_s == pytest.approx(10.0, abs=0.01)  # WPNAV_SPEED
    assert flight.ends_s - flight.down_s == pytest.approx(DOWN_S, abs=0.01)  # LAND_SPEED, whatever the mission says
    items = (at(22, 0, 0, 10), at(16, 100, 0, 10), at(21, 100, 0, 0))
    assert flown(*items, firmware=Autopilot.PX4).down_s == pytest.approx(10 / 3 + 20.0, abs=0.01)
    for ignored in (do(178, 1.0, -1.0), do(178, 1.0, math.nan), do(178, 1.0, 0.0)):
        assert flown(ignored, *items).down_s == pytest.approx(14.0, abs=0.01)


def test_delays_and_holds() -> None:
    items = [at(22, 0, 0, 10), do(93, 5.0, -1, -1, -1), speed(5), at(16, 50, 0, 10, p1=3.0), at(19, 50, 0, 10, p1=2.0)]
    flight = flown(*items, at(21, 50, 0, 0))
    assert flight.down_s == pytest.approx(4 + 5 + 10 + 3 + 2, abs=0.02)
    # A time of day is the common start, for which no vehicle waits alone.
    assert flown(items[0], do(93, -1.0, 12, 0, 0), *items[2:]).t_s[-1] == pytest.approx(19.0, abs=0.02)


def test_loops_end_after_their_count() -> None:
    legs = [at(22, 0, 0, 10), speed(5), at(16, 50, 0, 10), at(16, 0, 0, 10), do(177, 3.0, 2.0), at(21, 0, 0, 0)]
    assert flown(*legs).down_s == pytest.approx(4.0 + 3 * 20.0, abs=0.05)
    legs[4] = do(177, 3.0, 0.0)
    assert flown(*legs).down_s == pytest.approx(4.0 + 20.0, abs=0.05)


@pytest.mark.parametrize("target", [0.0, 7.0, -1.0, 2.5, math.nan, math.inf])
def test_jumps_that_lead_nowhere_are_passed_over(target: float) -> None:
    legs = [at(22, 0, 0, 10), speed(5), at(16, 50, 0, 10), do(177, target, 5.0), at(21, 50, 0, 0)]
    assert flown(*legs).down_s == pytest.approx(14.0, abs=0.02)


def test_jumps_count_as_the_file_does() -> None:
    items = (at(22, 0, 0, 10), speed(5), at(16, 50, 0, 10), at(16, 0, 0, 10), do(177, 2.0, 1.0), at(21, 0, 0, 0))
    by_seq = MissionFile("w", Autopilot.PX4, mission(()).home, items, jumps_from=0)
    assert fly(by_seq, FLAT).down_s == pytest.approx(10 / 3 + 2 * 20.0, abs=0.05)


@pytest.mark.parametrize("times", [-1.0, 1e9])
def test_a_mission_without_end_is_looked_at_for_a_while(times: float) -> None:
    flight = flown(at(22, 0, 0, 10), speed(5), at(16, 50, 0, 10), at(16, 0, 0, 10), do(177, 3.0, times))
    assert ITEMS_FLOWN_MAX / 2 < len(flight.t_s) < ITEMS_FLOWN_MAX
    assert "does not end" in flight.remarks[-1][1]
    assert math.isinf(flight.ends_s)
    assert flown(do(177, 1.0, -1.0)).remarks[0][0] == 0


def test_return_to_launch() -> None:
    """Up to 15 m over home, back at 5 m/s, down."""
    flight = flown(at(22, 0, 0, 10), speed(5), at(16, 50, 0, 10), do(20))
    assert flight.down_s == pytest.approx(4 + 10 + 5 / 2.5 + 10, abs=0.02)
    assert where(flight, flight.down_s) == pytest.approx([0, 0, -15], abs=0.02)
    assert where(flight, flight.ends_s) == pytest.approx([0, 0, 0], abs=0.02)


def test_latitude_and_longitude_zero_mean_here() -> None:
    climb = MissionItem(16, 3, (0.0,) * 4, 0, 0, 20.0)
    flight = flown(at(22, 0, 0, 10), speed(5), at(16, 50, 0, 10), climb, MissionItem(21, 3, (0.0,) * 4, 0, 0, 0.0))
    assert where(flight, flight.down_s) == pytest.approx([50, 0, -20], abs=0.02)
    assert flight.down_s == pytest.approx(4 + 10 + 10 / 2.5, abs=0.02)
    assert where(flight, flight.ends_s) == pytest.approx([50, 0, 0], abs=0.02)


def test_frames_say_what_altitudes_count_from() -> None:
    hill = Surroundings(ORIGIN, lambda north, east: 0.1 * north + 0.0 * east)
    over = mission([at(22, 0, 0, 10), speed(5), at(16, 100, 0, 12, frame=3)], home=(0, 0, 3))
    assert fly(over, hill).ned_m[-1, 2] == pytest.approx(-15.0, abs=0.01)
    over = mission([at(22, 0, 0, 10), speed(5), at(16, 100, 0, 515, frame=0)], home=(0, 0, 3))
    assert fly(over, hill).ned_m[-1, 2] == pytest.approx(-15.0, abs=0.01)
    over = mission([at(22, 0, 0, 10), speed(5), at(16, 100, 0, 5, frame=10)], home=(0, 0, 3))
    assert fly(over, hill).ned_m[-1, 2] == pytest.approx(-15.0, abs=0.01)
    # Without a map the ground is as high as home everywhere.
    assert fly(over, UNKNOWN).ned_m[-1, 2] == pytest.approx(-8.0, abs=0.01)


def test_heights_above_ground_follow_it_between_waypoints() -> None:
    bump = Surroundings(ORIGIN, lambda north, east: 20.0 * np.exp(-(((north - 100) / 30) ** 2)) + 0.0 * east)
    legs = [at(22, 0, 0, 10, frame=10), speed(5), at(16, 200, 0, 10, frame=10)]
    flight = fly(mission(legs), bump)
    north = flight.ned_m[2:, 0]
    above = -flight.ned_m[2:, 2] - 20.0 * np.exp(-(((north - 100) / 30) ** 2))
    assert len(north) > 30
    assert above == pytest.approx(np.full(len(above), 10.0), abs=0.02)
    assert flight.ned_m[:, 2].min() == pytest.approx(-30.0, abs=0.3)  # a look every 5 m


def test_landing_ends_on_the_ground_that_is_there() -> None:
    hill = Surroundings(ORIGIN, lambda north, east: 0.1 * north + 0.0 * east)
    flight = fly(mission(out_and_land(50.0)), hill)
    assert flight.ned_m[-1, 2] == pytest.approx(-5.0, abs=0.01)
    assert flight.ends_s - flight.down_s == pytest.approx(0.75 + 5.0 / 0.5, abs=0.02)


def test_px4_goes_to_where_it_takes_off() -> None:
    legs = [at(22, 20, 0, 10), at(21, 20, 0, 0)]
    assert where(flown(*legs, firmware=Autopilot.PX4), 99.0)[0] == pytest.approx(20.0, abs=0.01)
    assert flown(*legs).ned_m[1, 0] == pytest.approx(0.0, abs=0.01)


def test_all_leave_the_take_off_together() -> None:
    """The one that climbs higher is waited for; what follows is shifted, not stretched."""
    low, high = fly(mission(out_and_land(50.0)), FLAT), fly(mission(out_and_land(50.0, up_m=20.0)), FLAT)
    first, second = together([low, high])
    assert first.up_s == second.up_s == pytest.approx(8.0, abs=0.01)
    assert second is high
    assert where(first, 6.0) == where(first, 8.0) == pytest.approx([0, 0, -10], abs=0.01)
    assert (first.down_s, second.down_s) == pytest.approx((18.0, 18.0), abs=0.01)
    assert first.ends_s == pytest.approx(18.0 + DOWN_S, abs=0.01)


def test_a_mission_without_take_off_is_under_way_from_its_first_leg() -> None:
    flight = flown(speed(5), at(16, 50, 0, 10))
    assert flight.up_s == 0.0
    assert flight.down_s == flight.t_s[-1]


def test_what_is_not_modelled_is_remarked() -> None:
    remarks = flown(at(22, 0, 0, 10), at(82, 50, 0, 10), at(18, 50, 0, 10)).remarks
    assert [index for index, _ in remarks] == [1, 2]


def test_loitering_for_ever_is_the_end() -> None:
    flight = flown(at(22, 0, 0, 10), at(17, 50, 0, 10), at(16, 500, 0, 10))
    assert where(flight, 1e6)[0] == pytest.approx(50.0, abs=0.01)
    assert math.isinf(flight.ends_s)


def test_no_items_no_flight() -> None:
    flight = flown()
    assert len(flight.t_s) == 1
    assert fly(mission((), home_known=False), UNKNOWN).ned_m.shape == (1, 3)


@pytest.mark.parametrize("alt", [math.nan, 1e30, -1e30])
def test_mad_altitudes_stay_numbers(alt: float) -> None:
    assert np.isfinite(flown(at(22, 0, 0, alt), at(16, 10, 0, alt)).ned_m).all()


def test_the_frame_of_strangers_begins_at_their_home() -> None:
    known = mission(out_and_land(50.0))
    assert known.home is not None
    around = surroundings([mission((), home_known=False), known])
    assert (around.origin.lat_deg, around.origin.alt_amsl_m) == (known.home.lat_deg, known.home.alt_amsl_m)
    nowhere = surroundings([mission(out_and_land(50.0), home_known=False)])
    assert nowhere.origin.lat_deg == pytest.approx(ORIGIN.lat_deg, abs=1e-7)
    assert nowhere.origin.alt_amsl_m == 0.0
    assert surroundings([mission((), home_known=False)]).origin.lat_deg == 0.0


def test_an_unknown_home_is_the_ground_under_the_first_place() -> None:
    hill = Surroundings(ORIGIN, lambda north, east: 3.0 + 0.0 * north)
    flight = fly(mission(out_and_land(50.0), home_known=False), hill)
    assert flight.ned_m[0] == pytest.approx([0, 0, -3], abs=0.01)
    assert flight.ned_m[1] == pytest.approx([0, 0, -13], abs=0.01)
