"""A whole vehicle, spoken to in bytes: parameters, missions, time and signatures reach the part they are for."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.link.protocols.mission.item_messages import item_to_message
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from gcs.link.wire.signing import Signature, Signing, is_signed
from gcs.mavlink import MissionResult
from gcs.mission.model import MissionItem
from gcs.scenario.sources.load import load_scenario
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S
from sim_bridge.personality import ARDUPILOT, PX4, Milestone, Personality
from sim_bridge.sim.vehicle_factory import VehicleFactory

KEY = bytes(range(32))
NOON = 37_519_421_111_903
TAKEOFF = MissionItem(22, 3, (0.0,) * 4, -353632610, 1491652300, 5.0)
WAYPOINT = MissionItem(16, 3, (0.0,) * 4, -353632000, 1491652300, 5.0)


class Line:
    """A ground station's end of the line to one vehicle that stands on its pad."""

    def __init__(self, personality: Personality, repo_root: Path) -> None:
        self.personality = personality
        factory = VehicleFactory(load_scenario(repo_root / "missions" / "field"), personality, 1, 1.8e9)
        self.vehicle = factory.vehicle(0)
        self.ground = Codec(255, 190)
        self.steps = 0
        self.frames: list[bytes] = []
        self.codec = Codec(*self.vehicle.station)

    @property
    def now_s(self) -> float:
        return self.steps * CONTROL_PERIOD_S

    def say(self, message: Message, signature: Signature | None = None) -> list[Message]:
        """Send a frame; what comes back, at once and with the next step."""
        (heard,) = Codec(9, 9).decode(self.ground.encode(message, signature))
        answers = self.vehicle.receive(heard, self.now_s)
        answers += self.vehicle.step(self.steps * CONTROL_PERIOD_S, self.now_s, True)
        self.steps += 1
        self.frames = [self.codec.encode(answer, self.vehicle.signature(self.now_s)) for answer in answers]
        return [m for frame in self.frames for m in self.ground.decode(frame)]

    def ask(self, name: str, signature: Signature | None = None, **fields) -> list[Message]:
        return self.say(Message(name, {"target_system": 1, "target_component": 1, **fields}), signature)

    def upload(self, *items: MissionItem) -> list[Message]:
        heard = self.ask("MISSION_COUNT", count=len(items), mission_type=0)
        for seq, item in enumerate(items):
            heard += self.say(item_to_message(item, seq, self.vehicle.station))
        return heard


def named(messages: list[Message], name: str) -> list[dict]:
    return [message.fields for message in messages if message.name == name]


@pytest.fixture(params=[ARDUPILOT, PX4], ids=lambda p: p.name)
def line(request: pytest.FixtureRequest, repo_root: Path) -> Line:
    return Line(request.param, repo_root)


def test_a_mission_is_shelved_counted_and_told(line: Line):
    heard = line.upload(TAKEOFF, WAYPOINT, WAYPOINT)
    assert [f["type"] for f in named(heard, "MISSION_ACK")] == [MissionResult.ACCEPTED]
    totals = [f["param_value"] for f in named(heard, "PARAM_VALUE")]
    texts = [f["text"] for f in named(heard, "STATUSTEXT")]
    ardupilot = line.personality is ARDUPILOT
    assert totals == ([1.0, 2.0, 3.0] if ardupilot else [])
    assert ("Flight plan received" in texts) == ardupilot
    assert named(line.ask("MISSION_REQUEST_LIST", mission_type=0), "MISSION_COUNT")[0]["count"] == 3


def test_a_parameter_that_is_set_is_flown_by(repo_root: Path):
    line = Line(ARDUPILOT, repo_root)
    line.ask("PARAM_SET", param_id="GUID_TIMEOUT", param_value=2.0, param_type=9)
    (answer,) = named(line.ask("PARAM_REQUEST_READ", param_id="GUID_TIMEOUT", param_index=-1), "PARAM_VALUE")
    assert answer["param_value"] == 2.0


def test_a_list_of_parameters_comes_with_a_banner(repo_root: Path):
    line = Line(ARDUPILOT, repo_root)
    heard = line.ask("PARAM_REQUEST_LIST")
    assert len(named(heard, "PARAM_VALUE")) == len(ARDUPILOT.params)
    assert named(heard, "STATUSTEXT")[0]["text"].startswith("ArduCopter V4.5.6")


def test_time_is_told_in_the_originals_steps(line: Line):
    (answer,) = named(line.say(Message("TIMESYNC", {"tc1": 0, "ts1": 123})), "TIMESYNC")
    assert answer["ts1"] == 123
    assert answer["tc1"] > 0
    assert answer["tc1"] % 1000 == 0


def ask_version(line: Line, signature: Signature | None = None) -> bool:
    params = {f"param{n}": 0.0 for n in range(2, 8)}
    heard = line.ask("COMMAND_LONG", signature, command=512, confirmation=0, param1=148.0, **params)
    return bool(named(heard, "COMMAND_ACK"))


def test_after_set_up_ardupilot_hears_and_says_nothing_unsigned(repo_root: Path):
    line = Line(ARDUPILOT, repo_root)
    mine = Signing(link_id=7)
    mine.set_up(KEY, NOON, 0.0)
    assert ask_version(line)
    line.ask("SETUP_SIGNING", secret_key=list(KEY), initial_timestamp=NOON)
    assert not ask_version(line)
    assert not ask_version(line, Signature(bytes(reversed(KEY)), 7, NOON + 1))
    good = mine.signature(line.now_s)
    assert ask_version(line, good)
    assert all(map(is_signed, line.frames))
    assert all(mine.accepts(frame, line.now_s) for frame in line.frames)
    assert not ask_version(line, good), "a frame that was overheard and is sent again"
    line.ask("SETUP_SIGNING", mine.signature(line.now_s), secret_key=[0] * 32, initial_timestamp=0)
    assert ask_version(line)
    assert not any(map(is_signed, line.frames))


def test_px4_does_not_mind_signatures(repo_root: Path):
    line = Line(PX4, repo_root)
    line.ask("SETUP_SIGNING", secret_key=list(KEY), initial_timestamp=NOON)
    assert ask_version(line)
    assert ask_version(line, Signature(KEY, 7, NOON))
    assert not any(map(is_signed, line.frames))


def test_others_vehicles_keys_are_not_taken(repo_root: Path):
    line = Line(ARDUPILOT, repo_root)
    fields = {"target_system": 9, "target_component": 1, "secret_key": list(KEY), "initial_timestamp": NOON}
    line.say(Message("SETUP_SIGNING", fields))
    assert ask_version(line)


def command(number: int, *params: float) -> dict:
    values = (*params, *(0.0,) * (7 - len(params)))
    return {"command": number, "confirmation": 0} | {f"param{n}": v for n, v in enumerate(values, start=1)}


def test_px4_acknowledges_a_mode_twice_and_keeps_its_first_words_until_it_speaks(repo_root: Path):
    line = Line(PX4, repo_root)
    heard = line.ask("COMMAND_LONG", **command(176, 1.0, 4.0, 3.0))
    assert [f["command"] for f in named(heard, "COMMAND_ACK")] == [176, 176]
    heard = line.ask("COMMAND_LONG", **command(400, 1.0))
    assert [f["result"] for f in named(heard, "COMMAND_ACK")] == [1]
    assert named(heard, "STATUSTEXT") == []
    while not named(heard, "STATUSTEXT"):
        heard = line.ask("COMMAND_LONG", **command(512, 1.0))
        assert line.now_s < 3.0
    assert line.now_s == pytest.approx(2.4, abs=0.1)
    assert (
        "".join(f["text"] for f in named(heard, "STATUSTEXT"))
        == "Arming denied: Resolve system health failures first\t"
    )


def test_rally_points_that_are_shelved_are_returned_to(line: Line):
    origin = line.vehicle.autopilot.path_generator.origin
    point = MissionItem(5100, 3, (0.0,) * 4, round(origin.lat_deg * 1e7) + 9000, round(origin.lon_deg * 1e7), 5.0)
    line.ask("MISSION_COUNT", count=1, mission_type=2)
    (ack,) = named(
        line.say(item_to_message(point, 0, line.vehicle.station, mission_type=2, integer_frames=False)), "MISSION_ACK"
    )
    assert ack["type"] == MissionResult.ACCEPTED
    (place,) = line.vehicle.autopilot.path_generator.rally_ned_m
    assert place == pytest.approx([100.0, 0.0], abs=0.3)


@pytest.mark.parametrize(("frame", "result"), [(0, 0), (3, 0), (5, 0), (6, 0), (1, 2), (10, 2), (11, 2), (99, 2)])
def test_places_in_frames_that_it_does_not_know_are_denied_not_guessed(line: Line, frame: int, result: int):
    origin = line.vehicle.autopilot.path_generator.origin
    place = {"x": round(origin.lat_deg * 1e7) + 900, "y": round(origin.lon_deg * 1e7), "z": 10.0}
    asked = {"frame": frame, "current": 0, "autocontinue": 0, "param1": -1.0, "param2": 1.0, "param3": 0.0}
    heard = line.ask("COMMAND_INT", command=192, param4=float("nan"), **asked, **place)
    assert [f["result"] for f in named(heard, "COMMAND_ACK")][:1] == [result]


@pytest.mark.parametrize("lat_deg", [float("nan"), 91.0, 0.0])
def test_home_goes_nowhere_that_is_no_place(repo_root: Path, lat_deg: float):
    line = Line(ARDUPILOT, repo_root)
    line.vehicle.autopilot.readiness._reached.add(Milestone.READY)
    origin, before = (
        line.vehicle.autopilot.path_generator.origin,
        line.vehicle.autopilot.path_generator.home_ned_m.copy(),
    )
    for latitude, result in ((lat_deg, 2), (origin.lat_deg + 0.001, 0)):
        longitude = 0.0 if latitude == 0.0 else origin.lon_deg
        place = command(179, 0.0, 0.0, 0.0, 0.0, latitude, longitude, origin.alt_amsl_m)
        (ack,) = named(line.ask("COMMAND_LONG", **place), "COMMAND_ACK")
        assert ack["result"] == result
        assert (line.vehicle.autopilot.path_generator.home_ned_m == before).all() == (result == 2)
