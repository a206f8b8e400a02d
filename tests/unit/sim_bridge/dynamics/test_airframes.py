"""Closed loops from sensors to rotors: how well a fleet flies what it is asked to, and that it always flies alike."""

from __future__ import annotations

import numpy as np
import pytest

from sim_bridge.dynamics.airframes import Airframes, Craft
from sim_bridge.dynamics.failures import Failure, Sensor
from sim_bridge.dynamics.sensors import GNSS, RTK
from sim_bridge.dynamics.wind_field import parse_wind
from tests.unit.sim_bridge.flights import (
    F150,
    F150_LIMITS,
    FIELD,
    FIELD_LIMITS,
    PADS_NED_M,
    YAW_RAD,
    course,
    flat_ground,
    fly,
    hold,
    stand,
    steps,
)


@pytest.fixture(scope="module")
def paper_flight():
    airframes = stand(F150, F150_LIMITS, RTK, PADS_NED_M, seed=7)
    return fly(airframes, course(yaw_swing_rad=0.4), PADS_NED_M)


@pytest.mark.long
def test_the_papers_vehicles_stay_within_a_decimetre_of_a_full_flight(paper_flight):
    flown = ~(paper_flight.wanted_ned_m[..., 2] > 0.0).any(axis=1)  # the reference ends below the ground
    error_m = np.linalg.norm(paper_flight.truth[..., :3] - paper_flight.wanted_ned_m, axis=-1)[flown]
    assert np.sqrt(np.mean(error_m**2)) < 0.04
    assert error_m.max() < 0.1
    # It is a flight worth the name, and within the margins a plan leaves.
    assert np.linalg.norm(paper_flight.truth[..., 3:6], axis=-1).max() > 5.5
    assert np.abs(paper_flight.control[..., 1:3]).max() < 0.0501
    np.testing.assert_array_less(paper_flight.control[..., 0], 5.2)


@pytest.mark.slow
def test_neighbours_half_a_metre_apart_stay_apart(paper_flight):
    between = paper_flight.truth[:, 1, :3] - paper_flight.truth[:, 4, :3]
    assert np.linalg.norm(PADS_NED_M[1] - PADS_NED_M[4]) == 0.5
    assert np.linalg.norm(between, axis=-1).min() > 0.4


def test_it_ends_on_the_ground_with_its_filters_content(paper_flight):
    assert paper_flight.airframes.landed.all()
    assert paper_flight.airframes.healthy.all()
    np.testing.assert_array_equal(paper_flight.truth[-1, :, 3:8], 0.0)


def test_the_estimate_is_better_than_a_fix(paper_flight):
    error = paper_flight.estimate - paper_flight.truth
    rms = np.sqrt(np.mean(error**2, axis=(0, 1)))
    assert (rms[:2] < RTK.gnss_horizontal_m).all() and rms[2] < RTK.gnss_vertical_m
    assert (rms[3:6] < RTK.gnss_horizontal_mps).all()
    assert (rms[6:9] < 0.005).all()


def test_a_vehicle_of_the_two_kilogram_class_flies_with_the_same_rules():
    pads = 3.0 * PADS_NED_M[:1]
    flight = fly(stand(FIELD, None, RTK, pads, seed=3), course(yaw_swing_rad=0.4).part(0.0, 50.0), pads)
    error_m = np.linalg.norm(flight.truth[..., :3] - flight.wanted_ned_m, axis=-1)
    assert np.sqrt(np.mean(error_m**2)) < 0.02
    assert error_m.max() < 0.05


def test_metre_level_receivers_keep_a_fleet_within_metres():
    pads = 20.0 * PADS_NED_M[:3]
    airframes = stand(F150, F150_LIMITS, GNSS, pads, seed=5)
    home = airframes.estimate[:, :3].copy()  # as an autopilot takes it when it arms
    flight = fly(airframes, course(yaw_swing_rad=0.0).part(0.0, 24.0), home)
    error_m = np.linalg.norm(flight.truth[..., :3] - flight.wanted_ned_m, axis=-1)
    assert 0.2 < np.sqrt(np.mean(error_m**2)) < 5.0
    # It flies its estimate well; what is left is the receiver's.
    believed_m = np.linalg.norm(flight.estimate[600:, :, :3] - flight.wanted_ned_m[600:], axis=-1)
    assert np.sqrt(np.mean(believed_m**2)) < 0.3


@pytest.mark.parametrize("away_m", [1.0, 20.0])
def test_a_step_of_the_reference_ends_where_it_should(away_m):
    """No plan asks for this; a person with a joystick may."""
    pads = np.zeros((1, 3))
    airframes = stand(FIELD, None, RTK, pads, seed=3)
    fly(airframes, course(yaw_swing_rad=0.0).part(0.0, 13.5), pads)
    goal = np.array([[away_m, 0.0, -3.0]])
    past = 0.0
    for _ in range(steps(12.0)):
        airframes.step(hold(goal, np.array([YAW_RAD])), np.array([True]))
        past = max(past, airframes.truth[0, 0] - away_m)
    np.testing.assert_allclose(airframes.truth[0, :3], goal[0], atol=0.05)
    assert past < 0.1 * away_m + 0.05


def hop(vehicles, seed):
    pads = PADS_NED_M[:vehicles]
    flight = fly(stand(F150, F150_LIMITS, RTK, pads, seed=seed), course(yaw_swing_rad=0.1).part(0.0, 8.0), pads)
    return flight.truth


def test_the_same_seed_flies_the_same_flight_bit_for_bit_and_another_does_not():
    first = hop(2, 11)
    np.testing.assert_array_equal(first, hop(2, 11))
    assert np.abs(first - hop(2, 12)).max() > 1e-4


def eventful_flight(seed):
    """Wind, gusts and a breakdown of every kind, while two vehicles take off and hover."""
    pads = 6.0 * PADS_NED_M[1:3]
    airframes = stand(FIELD, FIELD_LIMITS, GNSS, pads, seed, parse_wind("3@200", "light"))
    pads_ned_m, up, truth, estimate = airframes.estimate[:, :3].copy(), course(yaw_swing_rad=0.2), [], []
    for begin_s, end_s, failures in (
        (0.0, 4.0, [Failure(remaining=0.2)]),
        (4.0, 6.0, [Failure(speed_mps=0.5), Failure(gnss_lost=True)]),
        (6.0, 8.0, [Failure(speed_mps=0.5), Failure(sensor=Sensor.COMPASS), Failure(motor=4, share=0.2)]),
        (8.0, 12.0, [Failure(motor=4, share=0.2), Failure(offset_ned_m=(2.0, 0.0, -1.0))]),
    ):
        airframes.fail(1, failures)
        flight = fly(airframes, up.part(begin_s, end_s), pads_ned_m)
        truth.append(flight.truth)
        estimate.append(flight.estimate)
    return np.concatenate(truth), np.concatenate(estimate), airframes


def test_wind_and_breakdowns_repeat_bit_for_bit_as_well():
    (first, guess, one), (second, same, two), (other, _, _) = (eventful_flight(seed) for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(guess, same)
    np.testing.assert_array_equal(one.battery.used_J, two.battery.used_J)
    np.testing.assert_array_equal(one.estimator.ekf.P, two.estimator.ekf.P)
    assert np.abs(first - other).max() > 1e-3
    assert np.isfinite(first).all()


@pytest.mark.parametrize(
    ("q", "limits", "wind", "gusts", "rms_m"),
    [
        pytest.param(FIELD, FIELD_LIMITS, "", "", 0.03, marks=pytest.mark.slow),
        (FIELD, FIELD_LIMITS, "3@240", "light", 0.06),
        pytest.param(F150, F150_LIMITS, "1@240", "", 0.04, marks=pytest.mark.slow),
        pytest.param(F150, F150_LIMITS, "1@240", "light", 0.12, marks=pytest.mark.slow),
    ],
)
def test_places_are_held_in_wind(q, limits, wind, gusts, rms_m):
    pads = 3.0 * PADS_NED_M
    airframes = stand(q, limits, RTK, pads, 3, parse_wind(wind, gusts))
    fly(airframes, course(yaw_swing_rad=0.0).part(0.0, 13.5), pads)
    there = hold(pads + np.array([0.0, 0.0, -3.0]), np.full(len(pads), YAW_RAD))
    off_m, push = [], []
    for _ in range(steps(30.0)):
        airframes.step(there, np.ones(len(pads), dtype=bool))
        off_m.append(airframes.truth[:, :3] - there[:, 0, :3])
        push.append(airframes.controller.push[:3].T.copy())
    settled = np.array(off_m)[steps(10.0) :]
    assert np.sqrt(np.mean(np.sum(settled**2, axis=-1))) < rms_m
    np.testing.assert_allclose(settled.mean(axis=(0, 1)), 0.0, atol=0.02)
    # What is observed is what the wind does: drag over mass, with the gusts that last.
    expected = np.array(q.drag_Nspm) / q.mass_kg * np.array(parse_wind(wind).mean_ned_mps or (0.0, 0.0, 0.0))
    tolerance = 0.005 + 1.5 * parse_wind("", gusts).gust_mps * q.drag_Nspm[0] / q.mass_kg
    np.testing.assert_allclose(np.array(push).mean(axis=(0, 1)), expected, atol=tolerance)


def test_who_has_no_fix_on_the_pad_waits_for_one_alone():
    pads = 3.0 * PADS_NED_M[:2]
    airframes = Airframes(Craft(F150), flat_ground, pads, np.zeros(2), RTK, seed=1)
    airframes.fail(1, [Failure(gnss_lost=True)])
    climb, ready_s = course(yaw_swing_rad=0.0), [np.inf, np.inf]
    for k in range(steps(20.0)):
        if k == steps(5.0):
            airframes.fail(1, [])
        airframes.step(climb.at(max(k - steps(8.0), 0), pads), np.array([True, True]))
        for row in np.flatnonzero(airframes.healthy):
            ready_s[row] = min(ready_s[row], airframes.t_s)
        assert np.isnan(airframes.gnss_ned[1]).all() == (airframes.t_s < 5.19)
    assert 1.9 < ready_s[0] < 2.5 and 6.9 < ready_s[1] < 7.5
    assert not airframes.landed.any()
    np.testing.assert_allclose(airframes.estimate[:, :6], airframes.truth[:, :6], atol=0.06)


def test_a_vehicle_flies_alike_in_any_fleet():
    # Not bit for bit: the order of sums in NumPy's products depends on the batch.
    np.testing.assert_allclose(hop(6, 11)[:, :2], hop(2, 11), atol=1e-9)


def test_motors_do_not_turn_before_the_filters_are_aligned_nor_when_off():
    airframes = Airframes(Craft(F150), flat_ground, PADS_NED_M, np.zeros(6), RTK, seed=1)
    climb = course(yaw_swing_rad=0.0).at(steps(6.0), PADS_NED_M)
    motors = np.array([True] * 5 + [False])
    while not airframes.healthy.any():
        airframes.step(climb, motors)
        assert not airframes.rotors_radps.any() or airframes.healthy.all()
    assert 1.0 < airframes.t_s < 5.0
    for _ in range(steps(3.0)):
        airframes.step(climb, motors)
    assert airframes.landed.tolist() == [False] * 5 + [True]
    assert not airframes.rotors_radps[5].any()
    assert (airframes.rotors_radps[:5] > 200.0).all()


def test_time_is_counted_not_summed():
    airframes = Airframes(Craft(F150), flat_ground, PADS_NED_M, np.zeros(6), RTK, seed=1)
    for _ in range(7):
        airframes.step(hold(PADS_NED_M, np.zeros(6)), np.zeros(6, dtype=bool))
    assert airframes.t_s == 0.14


def test_arrays_that_disagree_are_refused():
    with pytest.raises(ValueError, match=r"\(V, 3\)"):
        Airframes(Craft(F150), flat_ground, PADS_NED_M, np.zeros(5), RTK, seed=1)
