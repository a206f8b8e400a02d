"""The record of a flight on disks that are full, gone or slow: nothing is raised, and what is lacking is told."""

from __future__ import annotations

import os
import resource
import shutil
import struct
import threading
from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path

import pytest

from gcs.errors import FlightError, UsageError
from gcs.flight.monitoring.progress import Action, Event, Step
from gcs.flight.recording import flight_record
from gcs.flight.recording.flight_folder import EVENTS, PLAN, TELEMETRY, new_folder, read_events
from gcs.flight.recording.flight_record import FlightRecord
from gcs.flight.recording.flight_state import FlightState, newest_unfinished, read_flight_state
from gcs.flight.recording.record_gaps import needed_bytes, refuse_without_room, refusing_unwritable
from gcs.flight.recording.tlog import LoggedFrame, load_tlog, scan
from gcs.link.session.linked_fleet import FrameDirection
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from gcs.plan.trajectory.plan import Plan

IN = FrameDirection.IN
STATE = FlightState("hop", "0" * 64, ("udpin::14550",), {}, "stream", False, Step.FLY.value, None, os.getpid())
CODEC = Codec(1, 1)
FRAME_BYTES = 8 + 12 + 28


def frame(number: int) -> bytes:
    motion = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz"), 0.0)
    return CODEC.encode(Message("LOCAL_POSITION_NED", {"time_boot_ms": number, **motion}, 1, 1))


def write_frames(record: FlightRecord, numbers: range) -> None:
    for number in numbers:
        record.write_frame(IN, frame(number))


def numbers_in(path: Path) -> list[int]:
    found = list(scan(path))
    assert all(isinstance(one, LoggedFrame) or one.cut for one in found), "a reader meets no damage"
    messages = [one.message for one in found if isinstance(one, LoggedFrame)]
    return [message.fields["time_boot_ms"] for message in messages if message is not None]


@pytest.fixture
def largest() -> Iterator[Callable[[int], None]]:
    """Sets how large files of this process may grow: a full disk, EFBIG for ENOSPC."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def settle(record: FlightRecord) -> None:
    """Wait until all that was given is written or lost."""
    done = threading.Event()
    record.write_event(Event(0.0, 0.0, 0, "settled"))
    assert record._writer is not None
    record._writer.do(done.set)
    assert done.wait(60.0)


def test_stamps_follow_a_clock_that_gnss_sets_back_and_no_small_step(tmp_path: Path) -> None:
    times_s = [2_000_000_000.0, 2_000_000_001.0, 1_800_000_000.0, 1_800_000_002.0, 1_800_000_001.5, 1_800_000_003.0]
    told = iter(times_s)
    with FlightRecord(tmp_path, pytest.fail, lambda: next(told)) as record:
        write_frames(record, range(len(times_s)))
    stamps_s = [one.stamp_us / 1e6 for one in scan(tmp_path / TELEMETRY) if isinstance(one, LoggedFrame)]
    assert stamps_s == [*times_s[:4], times_s[3], times_s[5]]


def test_a_complete_record_says_nothing(tmp_path: Path) -> None:
    with FlightRecord(tmp_path, pytest.fail, lambda: 5.0) as record:
        write_frames(record, range(1000))
        record.write_event(Event(float("nan"), 2.0, 3, "a", data={"numpy": Path("b")}, action=Action.LAND))
        record.write_state(STATE)
    assert numbers_in(tmp_path / TELEMETRY) == list(range(1000))
    assert struct.unpack_from(">Q", (tmp_path / TELEMETRY).read_bytes())[0] == 5_000_000
    assert [(event.what, event.action) for event in read_events(tmp_path / EVENTS)] == [("a", Action.LAND)]
    assert read_flight_state(tmp_path) == STATE
    assert record.gaps.words() == ""


@pytest.mark.parametrize("unix_s", [2.0**64 / 1e6, float("nan"), float("inf"), -5.0, 1e30])
def test_an_impossible_time_is_no_time(tmp_path: Path, unix_s: float) -> None:
    with FlightRecord(tmp_path, pytest.fail, lambda: unix_s) as record:
        write_frames(record, range(3))
    assert numbers_in(tmp_path / TELEMETRY) == [0, 1, 2]


def test_a_disk_that_is_full_for_a_while(tmp_path: Path, largest: Callable[[int], None]) -> None:
    """The log is cut at a whole frame, goes on where there is room again, and is read without damage."""
    told: list[str] = []
    with FlightRecord(tmp_path, told.append, lambda: 5.0) as record:
        write_frames(record, range(1000))
        record.write_state(STATE)
        settle(record)
        largest(30_000)
        write_frames(record, range(1000, 2000))
        record.write_state(STATE)
        settle(record)
        write_frames(record, range(2000, 3000))
        settle(record)
        assert len(told) == 1
        assert told[0].startswith(f"{tmp_path / TELEMETRY} cannot be written: File too large. The flight goes on")
        largest(resource.RLIM_INFINITY)
        write_frames(record, range(3000, 4000))
        settle(record)
        record.write_state(STATE)
    assert "is written again" in told[1]
    assert told[-1] == record.gaps.words()
    kept = numbers_in(tmp_path / TELEMETRY)
    (gap,) = record.gaps.data()
    assert gap["lost"] == 4000 - len(kept) > 1000
    assert kept == sorted(kept)
    assert kept[-1] == 3999
    assert load_tlog(tmp_path / TELEMETRY).notes == ()
    assert gap["until_unix_s"] is not None
    assert read_flight_state(tmp_path).incomplete == record.gaps.found
    assert [event.what for event in read_events(tmp_path / EVENTS)] == ["settled"] * 4


def test_a_state_that_cannot_be_written_leaves_the_last_one(tmp_path: Path, largest: Callable[[int], None]) -> None:
    folder, told = tmp_path / "flight", list[str]()
    folder.mkdir()
    with FlightRecord(folder, told.append, lambda: None) as record:
        record.write_state(STATE)
        settle(record)
        largest(10)
        record.write_state(STATE)
        settle(record)
        largest(resource.RLIM_INFINITY)
    assert any("flight.json cannot be written" in text for text in told)
    assert newest_unfinished(tmp_path) == folder
    assert read_flight_state(folder).step == STATE.step
    assert not list(folder.glob(".*"))  # no half of a file


def test_a_folder_deleted_in_flight_is_made_again_for_attach(tmp_path: Path) -> None:
    folder, told = tmp_path / "flight", list[str]()
    folder.mkdir()
    (folder / PLAN).write_bytes(b"the plan")
    with FlightRecord(folder, told.append, lambda: None) as record:
        write_frames(record, range(1000))
        record.write_state(STATE)
        settle(record)
        shutil.rmtree(folder)
        write_frames(record, range(1000, 2000))
        settle(record)
        assert newest_unfinished(tmp_path) == folder
    assert (folder / PLAN).read_bytes() == b"the plan"
    assert f"{folder / TELEMETRY} cannot be written: it was deleted. The flight goes on" in told[0]
    kept = numbers_in(folder / TELEMETRY)
    assert kept[-1] == 1999
    assert {gap["file"]: gap["lost"] for gap in record.gaps.data()} == {TELEMETRY: 2000 - len(kept), EVENTS: 1}
    assert "telemetry.tlog lacks" in told[-1]


def test_a_folder_that_stays_away_is_told_and_no_file_is_named(tmp_path: Path) -> None:
    folder, told = tmp_path / "flight", list[str]()
    folder.mkdir()
    with FlightRecord(folder, told.append, lambda: None) as record:
        settle(record)
        shutil.rmtree(folder)
        folder.write_text("a file of somebody else")
        write_frames(record, range(1000))
        record.write_state(STATE)
        settle(record)
    assert told[-1].startswith(f"the record of this flight is lost: its folder {folder} is gone (")
    assert TELEMETRY not in told[-1]
    assert folder.read_text() == "a file of somebody else"


def test_a_record_without_a_folder_from_the_beginning(tmp_path: Path) -> None:
    """`gcs attach` lands vehicles though nothing can be written."""
    told: list[str] = []
    (tmp_path / "flight").write_text("")
    with FlightRecord(tmp_path / "flight", told.append, lambda: None) as record:
        write_frames(record, range(1000))
        record.write_event(Event(0.0, 0.0, 1, "a"))
    assert sum("telemetry.tlog cannot be written: Not a directory" in text for text in told) == 1


def test_a_disk_that_stands_still_keeps_no_frame_waiting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight_record, "WAITING_MAX_BYTES", 50_000)
    told: list[str] = []
    goes_on = threading.Event()
    with FlightRecord(tmp_path, told.append, lambda: None) as record:
        settle(record)
        assert record._writer is not None
        record._writer.do(goes_on.wait)  # type: ignore[arg-type]
        write_frames(record, range(4000))
        assert told == [
            f"{tmp_path / TELEMETRY} cannot be written: the disk stands still. "
            "The flight goes on; its record is incomplete"
        ]
        goes_on.set()
    (gap,) = record.gaps.data()
    assert gap["lost"] + len(numbers_in(tmp_path / TELEMETRY)) == 4000
    assert gap["lost"] > 1000


def test_the_room_is_checked_before_a_vehicle_is_touched(simulation1_plan: Plan, tmp_path: Path) -> None:
    needed = needed_bytes(simulation1_plan, emulated=False)
    assert 5_516_660 < needed < 200e6  # what a flight of it recorded
    assert needed < needed_bytes(simulation1_plan, emulated=True)
    folder = tmp_path / "flight"
    folder.mkdir()
    refuse_without_room(folder, needed)
    with pytest.raises(FlightError, match=r"no-go: the disk of .* has .* MB free; .* may need 1000000000000.0 MB"):
        refuse_without_room(folder, 1e18)
    assert list(tmp_path.iterdir()) == []


def test_a_limit_of_file_sizes_is_a_no_go(tmp_path: Path, largest: Callable[[int], None]) -> None:
    largest(1_000_000)
    folder = tmp_path / "flight"
    folder.mkdir()
    with pytest.raises(FlightError, match=r"may grow to 1\.0 MB; .* may need 2\.0 MB\. Nothing was uploaded"):
        refuse_without_room(folder, 2e6)


@pytest.mark.parametrize("root", ["file", "file/below", "nowhere", "/proc/none", "long" * 100])
def test_a_folder_that_cannot_be_made_is_a_sentence(tmp_path: Path, root: str) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "nowhere").symlink_to(tmp_path / "not" / "there")
    words = r"no-go: the flight's folder cannot be written: .* Nothing was uploaded"
    with pytest.raises(UsageError, match=words), refusing_unwritable(tmp_path / root):
        new_folder(tmp_path / root, "hop", datetime.now())
