"""Failsafes: what each autopilot does about a crossed fence, a low battery, a lost link or a lost place."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.mavlink import LandedState
from sim_bridge.autopilot.failsafe import Breach, Failsafe, Readings
from sim_bridge.missions.fence import FenceShape
from sim_bridge.personality import ARDUPILOT, PX4, Intent, Personality, Setting
from tests.unit.sim_bridge.bodies import HOME, OK, YAW, Body

BOTH = pytest.mark.parametrize("personality", [ARDUPILOT, PX4], ids=lambda p: p.name)
SQUARE = FenceShape(
    HOME[:2] + np.array([(-30.0, -30.0), (30.0, -30.0), (30.0, 30.0), (-30.0, 30.0)]), 0.0, stay_outside=False
)
FAR = FenceShape(np.array([[500.0, 500.0]]), 5.0, stay_outside=False)


class Watched(Body):
    """A body with failsafes; the ground station is heard every second, as long as `linked`."""

    def __init__(self, personality: Personality, **changed: float) -> None:
        super().__init__(personality)
        self.failsafe = Failsafe(self.pilot)
        self.failsafe.use(self.settings | {Setting[name]: value for name, value in changed.items()})
        self.linked = True
        self.volt, self.share, self.used_Ah = 16.0, 1.0, 0.0
        self.sysid = 255
        self.fly(10.0)
        self.told.clear()

    def step(self) -> None:
        super().step()
        if not hasattr(self, "failsafe"):
            return
        if self.linked and round(self.t_s * 100) % 100 == 0:
            self.failsafe.hear(self.sysid, self.t_s)
        if self.failsafe.due(self.t_s):
            left_Ah = 5.0 - self.used_Ah
            place = self.pilot.path.piece.at(self.t_s)[0, :3]
            self.failsafe.step(
                self.t_s, self.t_s, Readings(place, self.volt, self.used_Ah, left_Ah, self.share, self.healthy)
            )

    def go(self, north_m: float, up_m: float = 10.0) -> None:
        target = np.append(np.add(HOME, [north_m, 0.0, -up_m]), YAW)
        assert self.pilot.reposition(self.t_s, target, change_mode=True) == OK


def enabled(personality: Personality, action: int) -> dict[str, float]:
    return {"FENCE_ACTION": action} | ({"FENCE_ENABLED": 1.0} if personality is ARDUPILOT else {})


@BOTH
def test_too_high_is_a_breach(personality: Personality):
    home = 1 if personality is ARDUPILOT else 3
    body = Watched(personality, FENCE_HEIGHT_M=20.0, **enabled(personality, home))
    body.go(0.0, 19.0)
    body.run(60.0)
    assert (body.failsafe.breaches, body.intent) == (0, personality.flight.reposition_in)
    body.go(0.0, 24.0)
    body.run_until(lambda: body.failsafe.breaches == 1)
    assert body.failsafe.breach is Breach.HEIGHT
    assert body.intent is Intent.RETURN
    said = "Max Alt fence breached" if personality is ARDUPILOT else "Geofence: approaching or outside geofence"
    assert body.texts()[0] == said
    body.run_until(lambda: body.failsafe.breach is Breach.NONE)


@BOTH
def test_too_far_is_a_breach_and_may_end_in_a_landing(personality: Personality):
    land = 2 if personality is ARDUPILOT else 5
    body = Watched(personality, FENCE_RADIUS_M=40.0, **enabled(personality, land))
    body.go(80.0)
    body.run_until(lambda: body.failsafe.breaches == 1)
    assert body.failsafe.breach is Breach.BOUNDARY
    assert 40.0 < body.pilot.path.piece.at(body.t_s)[0, 0] - HOME[0] < 42.0
    assert body.intent is Intent.LAND
    body.run_until(lambda: not body.pilot.armed)


@BOTH
def test_beyond_a_polygon_is_a_breach_and_inside_one_of_two_only_for_px4_is_not(personality: Personality):
    hold = 4 if personality is ARDUPILOT else 2
    body = Watched(personality, **enabled(personality, hold))
    body.failsafe.fence([SQUARE, FAR] if personality is PX4 else [SQUARE])
    body.run(1.0)
    assert body.failsafe.breaches == 0
    body.go(80.0)
    body.run_until(lambda: body.failsafe.breaches == 1)
    assert body.intent is Intent.HOLD
    other = Watched(ARDUPILOT, **enabled(ARDUPILOT, 4))
    other.failsafe.fence([SQUARE, FAR])
    other.run(1.0)
    assert other.failsafe.breaches == 1


@BOTH
def test_px4_repeats_its_text_as_long_as_it_is_outside(personality: Personality):
    """Recorded: the second text came 2.1 s after the first."""
    body = Watched(personality, FENCE_RADIUS_M=40.0, **enabled(personality, 4 if personality is ARDUPILOT else 2))
    body.go(80.0)
    body.run_until(lambda: body.failsafe.breaches == 1)
    body.run(9.0)
    assert body.failsafe.breach is Breach.BOUNDARY
    said = [text for text in body.texts() if "fence" in text]
    assert len(said) == (1 if personality is ARDUPILOT else 5)
    assert body.failsafe.breaches == 1


@BOTH
def test_a_fence_that_is_switched_off_is_none(personality: Personality):
    off = {"FENCE_ENABLED": 0.0} if personality is ARDUPILOT else {"FENCE_ACTION": 0.0}
    body = Watched(personality, FENCE_RADIUS_M=40.0, **off)
    body.go(60.0)
    body.run(60.0)
    assert (body.failsafe.breaches, body.failsafe.fenced) == (0, False)


def test_ardupilot_returns_at_a_low_voltage_that_lasts_and_lands_when_so_much_is_used():
    body = Watched(
        ARDUPILOT, BATTERY_LOW_ACTION=2, BATTERY_LOW_V=14.0, BATTERY_CRITICAL_ACTION=1, BATTERY_CRITICAL_Ah=1.0
    )
    body.volt = 13.0
    body.run(5.0)
    body.volt = 16.0
    body.run(10.0)
    assert body.texts() == []
    body.volt, body.used_Ah = 13.0, 0.5
    assert body.run_until(lambda: body.intent is Intent.RETURN) == pytest.approx(10.0, abs=0.5)
    assert body.texts() == ["Battery 1 is low 13.00V used 500 mAh"]
    body.used_Ah = 4.2
    assert body.run_until(lambda: body.intent is Intent.LAND) == pytest.approx(10.0, abs=0.5)


def test_px4_warns_returns_and_lands_by_the_share_that_is_left():
    body = Watched(PX4, BATTERY_CRITICAL_ACTION=3)
    for share, intent, text in (
        (0.14, Intent.HOLD, "Low battery level\t"),
        (0.06, Intent.RETURN, "Critical battery level\t"),
        (0.04, Intent.LAND, "Emergency battery level\t"),
    ):
        body.share = share
        body.run(1.0)
        assert body.intent is intent
        assert text in body.texts()


@BOTH
def test_a_silent_ground_station_sends_it_home_once_it_was_heard(personality: Personality):
    action = 1 if personality is ARDUPILOT else 2
    body = Watched(personality, LINK_LOSS_ACTION=action, LINK_TIMEOUT_S=5.0)
    body.run(20.0)
    assert body.texts() == []
    body.linked = False
    assert 4.0 < body.run_until(lambda: body.intent is Intent.RETURN) < 6.5
    body.linked = True
    body.run(2.0)
    found = "GCS Failsafe Cleared" if personality is ARDUPILOT else "Connection to ground station regained\t"
    assert found in body.texts()
    assert body.intent is Intent.RETURN


def test_only_its_own_ground_station_counts_for_ardupilot():
    body = Watched(ARDUPILOT, LINK_LOSS_ACTION=1, LINK_TIMEOUT_S=5.0)
    body.sysid = 250
    assert 3.0 < body.run_until(lambda: body.intent is Intent.RETURN) < 6.5


@BOTH
def test_who_does_not_know_where_it_is_lands_but_not_for_a_moment(personality: Personality):
    body = Watched(personality)
    body.healthy = False
    body.run(5.0)
    body.healthy = True
    body.run(5.0)
    assert body.texts() == []
    body.healthy = False
    assert body.run_until(lambda: body.intent is Intent.LAND) == pytest.approx(6.0, abs=0.5)
    words = "EKF Failsafe: changed to LAND Mode" if personality is ARDUPILOT else "Failsafe activated\t"
    assert body.texts() == [words]
    body.run(0.1)
    assert body.pilot.mode_actions.landed_state == LandedState.LANDING


@BOTH
def test_nobody_arms_who_does_not_know_any_more_where_it_is(personality: Personality):
    body = Body(personality)
    body.mode(Intent.GUIDED if personality is ARDUPILOT else Intent.HOLD)
    body.healthy = False
    body.run(0.5)
    assert body.pilot.can_arm(body.t_s)
    body.run(1.0)
    assert not body.pilot.can_arm(body.t_s)
    assert body.arm() == personality.replies.refused
    words = "Arm: Need Position Estimate"
    assert body.texts()[-1] == (
        words if personality is ARDUPILOT else "Arming denied: Resolve system health failures first\t"
    )
    body.healthy = True
    body.run(0.1)
    assert body.arm() == OK


@BOTH
@pytest.mark.parametrize(("north_m", "lands_at_m"), [(50.0, (60.0, 5.0)), (20.0, (0.0, 0.0))])
def test_it_returns_to_the_nearest_of_home_and_rally_points(personality: Personality, north_m, lands_at_m):
    body = Watched(personality)
    body.pilot.mode_actions.change(rally_ned_m=(np.add(HOME[:2], [60.0, 5.0]), np.add(HOME[:2], [200.0, 0.0])))
    body.go(north_m)
    body.run(40.0)
    assert body.mode(Intent.RETURN) == OK
    body.run_until(lambda: not body.pilot.armed)
    np.testing.assert_allclose(body.pilot.path.piece.at(body.t_s)[0, :2] - HOME[:2], lands_at_m, atol=0.1)


@BOTH
def test_speeds_up_and_down_have_commands_of_their_own(personality: Personality):
    body = Watched(personality)
    before_mps = body.pilot.path_generator.speed_mps
    assert body.pilot.set_speed(body.t_s, 2.0, 0.7) == OK
    assert body.pilot.set_speed(body.t_s, 3.0, 0.5) == OK
    assert body.pilot.path_generator.speed_mps == before_mps
    body.go(0.0, 30.0)
    body.run(15.0)
    assert body.pilot.path.piece.at(body.t_s)[1, 2] == pytest.approx(-0.7, abs=0.01)
    body.go(0.0, 5.0)
    body.run(15.0)
    assert body.pilot.path.piece.at(body.t_s)[1, 2] == pytest.approx(0.5, abs=0.01)
