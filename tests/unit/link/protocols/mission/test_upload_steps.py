"""An upload that is read back, step by step: what is sent again, what is waited for, and what ends it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gcs.autopilots.protocol_timers import MissionTimers
from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerError, PeerTimeout
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.machine import MachineState
from gcs.link.protocols.mission.item_messages import item_to_message
from gcs.link.protocols.mission.rules import MissionRefused
from gcs.link.protocols.mission.verified_upload import VerifiedUpload
from gcs.link.wire.message import GROUND
from gcs.mavlink import MissionResult, MissionType
from gcs.mission.model import MissionItem
from tests.unit.link.protocols.mission.conversation import (
    VEHICLE,
    SteadyTrip,
    line,
    missions,
    said,
    talking,
    ticks,
    told,
    until,
)

ITEMS = missions(2)
OTHER = replace(ITEMS[1], alt_m=90.0)
TIMERS = MissionTimers(give_up_s=9.0, ack_s=2.5, doubt_s=1.2, busy_s=6.0)


def started(count: int = 2, **how: Any) -> VerifiedUpload:
    """An upload that made its offer at 10 s, with waits of 0.5 s."""
    upload = VerifiedUpload(missions(count), talking(Autopilot.PX4, timers=TIMERS, round_trip=SteadyTrip()), **how)
    assert (upload.deadline_s, upload.tick(50.0)) == (None, [])
    assert line(upload.start(10.0)) == f"COUNT {count}"
    return upload


def quiet(upload: VerifiedUpload, until_it: Callable[[str], bool]) -> tuple[float, str]:
    """When nobody answers: the time and the words at which something comes true."""
    for _ in range(60):
        assert upload.deadline_s is not None
        now_s = upload.deadline_s
        if until_it(answer := line(upload.tick(now_s))):
            return round(now_s, 6), answer
    raise AssertionError(upload.state)


def sent(upload: VerifiedUpload, now_s: float = 10.0) -> VerifiedUpload:
    for seq in (0, 1):
        assert told(upload, "MISSION_REQUEST_INT", now_s, seq=seq)[0] == f"ITEM_INT {seq}"
    return upload


def reading(upload: VerifiedUpload, now_s: float = 10.0) -> VerifiedUpload:
    assert told(sent(upload, now_s), "MISSION_ACK", now_s, type=0)[0] == "REQUEST_LIST"
    assert (upload.state, upload.sending_ended_s) == (MachineState.READING, now_s)
    return upload


def read(upload: VerifiedUpload, *items: MissionItem, now_s: float = 10.0) -> str:
    """What the upload says after the last item of its read-back."""
    answer = told(upload, "MISSION_COUNT", now_s, count=len(items))[0]
    for seq, item in enumerate(items):
        answer = line(upload.receive(replace(item_to_message(item, seq, GROUND), sysid=4, compid=1), now_s))
    return answer


def turns(upload: VerifiedUpload) -> list[tuple[float, str]]:
    """What it says with nobody answering, without what it only repeats."""
    found = ticks(upload)
    return [one for before, one in zip([(0.0, ""), *found], found, strict=False) if one[1] != before[1]]


def test_what_reads_back_equal_is_on_board() -> None:
    upload = reading(started())
    assert read(upload, *ITEMS) == "ACK 0"
    assert (upload.state, upload.error, upload.sent, upload.deadline_s) == (MachineState.DONE, None, 1, None)
    assert upload.receive(said("MISSION_COUNT", count=2), 11.0) == upload.tick(11.0) == []


@pytest.mark.parametrize(("autopilot", "equal"), [(Autopilot.PX4, False), (Autopilot.ARDUPILOT, True)])
@pytest.mark.parametrize("kind", [MissionType.MISSION, MissionType.FENCE])
def test_item_0_of_ardupilots_missions_is_home_and_reads_back_as_its_own(
    autopilot: int, equal: bool, kind: MissionType
) -> None:
    upload = VerifiedUpload(ITEMS, talking(autopilot, timers=TIMERS, round_trip=SteadyTrip()), mission_type=kind)
    upload._machine = upload._reader = cast("Any", SimpleNamespace(items=(replace(ITEMS[0], lat_degE7=5), ITEMS[1])))
    assert (upload._difference() is None) is (equal and kind is MissionType.MISSION)


@pytest.mark.parametrize("tries", [1, 3])
def test_what_reads_back_different_is_sent_again_a_few_times(tries: int) -> None:
    upload = started(tries=tries)
    for n in range(1, tries + 1):
        at_s = 10.0 + n
        again = read(reading(upload, at_s), ITEMS[0], OTHER, now_s=at_s)
        assert again == ("ACK 0, COUNT 2" if n < tries else "ACK 0")
        assert upload.sent == min(n + 1, tries)
    assert "differs from what was sent: item 1: altitude" in str(upload.error)


def test_a_refusal_for_good_ends_it_at_once() -> None:
    upload = started()
    told(upload, "MISSION_REQUEST_INT", 10.1, seq=0)
    assert told(upload, "MISSION_ACK", 10.2, type=int(MissionResult.UNSUPPORTED)) == ("", None)
    assert isinstance(upload.error, MissionRefused)
    assert (upload.error.seq, upload.sent) == (0, 1)


def test_a_busy_vehicle_is_waited_for_and_named_if_it_stays_so() -> None:
    upload, at_s = started(tries=3), 10.0
    for n in range(3):
        told(upload, "MISSION_ACK", at_s, type=int(MissionResult.ERROR))
        refused_s, _ = quiet(upload, lambda _: upload.state is not MachineState.SENDING)
        assert refused_s == at_s + 2.0  # the doubt: four waits
        if n < 2:
            assert (upload.state, until(upload)) == (MachineState.WAITING, refused_s + TIMERS.busy_s)
            assert told(upload, "MISSION_REQUEST_INT", refused_s + 1.0, seq=0)[0] == ""
            assert upload.tick(refused_s + 5.9) == []
            at_s = refused_s + 6.0
            assert line(upload.tick(at_s)) == "COUNT 2"
            assert upload.sent == 1
    assert isinstance(upload.error, MissionRefused)


@pytest.mark.parametrize(("result", "asked"), [(MissionResult.OPERATION_CANCELLED, 0), (MissionResult.ERROR, 1)])
def test_a_transfer_that_broke_off_is_cancelled_on_board_and_begun_again(result: MissionResult, asked: int) -> None:
    upload = started(4)
    for seq in range(asked):
        told(upload, "MISSION_REQUEST_INT", 10.0, seq=seq)
    told(upload, "MISSION_ACK", 10.0, type=int(result))
    assert quiet(upload, lambda _: upload.sent > 1) == (12.0, "ACK 15, COUNT 4")
    told(upload, "MISSION_ACK", 12.1, type=1)  # the first transfer may still be open: no refusal
    assert (upload.state, upload.error) == (MachineState.SENDING, None)


def test_who_never_answers_is_asked_once_and_who_falls_silent_again() -> None:
    upload = started()
    assert turns(upload) == [(10.5, "COUNT 2"), (19.0, "")]
    assert isinstance(upload.error, PeerTimeout) and upload.sent == 1
    upload = started(tries=2)
    told(upload, "MISSION_REQUEST_LIST", 10.0)
    assert turns(upload) == [(10.5, "COUNT 2"), (19.0, "ACK 15, COUNT 2"), (19.5, "COUNT 2"), (28.0, "")]


def test_without_an_acknowledgement_it_is_read_back_and_twice_without_an_answer_is_the_end() -> None:
    upload = sent(started())
    assert turns(upload) == [
        (10.5, "ITEM_INT 1"),
        (12.5, "REQUEST_LIST"),  # ack_s after the last item
        (21.5, "ACK 15, REQUEST_LIST"),
        (22.0, "REQUEST_LIST"),
        (30.5, "ACK 15"),
    ]
    assert isinstance(upload.error, PeerTimeout)
    assert (upload.sent, upload.sending_ended_s) == (1, 12.5)


def test_a_read_back_that_breaks_off_is_repeated_and_then_the_items_are_sent_again() -> None:
    upload = reading(started())
    for n in range(5):
        at_s = 20.0 * (n + 1)
        assert told(upload, "MISSION_COUNT", at_s, count=2)[0] == "REQUEST_INT 0"
        _, heard = quiet(upload, lambda answer: "REQUEST_INT" not in answer)
        assert heard == ("ACK 15, REQUEST_LIST" if n < 4 else "ACK 15, ACK 15, COUNT 2")
    assert upload.sent == 2


@pytest.mark.parametrize(("counted", "said_then"), [(False, "ACK 15, ACK 15, COUNT 2"), (True, "ACK 15, REQUEST_LIST")])
def test_a_read_back_that_is_refused(counted: bool, said_then: str) -> None:
    """In the middle PX4 refuses an earlier item, and is asked again; before, an upload may be open on board."""
    upload = reading(started())
    if counted:
        told(upload, "MISSION_COUNT", 10.0, count=2)
    told(upload, "MISSION_ACK", 10.0, type=int(MissionResult.DENIED))
    assert quiet(upload, lambda answer: "ACK" in answer)[1] == said_then


@pytest.mark.parametrize("begun", [False, True])
def test_a_cancelled_upload_tells_the_vehicle(begun: bool) -> None:
    upload = started() if begun else VerifiedUpload(ITEMS, Exchange(VEHICLE, Autopilot.PX4))
    assert line(upload.cancel()) == ("ACK 15" if begun else "")
    assert isinstance(upload.error, PeerError) and "the upload of the mission to vehicle 4" in upload.error.message
    assert upload.cancel() == upload.tick(99.0) == []


@pytest.mark.parametrize("in_read_back", [False, True])
def test_what_breaks_off_in_the_last_try_is_cancelled_on_board_and_reported(in_read_back: bool) -> None:
    upload = reading(started(tries=1)) if in_read_back else started(tries=1)
    told(upload, "MISSION_ACK", 10.0, type=int(MissionResult.OPERATION_CANCELLED))
    assert quiet(upload, lambda _: upload.done)[1] == ("ACK 15, ACK 15" if in_read_back else "ACK 15")
    assert upload.state is MachineState.FAILED and isinstance(upload.error, MissionRefused)
