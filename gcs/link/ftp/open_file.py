"""How a file of a vehicle gets opened where another one, or another session, is in the way.

Knows: which refusals pass. Does not know: what the file is opened for, clocks (time is an argument).

ArduPilot has one session for all stations (4.5), or some (4.7). A file that our own earlier transfer left open is
closed by ResetSessions. Somebody else's is let go of after 3 s in which the server said nothing to anybody, so that
asking is what must not be done meanwhile.
"""

from __future__ import annotations

from gcs.autopilots.protocol_timers import FtpTimers
from gcs.link.ftp.payload import FtpError, FtpOpcode, FtpPayload, FtpRefused, refusal
from gcs.link.ftp.requests import FtpRequests
from gcs.link.wire.message import Message

_RESETS = frozenset({FtpError.FAIL, FtpError.NO_SESSIONS_AVAILABLE})
_PASSING = _RESETS | {FtpError.INVALID_SESSION}
_CLOSED = frozenset({FtpError.FAIL, FtpError.INVALID_SESSION, FtpError.FILE_NOT_FOUND})


class FtpOpening:
    """Opens one file with `opcode`, `tries` times in all, however often it is closed in between."""

    def __init__(self, requests: FtpRequests, opcode: FtpOpcode, path: str, tries: int, timers: FtpTimers) -> None:
        self.session: int | None = None  # of the open file
        self.error: FtpRefused | None = None  # why it was not opened
        self.resume_s: float | None = None  # `tick` has nothing to do before
        self._requests = requests
        self._opcode = opcode
        self._path = path
        self._tries = tries
        self._reopen_s = timers.reopen_s
        self._resets = False

    def open(self, now_s: float) -> list[Message]:
        """Asks for the file, in a session of its own."""
        self._tries -= 1
        self.resume_s = self.session = None
        self._requests.drop()
        session = self._requests.numbers.next_session()
        return [self._requests.ask(self._opcode, now_s, session=session, data=self._path.encode())]

    def receive(self, reply: FtpPayload, now_s: float) -> list[Message]:
        """Takes an answer to a request of its own: afterwards there is a `session`, an `error`, or time to wait."""
        if reply.req_opcode == FtpOpcode.RESET_SESSIONS:
            return self.open(now_s)
        if reply.opcode == FtpOpcode.ACK:
            self.session = reply.session
            return []
        error = refusal(self._requests.peer, self._path, reply)
        if reply.error not in _PASSING or self._tries <= 0:
            self.error = error
            return []
        self._resets = not self._resets and reply.error in _RESETS
        if self._resets:
            return [self._requests.ask(FtpOpcode.RESET_SESSIONS, now_s, session=reply.session)]
        self.resume_s = now_s + self._reopen_s
        return []

    def tick(self, now_s: float) -> list[Message]:
        """Tries again when it is time."""
        return self.open(now_s) if self.resume_s is not None and now_s >= self.resume_s else []

    def reopens(self, reply: FtpPayload) -> bool:
        """Whether a NAK says that the file is not open any more, and it may be opened again."""
        return reply.error in _CLOSED and self._tries > 0
