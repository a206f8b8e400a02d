"""The autopilot's decisions as PX4 makes them, on a fake clock and a body that follows perfectly."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.mavlink import PX4_HOLD, PX4_MISSION, PX4_OFFBOARD, PX4_RTL, LandedState, MavResult, px4_mode
from sim_bridge.autopilot.guidance.stream import StampedSetpoint
from sim_bridge.autopilot.mission_progress import MissionState
from sim_bridge.personality import PX4, Intent, Setting
from tests.unit.sim_bridge.bodies import HOME, OK, YAW, Body, item, mission

REJECTED = MavResult.TEMPORARILY_REJECTED
L = LandedState
ARMED = "Armed by external command\t"


def body_of(**kwargs) -> Body:
    return Body(PX4, **kwargs)


def setpoint(body: Body, north_m: float = 0.0, height_m: float = 3.0, speed_mps: float = 0.0) -> StampedSetpoint:
    flat = np.zeros((3, 4))
    flat[0] = HOME[0] + north_m, HOME[1], HOME[2] - height_m, YAW
    flat[1, 0] = speed_mps
    return StampedSetpoint(body.t_s, flat, stamped=False)


def stream(body: Body, seconds: float, period_s: float = 0.1, **kwargs) -> None:
    for _ in range(round(seconds / period_s)):
        body.pilot.follow(body.t_s, setpoint(body, **kwargs))
        body.run(period_s)


def test_it_is_ready_after_four_seconds_and_says_one_sentence_until_then():
    body = body_of(ready=False)
    body.step()
    assert body.arm() == REJECTED
    assert body.texts() == ["Arming denied: Resolve system health failures first\t"]
    assert body.run_until(lambda: body.pilot.readiness.ready) == pytest.approx(4.0, abs=0.1)
    assert body.arm() == OK


@pytest.mark.parametrize("intent", [Intent.RETURN, Intent.LAND, Intent.MISSION, Intent.GUIDED, Intent.MANUAL])
def test_modes_that_lack_something_are_taken_on_the_ground_but_not_armed_in(intent):
    body = body_of()
    assert body.pilot.can_arm(body.t_s)
    assert body.mode(intent) == OK
    assert body.intent is intent
    assert not body.pilot.can_arm(body.t_s)
    assert body.arm() == REJECTED
    assert len(body.texts()) == 1


def test_an_unknown_mode_is_accepted_and_nothing_happens():
    body = body_of()
    assert body.pilot.set_mode(body.t_s, px4_mode(14, 9)) == OK
    assert body.pilot.mode.number == PX4_HOLD
    assert body.texts() == []


def test_arming_disarming_and_idling_each_have_their_words():
    body = body_of()
    body.arm()
    body.arm()
    body.pilot.disarm()
    body.pilot.disarm()
    body.arm()
    assert 9.9 < body.run_until(lambda: not body.pilot.armed) < 10.2
    assert body.texts() == [ARMED, "Disarmed by external command\t", ARMED, "Disarmed by auto preflight disarming\t"]


def test_takeoff_is_a_mode_that_waits_for_arming_and_ends_in_hold():
    body = body_of()
    assert body.pilot.take_off(body.t_s, 4.0) == OK
    assert body.pilot.mode.number == px4_mode(4, 2)
    assert body.pilot.progress.state(body.intent, flying=body.pilot.flying) == (MissionState.NO_MISSION, 1)
    body.run(3.0)
    assert not body.pilot.armed
    assert body.arm() == OK
    assert 1.0 < body.run_until(lambda: body.pilot.flying) < 2.0
    body.run(20.0)
    assert body.height_m == pytest.approx(4.0)
    assert body.pilot.mode.number == PX4_HOLD
    assert body.texts() == [ARMED, "Takeoff detected\t"]
    assert body.pilot.take_off(body.t_s, 6.0) == OK
    assert body.intent is Intent.TAKEOFF
    body.run(20.0)
    assert body.height_m == pytest.approx(6.0)
    assert body.intent is Intent.HOLD


@pytest.mark.parametrize("height_m", [math.nan, -480.0, 1.0])
def test_takeoff_goes_no_lower_than_its_parameter_says(height_m):
    body = body_of()
    body.pilot.take_off(body.t_s, height_m)
    body.arm()
    body.run(20.0)
    assert body.height_m == pytest.approx(2.5)


def test_disarming_in_the_air_is_refused_with_words_and_done_by_force():
    body = body_of()
    body.fly()
    assert body.pilot.disarm() == REJECTED
    assert body.texts()[-1] == "Disarming denied: not landed\t"
    assert body.pilot.disarm(force=True) == OK
    assert not body.pilot.armed


def test_landing_takes_its_time_and_the_mode_goes_back_to_the_last_that_could_be_armed_in():
    body = body_of()
    body.fly()
    body.mode(Intent.LAND)
    body.run_until(lambda: body.height_m <= 0.0)
    assert body.run_until(lambda: "Landing detected\t" in body.texts()) == pytest.approx(3.3, abs=0.3)
    assert body.run_until(lambda: not body.pilot.armed) == pytest.approx(2.0, abs=0.1)
    assert body.texts()[-1] == "Disarmed by landing\t"
    assert body.pilot.mode.number == px4_mode(4, 2)  # take-off was commanded, the hold after it was not
    assert body.states[-3:] == [L.IN_AIR, L.LANDING, L.ON_GROUND]


def test_arming_in_mission_mode_starts_the_mission_which_is_told_as_px4_does():
    body = body_of()
    body.pilot.progress.hold(mission(PX4))
    progress = body.pilot.progress
    assert progress.state(body.intent, flying=body.pilot.flying) == (MissionState.NOT_STARTED, 2)
    assert body.mode(Intent.MISSION) == OK
    assert progress.state(body.intent, flying=body.pilot.flying) == (MissionState.ACTIVE, 1)
    assert body.arm() == OK
    body.run_until(lambda: body.pilot.mode_actions.landed_state == L.LANDING)
    assert body.reached()[-1] == 6
    assert body.height_m > 4.0
    body.run_until(lambda: not body.pilot.armed)
    reached = body.reached()
    assert sorted(set(reached)) == [1, 2, 3, 4, 5, 6]
    assert reached == sorted(reached)
    assert reached.count(6) == 11
    assert body.currents == [0, 2, 3, 4, 5, 6]
    assert body.texts() == [
        ARMED,
        "Executing Mission\t",
        "Climb to 5.0 meters above home\t",
        "Takeoff detected\t",
        "Mission finished, landed\t",
        "Landing detected\t",
        "Disarmed by landing\t",
    ]
    assert body.pilot.mode.number == PX4_MISSION
    assert progress.state(body.intent, flying=body.pilot.flying) == (MissionState.COMPLETE, 1)


def test_mission_start_arms_and_flies_and_is_refused_without_a_mission():
    body = body_of()
    assert body.pilot.start_mission(body.t_s, body.estimate) == REJECTED
    body.pilot.progress.hold(mission(PX4))
    assert body.pilot.start_mission(body.t_s, body.estimate) == OK
    body.run(5.0)
    assert body.pilot.flying
    assert body.intent is Intent.MISSION


def test_a_mission_without_takeoff_climbs_first():
    body = body_of()
    body.pilot.progress.hold((item(16, (30, 0, 6)), item(21, (30, 0, 0))))
    body.pilot.start_mission(body.t_s, body.estimate)
    body.run_until(lambda: body.height_m > 5.99)
    np.testing.assert_allclose(body.estimate[:2], HOME[:2], atol=0.1)
    body.run_until(lambda: not body.pilot.armed)
    assert sorted(set(body.reached())) == [0, 1]
    assert body.estimate[0] == pytest.approx(HOME[0] + 30.0, abs=0.05)


def test_set_current_takes_the_first_item_as_an_item():
    body = body_of()
    body.pilot.progress.hold(mission(PX4))
    for asked, seq in ((3, 3), (0, 0), (1, 2)):
        assert body.pilot.set_current(body.t_s, asked) == OK
        assert body.pilot.progress.seq == seq


def test_offboard_wants_a_second_of_setpoints_before_it_can_be_armed_in():
    body = body_of()
    body.mode(Intent.GUIDED)
    stream(body, 0.5)
    assert body.arm() == REJECTED
    stream(body, 0.6)
    assert body.arm() == OK
    stream(body, 6.0)
    assert body.pilot.flying
    stream(body, 10.0)
    assert body.height_m == pytest.approx(3.0, abs=0.01)
    assert body.pilot.mode.number == PX4_OFFBOARD


def test_offboard_without_setpoints_is_refused_in_the_air():
    body = body_of()
    body.fly()
    assert body.mode(Intent.GUIDED) == REJECTED
    assert body.texts()[-1] == "Switching to mode 'Offboard' is currently not possible\t"
    stream(body, 1.2)
    assert body.mode(Intent.GUIDED) == OK


@pytest.mark.parametrize(("period_s", "proven"), [(0.5, True), (0.9, True), (1.2, False)])
def test_a_stream_needs_no_more_than_two_setpoints_a_second(period_s, proven):
    body = body_of()
    stream(body, 6.0, period_s)
    assert body.pilot.setpoints.proven(body.t_s) is proven


def offboard(height_m: float = 3.0) -> Body:
    body = body_of()
    body.fly(height_m)
    stream(body, 1.5, height_m=height_m)
    body.mode(Intent.GUIDED)
    stream(body, 3.0, height_m=height_m)
    body.told.clear()
    return body


def test_silence_brings_the_failsafe_after_a_second_and_it_comes_down_where_it_is():
    body = offboard(6.0)
    assert body.run_until(lambda: body.pilot.failing) == pytest.approx(1.0 - 0.1, abs=0.1)
    assert body.texts() == ["Failsafe activated\t"]
    assert body.pilot.mode.number == px4_mode(3)
    body.run(6.8)  # this vehicle is slow to change its height
    assert body.pilot.path.piece.at(body.t_s)[1, 2] == pytest.approx(0.7, abs=0.05)
    body.run_until(lambda: not body.pilot.armed)
    assert body.pilot.mode.number == PX4_OFFBOARD


def test_a_vehicle_that_lost_its_stream_slows_down_before_the_failsafe():
    body = body_of()
    body.fly(3.0)
    north_m = 0.0
    for _ in range(40):
        body.pilot.follow(body.t_s, setpoint(body, north_m, speed_mps=1.0))
        if body.intent is not Intent.GUIDED and body.t_s > 31.2:
            body.mode(Intent.GUIDED)
        body.run(0.1)
        north_m += 0.1
    assert body.speed_mps == pytest.approx(1.0)
    body.run(0.9)
    assert not body.pilot.failing
    assert 0.2 < body.speed_mps < 0.98


def test_orders_are_obeyed_during_the_failsafe():
    body = offboard()
    body.run(2.5)
    assert body.mode(Intent.RETURN) == OK
    assert not body.pilot.failing
    assert body.pilot.mode.number == PX4_RTL
    body.run_until(lambda: not body.pilot.armed)
    assert body.pilot.mode.number == PX4_OFFBOARD


@pytest.mark.parametrize(("action", "intent"), [(3, Intent.RETURN), (4, Intent.LAND), (5, Intent.HOLD)])
def test_what_follows_silence_is_a_parameter(action, intent):
    body = offboard()
    body.pilot.use(body.settings | {Setting.STREAM_LOSS_ACTION: float(action), Setting.STREAM_TIMEOUT_S: 2.0})
    body.run(1.5)
    assert not body.pilot.failing
    body.run(1.0)
    assert body.intent is intent


def test_setpoints_of_an_armed_vehicle_on_the_ground_lift_it_only_if_they_lie_above():
    body = body_of()
    body.mode(Intent.GUIDED)
    stream(body, 1.2, height_m=0.0)
    assert body.arm() == OK
    stream(body, 4.0, height_m=0.1)
    assert not body.pilot.flying
    stream(body, 0.2, height_m=3.0)
    assert body.pilot.flying


@pytest.mark.parametrize(("north_m", "height_m"), [(0.5, 4.0), (20.0, 20.0), (200.0, 60.0)])
def test_the_closer_to_home_the_lower_it_returns(north_m, height_m):
    body = body_of()
    body.fly(3.0)
    body.pilot.reposition(body.t_s, np.array([HOME[0] + north_m, HOME[1], HOME[2] - 3.0, YAW]), change_mode=True)
    body.run_until(lambda: body.pilot.path.at_rest)
    body.mode(Intent.RETURN)
    text = f"RTL: start return at {488.0 - HOME[2] + height_m:.0f} m ({height_m:.0f} m above destination)\t"
    assert body.texts()[-1] == text
    top_m = 0.0
    while body.pilot.mode_actions.landed_state != L.LANDING:
        top_m = max(top_m, body.height_m)
        body.run(0.5)
    assert top_m == pytest.approx(height_m, abs=0.1)
    assert body.texts()[-1] == "RTL: land at destination\t"


def test_it_repositions_in_hold():
    body = body_of()
    body.fly(3.0)
    target = np.array([HOME[0] + 5.0, HOME[1], HOME[2] - 4.0, YAW])
    assert body.pilot.reposition(body.t_s, target, change_mode=True) == OK
    body.run(20.0)
    assert body.pilot.mode.number == PX4_HOLD
    np.testing.assert_allclose(body.pilot.path.piece.at(body.t_s)[0], target, atol=1e-9)


def test_a_takeoff_is_told_at_once_and_floats_before_it_climbs():
    body = body_of()
    body.pilot.take_off(body.t_s, 4.0)
    body.arm()
    body.run_until(lambda: "Takeoff detected\t" in body.texts())
    assert body.t_s - 5.0 == pytest.approx(1.8, abs=0.5)
    assert 2.0 < body.run_until(lambda: body.height_m > 0.1) < 4.5
    assert body.pilot.mode_actions.landed_state == L.TAKEOFF


def test_a_landing_counts_as_a_mission_that_is_flown_to_its_end():
    body = body_of()
    body.pilot.progress.hold(mission(PX4))
    progress = body.pilot.progress
    body.fly()
    assert progress.state(body.intent, flying=body.pilot.flying) == (MissionState.COMPLETE, 2)
    body.mode(Intent.LAND)
    assert progress.state(body.intent, flying=body.pilot.flying) == (MissionState.ACTIVE, 1)
    body.run_until(lambda: not body.pilot.flying)
    assert progress.state(body.intent, flying=body.pilot.flying) == (MissionState.COMPLETE, 1)


def test_close_to_home_it_comes_down_while_it_still_flies_there():
    body = body_of()
    body.fly()
    body.pilot.reposition(body.t_s, np.append(np.add(HOME, [1.5, 0.0, -6.0]), YAW), change_mode=True)
    body.run(30.0)
    body.mode(Intent.RETURN)
    body.run_until(lambda: "RTL: land at destination\t" in body.texts())
    away_m = np.linalg.norm(body.pilot.path.piece.at(body.t_s)[0, :2] - HOME[:2])
    assert 1.0 < away_m < 2.0
    body.run_until(lambda: not body.pilot.armed)
    assert np.linalg.norm(body.pilot.path.piece.at(body.t_s)[0, :2] - HOME[:2]) < 0.01
