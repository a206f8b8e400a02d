"""Waypoints from samples: closed forms for the longest leg, both limits held, evenness."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.mission.waypoints.placement import (
    Deviation,
    SampledFlight,
    _Pace,
    deviation,
    gentle_indices,
    waypoint_indices,
)

T = np.linspace(0.0, 20.0, 2001)


def along_north(s_m: np.ndarray) -> SampledFlight:
    return SampledFlight(T, np.stack([s_m, 0 * s_m, 0 * s_m], axis=-1)[None])


def test_straight_and_steady_needs_no_waypoint_between() -> None:
    assert waypoint_indices(along_north(3.0 * T), Deviation(1e-6, 1e-6)) == [0, 2000]


def test_constant_acceleration_splits_by_time_although_the_path_is_straight() -> None:
    # s = a t^2 / 2: a constant-speed leg of duration T is a T^2 / 8 behind halfway.
    a, limit = 0.2, 0.11
    flown = along_north(0.5 * a * T**2)
    indices = waypoint_indices(flown, Deviation(1e-3, limit))
    longest_s = np.sqrt(8 * limit / a)
    assert len(indices) - 1 == np.ceil(20.0 / longest_s)
    error = deviation(flown, indices)
    assert error.path_m < 1e-9
    assert 0.8 * limit < error.time_m <= limit


def test_circle_splits_by_sagitta() -> None:
    # A chord over an angle w leaves a circle by R (1 - cos(w / 2)).
    radius, limit = 50.0, 0.5
    angle = 2 * np.pi * T / T[-1]
    circle = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * T], axis=-1)[None]
    indices = waypoint_indices(SampledFlight(T, circle), Deviation(limit, 100.0))
    widest = 2 * np.arccos(1 - limit / radius)
    assert len(indices) - 1 == np.ceil(2 * np.pi / widest)
    assert deviation(SampledFlight(T, circle), indices).path_m <= limit


def test_the_last_leg_is_no_splinter() -> None:
    flown = along_north(0.5 * 0.2 * T**2)
    durations = np.diff(T[waypoint_indices(flown, Deviation(1.0, 0.1))])
    assert durations.min() > 0.5 * durations.max()


def test_every_vehicle_counts() -> None:
    straight = np.stack([T, 0 * T, 0 * T], axis=-1)
    weaving = np.stack([T, np.sin(T), 0 * T], axis=-1)
    both = SampledFlight(T, np.stack([straight, weaving]))
    indices = waypoint_indices(both, Deviation(0.1, 0.5))
    assert len(indices) > 10
    error = deviation(both, indices)
    assert error.path_m <= 0.1
    assert error.time_m <= 0.5


def test_deviation_is_measured_from_the_middle_of_a_bend() -> None:
    t = np.array([0.0, 1.0, 2.0])
    bend = np.array([[[0.0, 0, 0], [3, 4, 0], [6, 0, 0]]])
    assert deviation(SampledFlight(t, bend), [0, 2]) == Deviation(4.0, 4.0)


def test_a_leg_too_slow_to_fly_is_flown_faster_and_waited_out() -> None:
    # 1 m in 20 s at no less than 0.2 m/s: there after 5 s, then 0.75 m ahead of the plan.
    slow = SampledFlight(T, np.stack([0.05 * T, 0 * T, 0 * T], axis=-1)[None], speed_min_mps=0.2)
    assert deviation(slow, [0, 2000]).time_m == pytest.approx(0.75)
    assert deviation(slow, waypoint_indices(slow, Deviation(0.1, 0.1))).time_m <= 0.1


def test_standing_still_is_one_leg() -> None:
    assert waypoint_indices(along_north(0 * T), Deviation(0.01, 0.01)) == [0, 2000]


def test_no_leg_passes_over_a_drawn_point() -> None:
    """A straight line at constant speed needs two waypoints; drawn points are kept among them, and nothing else."""
    drawn = (3, 700, 1999)
    line = SampledFlight(T, along_north(3.0 * T).position_ned_m, drawn=drawn)
    assert waypoint_indices(line, Deviation(1e-6, 1e-6)) == [0, *drawn, 2000]
    # Speeds that no short leg sustains: legs are long, but end at drawn points all the same.
    kept = gentle_indices(line, Deviation(1e-6, 1e-6), lambda length_m: 0.01 * length_m, 1.0)
    assert kept == [0, *drawn, 2000]


def test_waypoints_between_drawn_points_are_as_far_apart_as_their_speed_needs() -> None:
    circle = 50.0 * np.stack([np.cos(0.5 * T), np.sin(0.5 * T), 0.0 * T], axis=-1)[None]
    drawn = (640, 1330)
    flown = SampledFlight(T, circle, drawn=drawn)
    kept = gentle_indices(flown, Deviation(0.1, 100.0), lambda length_m: 0.5 * length_m, 1.0)
    assert set(drawn) <= set(kept)
    chords_m = np.linalg.norm(np.diff(circle[0, kept], axis=0), axis=1)
    # 25 m/s need 50 m
    assert chords_m.min() >= 49.9
    assert len(kept) > 8


def test_a_leg_that_is_not_allowed_is_split_though_it_is_straight() -> None:
    """No leg may pass over the sample at 5 s; a leg to the next sample is always accepted."""
    line = SampledFlight(T, along_north(3.0 * T).position_ned_m, allowed=lambda i, j: not i < 500 < j)
    assert waypoint_indices(line, Deviation(1.0, 1.0)) == [0, 500, 2000]
    never = SampledFlight(T[:5], along_north(3.0 * T).position_ned_m[:, :5], allowed=lambda i, j: False)
    assert waypoint_indices(never, Deviation(1.0, 1.0)) == [0, 1, 2, 3, 4]


def test_beyond_the_ends_of_a_leg_the_distance_is_that_to_its_ends() -> None:
    """Back 3 m and aside 4 m before it goes on: 5 m from the start of the leg, and half of the way ahead in time."""
    t = np.array([0.0, 1.0, 2.0])
    back = np.array([[[0.0, 0, 0], [-3, 4, 0], [6, 0, 0]]])
    error = deviation(SampledFlight(t, back), [0, 2])
    assert (error.path_m, error.time_m) == (pytest.approx(5.0), pytest.approx(np.hypot(6.0, 4.0)))


@pytest.mark.parametrize(("share", "legs"), [(1.0, 4), (0.5, 8), (2.0, 2)])
def test_legs_are_long_enough_for_a_share_of_their_speed(share: float, legs: int) -> None:
    """At 3 m/s over 60 m, with 0.2 m/s sustained for each metre: 15 m for all of it; 0.02 m/s are always sustained."""
    line = SampledFlight(T, along_north(3.0 * T).position_ned_m, allowed=lambda i, j: j - i < 2)
    kept = gentle_indices(line, Deviation(1.0, 1.0), lambda length_m: 0.2 * length_m, share)
    assert len(kept) - 1 == pytest.approx(legs, abs=1)
    lengths_m = 3.0 * np.diff(T[kept])
    assert lengths_m[:-1].min() == pytest.approx((3.0 - 0.02) * share / 0.2, abs=0.2)
    assert lengths_m[-1] >= (3.0 - 0.02) * share / 0.2 - 0.2  # the last leg is not shorter


def test_the_speed_of_a_leg_is_halfway_between_its_mean_and_its_highest() -> None:
    """10 s at 1 m/s, then 10 s at 5 m/s, of a second vehicle; over all of it 3 and 5 give 4 m/s."""
    second = np.where(T < 10.0, T, 10.0 + 5.0 * (T - 10.0))
    both = SampledFlight(T, np.concatenate([along_north(0.5 * T).position_ned_m, along_north(second).position_ned_m]))
    for most_mps, sustained in ((4.05, True), (3.9, False)):
        pace = _Pace(both, lambda length_m, most=most_mps: most if length_m > 40.0 else 0.6, 1.0)  # type: ignore[misc]
        assert pace.sustained(0, 2000) == sustained
    slow = _Pace(both, lambda length_m: 0.0, 1.0)
    assert not slow.sustained(0, 2000)
    still = _Pace(SampledFlight(T, along_north(0.01 * T).position_ned_m), lambda length_m: 0.0, 1.0)
    assert still.sustained(0, 2000)
