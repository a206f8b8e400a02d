"""FileUpload: uploads a mission to ArduPilot as one file (MAVLink FTP), reads the file back and compares it.

    state    event                                   next     sends
    IDLE     start                                   WRITING  the start of an FtpWriter
    WRITING  file closed                             READING  the start of an FtpReader
    WRITING  refused, or never answered              FAILED
    WRITING  timeout after some answers              WRITING  the file again
    READING  equal by meaning                        DONE
    READING  refused, or timeout                     READING  the read-back again, then WRITING, then FAILED
    READING  different                               FAILED

A closed file proves nothing, and after a refused close the contents are unknown: only the read-back counts. It is
compared item by item. A difference would come again: items sent one by one show which of them is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto

from gcs.autopilots.protocol_timers import FtpTimers
from gcs.autopilots.traits import link_behaviour
from gcs.errors import GcsError, PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.ftp.reader import FtpReader
from gcs.link.protocols.ftp.requests import FtpNumbers
from gcs.link.protocols.ftp.writer import FtpWriter
from gcs.link.protocols.mission.mission_dat import (
    HEADER,
    ITEM,
    length_of,
    path_of,
    pieces_of,
    read_mission_file,
    write_mission_file,
)
from gcs.link.protocols.mission.read_back import compare_missions, read_back_error
from gcs.link.protocols.rtt import RttEstimator
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MissionType
from gcs.mission.model import MissionItem

_READS = 3  # read-backs of one upload


class FileState(Enum):
    """The states of the table above."""

    IDLE = auto()
    WRITING = auto()
    READING = auto()
    DONE = auto()
    FAILED = auto()


class FileUpload:
    """All items of a flight mission with home as item 0. Home reads back as the vehicle's own and is not compared."""

    def __init__(
        self,
        items: Sequence[MissionItem],
        peer: Station,
        autopilot: int,
        *,
        me: Station = GROUND,
        timers: FtpTimers | None = None,
        round_trip: RttEstimator | None = None,
        numbers: FtpNumbers | None = None,
        tries: int = 2,
    ) -> None:
        self.items = tuple(items)
        self.peer = peer
        self.state = FileState.IDLE
        self.error: GcsError | None = None
        self.sending_ended_s: float | None = None  # end of the last upload
        self._autopilot = autopilot
        self._me, self._timers = me, timers or link_behaviour(autopilot).timers.ftp
        self._round_trip = round_trip or RttEstimator()
        self._numbers = numbers or FtpNumbers()
        self._tries = tries
        self._reads_left = 0
        self._path = path_of(MissionType.MISSION)
        self._machine: FtpWriter | FtpReader | None = None

    @property
    def done(self) -> bool:
        """Whether it has ended: with success (these items are on board) if `error` is None."""
        return self.state in (FileState.DONE, FileState.FAILED)

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        return None if self.done or self._machine is None else self._machine.deadline_s

    def start(self, now_s: float) -> list[Message]:
        """Return the first messages. Raises `ProtocolMisuse` if called twice."""
        if self.state is not FileState.IDLE:
            raise ProtocolMisuse("a FileUpload was started twice: create a new one.")
        return self._write(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message; none if it belongs to another conversation."""
        if self.done or self._machine is None:
            return []
        return self._machine.receive(message, now_s) + self._advance(now_s)

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        if self.done or self._machine is None:
            return []
        return self._machine.tick(now_s) + self._advance(now_s)

    def cancel(self) -> list[Message]:
        """End the upload. What is on board is then unknown."""
        if self.done:
            return []
        messages = self._machine.cancel() if self._machine is not None else []
        self._fail(PeerError(f"the upload of the mission to {self.peer} was cancelled."))
        return messages

    def _advance(self, now_s: float) -> list[Message]:
        machine = self._machine
        if machine is None or not machine.done:
            return []
        if isinstance(machine, FtpWriter):
            self.sending_ended_s = now_s
            if machine.error is not None:
                timed_out = isinstance(machine.error, PeerTimeout) and machine.heard
                return self._write(now_s) if timed_out and self._tries > 0 else self._fail(machine.error)
            self._reads_left = _READS
            return self._read(now_s)
        return self._read_back(machine, now_s)

    def _read_back(self, machine: FtpReader, now_s: float) -> list[Message]:
        error = machine.error
        if error is None:
            try:
                on_board = read_mission_file(machine.data, MissionType.MISSION, self.peer)
            except PeerError as invalid:
                return self._fail(invalid)
            differences = compare_missions(self.items[1:], on_board[1:], autopilot=self._autopilot)
            if differences:
                return self._fail(read_back_error(self.peer, MissionType.MISSION, differences))
            self.state = FileState.DONE
            return []
        self._reads_left -= 1
        if self._reads_left > 0:
            return self._read(now_s)
        return self._write(now_s) if self._tries > 0 else self._fail(error)

    def _write(self, now_s: float) -> list[Message]:
        self._tries -= 1
        self.state = FileState.WRITING
        self._machine = FtpWriter(
            self._path,
            pieces_of(write_mission_file(self.items)),
            self.peer,
            me=self._me,
            timers=self._timers,
            round_trip=self._round_trip,
            numbers=self._numbers,
        )
        return self._machine.start(now_s)

    def _read(self, now_s: float) -> list[Message]:
        self.state = FileState.READING
        self._machine = FtpReader(
            self._path,
            self.peer,
            self._length,
            HEADER.size,
            me=self._me,
            timers=self._timers,
            round_trip=self._round_trip,
            numbers=self._numbers,
        )
        return self._machine.start(now_s)

    def _length(self, head: bytes) -> int:
        """The length of the file on board. Raises `PeerError` if it is longer than the one that was written."""
        length, written = length_of(head, MissionType.MISSION, self.peer), HEADER.size + len(self.items) * ITEM.size
        if length > written:
            raise PeerError(f"{self.peer} sent a mission file of {length} bytes; {written} were written.")
        return length

    def _fail(self, error: GcsError) -> list[Message]:
        self.error = error
        self.state = FileState.FAILED
        return []
