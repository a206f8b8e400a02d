"""A mission that goes as a file: what follows when the file, or its read-back, ends in one way or another."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerError, PeerTimeout
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.machine import MachineState
from gcs.link.protocols.mission import file_upload
from gcs.link.protocols.mission.file_upload import FileUpload
from gcs.link.protocols.mission.mission_dat import write_mission_file
from gcs.link.wire.message import Message
from tests.unit.link.protocols.mission.conversation import VEHICLE, missions

ITEMS = missions(3)
SILENT = PeerTimeout("silent")
END = Message("end", {})


class Part:
    """A transfer of the file that ends, when it is told so, as its script has it: with an error, or with bytes."""

    script: ClassVar[list[Any]] = []

    def __init__(self, path: str, *given: Any, **named: Any) -> None:
        assert path == "@MISSION/mission.dat"
        self.length = given[1] if type(self) is Reading else None
        self.done, self.heard, self.error, self.data, self.deadline_s = False, True, None, b"", 7.0

    def start(self, now_s: float) -> list[Message]:
        return [Message(f"{type(self).__name__} {now_s:g}", {})]

    def receive(self, message: Message, now_s: float) -> list[Message]:
        self.done, end = True, self.script.pop(0)
        if isinstance(end, bytes):
            self.data = end
        elif end == "never heard":
            self.heard, self.error = False, SILENT
        else:
            self.error = end
        return []

    def tick(self, now_s: float) -> list[Message]:
        return self.receive(END, now_s)

    def cancel(self) -> list[Message]:
        return [Message("reset", {})]


class Writing(Part):
    pass


class Reading(Part):
    pass


FILE = write_mission_file(ITEMS)
HOME_MOVED = write_mission_file((replace(ITEMS[0], alt_m=5.0), *ITEMS[1:]))
CHANGED = write_mission_file((*ITEMS[:2], replace(ITEMS[2], alt_m=5.0)))
REFUSED = PeerError("refused")


@pytest.mark.parametrize(
    ("script", "went", "error"),
    [
        ([None, FILE], "WR", None),
        ([None, HOME_MOVED], "WR", None),  # the vehicle's own home
        ([None, CHANGED], "WR", "item 1: altitude (m) sent 12.0, read back 5.0"),
        ([None, FILE[:-1]], "WR", "its header gives another length"),
        ([REFUSED], "W", "refused"),
        (["never heard"], "W", "silent"),
        ([SILENT, None, FILE], "WWR", None),
        ([SILENT, SILENT], "WW", "silent"),
        ([None, REFUSED, SILENT, FILE], "WRRR", None),
        ([None, SILENT, SILENT, SILENT, None, FILE], "WRRRWR", None),
        ([None, SILENT, SILENT, SILENT, None, SILENT, SILENT, REFUSED], "WRRRWRRR", "refused"),
    ],
)
def test_what_follows_each_end_of_a_transfer(
    monkeypatch: pytest.MonkeyPatch, script: list[Any], went: str, error: str | None
) -> None:
    monkeypatch.setattr(file_upload, "FtpWriter", Writing)
    monkeypatch.setattr(file_upload, "FtpReader", Reading)
    monkeypatch.setattr(Part, "script", list(script))
    upload = FileUpload(ITEMS, Exchange(VEHICLE, Autopilot.ARDUPILOT))
    assert (upload.deadline_s, upload.receive(END, 0.0), upload.tick(0.0)) == (None, [], [])
    begun, now_s = upload.start(0.0), 0.0
    while not upload.done:
        assert upload.deadline_s == 7.0
        now_s += 1.0
        begun += upload.receive(END, now_s) if int(now_s) % 2 else upload.tick(now_s)
    assert "".join(message.name[0] for message in begun) == went
    assert [float(message.name.split()[1]) for message in begun] == [float(n) for n in range(len(went))]
    assert (upload.error is None) if error is None else (error in str(upload.error))
    assert upload.sending_ended_s == went.rindex("W") + 1
    assert (upload.deadline_s, upload.cancel(), upload.receive(END, 9.0)) == (None, [], [])
    assert (upload.error is None) is (upload.state is MachineState.DONE) is (error is None)


def test_a_file_on_board_that_is_longer_than_what_was_written_is_not_read() -> None:
    upload = FileUpload(ITEMS, Exchange(VEHICLE, Autopilot.ARDUPILOT))
    assert upload._length(FILE[:10]) == len(FILE)
    assert upload._length(write_mission_file(ITEMS[:2])[:10]) == len(FILE) - 38
    longer = write_mission_file(missions(4))
    with pytest.raises(PeerError, match=f"a mission file of {len(longer)} bytes; {len(FILE)} were written"):
        upload._length(longer[:10])


@pytest.mark.parametrize("begun", [False, True])
def test_a_cancelled_upload_ends_its_transfer(monkeypatch: pytest.MonkeyPatch, begun: bool) -> None:
    monkeypatch.setattr(file_upload, "FtpWriter", Writing)
    upload = FileUpload(ITEMS, Exchange(VEHICLE, Autopilot.ARDUPILOT))
    if begun:
        upload.start(0.0)
    assert [message.name for message in upload.cancel()] == ["reset"] * begun
    assert "the upload of the mission to vehicle 4 was cancelled" in str(upload.error)
