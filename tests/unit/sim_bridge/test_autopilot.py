"""The autopilot's decisions, on a fake clock and a body that follows perfectly."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.frames import Origin, ned_to_geodetic, to_degE7
from gcs.link.dialect import CopterMode, LandedState, MavResult
from gcs.mission.model import Command, Frame, MissionItem
from sim_bridge.autopilot import Autopilot, Reached, Said
from sim_bridge.course import Guide
from sim_bridge.guidance.limits import MotionLimits
from sim_bridge.guidance.stream import Setpoint
from sim_bridge.personality import ARDUPILOT

LIMITS = MotionLimits(4.0, 1.6, 1.0, 0.2, 0.85, 0.5, 0.07)
ORIGIN = Origin(47.4, 8.5, 488.0)
HOME = np.array([10.0, 20.0, -1.0])
YAW = 0.6
OK, FAILED = MavResult.ACCEPTED, MavResult.FAILED


class Body:
    """Stands where the autopilot wants it, above flat ground at the height of home."""

    def __init__(self, *, ready: bool = True) -> None:
        guide = Guide(LIMITS, ORIGIN, HOME, 3.0, 0.5, 1.5, 15.0)
        self.pilot = Autopilot(ARDUPILOT, guide, YAW)
        self.pilot.ready = ready
        self.t_s = 0.0
        self.told: list = []
        self.states: list[LandedState] = []
        self.currents: list[int] = []

    @property
    def estimate(self) -> np.ndarray:
        flat = self.pilot.piece.at(self.t_s)
        return np.concatenate(
            [np.minimum(flat[0, :3], [1e9, 1e9, HOME[2]]), flat[1, :3], [0, 0, flat[0, 3]], np.zeros(3)]
        )

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.t_s = round(self.t_s + 0.01, 6)
            down = self.pilot.piece.at(self.t_s)[0, 2]
            self.pilot.step(self.t_s, bool(down >= HOME[2] - 1e-3))
            self.told += self.pilot.events
            self.pilot.events.clear()
            for seen, value in ((self.states, self.pilot.landed_state), (self.currents, self.pilot.current_seq)):
                if not seen or seen[-1] != value:
                    seen.append(value)

    def arm(self) -> MavResult:
        return self.pilot.arm(self.t_s, self.estimate)

    def texts(self) -> list[str]:
        return [e.text for e in self.told + self.pilot.events if isinstance(e, Said)]

    def fly(self, height_m: float = 3.0) -> None:
        assert self.pilot.set_mode(self.t_s, CopterMode.GUIDED) == OK
        assert self.arm() == OK
        assert self.pilot.take_off(self.t_s, height_m) == OK
        self.run(20.0)
        assert self.pilot.landed_state == LandedState.IN_AIR


def test_no_arming_before_the_estimate_is_ready():
    body = Body(ready=False)
    assert body.arm() == FAILED
    assert body.texts() == ["Arm: Need Position Estimate"]


@pytest.mark.parametrize("mode", [CopterMode.AUTO, CopterMode.RTL, CopterMode.LAND])
def test_modes_that_cannot_be_armed_in(mode):
    body = Body()
    assert body.pilot.set_mode(0.0, mode) == OK
    assert body.arm() == FAILED
    assert body.texts() == [f"Arm: {mode.name} mode not armable"]


def test_arming_and_disarming_twice_is_accepted():
    body = Body()
    assert [body.arm(), body.arm(), body.pilot.disarm(), body.pilot.disarm()] == [OK] * 4


def test_unknown_mode_fails():
    assert Body().pilot.set_mode(0.0, 99) == FAILED


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
    body.pilot.set_mode(0.0, mode)
    if arm:
        body.arm()
    assert body.pilot.take_off(0.0, 3.0) == FAILED


@pytest.mark.parametrize("height_m", [0.0, -2.0, math.nan, math.inf])
def test_takeoff_to_nowhere_fails(height_m):
    body = Body()
    body.pilot.set_mode(0.0, CopterMode.GUIDED)
    body.arm()
    assert body.pilot.take_off(0.0, height_m) == FAILED


def test_takeoff_reaches_its_height_and_a_second_one_fails():
    body = Body()
    body.fly(3.0)
    assert body.pilot.piece.at(body.t_s)[0, 2] == pytest.approx(HOME[2] - 3.0)
    assert body.pilot.take_off(body.t_s, 5.0) == FAILED
    assert body.pilot.disarm() == FAILED
    assert body.states == [LandedState.TAKEOFF, LandedState.IN_AIR]


def test_landing_ends_disarmed():
    body = Body()
    body.fly()
    assert body.pilot.set_mode(body.t_s, CopterMode.LAND) == OK
    body.run(30.0)
    assert not body.pilot.armed
    assert body.states[-3:] == [LandedState.IN_AIR, LandedState.LANDING, LandedState.ON_GROUND]


def test_return_to_launch_climbs_comes_home_and_lands():
    body = Body()
    body.fly()
    body.pilot.go_to(body.t_s, np.array([40.0, 20.0, -4.0, YAW]))
    body.run(40.0)
    body.pilot.set_mode(body.t_s, CopterMode.RTL)
    body.run(20.0)
    assert body.pilot.piece.at(body.t_s)[0, 2] <= HOME[2] - 10.0
    body.run(120.0)
    assert not body.pilot.armed
    np.testing.assert_allclose(body.estimate[:2], HOME[:2], atol=1e-3)


def test_setpoints_are_ignored_on_the_ground():
    body = Body()
    body.pilot.set_mode(0.0, CopterMode.GUIDED)
    body.arm()
    body.pilot.follow(0.0, Setpoint(0.0, np.ones((3, 4))))
    body.run(1.0)
    np.testing.assert_allclose(body.estimate[:3], HOME)


def test_a_stream_that_stops_is_flown_on_for_three_seconds_then_braked():
    body = Body()
    body.fly()
    flat = body.pilot.piece.at(body.t_s)[:3].copy()
    flat[1, 0] = 1.0
    body.pilot.follow(body.t_s, Setpoint(body.t_s + 0.5, flat))
    body.run(0.45)
    assert body.pilot.piece.at(body.t_s)[1, 0] == 0.0
    body.run(2.5)
    assert body.pilot.piece.at(body.t_s)[1, 0] == 1.0
    body.run(10.0)
    assert body.pilot.piece.at(body.t_s)[1, 0] == pytest.approx(0.0, abs=1e-9)
    assert body.pilot.flying


def test_mission_start_wants_arming_and_a_takeoff_item():
    body = Body()
    assert body.pilot.start_mission(0.0) == FAILED
    body.pilot.set_mode(0.0, CopterMode.AUTO)
    assert body.pilot.start_mission(0.0) == OK
    body.pilot.set_mode(0.0, CopterMode.GUIDED)
    body.arm()
    assert body.pilot.start_mission(0.0) == FAILED
    body.pilot.set_mission(mission()[:1] + mission()[3:])
    assert body.pilot.start_mission(0.0) == FAILED
    assert body.texts()[-1] == "Auto: Missing Takeoff Cmd"


def item(command: int, place: tuple[float, float, float] | None = None, **params: float) -> MissionItem:
    """An item at `place`: metres north and east of home, and above it."""
    p = tuple(params.get(f"p{i}", 0.0) for i in range(1, 5))
    if place is None:
        return MissionItem(command, Frame.MISSION, p, 0, 0, 0.0)
    lat, lon, _ = ned_to_geodetic(HOME + np.array([place[0], place[1], 0.0]), ORIGIN)
    return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, p, to_degE7(lat), to_degE7(lon), place[2])


def mission() -> tuple[MissionItem, ...]:
    """The recorded `auto_flight`: take-off, a speed, waypoints, a delay, landing."""
    return (
        item(Command.NAV_WAYPOINT, (0, 0, 0)),
        MissionItem(Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, (0.0, 0.0, 0.0, 0.0), 0, 0, 5.0),
        item(Command.DO_CHANGE_SPEED, p1=1.0, p2=2.0, p3=-1.0),
        item(Command.NAV_WAYPOINT, (8, 0, 5)),
        item(Command.NAV_WAYPOINT, (8, 8, 6)),
        item(Command.NAV_DELAY, p1=3.0),
        item(Command.NAV_WAYPOINT, (0, 8, 5)),
        item(Command.NAV_LAND, (0, 0, 0)),
    )


def test_a_mission_is_flown_and_told_as_arducopter_does():
    body = Body()
    body.pilot.set_mission(mission())
    body.pilot.set_mode(0.0, CopterMode.GUIDED)
    body.arm()
    assert body.pilot.start_mission(body.t_s) == OK
    assert body.pilot.mode.number == CopterMode.AUTO
    body.run(100.0)
    assert not body.pilot.armed
    assert [e.seq for e in body.told if isinstance(e, Reached)] == [2, 3, 4, 5, 6]
    assert body.currents == [1, 3, 4, 5, 6, 7, 1]
    L = LandedState
    assert body.states == [L.TAKEOFF, L.IN_AIR, L.LANDING, L.ON_GROUND]
    np.testing.assert_allclose(body.estimate[:2], HOME[:2], atol=0.02)


def test_a_mission_in_the_air_takes_legs_at_the_speed_asked_for():
    body = Body()
    body.fly(5.0)
    body.pilot.set_mission(mission())
    start_s = body.t_s
    assert body.pilot.start_mission(start_s) == OK
    body.run(8.0 / 2.0 - 0.05)
    assert body.pilot.current_seq == 3
    body.run(0.1)
    assert body.pilot.current_seq == 4


@pytest.mark.parametrize(("asked", "result", "seq"), [(3, OK, 3), (2, OK, 3), (99, MavResult.DENIED, 0)])
def test_set_current_lands_on_an_item_that_moves(asked, result, seq):
    body = Body()
    body.pilot.set_mission(mission())
    assert body.pilot.set_current(0.0, asked) == result
    assert body.pilot.current_seq == seq
