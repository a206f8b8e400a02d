"""A second station changes parameters of a vehicle in flight, as one did on ArduCopter 4.5.6."""

from __future__ import annotations

import pytest

from gcs.flight.execution.parameter_watch import watch_parameters
from gcs.link.session.vehicle_load import VehicleLoad
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message
from gcs.mavlink import ModeFlag
from gcs.mission.waypoints.mission_items import build_missions
from gcs.plan.trajectory.plan import Plan
from tests.real_flights import in_virtual_time

RTL_ALT, FENCE_ENABLE, WPNAV_ACCEL = ("RTL_ALT", 5800.0, 6), ("FENCE_ENABLE", 1.0, 2), ("WPNAV_ACCEL", 250.0, 9)
Told = tuple[str, float, int]


class Scene:
    """Vehicle 3 of a flight that set RTL_ALT and FENCE_ENABLE, and the events that come of what it tells."""

    def __init__(self, plan: Plan) -> None:
        (mission,) = [each for each in build_missions(plan) if each.sysid == 3]
        load = VehicleLoad(mission, parameters=(("RTL_ALT", 5800), ("FENCE_ENABLE", 1)))
        beat = self.beat(armed=False)
        self.session = VehicleSession(beat, lambda _: None)
        self.events: list[str] = []
        self.stop = watch_parameters({3: self.session}, [load], self.report)

    def beat(self, *, armed: bool) -> Message:
        mode = int(ModeFlag.ARMED if armed else 0) | 1
        fields = {"type": 2, "autopilot": 3, "base_mode": mode, "custom_mode": 4, "system_status": 4}
        return Message("HEARTBEAT", fields, 3, 1)

    def report(self, sysid: int, what: str, rule: str, *, alarm: bool = False) -> None:
        assert alarm and sysid == 3 and rule
        self.events.append(what)

    def tells(self, told: Told) -> list[str]:
        name, value, kind = told
        fields = {"param_id": name, "param_value": value, "param_type": kind, "param_count": 1364, "param_index": 65535}
        self.session.receive(Message("PARAM_VALUE", fields, 3, 1), 0.0)
        new, self.events = self.events, []
        return new

    def arms(self, *, armed: bool = True) -> None:
        self.session.receive(self.beat(armed=armed), 0.0)


@pytest.fixture
def scene(simulation1_plan: Plan) -> Scene:
    async def made() -> Scene:
        return Scene(simulation1_plan)

    return in_virtual_time(made())


def test_a_parameter_that_another_station_changed_in_flight_is_an_alarm_once(scene: Scene) -> None:
    scene.arms()
    assert scene.tells(RTL_ALT) == []
    assert scene.tells(("RTL_ALT", 300.0, 6)) == ["has another RTL_ALT: 300, was 5800"]
    assert scene.tells(("RTL_ALT", 300.0, 6)) == []
    assert scene.tells(("RTL_ALT_M", 58.0, 9)) == ["has another RTL_ALT: 5800, was 300"]  # as 4.7 names it
    assert scene.tells(("FENCE_ENABLE", 0.0, 2)) == ["has another FENCE_ENABLE: 0, was 1"]


def test_what_was_read_before_the_flight_counts_too_and_nothing_else(scene: Scene) -> None:
    assert scene.tells(WPNAV_ACCEL) == []
    scene.arms()
    assert scene.tells(("WPNAV_ACCEL", 100.0, 9)) == ["has another WPNAV_ACCEL: 100, was 250"]
    assert scene.tells(("WPNAV_JERK", 3.0, 9)) == []  # nobody knows what it was
    assert scene.tells(("STAT_FLTTIME", 3.0, 6)) == []


def test_uploads_and_what_is_given_back_on_the_ground_are_no_alarms(scene: Scene) -> None:
    assert scene.tells(("RTL_ALT", 1500.0, 6)) == []  # before the upload
    assert scene.tells(RTL_ALT) == []
    scene.arms()
    assert scene.tells(RTL_ALT) == []
    scene.arms(armed=False)
    assert scene.tells(("RTL_ALT", 1500.0, 6)) == []


def test_it_ends(scene: Scene) -> None:
    scene.arms()
    scene.stop()
    assert scene.tells(("RTL_ALT", 300.0, 6)) == []
