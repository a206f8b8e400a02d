"""FtpWriter: writes a file to a vehicle by MAVLink FTP, several pieces at a time. It is valid only at the very end.

It follows https://mavlink.io/en/services/ftp.html. A server uses a file when it is closed, and closes it for many
reasons: a lost session, a new one, a reset. Therefore the piece at offset 0, which contains the header, is written
last: a file closed earlier is invalid, and the vehicle keeps its old mission.

    state    event                                        next     sends
    IDLE     start                                        OPENING  CreateFile
    OPENING  ACK                                          WRITING  WriteFile of the first pieces
    OPENING  NAK: another file or session is open         OPENING  see `FtpOpening`
    WRITING  ACK                                          WRITING  WriteFile of one more
    WRITING  ACK of all pieces but the first              SEALING  WriteFile of the first
    SEALING  ACK                                          CLOSING  TerminateSession
    CLOSING  ACK                                          DONE
    WRITING, SEALING  NAK: the file is not open any more  OPENING  CreateFile, `tries` in all
    any      no answer in time                            same     the same request
    any      another NAK, or timeout                      FAILED   zeros over the first piece, TerminateSession
    any      cancel                                       FAILED   the same

DONE means that the server closed the file. ArduPilot before 4.7 acknowledges this even if it rejects the contents: only
a read-back is a proof.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto

from gcs.autopilots.protocol_timers import STANDARD, FtpTimers
from gcs.errors import GcsError, PeerError, ProtocolMisuse
from gcs.link.ftp.open_file import FtpOpening
from gcs.link.ftp.payload import FtpOpcode, FtpPayload, FtpRefused
from gcs.link.ftp.requests import FtpNumbers, FtpRequests
from gcs.link.microservices.rtt import RttEstimator
from gcs.link.wire.message import GROUND, Message, Station

_WINDOW = 4  # ArduPilot queues five requests


class WriterState(Enum):
    """The states of the table above."""

    IDLE = auto()
    OPENING = auto()
    WRITING = auto()
    SEALING = auto()
    CLOSING = auto()
    DONE = auto()
    FAILED = auto()


class FtpWriter:
    """One file, as pieces of at most 239 bytes by offset, the first of them at 0."""

    def __init__(
        self,
        path: str,
        pieces: Sequence[tuple[int, bytes]],
        peer: Station,
        *,
        me: Station = GROUND,
        timers: FtpTimers = STANDARD.ftp,
        round_trip: RttEstimator | None = None,
        numbers: FtpNumbers | None = None,
        tries: int = 5,
    ) -> None:
        self.state = WriterState.IDLE
        self.error: GcsError | None = None
        self._path = path
        self._pieces = tuple(pieces)
        self._requests = FtpRequests(
            peer,
            me=me,
            numbers=numbers or FtpNumbers(),
            round_trip=round_trip or RttEstimator(),
            timers=timers,
        )
        self._opening = FtpOpening(self._requests, FtpOpcode.CREATE_FILE, path, tries, timers)
        self._session = 0
        self._left: list[tuple[int, bytes]] = []
        self._requests.allow(sum(len(data) for _, data in self._pieces))

    @property
    def done(self) -> bool:
        """Whether it has ended: with success (the server closed a whole file) if `error` is None."""
        return self.state in (WriterState.DONE, WriterState.FAILED)

    @property
    def heard(self) -> bool:
        """Whether the vehicle has answered to MAVLink FTP."""
        return self._requests.heard

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        if self.done:
            return None
        return self._requests.deadline_s if self._opening.resume_s is None else self._opening.resume_s

    def start(self, now_s: float) -> list[Message]:
        """Return the request for the file. Raises `ProtocolMisuse` if called twice, or without a piece at offset 0."""
        if self.state is not WriterState.IDLE:
            raise ProtocolMisuse("an FtpWriter was started twice: create a new one.")
        if not self._pieces or self._pieces[0][0] != 0:
            raise ProtocolMisuse("an FtpWriter needs pieces, the first of them at offset 0.")
        return self._open(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message; none if it belongs to another conversation."""
        if self.done:
            return []
        matched = self._requests.match(message, now_s)
        if matched is None:
            return []
        _, reply = matched
        if self.state is WriterState.OPENING:
            messages = self._opening.receive(reply, now_s)
            if self._opening.error is not None:
                return self._fail(self._opening.error)
            if self._opening.session is None:
                return messages
            self._session = self._opening.session
            self.state = WriterState.WRITING
        elif reply.opcode == FtpOpcode.NAK:
            return self._refused(reply, now_s)
        self._requests.progressed(now_s)
        return self._advance(now_s)

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        if self.done:
            return []
        if self._opening.resume_s is not None:
            return self._opening.tick(now_s)
        error = self._requests.timed_out(self._path, now_s)
        return self._fail(error) if error is not None else self._requests.tick(now_s)

    def cancel(self) -> list[Message]:
        """End the transfer. The vehicle keeps its old file, unless the new one was already complete."""
        if self.done:
            return []
        return self._fail(PeerError(f"the transfer of {self._path} was cancelled."))

    def _open(self, now_s: float) -> list[Message]:
        self.state = WriterState.OPENING
        self._left = list(self._pieces[1:])
        return self._opening.open(now_s)

    def _advance(self, now_s: float) -> list[Message]:
        if self.state is WriterState.SEALING:
            self.state = WriterState.CLOSING
            return [self._requests.request(FtpOpcode.TERMINATE_SESSION, now_s, session=self._session)]
        if self.state is WriterState.CLOSING:
            self.state = WriterState.DONE
            return []
        messages = []
        while self._left and len(self._requests) < _WINDOW:
            messages.append(self._write(self._left.pop(0), now_s))
        if not len(self._requests):
            self.state = WriterState.SEALING
            messages.append(self._write(self._pieces[0], now_s))
        return messages

    def _write(self, piece: tuple[int, bytes], now_s: float) -> Message:
        offset, data = piece
        return self._requests.request(FtpOpcode.WRITE_FILE, now_s, session=self._session, offset=offset, data=data)

    def _refused(self, reply: FtpPayload, now_s: float) -> list[Message]:
        if self.state is not WriterState.CLOSING and self._opening.reopens(reply):
            return self._open(now_s)
        return self._fail(FtpRefused(self._requests.peer, self._path, reply))

    def _fail(self, error: GcsError) -> list[Message]:
        opened = self.state in (WriterState.WRITING, WriterState.SEALING, WriterState.CLOSING)
        self._requests.drop()
        self.error = error
        self.state = WriterState.FAILED
        return self._invalidate() if opened else []

    def _invalidate(self) -> list[Message]:
        """Messages that make the open file invalid. All are sent twice, because no answer is awaited."""
        numbers, peer = self._requests.numbers, self._requests.peer
        zeros = bytes(len(self._pieces[0][1]))
        write = FtpPayload(numbers.next_seq(), self._session, FtpOpcode.WRITE_FILE, 0, zeros).message(peer)
        close = FtpPayload(numbers.next_seq(), self._session, FtpOpcode.TERMINATE_SESSION).message(peer)
        return [write, write, close, close]
