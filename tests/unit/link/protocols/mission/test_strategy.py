"""How a mission goes to its vehicle, why so, and what is tried when the first way fails."""

from __future__ import annotations

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerError
from gcs.link.protocols.mission.strategy import Preferred, SentAs, Transfer, planned, sent_data, sent_words
from gcs.link.wire.message import Message
from gcs.mavlink import MissionType

AP, PX4 = Autopilot.ARDUPILOT, Autopilot.PX4
MISSION, FENCE = MissionType.MISSION, MissionType.FENCE


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ((Transfer.ITEMS, AP, MISSION, 90), "item by item (--transfer items)"),
        ((Transfer.AUTO, AP, FENCE, 90), "item by item (fences and rally points are short)"),
        ((Transfer.FILE, PX4, MISSION, 90), "item by item (PX4 takes no files)"),
        ((Transfer.AUTO, AP, MISSION, 4), "item by item (fewer than 5 items)"),
        ((Transfer.AUTO, AP, MISSION, 5), "as a file (it reports MAVLink FTP)"),
        ((Transfer.FILE, AP, MISSION, 0), "item by item (fewer than 1 items)"),
        ((Transfer.FILE, AP, MISSION, 1), "as a file (--transfer file)"),
    ],
)
def test_the_way_of_a_mission_is_told_with_its_reason(asked: tuple[Transfer, int, int, int], words: str) -> None:
    assert str(planned(*asked)) == words


def test_vehicles_are_told_by_the_way_their_missions_went() -> None:
    as_file, by_items = SentAs(Transfer.FILE, "one"), SentAs(Transfer.ITEMS, "other")
    sent = {3: as_file, 2: by_items, 1: as_file}
    assert sent_words(sent) == "vehicles 1, 3: as a file (one); vehicles 2: item by item (other)"
    file, items = sent[1], sent[2]
    many = dict.fromkeys(range(1, 101), file) | {7: items, 9: items}
    assert sent_words(many) == ("vehicles 1 to 6, 8, 10 to 100: as a file (one); vehicles 7, 9: item by item (other)")
    assert sent_data(sent) == [
        {"vehicle": 1, "sent_as": "file", "why": "one"},
        {"vehicle": 2, "sent_as": "items", "why": "other"},
        {"vehicle": 3, "sent_as": "file", "why": "one"},
    ]


class Script:
    """A machine that says its name and what happened, and ends with the message "end" or at the time 9 s."""

    def __init__(self, name: str, *, fails: bool) -> None:
        self.name, self.fails = name, fails
        self.done = False
        self.error: PeerError | None = None
        self.deadline_s: float | None = 9.0

    def _said(self, what: str, now_s: float, *, ends: bool) -> list[Message]:
        self.done |= ends
        self.error = PeerError(self.name) if self.done and self.fails else self.error
        return [Message(f"{self.name} {what} {now_s:g}", {})]

    def start(self, now_s: float) -> list[Message]:
        return self._said("start", now_s, ends=False)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        return self._said("hears", now_s, ends=message.name == "end")

    def tick(self, now_s: float) -> list[Message]:
        return self._said("tick", now_s, ends=now_s >= 9.0)

    def cancel(self) -> list[Message]:
        return self._said("cancelled", 0.0, ends=True)


def names(messages: list[Message]) -> list[str]:
    return [message.name for message in messages]


@pytest.mark.parametrize("by", ["message", "time"])
def test_the_second_way_begins_where_the_first_has_failed(by: str) -> None:
    either = Preferred(Script("file", fails=True), Script("items", fails=by == "time"))
    assert names(either.start(1.0)) == ["file start 1"]
    assert names(either.receive(Message("other", {}), 2.0)) == ["file hears 2"]
    assert (either.done, either.failed) == (False, None)
    said = either.receive(Message("end", {}), 9.0) if by == "message" else either.tick(9.0)
    assert names(said) == [f"file {'hears' if by == 'message' else 'tick'} 9", "items start 9"]
    assert (either.done, str(either.failed), either.error, either.deadline_s) == (False, "file", None, 9.0)
    assert names(either.receive(Message("end", {}), 9.5)) == ["items hears 9.5"]
    assert either.done
    assert (str(either.error) if either.error else None) == ("items" if by == "time" else None)


def test_a_first_way_that_succeeds_or_is_cancelled_has_no_second() -> None:
    either = Preferred(Script("file", fails=False), Script("items", fails=False))
    assert names(either.receive(Message("end", {}), 1.0)) == ["file hears 1"]
    assert either.done and either.error is None and either.failed is None
    either = Preferred(Script("file", fails=True), Script("items", fails=False))
    assert names(either.cancel()) == ["file cancelled 0"]
    assert either.done and str(either.error) == "file"
