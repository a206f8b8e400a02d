"""FtpOpening: opens a file on board, also if another file or another session is in the way.

ArduPilot has one session for all stations (4.5), or some (4.7). ResetSessions closes a file that an earlier transfer of
ours left open. The server closes a file of another station after 3 s without any request; therefore we send no request
for 3.4 s.
"""

from __future__ import annotations

from gcs.autopilots.protocol_timers import FtpTimers
from gcs.link.ftp.payload import FtpError, FtpOpcode, FtpPayload, FtpRefused
from gcs.link.ftp.requests import FtpRequests
from gcs.link.wire.message import Message

_RESETS = frozenset({FtpError.FAIL, FtpError.NO_SESSIONS_AVAILABLE})
_TEMPORARY = _RESETS | {FtpError.INVALID_SESSION}
_CLOSED = frozenset({FtpError.FAIL, FtpError.INVALID_SESSION, FtpError.FILE_NOT_FOUND})


class FtpOpening:
    """Opens one file with `opcode`, at most `tries` times in all."""

    def __init__(self, requests: FtpRequests, opcode: FtpOpcode, path: str, tries: int, timers: FtpTimers) -> None:
        self.session: int | None = None  # the session of the open file
        self.error: FtpRefused | None = None  # the reason that it was not opened
        self.resume_s: float | None = None  # `tick` has nothing to do before
        self._requests = requests
        self._opcode = opcode
        self._path = path
        self._tries = tries
        self._reopen_s = timers.reopen_s
        self._resets = False

    def open(self, now_s: float) -> list[Message]:
        """Return the request for the file, in a new session."""
        self._tries -= 1
        self.resume_s = self.session = None
        self._requests.drop()
        session = self._requests.numbers.next_session()
        return [self._requests.request(self._opcode, now_s, session=session, data=self._path.encode())]

    def receive(self, reply: FtpPayload, now_s: float) -> list[Message]:
        """Process the answer to one of its requests: the result is a `session`, an `error`, or `resume_s`."""
        self._requests.progressed(now_s)
        if reply.req_opcode == FtpOpcode.RESET_SESSIONS:
            return self.open(now_s)
        if reply.opcode == FtpOpcode.ACK:
            self.session = reply.session
            return []
        error = FtpRefused(self._requests.peer, self._path, reply)
        if reply.error not in _TEMPORARY or self._tries <= 0:
            self.error = error
            return []
        self._resets = not self._resets and reply.error in _RESETS
        if self._resets:
            return [self._requests.request(FtpOpcode.RESET_SESSIONS, now_s, session=reply.session)]
        self.resume_s = now_s + self._reopen_s
        return []

    def tick(self, now_s: float) -> list[Message]:
        """Try again once `resume_s` has passed."""
        return self.open(now_s) if self.resume_s is not None and now_s >= self.resume_s else []

    def reopens(self, reply: FtpPayload) -> bool:
        """Whether a NAK means that the file is not open any more, and a try is left."""
        return reply.error in _CLOSED and self._tries > 0
