"""What breaks, when it does, and what the controller makes of it."""

from __future__ import annotations

import numpy as np
import pytest

from sim_bridge.dynamics.failures import Effects, Failure, Sensor
from sim_bridge.dynamics.sensors import RTK
from tests.unit.sim_bridge.flights import (
    F150,
    F150_LIMITS,
    FIELD,
    FIELD_LIMITS,
    YAW_RAD,
    course,
    fly,
    hold,
    reference_of,
    stand,
    steps,
)

PADS_NED_M = 5.0 * np.arange(2)[:, None] * np.array([[1.0, 0.0, 0.0]])


def hovering(q, limits, seed=6):
    """Two vehicles 3 m up, and what holds them there."""
    airframes = stand(q, limits, RTK, PADS_NED_M, seed=seed)
    fly(airframes, course(yaw_swing_rad=0.0).part(0.0, 13.5), PADS_NED_M)
    return airframes, hold(PADS_NED_M + np.array([0.0, 0.0, -3.0]), np.full(2, YAW_RAD))


def go_on(airframes, reference, seconds):
    truth = []
    for _ in range(steps(seconds)):
        airframes.step(reference, np.array([True, True]))
        truth.append(airframes.truth.copy())
    return np.array(truth)


def test_failures_add_up_vehicle_by_vehicle():
    motor = Failure(motor=2, share=0.5)
    found = Effects.of(
        [
            [Failure(gnss_lost=True), motor, motor, Failure(push_ned_mps2=(0.0, 0.0, 1.5))],
            [
                Failure(sensor=Sensor.COMPASS),
                *(Failure(wind_ned_mps=wind) for wind in ((3.0, 0.0, 0.0), (1.0, -2.0, 0.0))),
                *(Failure(remaining=share) for share in (0.3, 0.1, 0.2)),
            ],
            [*(Failure(offset_ned_m=far) for far in ((1.0, 0.0, 0.0), (0.0, 2.0, 0.0))), Failure(speed_mps=2.0)],
        ]
    )
    assert not found.sound and Effects.of([(), ()]).sound
    assert found.gnss_lost.tolist() == [True, False, False]
    np.testing.assert_array_equal(found.motor_strength, [[1.0, 0.25, 1.0, 1.0], [1.0] * 4, [1.0] * 4])
    assert np.argwhere(found.stuck).tolist() == [[1, Sensor.COMPASS]]
    np.testing.assert_array_equal(found.gnss_offset_ned_m[2], [1.0, 2.0, 0.0])
    np.testing.assert_array_equal(found.speed_max_mps, [np.inf, np.inf, 2.0])
    np.testing.assert_array_equal(found.wind_ned_mps, [[0.0] * 3, [4.0, -2.0, 0.0], [0.0] * 3])
    np.testing.assert_array_equal(found.push_ned_mps2, [[0.0, 0.0, 1.5], [0.0] * 3, [0.0] * 3])
    np.testing.assert_array_equal(found.remaining, [1.0, 0.1, 1.0])


def test_a_drained_battery_stays_drained_and_is_drained_once():
    airframes, there = hovering(FIELD, FIELD_LIMITS)
    airframes.fail(1, [Failure(remaining=0.3)])
    go_on(airframes, there, 10.0)
    after = airframes.battery.remaining.copy()
    assert after[0] > 0.9 and after[1] < 0.3
    airframes.fail(1, [Failure(remaining=0.3), Failure(speed_mps=9.0)])
    go_on(airframes, there, 0.02)
    airframes.fail(1, [])
    go_on(airframes, there, 0.02)
    np.testing.assert_allclose(airframes.battery.remaining, after, atol=1e-3)


@pytest.mark.parametrize(
    ("q", "limits", "share"),
    [pytest.param(F150, F150_LIMITS, 0.1, marks=pytest.mark.slow), (FIELD, FIELD_LIMITS, 0.25)],
)
def test_a_motor_that_weakens_is_made_good_and_the_neighbour_feels_nothing(q, limits, share):
    airframes, there = hovering(q, limits)
    sound, same = hovering(q, limits)
    airframes.fail(0, [Failure(motor=3, share=share)])
    truth, healthy = go_on(airframes, there, 20.0), go_on(sound, same, 20.0)
    off_m = np.linalg.norm(truth[:, :, :3] - there[:, 0, :3], axis=-1)
    assert off_m[:, 0].max() < 1.5
    assert off_m[steps(15.0) :, 0].max() < 0.1
    np.testing.assert_allclose(truth[:, 1], healthy[:, 1], atol=1e-9)
    assert airframes.rotors_radps[0, 2] > (1.0 + 0.4 * share) * airframes.rotors_radps[1, 2]  # for the same thrust
    np.testing.assert_allclose(airframes.control[0], airframes.control[1], atol=0.15 * q.weight_N)


def test_a_push_moves_its_vehicle_its_sensors_feel_it_and_it_comes_back():
    airframes, there = hovering(FIELD, FIELD_LIMITS)
    airframes.fail(0, [Failure(push_ned_mps2=(0.0, 6.0, 0.0))])
    pushed = go_on(airframes, there, 1.0)
    airframes.fail(0, [])
    truth = np.concatenate((pushed, go_on(airframes, there, 14.0)))
    off_m = truth[:, :, :3] - there[:, 0, :3]
    assert off_m[:, 0, 1].max() > 1.0
    assert np.linalg.norm(off_m[:, 1], axis=-1).max() < 0.1
    assert np.linalg.norm(off_m[steps(12.0) :, 0], axis=-1).max() < 0.1
    assert airframes.healthy.all()  # an estimate without the push would have been refused the fixes


def test_a_step_of_wind_is_leant_against():
    airframes, there = hovering(FIELD, FIELD_LIMITS)
    airframes.fail(0, [Failure(wind_ned_mps=(-6.0, 0.0, 0.0))])
    truth = go_on(airframes, there, 15.0)
    assert airframes.wind_ned_mps.tolist() == [[-6.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    off_m = truth[:, :, :3] - there[:, 0, :3]
    assert off_m[:, 0, 0].min() < -0.1
    assert np.linalg.norm(off_m[steps(10.0) :, 0], axis=-1).max() < 0.1
    drag = FIELD.drag_Nspm[0] * 6.0 / FIELD.weight_N
    assert np.hypot(*truth[steps(10.0) :, 0, 6:8].mean(axis=0)) == pytest.approx(drag, rel=0.1)  # its tilt


def test_a_motor_that_stands_brings_its_vehicle_down_and_no_other():
    airframes, there = hovering(FIELD, FIELD_LIMITS)
    airframes.fail(0, [Failure(motor=1)])
    truth = go_on(airframes, there, 12.0)
    assert airframes.landed.tolist() == [True, False]
    assert np.isfinite(truth).all()
    assert np.linalg.norm(truth[:, 1, :3] - there[:, 0, :3][1], axis=-1).max() < 0.1


def test_an_empty_battery_stops_the_motors():
    airframes, there = hovering(FIELD, FIELD_LIMITS)
    airframes.fail(1, [Failure(remaining=0.0)])
    go_on(airframes, there, 3.0)
    assert airframes.landed.tolist() == [False, True]
    assert airframes.battery.remaining[1] == 0.0
    np.testing.assert_array_equal(airframes.control[1], 0.0)


def test_a_slow_vehicle_falls_behind_and_catches_up():
    airframes, there = hovering(FIELD, FIELD_LIMITS)
    airframes.fail(0, [Failure(speed_mps=1.5)])
    zero = np.zeros((2, 3))

    def moving(seconds):
        """East, from rest to 3 m/s in 5 s, for 10 s in all, then stand."""
        t = min(seconds, 10.0)
        t_up = min(t, 5.0)
        distance = 0.3 * t_up**2 + 3.0 * max(t - 5.0, 0.0)
        speed = 0.6 * t_up if seconds < 10.0 else 0.0
        ahead = np.array([0.0, 1.0, 0.0])
        return reference_of(
            there[:, 0, :3] + distance * ahead,
            zero + speed * ahead,
            zero + (0.6 if t < 5.0 else 0.0) * ahead,
            zero,
            zero,
            there[:, 0, 3],
            there[:, 1, 3],
        )

    fastest, behind = np.zeros(2), 0.0
    for k in range(steps(25.0)):
        if k == steps(12.0):
            airframes.fail(0, [])
        airframes.step(moving(0.02 * k), np.array([True, True]))
        if k < steps(12.0):
            fastest = np.maximum(fastest, airframes.truth[:, 4])
        if k == steps(10.0):
            behind = airframes.truth[1, 1] - airframes.truth[0, 1]
    assert fastest[0] < 1.7 and fastest[1] > 2.8
    assert behind > 5.0
    np.testing.assert_allclose(airframes.truth[:, :3], moving(25.0)[:, 0, :3], atol=0.3)
