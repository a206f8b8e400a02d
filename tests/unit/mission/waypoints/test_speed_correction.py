"""Speeds that bring a vehicle to its waypoints when they are due."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.autopilots.waypoint_models.predict import predict
from gcs.mission.machine_independent import ORDER_GRID
from gcs.mission.waypoints import speed_correction
from gcs.mission.waypoints.leg_profile import SHARES, LegProfile, NavigatorLimits, leg_profile
from gcs.mission.waypoints.speed_correction import correct
from gcs.util.long_work import shown

NAMES = pytest.mark.parametrize("name", ["ardupilot", "px4"])
LIMITS = NavigatorLimits(np.array([6.0, 6.0, 2.0]), slowest_mps=0.3, fastest_mps=12.0)


def bend() -> tuple[np.ndarray, np.ndarray, list[int]]:
    """From rest along a bend of 300 m, slower and slower towards its end, in samples of 0.1 s."""
    t_s = np.arange(0.0, 90.05, 0.1)
    speed = np.interp(t_s, [0.0, 8.0, 50.0, 60.0, 82.0, 90.0], [0.0, 4.5, 4.5, 3.0, 3.0, 0.0])
    course = np.interp(t_s, [0.0, 30.0, 60.0, 90.0], [0.0, 0.0, 0.8, 0.8])
    north, east = (np.cumsum(speed * part) * 0.1 for part in (np.cos(course), np.sin(course)))
    down = -20.0 - np.interp(t_s, [0.0, 40.0, 60.0], [0.0, 0.0, 4.0])
    return t_s, np.stack([north, east, down], axis=1), [0, 100, 250, 350, 450, 550, 620, 700, 900]


def late_s(name: str, speeds_mps: np.ndarray, course: object) -> np.ndarray:
    flown = predict(Autopilot.named(name).navigator, course.orders(speeds_mps))  # type: ignore[attr-defined]
    return (course.passed_s(flown) - course.due_s)[:, -1]  # type: ignore[attr-defined,no-any-return]


@NAMES
def test_late_waypoints_are_passed_in_time(name: str) -> None:
    course, legs = leg_profile(*bend(), LIMITS, 200.0)
    assert legs == list(range(8))
    before = late_s(name, course.planned_mps, course)
    found = correct(Autopilot.named(name).navigator, course, (0.0, 3.0))
    assert np.abs(before).max() > 1.0
    assert np.abs(found.late_s).max() < 0.5
    assert np.allclose(late_s(name, found.speeds_mps, course) - found.lead_s, found.late_s)
    assert 0.0 <= found.lead_s <= 2.0
    assert (found.speeds_mps >= 0.3).all()
    assert (found.speeds_mps <= course.fastest_mps + 1e-9).all()


def test_the_progress_says_how_far_off_the_waypoints_still_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes minutes for many vehicles: the same line again and again would look like a standstill."""
    heard: list[str] = []
    at: list[int] = []  # how many lines were heard before each flight of the model, which takes up to a second
    monkeypatch.setattr(speed_correction, "predict", lambda *flown: (at.append(len(heard)), predict(*flown))[1])
    course, _ = leg_profile(*bend(), LIMITS, 200.0)
    with shown(heard.append, every_s=0.0):
        correct(Autopilot.ARDUPILOT.navigator, course, (0.0, 3.0))
    off_s = [float(line.removesuffix(" s off").split()[-1]) for line in heard]
    assert off_s[0] > 1.0 > off_s[-1]
    assert max(Counter(at).values()) <= 3


def test_a_vehicle_begins_with_what_was_found_for_one_like_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Vehicles are corrected one after the other: the second takes a fraction of the flights."""
    navigator, (t_s, position, ends) = Autopilot.ARDUPILOT.navigator, bend()
    found = correct(navigator, leg_profile(t_s, position, ends, LIMITS, 200.0)[0], (0.0, 3.0)).found
    beside, _ = leg_profile(t_s, 1.02 * position, ends, LIMITS, 200.0)
    flights: list[bool] = []
    monkeypatch.setattr(speed_correction, "predict", lambda *flown: (flights.append(True), predict(*flown))[1])
    alone, alone_flights = correct(navigator, beside, (0.0, 3.0)), len(flights)
    like = correct(navigator, beside, (0.0, 3.0), found)
    assert len(flights) - alone_flights <= alone_flights // 2
    assert np.abs(like.late_s).max() < max(np.abs(alone.late_s).max(), 0.2) + 0.1


def test_a_speed_with_little_effect_stays_near_the_planned_one() -> None:
    """The last legs are 0.5 and 0.2 m long: the vehicle brakes there whatever is commanded."""
    t_s, position, _ = bend()
    ends = [0, 350, 450, 550, 700, 880, 890, 900]
    course, _ = leg_profile(t_s, position, ends, LIMITS, 200.0)
    found = correct(Autopilot.ARDUPILOT.navigator, course, (0.0, 3.0))
    assert np.abs(np.log(found.speeds_mps / course.planned_mps))[-2:].max() < 0.15


def test_speeds_keep_to_the_limits_of_every_axis() -> None:
    course, _ = leg_profile(*bend(), replace(LIMITS, speed_ned_mps=np.array([4.0, 4.0, 0.1])), 200.0)
    ways = np.diff(course.points_ned_m, axis=0)
    found = correct(Autopilot.ARDUPILOT.navigator, course)
    asked = np.abs(ways) / course.lengths_m[:, None] * found.speeds_mps[:, None]
    assert (asked <= np.array([4.0, 4.0, 0.1]) + np.abs(ways) * 0.3 / course.lengths_m[:, None] + 1e-9).all()
    assert found.lead_s == 0.0


def test_a_rest_is_a_hold_and_not_a_leg() -> None:
    t_s = np.arange(0.0, 60.05, 0.1)
    north = np.interp(t_s, [0.0, 20.0, 30.0, 60.0], [0.0, 80.0, 80.0, 200.0])
    position = np.stack([north, 0.0 * north, 0.0 * north - 10.0], axis=1)
    course, legs = leg_profile(t_s, position, [0, 200, 300, 600], LIMITS, 0.0)
    assert legs == [0, 2]
    assert course.holds_s.tolist() == pytest.approx([10.0, 0.0])
    assert course.due_s[0].tolist() == pytest.approx([20.0 * share for share in SHARES], abs=ORDER_GRID)
    found = correct(Autopilot.ARDUPILOT.navigator, course)
    assert found.flown.completed_s[0] - found.flown.passed_s[0] >= 10.0


@NAMES
def test_a_hold_ends_when_the_plan_leaves_wherever_the_delay_begins(name: str) -> None:
    """PX4 begins a delay at its radius of 2 m, half a second before the rest at 4 m/s; ArduPilot begins it in rest."""
    navigator = Autopilot.named(name).navigator
    t_s = np.arange(0.0, 60.05, 0.1)
    north = np.interp(t_s, [0.0, 20.0, 30.0, 60.0], [0.0, 80.0, 80.0, 170.0])
    course, _ = leg_profile(
        t_s,
        np.stack([north, 0.0 * north, 0.0 * north - 10.0], axis=1),
        [0, 200, 300, 600],
        replace(LIMITS, delay_begins_m=navigator.delay_begins_m),
        200.0,
    )
    early_s = {"ardupilot": 0.0, "px4": 0.5}[name]
    assert course.holds_s.tolist() == pytest.approx([10.0 + early_s, 0.0])
    assert course.due_s[0, -1] == pytest.approx(20.0 - early_s, abs=ORDER_GRID)
    found = correct(navigator, course)
    assert found.flown.completed_s[0] == pytest.approx(30.0, abs=1.0)  # no vehicle stops from 4 m/s at once
    assert np.abs(found.late_s).max() < 1.0


def slower_at_the_end(cruise_mps: float, slow_mps: float) -> LegProfile:
    """Legs of a mission whose vehicles came within a metre, flown straight on: the last, to a stop, is a slow one."""
    ends_m = np.cumsum([0.0, 20.0, 18.7, 18.7, 13.4, 16.8, 18.5])
    speed_mps, along_m = 0.0, [0.0]
    while ends_m[-1] - along_m[-1] > 0.02:
        wanted_mps = min(cruise_mps if along_m[-1] < ends_m[-2] else slow_mps, math.sqrt(ends_m[-1] - along_m[-1]))
        speed_mps += min(max(wanted_mps - speed_mps, -0.1), 0.07)
        along_m.append(along_m[-1] + 0.1 * speed_mps)
    north_m = np.array(along_m)
    waypoints = [int(np.abs(north_m - end_m).argmin()) for end_m in ends_m]
    t_s, position = 0.1 * np.arange(len(north_m)), np.stack([north_m, 0.0 * north_m, 0.0 * north_m - 25.0], axis=1)
    return leg_profile(t_s, position, waypoints, LIMITS, 200.0)[0]


@pytest.mark.parametrize(("cruise_mps", "slow_mps"), [(2.9, 2.0), pytest.param(2.7, 1.6, marks=pytest.mark.slow)])
def test_no_speed_counts_on_being_ignored(cruise_mps: float, slow_mps: float) -> None:
    """ArduCopter may make a slow-down, and the vehicle is seconds late, or not: no leg is much slower than flown."""
    course = slower_at_the_end(cruise_mps, slow_mps)
    found = correct(Autopilot.ARDUPILOT.navigator, course, (0.0, 3.0))
    one_third, two_thirds, _ = course.passed_s(found.flown).T
    flown_mps = course.lengths_m / 3.0 / (two_thirds - one_third)
    assert (flown_mps <= 1.15 * found.speeds_mps).all()
    assert np.abs(found.late_s).max() < 0.5
    made, not_made = (
        predict(each, course.orders(found.speeds_mps)) for each in Autopilot.ARDUPILOT.navigator.reactions
    )
    assert np.abs(made.passed_s - not_made.passed_s).max() < 1.0
