"""The autopilot's decisions as ArduCopter makes them, on a fake clock and a body that follows perfectly."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs.mavlink import CopterMode, LandedState, MavResult
from sim_bridge.autopilot.guidance.stream import StampedSetpoint
from sim_bridge.personality import Intent, Setting
from tests.unit.sim_bridge.bodies import HOME, OK, YAW, Body, mission

FAILED = MavResult.FAILED
L = LandedState


def test_no_arming_before_the_estimate_is_ready_and_the_reasons_change_on_the_way():
    body = Body(ready=False)
    body.step()
    assert body.arm() == FAILED
    assert body.texts()[0] == "Arm: Gyros not healthy"
    body.run(2.0)
    body.told.clear()
    assert body.arm() == FAILED
    assert body.texts() == ["Arm: AHRS: waiting for home"]
    body.run(1.0)
    body.mode(Intent.GUIDED)
    body.told.clear()
    assert body.arm() == FAILED
    assert body.texts() == ["Arm: Need Position Estimate"]
    assert body.mode(Intent.MANUAL) == OK
    assert body.arm() == OK


def test_a_filter_that_does_not_converge_keeps_it_waiting():
    body = Body(ready=False)
    body.healthy = False
    body.run(60.0)
    assert not body.pilot.readiness.ready
    body.healthy = True
    body.run(0.1)
    assert body.pilot.readiness.ready
    assert "EKF3 IMU0 is using GPS" in body.texts()


def test_a_mode_set_before_it_runs_is_forgotten():
    body = Body(ready=False)
    body.step()
    assert body.mode(Intent.GUIDED) == OK
    body.run(0.5)
    assert body.intent is Intent.MANUAL


def test_failing_checks_are_reported_now_and_then():
    body = Body()
    body.mode(Intent.MISSION)
    body.run(1.5)
    assert body.texts() == ["PreArm: Mode requires mission"]
    body.run(28.0)
    assert len(body.texts()) == 1
    body.run(2.0)
    assert len(body.texts()) == 2
    body.mode(Intent.GUIDED)
    body.run(60.0)
    assert len(body.texts()) == 2


@pytest.mark.parametrize("mode", [CopterMode.AUTO, CopterMode.RTL, CopterMode.LAND])
def test_modes_that_cannot_be_armed_in(mode):
    body = Body()
    body.pilot.progress.hold(mission())
    assert body.pilot.set_mode(body.t_s, mode) == OK
    assert body.arm() == FAILED
    assert body.texts() == [f"Arm: {mode.name} mode not armable"]


def test_arming_and_disarming_twice_is_accepted():
    body = Body()
    assert [body.arm(), body.arm(), body.pilot.disarm(), body.pilot.disarm()] == [OK] * 4
    assert body.texts() == ["Arming motors", "Disarming motors"]


def test_unknown_mode_fails():
    body = Body()
    assert body.pilot.set_mode(body.t_s, 99) == FAILED
    assert body.texts() == ["No such mode 99"]


def test_left_alone_it_disarms_after_ten_seconds():
    body = Body()
    body.arm()
    body.run(9.9)
    assert body.pilot.armed
    body.run(0.3)
    assert not body.pilot.armed


@pytest.mark.parametrize(("mode", "arm"), [(CopterMode.GUIDED, False), (CopterMode.LOITER, True)])
def test_takeoff_needs_guided_and_arming(mode, arm):
    body = Body()
    body.pilot.set_mode(body.t_s, mode)
    if arm:
        body.arm()
    assert body.pilot.take_off(body.t_s, 3.0) == FAILED


@pytest.mark.parametrize("height_m", [0.0, -2.0, math.nan, math.inf])
def test_takeoff_to_nowhere_fails(height_m):
    body = Body()
    body.mode(Intent.GUIDED)
    body.arm()
    assert body.pilot.take_off(body.t_s, height_m) == FAILED


def test_motors_need_three_seconds_before_they_lift():
    body = Body()
    body.mode(Intent.GUIDED)
    body.arm()
    body.pilot.take_off(body.t_s, 3.0)
    assert 2.5 < body.run_until(lambda: body.pilot.flying) < 3.5
    body.run(1.0)
    assert body.states[-1] == L.TAKEOFF


def test_a_mode_changed_before_the_motors_lift_ends_the_takeoff():
    body = Body()
    body.mode(Intent.GUIDED)
    body.arm()
    body.pilot.take_off(body.t_s, 3.0)
    body.mode(Intent.HOLD)
    body.run(20.0)
    assert not body.pilot.armed
    assert body.height_m == 0.0


def test_takeoff_reaches_its_height_and_a_second_one_fails():
    body = Body()
    body.fly(3.0)
    assert body.height_m == pytest.approx(3.0)
    assert body.pilot.take_off(body.t_s, 5.0) == FAILED
    assert body.pilot.disarm() == FAILED
    assert body.states == [L.ON_GROUND, L.TAKEOFF, L.IN_AIR]


def test_landing_ends_disarmed_two_seconds_after_the_ground():
    body = Body()
    body.fly()
    assert body.pilot.set_mode(body.t_s, CopterMode.LAND) == OK
    body.run_until(lambda: body.height_m <= 0.0)
    assert body.run_until(lambda: not body.pilot.armed) == pytest.approx(2.05, abs=0.2)
    assert body.states[-3:] == [L.IN_AIR, L.LANDING, L.ON_GROUND]
    assert body.pilot.mode.number == CopterMode.LAND


def test_return_to_launch_climbs_waits_over_home_and_lands():
    body = Body()
    body.fly()
    assert body.pilot.reposition(body.t_s, np.array([40.0, 20.0, -4.0, YAW]), change_mode=False) == OK
    body.run(40.0)
    body.mode(Intent.RETURN)
    body.run_until(lambda: np.linalg.norm(body.estimate[:2] - HOME[:2]) < 1e-3)
    assert body.height_m == pytest.approx(15.0, abs=0.01)
    waited_s = body.run_until(lambda: body.pilot.mode_actions.landed_state == L.LANDING)
    assert waited_s >= 5.0
    body.run(60.0)
    assert not body.pilot.armed
    np.testing.assert_allclose(body.estimate[:2], HOME[:2], atol=1e-3)


def test_setpoints_are_ignored_on_the_ground():
    body = Body()
    body.mode(Intent.GUIDED)
    body.arm()
    body.run(4.0)
    body.pilot.follow(body.t_s, StampedSetpoint(body.t_s, np.zeros((3, 4))))
    body.run(1.0)
    np.testing.assert_allclose(body.estimate[:3], HOME)


def test_a_stream_that_stops_is_flown_on_with_its_acceleration_for_three_seconds_then_braked():
    body = Body()
    body.fly()
    flat = body.pilot.path.piece.at(body.t_s)[:3].copy()
    flat[1, 0], flat[2, 0] = 1.0, 0.5
    body.pilot.follow(body.t_s, StampedSetpoint(body.t_s + 0.5, flat))
    body.run(0.45)
    assert body.speed_mps == 0.0
    body.run(3.0)
    assert body.speed_mps == pytest.approx(1.0 + 0.5 * 2.95)
    body.run(10.0)
    assert body.speed_mps == pytest.approx(0.0, abs=1e-9)
    assert body.pilot.flying


def test_a_setpoint_far_off_is_flown_to_and_not_jumped_to():
    body = Body()
    body.fly()
    flat = body.pilot.path.piece.at(body.t_s)[:3].copy()
    flat[0, 0] += 20.0
    for _ in range(400):
        before = body.pilot.path.piece.at(body.t_s)[0]
        body.pilot.follow(body.t_s, StampedSetpoint(body.t_s, flat.copy(), stamped=False))
        body.run(0.05)
        assert np.linalg.norm(body.pilot.path.piece.at(body.t_s)[0] - before) < 2.1
    np.testing.assert_allclose(body.pilot.path.piece.at(body.t_s)[0], flat[0], atol=1e-6)


def test_the_same_place_asked_for_again_and_again_does_not_slow_it_down():
    times = []
    for period_s in (0.1, 50.0):
        body = Body()
        body.fly()
        flat = body.pilot.path.piece.at(body.t_s)[:3].copy()
        flat[0, 0] += 12.0
        start_s = body.t_s
        while abs(body.pilot.path.piece.at(body.t_s)[0, 0] - flat[0, 0]) > 0.05:
            body.pilot.follow(body.t_s, StampedSetpoint(body.t_s, flat, stamped=False), to_rest=True)
            body.run(min(period_s, 0.1))
        times.append(body.t_s - start_s)
    assert times[0] == pytest.approx(times[1])


def test_mission_start_wants_arming_and_a_takeoff_item():
    body = Body()
    body.pilot.progress.hold(mission())
    assert body.pilot.start_mission(0.0, body.estimate) == FAILED
    body.mode(Intent.MISSION)
    assert body.pilot.start_mission(0.0, body.estimate) == OK
    assert body.texts() == ["Mission: 1 Takeoff"]
    assert not body.pilot.armed
    body.mode(Intent.GUIDED)
    body.arm()
    body.pilot.progress.hold(())
    assert body.pilot.start_mission(0.0, body.estimate) == FAILED
    body.pilot.progress.hold(mission()[:1] + mission()[3:])
    assert body.pilot.start_mission(0.0, body.estimate) == FAILED
    assert body.texts()[-1] == "Auto: Missing Takeoff Cmd"


def test_an_armed_vehicle_put_into_auto_waits_for_mission_start_unless_told_otherwise():
    for options, flies in ((0.0, False), (2.0, True)):
        body = Body()
        body.pilot.use(body.settings | {Setting.AUTO_OPTIONS: options})
        body.pilot.progress.hold(mission())
        body.mode(Intent.GUIDED)
        body.arm()
        body.mode(Intent.MISSION)
        body.run(6.0)
        assert body.pilot.flying is flies
    body = Body()
    body.pilot.use(body.settings | {Setting.AUTO_OPTIONS: 3.0})
    body.pilot.progress.hold(mission())
    body.mode(Intent.MISSION)
    assert body.arm() == OK
    body.run(6.0)
    assert body.pilot.flying


def test_a_mission_is_flown_and_told_as_arducopter_does():
    body = Body()
    body.pilot.progress.hold(mission())
    body.mode(Intent.GUIDED)
    body.arm()
    assert body.pilot.start_mission(body.t_s, body.estimate) == OK
    assert body.pilot.mode.number == CopterMode.AUTO
    body.run(100.0)
    assert not body.pilot.armed
    assert body.reached() == [2, 3, 4, 5, 6]
    assert body.currents == [0, 1, 3, 4, 5, 6, 7, 1]
    assert body.states == [L.ON_GROUND, L.TAKEOFF, L.IN_AIR, L.LANDING, L.ON_GROUND]
    assert body.texts() == [
        "Arming motors",
        "Mission: 1 Takeoff",
        "Mission: 2 ChangeSpeed",
        "Mission: 3 WP",
        "Reached command #3",
        "Mission: 4 WP",
        "Reached command #4",
        "Mission: 5 Delay",
        "Delaying 3 sec",
        "Mission: 6 WP",
        "Reached command #6",
        "Mission: 7 Land",
        "Disarming motors",
        "Mission: 1 Takeoff",
    ]
    np.testing.assert_allclose(body.estimate[:2], HOME[:2], atol=0.02)


def test_a_mission_in_the_air_takes_legs_at_the_speed_asked_for():
    body = Body()
    body.fly(5.0)
    body.pilot.progress.hold(mission())
    start_s = body.t_s
    assert body.pilot.start_mission(start_s, body.estimate) == OK
    body.run(8.0 / 2.0 - 0.05)
    assert body.pilot.progress.seq == 3
    body.run(0.1)
    assert body.pilot.progress.seq == 4


@pytest.mark.parametrize(("asked", "result", "seq"), [(0, OK, 1), (3, OK, 3), (2, OK, 3), (99, MavResult.DENIED, 0)])
def test_set_current_lands_on_an_item_that_moves(asked, result, seq):
    body = Body()
    body.pilot.progress.hold(mission())
    assert body.pilot.set_current(0.0, asked) == result
    assert body.pilot.progress.seq == seq


def test_a_mission_replaced_in_flight_is_flown_to_its_end_as_it_was():
    body = Body()
    body.pilot.progress.hold(mission())
    body.mode(Intent.GUIDED)
    body.arm()
    body.pilot.start_mission(body.t_s, body.estimate)
    body.run(12.0)
    body.pilot.progress.hold(mission()[:2])
    body.run(100.0)
    assert body.reached() == [2, 3, 4, 5, 6]
    assert not body.pilot.armed


def test_a_failsafe_acts_in_the_air_and_disarms_on_the_ground():
    body = Body()
    body.mode(Intent.GUIDED)
    body.arm()
    body.pilot.fail(body.t_s, Intent.RETURN)
    assert not body.pilot.armed
    body.fly()
    body.pilot.fail(body.t_s, Intent.RETURN)
    assert body.intent is Intent.RETURN
    assert body.pilot.failing
    assert body.mode(Intent.GUIDED) == OK
    assert not body.pilot.failing


def test_a_longer_start_takes_as_long_as_the_original():
    body = Body(replace(Body().pilot.personality).booting_for_real(), ready=False)
    assert body.run_until(lambda: body.pilot.readiness.ready) == pytest.approx(41.4, abs=0.1)


def test_when_a_stream_ran_out_it_comes_back_to_where_that_was():
    body = Body()
    body.fly()
    flat = body.pilot.path.piece.at(body.t_s)[:3].copy()
    flat[1, 0] = 1.0
    body.pilot.follow(body.t_s, StampedSetpoint(body.t_s, flat, stamped=False))
    body.run(3.0)
    place = body.pilot.path.piece.at(body.t_s)[0].copy()
    body.run_until(lambda: body.pilot.path.piece.at(body.t_s)[0, 0] > place[0] + 0.2)
    body.run_until(lambda: body.speed_mps < 1e-6)
    np.testing.assert_allclose(body.pilot.path.piece.at(body.t_s)[0], place, atol=0.05)


def test_a_place_is_flown_to_as_fast_as_asked_until_the_mode_changes():
    body = Body()
    body.fly()
    target = np.append(np.add(HOME, [190.0, 0.0, -5.0]), YAW)
    body.pilot.reposition(body.t_s, target, change_mode=False, speed_mps=1.5)
    body.run(12.0)
    assert body.speed_mps == pytest.approx(1.5, abs=0.01)
    assert body.pilot.set_speed(body.t_s, 1.0, 2.5) == OK
    body.run(12.0)
    assert body.speed_mps == pytest.approx(2.5, abs=0.01)
    body.mode(Intent.HOLD)
    body.mode(Intent.GUIDED)
    body.pilot.reposition(body.t_s, target, change_mode=False)
    body.run(14.0)
    assert body.speed_mps == pytest.approx(min(body.settings[Setting.CRUISE_MPS], 4.0), abs=0.01)


def test_a_new_speed_in_the_middle_of_a_mission_begins_no_item_anew():
    body = Body()
    body.fly(5.0)
    body.pilot.progress.hold(mission())
    assert body.pilot.start_mission(body.t_s, body.estimate) == OK
    body.run(2.0)
    before = body.texts()
    assert body.pilot.set_speed(body.t_s, 1.0, 1.0) == OK
    body.run(1.0)
    assert body.texts() == before
    assert body.pilot.progress.seq == 3
