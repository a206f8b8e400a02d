"""FileDelivery: a mission goes to an ArduPilot as one file, is read back as one, and compared.

Knows: the file's way there and back. Does not know: sockets, clocks (time is an argument), the way item by item
(`delivery`), when to prefer which (`transfer`).

    state    event                                   next     sends
    IDLE     start                                   WRITING  what an FtpWriter starts with
    WRITING  closed                                  READING  what an FtpReader starts with
    WRITING  refused, or never answered              FAILED
    WRITING  silent after answers                    WRITING  ... once more
    READING  equal by meaning                        DONE
    READING  changed while it was read               READING  ... once more
    READING  different, refused, or silent           WRITING  ... once more, `tries` in all, then FAILED

That a file was closed proves nothing, and a refused close may have left anything: only what is read back counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto

from gcs.autopilots.traits import Autopilot
from gcs.errors import GcsError, PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.ftp.reader import FtpReader
from gcs.link.ftp.requests import FtpNumbers
from gcs.link.ftp.writer import FtpWriter
from gcs.link.microservices.rtt import RttEstimator
from gcs.link.mission_protocol.mission_dat import (
    HEADER,
    length_of,
    path_of,
    pieces_of,
    read_mission_file,
    write_mission_file,
)
from gcs.link.mission_protocol.read_back import compare_missions, not_held
from gcs.link.mission_protocol.rules import GROUND_TIMERS, Timers
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MissionType
from gcs.mission.model import MissionItem

_READS = 3  # of one upload


class FileState(Enum):
    """See the table above."""

    IDLE = auto()
    WRITING = auto()
    READING = auto()
    DONE = auto()
    FAILED = auto()


class FileUpload:
    """All items of a flight mission, home as item 0: it reads back as the vehicle's own and is not compared."""

    def __init__(
        self,
        items: Sequence[MissionItem],
        peer: Station,
        *,
        me: Station = GROUND,
        timers: Timers = GROUND_TIMERS,
        round_trip: RttEstimator | None = None,
        numbers: FtpNumbers | None = None,
        tries: int = 2,
    ) -> None:
        self.items = tuple(items)
        self.peer = peer
        self.state = FileState.IDLE
        self.error: GcsError | None = None
        self.sending_ended_s: float | None = None  # when the last upload was over
        self._me, self._timers = me, timers
        self._round_trip = round_trip or RttEstimator()
        self._numbers = numbers or FtpNumbers()
        self._tries = tries
        self._reads_left = 0
        self._path = path_of(MissionType.MISSION)
        self._machine: FtpWriter | FtpReader | None = None

    @property
    def done(self) -> bool:
        """Whether it ended, well (`error` is None: the vehicle holds these items) or badly."""
        return self.state in (FileState.DONE, FileState.FAILED)

    @property
    def deadline_s(self) -> float | None:
        """When `tick` next has something to do."""
        return None if self.done or self._machine is None else self._machine.deadline_s

    def start(self, now_s: float) -> list[Message]:
        """Begins. Raises `ProtocolMisuse` when called twice."""
        if self.state is not FileState.IDLE:
            raise ProtocolMisuse("a FileDelivery was started twice; make a new one for a new delivery.")
        return self._write(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """What the message calls for; nothing for messages of other conversations."""
        if self.done or self._machine is None:
            return []
        return self._machine.receive(message, now_s) + self._go_on(now_s)

    def tick(self, now_s: float) -> list[Message]:
        """What the passing of time calls for."""
        if self.done or self._machine is None:
            return []
        return self._machine.tick(now_s) + self._go_on(now_s)

    def cancel(self) -> list[Message]:
        """Ends the delivery from our side; what the vehicle holds is not known then."""
        if self.done:
            return []
        told = self._machine.cancel() if self._machine is not None else []
        self._fail(PeerError(f"the mission for {self.peer} was cancelled half way."))
        return told

    def _go_on(self, now_s: float) -> list[Message]:
        machine = self._machine
        if machine is None or not machine.done:
            return []
        if isinstance(machine, FtpWriter):
            self.sending_ended_s = now_s
            if machine.error is not None:
                fell_silent = isinstance(machine.error, PeerTimeout) and machine.heard
                return self._write(now_s) if fell_silent and self._tries > 0 else self._fail(machine.error)
            self._reads_left = _READS
            return self._read(now_s)
        return self._read_back(machine, now_s)

    def _read_back(self, machine: FtpReader, now_s: float) -> list[Message]:
        error = machine.error
        if error is None:
            try:
                held = read_mission_file(machine.data, MissionType.MISSION, self.peer)
            except PeerError as bad:
                error = bad
            else:
                differences = compare_missions(self.items[1:], held[1:], autopilot=Autopilot.ARDUPILOT)
                if not differences:
                    self.state = FileState.DONE
                    return []
                error = not_held(self.peer, "mission", differences)
                self._reads_left = 0
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
            lambda head: length_of(head, MissionType.MISSION, self.peer),
            HEADER.size,
            me=self._me,
            timers=self._timers,
            round_trip=self._round_trip,
            numbers=self._numbers,
        )
        return self._machine.start(now_s)

    def _fail(self, error: GcsError) -> list[Message]:
        self.error = error
        self.state = FileState.FAILED
        return []
