"""Transfers of missions, fences and rally points as both autopilots do them: what goes well, and what goes wrong."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.autopilots.traits import Autopilot
from gcs.frames import Origin
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.mission.item_messages import item_to_message
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.protocols.mission.receiver import MissionReceiver
from gcs.link.protocols.mission.sender import MissionSender
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MissionResult, MissionType
from gcs.mission.model import MissionItem
from sim_bridge.missions.acceptance import flyable
from sim_bridge.missions.store import MissionStore
from sim_bridge.missions.transfer_traits import MissionTraits
from sim_bridge.personality.ardupilot_missions import MISSIONS as ARDUPILOT
from sim_bridge.personality.px4_missions import MISSIONS as PX4

ME = Station(3, 1)
OTHER = Station(254, 190)
HOME = Origin(47.0, 8.0, 400.0)
LAT, LON = 470000000, 80000000
R = MissionResult
BOTH = pytest.mark.parametrize("traits", [ARDUPILOT, PX4], ids=["ardupilot", "px4"])
NAN = math.nan


def item(command: int = 16, frame: int = 3, p=(0.0, 0.0, 0.0, 0.0), lat=LAT, lon=LON, alt=5.0) -> MissionItem:
    return MissionItem(command, frame, p, lat, lon, alt)


HOME_ITEM = item(frame=0, alt=0.0)
TAKEOFF = item(22)
SPEED = item(178, 2, (1.0, 2.5, -1.0, 0.0), 0, 0, 0.0)
WAIT = item(93, 2, (3.0, -1.0, -1.0, -1.0), 0, 0, 0.0)
LAND = item(21, alt=0.0)
MISSION = (HOME_ITEM, TAKEOFF, SPEED, item(lat=LAT + 700), WAIT, LAND)
SHORT = (HOME_ITEM, TAKEOFF, item(lat=LAT + 100), item(lat=LAT + 200))


def vertex(north: int, east: int, count: float = 4.0, command: int = 5001) -> MissionItem:
    return MissionItem(command, 0, (count, 0.0, 0.0, 0.0), LAT + north, LON + east, 0.0)


CIRCLE = vertex(0, 0, 5.0, 5004)
SQUARE = (vertex(900, -900), vertex(900, 900), vertex(-900, 900), vertex(-900, -900))
RALLY = (item(5100, alt=10.0), item(5100, lat=LAT + 300, alt=12.0))


@dataclass
class StoreBench:
    """A shelf, and what it told the rest of the vehicle."""

    traits: MissionTraits
    texts: list[tuple[int, str]] = field(default_factory=list)
    changes: list[tuple[int, tuple[MissionItem, ...]]] = field(default_factory=list)
    now_s: float = 0.0
    current_seq: int = 0

    def __post_init__(self) -> None:
        self.store = MissionStore(
            ME,
            self.traits,
            HOME,
            lambda kind, items: self.changes.append((kind, items)),
            lambda severity, text: self.texts.append((int(severity), text)),
            lambda: self.current_seq,
        )

    def hear(self, name: str, source: Station = GROUND, **fields) -> list[Message]:
        return self.store.receive(Message(name, {"mission_type": 0, **fields}, *source), self.now_s)

    def item(self, seq: int, what: MissionItem, kind: int = 0, source: Station = GROUND) -> list[Message]:
        message = item_to_message(what, seq, ME, mission_type=kind)
        return self.store.receive(Message(message.name, message.fields, *source), self.now_s)

    def float_item(self, seq: int, what: MissionItem) -> list[Message]:
        fields = item_to_message(what, seq, ME).fields
        fields |= {"x": fields["x"] / 1e7, "y": fields["y"] / 1e7, "frame": what.frame}
        return self.store.receive(Message("MISSION_ITEM", fields, *GROUND), self.now_s)

    def put(self, items=SHORT, kind: int = 0) -> list[Message]:
        """A whole upload; the last answer."""
        answers = self.hear("MISSION_COUNT", count=len(items), mission_type=kind)
        for seq, what in enumerate(items):
            answers = self.item(seq, what, kind)
        return answers

    def held(self, kind: int = 0) -> tuple[MissionItem, ...]:
        return self.store.items(kind)

    def tick(self, now_s: float) -> list[Message]:
        self.now_s = now_s
        return self.store.tick(now_s)


def result(messages: list[Message]) -> MissionResult:
    (ack,) = messages
    assert ack.name == "MISSION_ACK"
    return R(ack.fields["type"])


def asked(messages: list[Message]) -> int:
    (request,) = messages
    assert request.name.startswith("MISSION_REQUEST")
    return request.fields["seq"]


def talk(machine, bench: StoreBench, messages: list[Message]) -> None:
    """Carry messages to and fro until both are silent."""
    while messages:
        answers = [a for m in messages for a in bench.hear(m.name, **m.fields)]
        messages = [a for m in answers for a in machine.receive(Message(m.name, m.fields, *ME), 0.0)]


# What goes well


@BOTH
@pytest.mark.parametrize("kind", [0, 1, 2])
def test_what_our_ground_station_sends_it_reads_back(traits, kind):
    bench = StoreBench(traits)
    items = {0: MISSION, 1: (*SQUARE, CIRCLE), 2: RALLY}[kind]
    sender = MissionSender(items, Exchange(ME, estimates=False), mission_type=kind)
    talk(sender, bench, sender.start(0.0))
    assert sender.error is None
    receiver = MissionReceiver(Exchange(ME, estimates=False), mission_type=kind)
    talk(receiver, bench, receiver.start(0.0))
    first = 1 if kind == MissionType.MISSION and traits.home_is_item_0 else 0
    differences = compare_missions(items[first:], receiver.items[first:], autopilot=Autopilot.ARDUPILOT)
    assert [d for d in differences if d.what != "autocontinue"] == []
    assert not bench.store.busy
    assert bench.changes[-1] == (kind, bench.held(kind))


def test_ardupilot_asks_for_floats_and_px4_for_integers():
    assert StoreBench(ARDUPILOT).hear("MISSION_COUNT", count=1)[0].name == "MISSION_REQUEST"
    assert StoreBench(PX4).hear("MISSION_COUNT", count=1)[0].name == "MISSION_REQUEST_INT"


def test_ardupilot_keeps_items_its_own_way():
    bench = StoreBench(ARDUPILOT)
    bench.put(MISSION)
    home, *rest = bench.held()
    assert (home.lat_degE7, home.alt_m, home.frame) == (470000000, 400.0, 0)
    assert [i.frame for i in rest] == [3, 0, 3, 0, 3]
    assert rest[-1].params[3] == 1.0
    bench.put((HOME_ITEM, item(alt=5.678), item(alt=-5.678)))
    assert [i.alt_m for i in bench.held()[1:]] == [5.67, -5.67]
    assert bench.texts == [(6, "Flight plan received")] * 2


def test_px4_keeps_items_as_they_come_and_marks_the_first():
    bench = StoreBench(PX4)
    items = (replace(TAKEOFF, params=(0.0, 0.0, 0.0, NAN)), *MISSION[2:])
    bench.put(items)
    assert repr(bench.held()) == repr(items)
    bench.hear("MISSION_REQUEST_LIST")
    first, second = (bench.hear("MISSION_REQUEST_INT", seq=seq)[0].fields for seq in (0, 1))
    assert (first["current"], second["current"]) == (1, 0)
    assert (first["frame"], second["frame"]) == (6, 2)


def test_the_current_item_reads_back_as_such():
    bench = StoreBench(ARDUPILOT)
    bench.put(SHORT)
    bench.current_seq = 2
    assert [bench.hear("MISSION_REQUEST_INT", seq=seq)[0].fields["current"] for seq in range(4)] == [0, 0, 1, 0]


def test_fences_and_rally_points_read_back_in_their_frames():
    told = {}
    for traits in (ARDUPILOT, PX4):
        bench = StoreBench(traits)
        bench.put((*SQUARE, CIRCLE), 1)
        bench.put(RALLY, 2)
        for kind in (1, 2):
            bench.hear("MISSION_REQUEST_LIST", mission_type=kind)
            fields = bench.hear("MISSION_REQUEST_INT", seq=0, mission_type=kind)[0].fields
            told[traits is PX4, kind] = fields["frame"], fields["autocontinue"]
            bench.hear("MISSION_ACK", type=0, mission_type=kind)
    assert told == {(False, 1): (0, 0), (False, 2): (3, 0), (True, 1): (5, 0), (True, 2): (6, 1)}


def test_totals_count_a_fences_shapes_too():
    bench = StoreBench(ARDUPILOT)
    bench.put((*SQUARE, CIRCLE), 1)
    bench.put(RALLY, 2)
    assert [bench.store.total(kind) for kind in (0, 1, 2)] == [0, 7, 2]


def test_home_follows_the_vehicle():
    bench = StoreBench(ARDUPILOT)
    bench.put()
    bench.store.move_home(Origin(46.0, 8.0, 401.0))
    assert bench.held()[0].lat_degE7 == 460000000
    bench = StoreBench(PX4)
    bench.put()
    bench.store.move_home(Origin(46.0, 8.0, 401.0))
    assert bench.held() == SHORT


# Items that do not please


@pytest.mark.parametrize(
    ("change", "ardupilot", "px4"),
    [
        ({}, R.ACCEPTED, R.ACCEPTED),
        ({"command": 9999}, R.UNSUPPORTED, R.UNSUPPORTED),
        ({"frame": 99}, R.UNSUPPORTED_FRAME, R.UNSUPPORTED_FRAME),
        ({"frame": 10}, R.ACCEPTED, R.UNSUPPORTED_FRAME),
        ({"command": 20, "frame": 3}, R.ACCEPTED, R.UNSUPPORTED),
        ({"command": 20, "frame": 2}, R.ACCEPTED, R.ACCEPTED),
        ({"command": 5001}, R.UNSUPPORTED, R.UNSUPPORTED),
        ({"alt_m": NAN}, R.INVALID_PARAM7, R.ACCEPTED),
        ({"params": (NAN, 0.0, 0.0, 0.0)}, R.INVALID_PARAM1, R.ACCEPTED),
        ({"params": (0.0, NAN, 0.0, 0.0)}, R.INVALID_PARAM2, R.ACCEPTED),
        ({"params": (0.0, 0.0, NAN, 0.0)}, R.INVALID_PARAM3, R.ACCEPTED),
        ({"params": (0.0, 0.0, 0.0, NAN)}, R.ACCEPTED, R.ACCEPTED),
        ({"params": (0.0, 0.0, 0.0, NAN), "command": 22}, R.ACCEPTED, R.ACCEPTED),
        ({"params": (0.0, 0.0, 0.0, NAN), "command": 84}, R.ACCEPTED, R.UNSUPPORTED),
        ({"params": (0.0, 0.0, 0.0, NAN), "command": 17}, R.INVALID_PARAM4, R.UNSUPPORTED),
        ({"lat_degE7": 1_900_000_000}, R.INVALID_PARAM5_X, R.ACCEPTED),
        ({"lon_degE7": 1_900_000_000}, R.INVALID_PARAM6_Y, R.ACCEPTED),
    ],
)
def test_items_are_judged_with_the_originals_reasons(change, ardupilot, px4):
    for traits, wanted in ((ARDUPILOT, ardupilot), (PX4, px4)):
        bench = StoreBench(traits)
        bench.hear("MISSION_COUNT", count=2)
        bench.item(0, SHORT[1])
        assert result(bench.item(1, replace(item(), **change))) == wanted
        assert not bench.store.busy
        said = [text for _, text in bench.texts]
        if wanted != R.ACCEPTED:
            assert said == (["IGN MISSION_ITEM: Invalid item\t"] if traits is PX4 else [])


def test_a_refused_upload_leaves_ardupilot_with_new_and_old_items_and_px4_with_the_old():
    for traits in (ARDUPILOT, PX4):
        bench = StoreBench(traits)
        bench.put(SHORT)
        bench.hear("MISSION_COUNT", count=3)
        bench.item(0, HOME_ITEM)
        bench.item(1, replace(TAKEOFF, alt_m=9.0))
        bench.item(2, item(9999))
        altitudes = [i.alt_m for i in bench.held()[1:]]
        assert altitudes == ([9.0, 5.0] if traits is ARDUPILOT else [5.0, 5.0, 5.0])


def test_a_mission_with_numbers_that_are_none_cannot_be_flown():
    assert flyable(MISSION)
    for what in (TAKEOFF, LAND, item()):  # any heading
        assert flyable((replace(what, params=(0.0, 0.0, 0.0, NAN)),))
        assert not flyable((replace(what, params=(0.0, 0.0, 0.0, math.inf)),))
    assert not flyable((replace(TAKEOFF, alt_m=NAN),))
    assert not flyable((replace(TAKEOFF, alt_m=math.inf),))
    assert not flyable((replace(TAKEOFF, lat_degE7=1_900_000_000),))
    assert not flyable((replace(WAIT, params=(NAN, 0.0, 0.0, 0.0)),))


@BOTH
def test_a_vehicle_that_rejects_is_pleased_by_nothing(traits):
    bench = StoreBench(traits)
    bench.store.rejects = True
    bench.hear("MISSION_COUNT", count=1)
    assert result(bench.item(0, TAKEOFF)) == R.INVALID
    assert bench.held() == ()


# Counts


@BOTH
def test_too_many_items_are_refused_and_the_old_mission_kept(traits):
    bench = StoreBench(traits)
    bench.put()
    texts = list(bench.texts)
    capacity = traits.storage[0].capacity
    assert result(bench.hear("MISSION_COUNT", count=capacity + 1)) == R.NO_SPACE
    assert len(bench.held()) == len(SHORT)
    assert bench.texts[len(texts) :] == ([(4, "Only 650 items are supported")] if traits is ARDUPILOT else [])
    assert asked(bench.hear("MISSION_COUNT", count=capacity)) == 0


@BOTH
def test_count_0_is_a_clear(traits):
    bench = StoreBench(traits)
    bench.put()
    assert result(bench.hear("MISSION_COUNT", count=0)) == R.ACCEPTED
    assert bench.held() == ()
    assert bench.changes[-1] == (0, ())


# Order


def test_a_wrong_sequence_is_told_by_ardupilot_and_passed_over_by_px4():
    for traits, again_s in ((ARDUPILOT, 1.0), (PX4, 0.25)):
        bench = StoreBench(traits)
        bench.hear("MISSION_COUNT", count=4)
        bench.item(0, HOME_ITEM)
        answers = bench.item(3, LAND)
        assert (result(answers) == R.INVALID_SEQUENCE) if traits is ARDUPILOT else (answers == [])
        assert bench.tick(again_s * 0.99) == []
        assert asked(bench.tick(again_s * 1.01)) == 1
        for seq in (1, 2, 3):
            answers = bench.item(seq, SHORT[seq])
        assert result(answers) == R.ACCEPTED


def test_an_item_that_nobody_asked_for():
    for traits in (ARDUPILOT, PX4):
        bench = StoreBench(traits)
        assert result(bench.item(1, TAKEOFF)) == R.ERROR
        assert bench.texts == ([] if traits is ARDUPILOT else [(2, "IGN MISSION_ITEM: No transfer\t")])


def test_float_items_are_reproached_once_by_ardupilot_and_followed_by_px4():
    for traits in (ARDUPILOT, PX4):
        bench = StoreBench(traits)
        (request,) = bench.hear("MISSION_COUNT", count=3)
        names = [request.name, *(bench.float_item(seq, SHORT[seq])[0].name for seq in range(3))]
        if traits is ARDUPILOT:
            assert names == ["MISSION_REQUEST"] * 3 + ["MISSION_ACK"]
            assert bench.texts[0] == (4, "got MISSION_ITEM; GCS should send MISSION_ITEM_INT")
            assert len(bench.texts) == 2
        else:
            assert names == ["MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_REQUEST", "MISSION_ACK"]
            assert bench.texts == []
        assert bench.held()[1].lat_degE7 == LAT


def test_ardupilot_reckons_with_degrees_in_single_precision():
    places = {}
    for traits in (ARDUPILOT, PX4):
        bench = StoreBench(traits)
        bench.hear("MISSION_COUNT", count=2)
        for seq in range(2):
            fields = item_to_message(SHORT[seq], seq, ME).fields | {"x": -35.36326217651367, "y": 149.16523742675781}
            bench.store.receive(Message("MISSION_ITEM", fields, *GROUND), 0.0)
        places[traits is PX4] = bench.held()[1].lat_degE7, bench.held()[1].lon_degE7
    assert places == {False: (-353632608, 1491652352), True: (-353632622, 1491652374)}


@BOTH
def test_a_float_position_that_is_no_number_is_refused(traits):
    bench = StoreBench(traits)
    bench.hear("MISSION_COUNT", count=1)
    fields = item_to_message(TAKEOFF, 0, ME).fields | {"x": NAN, "y": 8.0}
    assert result(bench.store.receive(Message("MISSION_ITEM", fields, *GROUND), 0.0)) == R.INVALID_PARAM5_X
    assert bench.held() == ()


# Silence


def test_a_stalled_upload_ends_after_8_s_on_ardupilot_with_an_answer():
    bench = StoreBench(ARDUPILOT)
    bench.put(SHORT)
    bench.texts.clear()
    bench.hear("MISSION_COUNT", count=6)
    bench.item(0, HOME_ITEM)
    bench.item(1, replace(TAKEOFF, alt_m=9.0))
    said = [message for n in range(1, 1000) for message in bench.tick(n * 0.01)]
    assert [m.name for m in said] == ["MISSION_REQUEST"] * 7 + ["MISSION_ACK"]
    assert {m.fields["seq"] for m in said[:-1]} == {2}
    assert result(said[-1:]) == R.OPERATION_CANCELLED
    assert bench.texts == [(4, "Mission upload timeout")]
    assert not bench.store.busy
    assert [i.alt_m for i in bench.held()[1:]] == [9.0, 5.0, 5.0]  # new, then old


def test_a_stalled_upload_ends_after_5_s_on_px4_without_an_answer():
    bench = StoreBench(PX4)
    bench.put(SHORT)
    bench.hear("MISSION_COUNT", count=6)
    bench.item(0, HOME_ITEM)
    said = [message for n in range(1, 600) for message in bench.tick(n * 0.01)]
    assert {(m.name, m.fields["seq"]) for m in said} == {("MISSION_REQUEST_INT", 1)}
    assert 18 <= len(said) <= 20
    assert bench.texts == [(2, "Operation timeout\t")]
    assert not bench.store.busy
    assert bench.held() == SHORT


def test_any_item_keeps_px4_waiting_but_not_ardupilot():
    for traits, timeout_s in ((ARDUPILOT, 8.0), (PX4, 5.0)):
        bench = StoreBench(traits)
        bench.hear("MISSION_COUNT", count=4)
        bench.tick(timeout_s * 0.9)
        bench.item(2, LAND)
        bench.tick(timeout_s * 1.1)
        assert bench.store.busy == (traits is PX4)


# Two at a time


def test_a_second_station_is_turned_away_and_the_first_goes_on():
    for traits, wanted in ((ARDUPILOT, R.DENIED), (PX4, R.ERROR)):
        bench = StoreBench(traits)
        bench.hear("MISSION_COUNT", count=4)
        assert asked(bench.item(0, HOME_ITEM)) == 1
        (ack,) = bench.hear("MISSION_COUNT", OTHER, count=3)
        assert (ack.fields["type"], ack.fields["target_system"]) == (wanted, OTHER.sysid)
        bench.item(1, LAND, source=OTHER)
        assert asked(bench.item(1, TAKEOFF)) == 2
        assert bench.texts == []


def test_a_new_count_restarts_ardupilot_and_meets_a_busy_px4():
    bench = StoreBench(ARDUPILOT)
    bench.put()
    bench.hear("MISSION_COUNT", count=4)
    bench.item(0, HOME_ITEM)
    assert asked(bench.hear("MISSION_COUNT", count=3)) == 0
    assert len(bench.held()) == 3  # cut at once
    for seq in range(3):
        answers = bench.item(seq, SHORT[seq])
    assert result(answers) == R.ACCEPTED

    bench = StoreBench(PX4)
    bench.hear("MISSION_COUNT", count=4)
    assert asked(bench.hear("MISSION_COUNT", count=3)) == 0  # a lost request
    bench.item(0, TAKEOFF)
    assert result(bench.hear("MISSION_COUNT", count=3)) == R.ERROR
    assert bench.texts == [(2, "WPM: REJ. CMD: Busy\t")]
    for seq in (1, 2, 3):
        answers = bench.item(seq, SHORT[seq])
    assert result(answers) == R.ACCEPTED
    assert len(bench.held()) == 4


def test_a_download_during_an_upload():
    for traits in (ARDUPILOT, PX4):
        bench = StoreBench(traits)
        bench.put()
        bench.texts.clear()
        bench.hear("MISSION_COUNT", count=4)
        answers = bench.hear("MISSION_REQUEST_LIST")
        if traits is ARDUPILOT:
            assert result(answers) == R.DENIED
            assert result(bench.hear("MISSION_REQUEST_INT", seq=0)) == R.DENIED
        else:
            assert answers == []
            assert bench.texts == [(6, "Mission download request ignored, already active\t")]


def test_a_fence_during_a_mission_is_pulled_side_by_side_by_ardupilot_alone():
    bench = StoreBench(ARDUPILOT)
    bench.hear("MISSION_COUNT", count=4)
    (request,) = bench.hear("MISSION_COUNT", count=4, mission_type=1)
    assert (request.fields["seq"], request.fields["mission_type"]) == (0, 1)
    assert [m.fields["mission_type"] for m in bench.tick(1.1)] == [0, 1]

    bench = StoreBench(PX4)
    bench.hear("MISSION_COUNT", count=4)
    (request,) = bench.hear("MISSION_COUNT", count=4, mission_type=1)
    assert (request.fields["seq"], request.fields["mission_type"]) == (0, 0)
    assert bench.item(0, SQUARE[0], kind=1) == []


def test_a_cancelled_upload_ends_on_px4_and_is_not_heard_by_ardupilot():
    for traits in (ARDUPILOT, PX4):
        bench = StoreBench(traits)
        bench.hear("MISSION_COUNT", count=4)
        assert bench.hear("MISSION_ACK", type=int(R.OPERATION_CANCELLED)) == []
        assert bench.store.busy == (traits is ARDUPILOT)


# Types and clearing


def test_unknown_types():
    for traits, wanted in ((ARDUPILOT, R.UNSUPPORTED), (PX4, R.NO_SPACE)):
        bench = StoreBench(traits)
        assert result(bench.hear("MISSION_COUNT", count=2, mission_type=7)) == wanted
        (answer,) = bench.hear("MISSION_REQUEST_LIST", mission_type=7)
        assert answer.name == ("MISSION_ACK" if traits is ARDUPILOT else "MISSION_COUNT")


def test_clearing_all_types_at_once_is_px4s_alone():
    for traits in (ARDUPILOT, PX4):
        bench = StoreBench(traits)
        bench.put()
        bench.put((*SQUARE, CIRCLE), 1)
        bench.put(RALLY, 2)
        bench.texts.clear()
        answer = result(bench.hear("MISSION_CLEAR_ALL", mission_type=255))
        assert answer == (R.UNSUPPORTED if traits is ARDUPILOT else R.ACCEPTED)
        assert [len(bench.held(kind)) for kind in (0, 1, 2)] == ([4, 5, 2] if traits is ARDUPILOT else [0, 0, 0])
        for kind in (1, 0):
            assert result(bench.hear("MISSION_CLEAR_ALL", mission_type=kind)) == R.ACCEPTED
            assert bench.held(kind) == ()
        assert bench.texts == ([(7, "Fence Indexed OK")] if traits is ARDUPILOT else [])


@BOTH
def test_another_station_cannot_clear_what_is_being_uploaded(traits):
    bench = StoreBench(traits)
    bench.put()
    bench.hear("MISSION_COUNT", count=4)
    assert result(bench.hear("MISSION_CLEAR_ALL", OTHER)) != R.ACCEPTED
    assert len(bench.held()) == 4
    assert bench.store.busy


# Fences


@pytest.mark.parametrize(
    ("items", "ardupilot", "px4", "texts"),
    [
        (
            tuple(replace(v, params=(2.0, 0.0, 0.0, 0.0)) for v in SQUARE[:2]),
            R.ERROR,
            R.ERROR,
            "Invalid vertex count (2)",
        ),
        (SQUARE[:3], R.ERROR, R.ACCEPTED, "Incorrect item count"),
        ((*SQUARE, item()), R.UNSUPPORTED, R.ACCEPTED, ""),
        ((*SQUARE[:2], CIRCLE), R.ERROR, R.ACCEPTED, "Vertex expected, not 5004"),
        ((*SQUARE[:2], vertex(0, 0, 4.0, 5002)), R.ERROR, R.ACCEPTED, "Vertex of another polygon (4)"),
        ((replace(CIRCLE, params=(0.0,) * 4),), R.ERROR, R.ACCEPTED, "Non-positive circle radius"),
        ((), R.ACCEPTED, R.ACCEPTED, ""),
    ],
    ids=["two vertices", "a vertex short", "a waypoint", "circle for vertex", "two polygons", "no radius", "nothing"],
)
def test_fences_that_make_no_sense(items, ardupilot, px4, texts):
    for traits, wanted in ((ARDUPILOT, ardupilot), (PX4, px4)):
        bench = StoreBench(traits)
        bench.put((*SQUARE, CIRCLE), 1)
        bench.texts.clear()
        answers = bench.hear("MISSION_COUNT", count=len(items), mission_type=1)
        for seq, what in enumerate(items):
            if answers[0].name != "MISSION_ACK":
                answers = bench.item(seq, what, 1)
        assert result(answers) == wanted
        assert len(bench.held(1)) == (len(items) if wanted == R.ACCEPTED else 5)
        said = [text for _, text in bench.texts]
        if traits is PX4:
            assert said == []
        elif texts:
            assert said == [texts, "Fence validation failed"]


def test_px4_refuses_too_few_vertices_at_once():
    bench = StoreBench(PX4)
    bench.hear("MISSION_COUNT", count=2, mission_type=1)
    assert result(bench.item(0, vertex(0, 0, 2.0), 1)) == R.ERROR


def test_px4_says_some_time_later_that_a_fence_leaves_home_out():
    broken, elsewhere = SQUARE[:3], tuple(replace(v, lat_degE7=v.lat_degE7 + 10_000) for v in SQUARE)
    for fence, says in ((SQUARE, False), ((*SQUARE, item()), False), (broken, True), (elsewhere, True), ((), False)):
        bench = StoreBench(PX4)
        bench.put(fence, 1) if fence else bench.hear("MISSION_COUNT", count=0, mission_type=1)
        assert bench.store.waits
        assert not bench.store.busy
        bench.tick(0.4)
        assert bench.texts == []
        bench.tick(0.6)
        wanted = [(2, "Geofence invalid, doesn't contain Home position\t")] if says else []
        assert bench.texts == wanted
        assert not bench.store.waits


def test_px4_forgets_what_a_fence_has_no_use_for():
    bench = StoreBench(PX4)
    bench.put((item(p=(0.0, 0.0, 0.0, NAN)),), 1)
    assert bench.held(1)[0].params == (0.0, 0.0, 0.0, 0.0)


# Downloads


def test_ardupilot_reads_out_whatever_is_asked_for():
    bench = StoreBench(ARDUPILOT)
    bench.put()
    assert bench.hear("MISSION_REQUEST_INT", OTHER, seq=2)[0].fields["x"] == LAT + 100
    assert bench.hear("MISSION_REQUEST", seq=0)[0].name == "MISSION_ITEM_INT"
    assert result(bench.hear("MISSION_REQUEST_INT", seq=4)) == R.ERROR
    assert not bench.store.busy


def test_px4_reads_out_in_order_to_who_asked_for_the_list():
    bench = StoreBench(PX4)
    bench.put()
    assert bench.hear("MISSION_REQUEST_INT", seq=0) == []
    assert bench.hear("MISSION_REQUEST_LIST")[0].fields["count"] == 4
    assert bench.hear("MISSION_REQUEST_INT", OTHER, seq=0) == []
    for seq in (0, 0, 1, 1, 2, 3, 3):
        assert bench.hear("MISSION_REQUEST_INT", seq=seq)[0].fields["seq"] == seq
    assert bench.hear("MISSION_ACK", type=0) == []
    assert bench.hear("MISSION_REQUEST_INT", seq=3) == []


def test_px4_ends_a_download_that_jumps_or_falls_silent():
    bench = StoreBench(PX4)
    bench.put()
    bench.hear("MISSION_REQUEST_LIST")
    assert result(bench.hear("MISSION_REQUEST_INT", seq=2)) == R.ERROR
    assert not bench.store.busy
    bench.hear("MISSION_REQUEST_LIST")
    assert result(bench.hear("MISSION_COUNT", count=3)) == R.ERROR
    assert bench.tick(4.9) == []
    assert bench.store.busy
    assert bench.tick(5.1) == []
    assert not bench.store.busy
    assert [text for _, text in bench.texts] == ["WPM: REJ. CMD: Busy\t", "Operation timeout\t"]


@BOTH
@settings(deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(
                [
                    "MISSION_COUNT",
                    "MISSION_ITEM",
                    "MISSION_ITEM_INT",
                    "MISSION_ACK",
                    "MISSION_CLEAR_ALL",
                    "MISSION_REQUEST_LIST",
                    "MISSION_REQUEST",
                    "MISSION_REQUEST_INT",
                ]
            ),
            st.sampled_from([GROUND, OTHER]),
            st.sampled_from([0, 1, 2, 7, 255]),
            st.integers(0, 3),
            st.sampled_from([*MISSION, *SQUARE, CIRCLE, *RALLY, item(9999), item(alt=NAN)]),
            st.floats(0.0, 3.0),
        ),
        max_size=40,
    )
)
def test_no_conversation_confuses_it(traits, conversation):
    """After any messages, answers went to the sender or its transfer, and stored items came from a station."""
    bench = StoreBench(traits)
    for name, source, kind, number, what, pause_s in conversation:
        fields = item_to_message(what, number, ME, mission_type=kind).fields
        fields |= {"count": number, "type": number}
        if name == "MISSION_ITEM":
            fields |= {"x": fields["x"] / 1e7, "y": fields["y"] / 1e7}
        answers = bench.hear(name, source, **fields)
        answers += bench.tick(bench.now_s + pause_s)
        assert all(a.fields["target_system"] in (GROUND.sysid, OTHER.sysid) for a in answers)
        for held in (0, 1, 2):
            assert len(bench.held(held)) <= 3
    assert bench.tick(bench.now_s + 100.0) is not None
    assert not bench.store.busy
