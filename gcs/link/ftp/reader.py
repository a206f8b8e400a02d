"""FtpReader: a file comes from a vehicle by MAVLink FTP, as a burst, then piece by piece what got lost of it.

Knows and does not know: see `ftp_requests`.

    state     event                                        next      sends
    IDLE      start                                        OPENING   OpenFileRO
    OPENING   ACK                                          READING   BurstReadFile
    OPENING   NAK: a file, a session in the way            OPENING   see `ftp_opening`
    READING   pieces of the burst                          READING
    READING   ... its end, or nothing more for a while     READING   ReadFile of what is missing, some at a time
    READING   everything is here                           CHECKING  CalcFileCRC32, TerminateSession
    READING   NAK: the file is not open any more           OPENING   OpenFileRO, `tries` in all
    CHECKING  both answered, the checksum is ours          DONE
    any       no answer in time                            same      the same again
    any       another NAK, another checksum, or silence    FAILED    TerminateSession

How long the file is says `measure`, from its first bytes: ArduPilot tells 1 MiB of all files that it makes up.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum, auto

from gcs.autopilots.protocol_timers import STANDARD, FtpTimers
from gcs.errors import GcsError, PeerError, ProtocolMisuse
from gcs.link.ftp.open_file import FtpOpening
from gcs.link.ftp.payload import DATA_MAX, FtpError, FtpOpcode, FtpPayload, crc32, refusal
from gcs.link.ftp.requests import FtpNumbers, FtpRequests
from gcs.link.microservices.rtt import RttEstimator
from gcs.link.wire.message import GROUND, Message, Station

_WINDOW = 4  # ArduPilot queues five requests
_BURST_MIN = 12 * DATA_MAX  # less than this is asked for piece by piece
_SIZE_MAX = 1 << 18


class ReaderState(Enum):
    """See the table above."""

    IDLE = auto()
    OPENING = auto()
    READING = auto()
    CHECKING = auto()
    DONE = auto()
    FAILED = auto()


class FtpReader:
    """One file. `measure` makes its length, at most 256 KiB, of its first `head` bytes, or raises `PeerError`."""

    def __init__(
        self,
        path: str,
        peer: Station,
        measure: Callable[[bytes], int],
        head: int,
        *,
        me: Station = GROUND,
        timers: FtpTimers = STANDARD.ftp,
        round_trip: RttEstimator | None = None,
        numbers: FtpNumbers | None = None,
        tries: int = 4,
    ) -> None:
        self.state = ReaderState.IDLE
        self.error: GcsError | None = None
        self._timers = timers
        self._path = path
        self._measure = measure
        self._head = head
        self._requests = FtpRequests(
            peer, me, numbers or FtpNumbers(), round_trip or RttEstimator(), give_up_s=timers.give_up_s
        )
        self._opening = FtpOpening(self._requests, FtpOpcode.OPEN_FILE_RO, path, tries, timers)
        self._session = 0
        self._pieces: dict[int, bytes] = {}
        self._size: int | None = None
        self._quiet_s: float | None = None  # when a burst that says no more is over
        self._piece_s: float | None = None
        self._spacing_s = 0.0
        self._checked = False

    @property
    def done(self) -> bool:
        """Whether it ended, well (`error` is None: `data` is the file) or badly."""
        return self.state in (ReaderState.DONE, ReaderState.FAILED)

    @property
    def data(self) -> bytes:
        """The whole file. Raises `ProtocolMisuse` before it is complete."""
        if self.state is not ReaderState.DONE:
            raise ProtocolMisuse("an FtpReader was asked for its file before it had all of it.")
        return self._joined()

    @property
    def deadline_s(self) -> float | None:
        """When `tick` next has something to do."""
        if self.done:
            return None
        if self._opening.resume_s is not None:
            return self._opening.resume_s
        both = [at_s for at_s in (self._quiet_s, self._requests.deadline_s) if at_s is not None]
        return min(both) if both else None

    def start(self, now_s: float) -> list[Message]:
        """Asks for the file. Raises `ProtocolMisuse` when called twice."""
        if self.state is not ReaderState.IDLE:
            raise ProtocolMisuse("an FtpReader was started twice; make a new one for a new file.")
        return self._open(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """What the message calls for; nothing for messages of other conversations."""
        if self.done:
            return []
        reply = self._requests.reply(message)
        if reply is None:
            return []
        taken = self._requests.take(message, now_s)
        if reply.req_opcode == FtpOpcode.BURST_READ_FILE:
            in_burst = self.state is ReaderState.READING and reply.session == self._session
            return self._burst(reply, now_s) if in_burst else []
        if taken is None:
            return []
        return self._answered(reply, now_s)

    def tick(self, now_s: float) -> list[Message]:
        """What the passing of time calls for."""
        if self.done:
            return []
        if self._opening.resume_s is not None:
            return self._opening.tick(now_s)
        error = self._requests.gave_up(self._path, now_s)
        if error is not None:
            return self._finish(None if self._checked else error)
        messages = self._requests.tick(now_s)
        if self._quiet_s is not None and now_s >= self._quiet_s:
            self._quiet_s = None
            messages += self._fill(now_s)
        return messages

    def cancel(self) -> list[Message]:
        """Ends it from our side."""
        return [] if self.done else self._finish(PeerError(f"the transfer of {self._path} was cancelled half way."))

    def _open(self, now_s: float) -> list[Message]:
        self._quiet_s = self._piece_s = self._size = None
        self._pieces.clear()
        self.state = ReaderState.OPENING
        return self._opening.open(now_s)

    def _answered(self, reply: FtpPayload, now_s: float) -> list[Message]:
        if self.state is ReaderState.OPENING:
            messages = self._opening.receive(reply, now_s)
            if self._opening.error is not None:
                return self._finish(self._opening.error)
            if self._opening.session is None:
                return messages
            self._session = self._opening.session
            self.state = ReaderState.READING
            return [self._ask_burst(0, now_s)]
        if self.state is ReaderState.CHECKING:
            return self._check(reply)
        if reply.opcode == FtpOpcode.NAK:
            return self._refused(reply, now_s)
        self._take(reply)
        return self._go_on(now_s)

    def _burst(self, reply: FtpPayload, now_s: float) -> list[Message]:
        self._requests.drop(FtpOpcode.BURST_READ_FILE)
        if reply.opcode == FtpOpcode.NAK:
            self._quiet_s = None
            return self._fill(now_s) if reply.error == FtpError.END_OF_FILE else self._refused(reply, now_s)
        if self._piece_s is not None:
            self._spacing_s = max(self._spacing_s, now_s - self._piece_s)
        self._piece_s = now_s
        timers = self._timers
        rhythm_s = timers.burst_spacings * self._spacing_s if self._spacing_s else timers.burst_pause_s
        self._quiet_s = now_s + max(self._requests.wait_s, rhythm_s)
        if self._take(reply):
            self._requests.progressed(now_s)
        last = self._size is not None and reply.offset + len(reply.data) >= self._size
        if reply.burst_complete or last:
            self._quiet_s = None
        return self._go_on(now_s)

    def _take(self, reply: FtpPayload) -> bool:
        """Whether it brought something new."""
        fits = reply.offset + len(reply.data) <= _SIZE_MAX
        if not fits or len(reply.data) <= len(self._pieces.get(reply.offset, b"")):
            return False
        self._pieces[reply.offset] = reply.data
        return True

    def _go_on(self, now_s: float) -> list[Message]:
        if self._size is None and len(self._pieces.get(0, b"")) >= self._head:
            try:
                self._size = self._measure(self._pieces[0][: self._head])
            except GcsError as error:
                return self._finish(error)
        if self._size is not None and not self._gaps():
            self._quiet_s = None
            self._requests.drop()
            self.state = ReaderState.CHECKING
            checksum = self._requests.ask(
                FtpOpcode.CALC_FILE_CRC32, now_s, session=self._session, data=self._path.encode()
            )
            return [checksum, self._requests.ask(FtpOpcode.TERMINATE_SESSION, now_s, session=self._session)]
        return [] if self._quiet_s is not None else self._fill(now_s)

    def _fill(self, now_s: float) -> list[Message]:
        """Asks for what is missing: a burst where it is much, else some pieces at a time."""
        gaps = self._gaps()
        asked = {one.offset for one in self._requests.awaits(FtpOpcode.READ_FILE)}
        if self._requests.awaits(FtpOpcode.BURST_READ_FILE):
            return []
        if not asked and sum(length for _, length in gaps) >= _BURST_MIN:
            return [self._ask_burst(gaps[0][0], now_s)]
        pieces = [
            (at, min(DATA_MAX, start + length - at))
            for start, length in gaps
            for at in range(start, start + length, DATA_MAX)
        ]
        return [
            self._requests.ask(FtpOpcode.READ_FILE, now_s, session=self._session, offset=at, size=size)
            for at, size in [piece for piece in pieces if piece[0] not in asked][: max(_WINDOW - len(asked), 0)]
        ]

    def _gaps(self) -> list[tuple[int, int]]:
        """Offset and length of all that is missing; without a header, as much as one piece holds."""
        size = DATA_MAX if self._size is None else self._size
        gaps, here = [], 0
        for offset, piece in sorted(self._pieces.items()):
            if offset > here:
                gaps.append((here, min(offset, size) - here))
            here = max(here, offset + len(piece))
            if here >= size:
                return gaps
        return [*gaps, (here, size - here)]

    def _ask_burst(self, offset: int, now_s: float) -> Message:
        self._piece_s = None
        message = self._requests.ask(
            FtpOpcode.BURST_READ_FILE, now_s, session=self._session, offset=offset, size=DATA_MAX
        )
        self._requests.numbers.skip()
        return message

    def _check(self, reply: FtpPayload) -> list[Message]:
        if reply.req_opcode == FtpOpcode.CALC_FILE_CRC32:
            self._checked = True  # who does not know how to is not asked again
            if reply.opcode == FtpOpcode.ACK and int.from_bytes(reply.data[:4], "little") != crc32(self._joined()):
                return self._finish(PeerError(f"{self._path} of {self._requests.peer} changed while it was read."))
        return [] if len(self._requests) else self._finish(None)

    def _joined(self) -> bytes:
        whole = bytearray(self._size or 0)
        for offset, piece in self._pieces.items():
            cut = piece[: max(len(whole) - offset, 0)]
            whole[offset : offset + len(cut)] = cut
        return bytes(whole)

    def _refused(self, reply: FtpPayload, now_s: float) -> list[Message]:
        if self._opening.reopens(reply):
            return self._open(now_s)
        return self._finish(refusal(self._requests.peer, self._path, reply))

    def _finish(self, error: GcsError | None) -> list[Message]:
        opened = self.state is ReaderState.READING
        self._requests.drop()
        self.error = error
        self.state = ReaderState.DONE if error is None else ReaderState.FAILED
        if not opened:
            return []
        seq = self._requests.numbers.next_seq()
        return [FtpPayload(seq, self._session, FtpOpcode.TERMINATE_SESSION).message(self._requests.peer)]
