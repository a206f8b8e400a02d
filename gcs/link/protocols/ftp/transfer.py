"""What reading and writing a file by MAVLink FTP have in common: states, opening, end."""

from __future__ import annotations

from enum import Enum, auto

from gcs.errors import GcsError, PeerError, ProtocolMisuse
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.ftp.payload import FtpError, FtpOpcode, FtpPayload, FtpRefused
from gcs.link.protocols.ftp.requests import FtpRequests
from gcs.link.wire.message import Message

_RESETS = frozenset({FtpError.FAIL, FtpError.NO_SESSIONS_AVAILABLE})
_TEMPORARY = _RESETS | {FtpError.INVALID_SESSION}
_CLOSED = frozenset({FtpError.FAIL, FtpError.INVALID_SESSION, FtpError.FILE_NOT_FOUND})


class FtpState(Enum):
    """The states of the tables of `FtpReader` and `FtpWriter`."""

    IDLE = auto()
    OPENING = auto()
    READING = auto()
    WRITING = auto()
    SEALING = auto()
    CLOSING = auto()
    DONE = auto()
    FAILED = auto()


class FtpTransfer:
    """One file of one vehicle, opened with `opcode` at most `tries` times, also while another file is open.

    ArduPilot has one session for all stations (4.5), or some (4.7). ResetSessions closes a file that an earlier
    transfer of ours left open. The server closes a file of another station after 3 s without any request; therefore we
    send no request for 3.4 s.
    """

    def __init__(self, opcode: FtpOpcode, path: str, exchange: Exchange, tries: int) -> None:
        self.state = FtpState.IDLE
        self.error: GcsError | None = None
        self._path = path
        self._timers = exchange.timers.ftp
        self._requests = FtpRequests(exchange)
        self._opcode = opcode
        self._tries = tries
        self._resets = False
        self._resume_s: float | None = None  # of opening: there is nothing to do before
        self._session = 0

    @property
    def done(self) -> bool:
        """Whether it has ended: with success if `error` is None."""
        return self.state in (FtpState.DONE, FtpState.FAILED)

    @property
    def heard(self) -> bool:
        """Whether the vehicle has answered to MAVLink FTP."""
        return self._requests.heard

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        if self.done:
            return None
        return self._requests.deadline_s if self._resume_s is None else self._resume_s

    def start(self, now_s: float) -> list[Message]:
        """Return the request for the file. Raises `ProtocolMisuse` if called twice."""
        if self.state is not FtpState.IDLE:
            raise ProtocolMisuse(f"an {type(self).__name__} was started twice: create a new one.")
        return self._open(now_s)

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        if self.done:
            return []
        if self._resume_s is not None:
            return self._open(now_s) if now_s >= self._resume_s else []
        error = self._requests.timed_out(self._path, now_s)
        return self._fail(error) if error is not None else self._requests.tick(now_s)

    def cancel(self) -> list[Message]:
        """End the transfer. The vehicle keeps its old file, unless a new one was already complete."""
        return [] if self.done else self._fail(PeerError(f"the transfer of {self._path} was cancelled."))

    def _open(self, now_s: float) -> list[Message]:
        """Request the file, in a new session."""
        self.state = FtpState.OPENING
        self._tries -= 1
        self._resume_s = None
        self._requests.drop()
        session = self._requests.numbers.next_session()
        return [self._requests.request(self._opcode, now_s, session=session, data=self._path.encode())]

    def _opened(self, reply: FtpPayload, now_s: float) -> list[Message] | None:
        """Process the answer to an opening request: the messages to send, or None once the file is open."""
        self._requests.progressed(now_s)
        if reply.req_opcode == FtpOpcode.RESET_SESSIONS:
            return self._open(now_s)
        if reply.opcode == FtpOpcode.ACK:
            self._session = reply.session
            return None
        if reply.error not in _TEMPORARY or self._tries <= 0:
            return self._fail(FtpRefused(self._requests.peer, self._path, reply))
        self._resets = not self._resets and reply.error in _RESETS
        if self._resets:
            return [self._requests.request(FtpOpcode.RESET_SESSIONS, now_s, session=reply.session)]
        self._resume_s = now_s + self._timers.reopen_s
        return []

    def _refused(self, reply: FtpPayload, now_s: float) -> list[Message]:
        """Open the file again if it is not open any more, and a try is left; else fail."""
        if self.state is not FtpState.CLOSING and reply.error in _CLOSED and self._tries > 0:
            return self._open(now_s)
        return self._fail(FtpRefused(self._requests.peer, self._path, reply))

    def _fail(self, error: GcsError) -> list[Message]:
        raise NotImplementedError
