"""FtpWriter: a file goes to a vehicle by MAVLink FTP, several pieces at a time, and is valid only at the very end.

Knows and does not know: see `ftp_requests`. A server acts on a file when it is closed, and closes it for many reasons:
a lost session, a new one, a reset. So the piece at offset 0, which makes the file what it is, goes last of all: what is
closed before is no file, and the vehicle keeps what it had.

    state    event                                        next     sends
    IDLE     start                                        OPENING  CreateFile
    OPENING  ACK                                          WRITING  WriteFile of the first pieces
    OPENING  NAK: a file, a session in the way            OPENING  see `ftp_opening`
    WRITING  ACK                                          WRITING  WriteFile of one more
    WRITING  ACK of the last but the first piece          SEALING  WriteFile of the first
    SEALING  ACK                                          CLOSING  TerminateSession
    CLOSING  ACK                                          DONE
    WRITING, SEALING  NAK: the file is not open any more  OPENING  CreateFile, `tries` in all
    any      no answer in time                            same     the same again
    any      another NAK, or patience ends                FAILED   zeros over the first piece, TerminateSession
    any      cancel                                       FAILED   the same

DONE means that the server closed the file. ArduPilot before 4.7 says so whether or not it liked the contents: only
reading back tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto

from gcs.autopilots.protocol_timers import STANDARD, FtpTimers
from gcs.errors import GcsError, PeerError, ProtocolMisuse
from gcs.link.ftp.open_file import FtpOpening
from gcs.link.ftp.payload import FtpOpcode, FtpPayload, refusal
from gcs.link.ftp.requests import FtpNumbers, FtpRequests
from gcs.link.microservices.rtt import RttEstimator
from gcs.link.wire.message import GROUND, Message, Station

_WINDOW = 4  # ArduPilot queues five requests


class WriterState(Enum):
    """See the table above."""

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
            peer, me, numbers or FtpNumbers(), round_trip or RttEstimator(), give_up_s=timers.give_up_s
        )
        self._opening = FtpOpening(self._requests, FtpOpcode.CREATE_FILE, path, tries, timers)
        self._session = 0
        self._left: list[tuple[int, bytes]] = []

    @property
    def done(self) -> bool:
        """Whether it ended, well (`error` is None: the server closed a whole file) or badly."""
        return self.state in (WriterState.DONE, WriterState.FAILED)

    @property
    def heard(self) -> bool:
        """Whether the vehicle answered to MAVLink FTP at all."""
        return self._requests.heard

    @property
    def deadline_s(self) -> float | None:
        """When `tick` next has something to do."""
        if self.done:
            return None
        return self._requests.deadline_s if self._opening.resume_s is None else self._opening.resume_s

    def start(self, now_s: float) -> list[Message]:
        """Asks for the file. Raises `ProtocolMisuse` when called twice, or for pieces that are none."""
        if self.state is not WriterState.IDLE:
            raise ProtocolMisuse("an FtpWriter was started twice; make a new one for a new file.")
        if not self._pieces or self._pieces[0][0] != 0:
            raise ProtocolMisuse("an FtpWriter needs pieces, the first of them at offset 0.")
        return self._open(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """What the message calls for; nothing for messages of other conversations."""
        if self.done:
            return []
        taken = self._requests.take(message, now_s)
        if taken is None:
            return []
        _, reply = taken
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
        return self._go_on(now_s)

    def tick(self, now_s: float) -> list[Message]:
        """What the passing of time calls for."""
        if self.done:
            return []
        if self._opening.resume_s is not None:
            return self._opening.tick(now_s)
        error = self._requests.gave_up(self._path, now_s)
        return self._fail(error) if error is not None else self._requests.tick(now_s)

    def cancel(self) -> list[Message]:
        """Ends it from our side; the vehicle keeps what it had, unless the file was whole already."""
        if self.done:
            return []
        return self._fail(PeerError(f"the transfer of {self._path} was cancelled half way."))

    def _open(self, now_s: float) -> list[Message]:
        self.state = WriterState.OPENING
        self._left = list(self._pieces[1:])
        return self._opening.open(now_s)

    def _go_on(self, now_s: float) -> list[Message]:
        if self.state is WriterState.SEALING:
            self.state = WriterState.CLOSING
            return [self._requests.ask(FtpOpcode.TERMINATE_SESSION, now_s, session=self._session)]
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
        return self._requests.ask(FtpOpcode.WRITE_FILE, now_s, session=self._session, offset=offset, data=data)

    def _refused(self, reply: FtpPayload, now_s: float) -> list[Message]:
        if self.state is not WriterState.CLOSING and self._opening.reopens(reply):
            return self._open(now_s)
        return self._fail(refusal(self._requests.peer, self._path, reply))

    def _fail(self, error: GcsError) -> list[Message]:
        opened = self.state in (WriterState.WRITING, WriterState.SEALING, WriterState.CLOSING)
        self._requests.drop()
        self.error = error
        self.state = WriterState.FAILED
        return self._void() if opened else []

    def _void(self) -> list[Message]:
        """What makes sure that the open file is none, as far as one may be sure without answers: all twice."""
        numbers, peer = self._requests.numbers, self._requests.peer
        zeros = bytes(len(self._pieces[0][1]))
        write = FtpPayload(numbers.next_seq(), self._session, FtpOpcode.WRITE_FILE, 0, zeros).message(peer)
        close = FtpPayload(numbers.next_seq(), self._session, FtpOpcode.TERMINATE_SESSION).message(peer)
        return [write, write, close, close]
