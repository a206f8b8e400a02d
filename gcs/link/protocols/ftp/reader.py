"""FtpReader: reads a file of a vehicle by MAVLink FTP, as a burst, then the lost pieces one by one.

It follows https://mavlink.io/en/services/ftp.html.

    state     event                                        next      sends
    IDLE      start                                        OPENING   OpenFileRO
    OPENING   ACK                                          READING   BurstReadFile
    OPENING   NAK: another file or session is open         OPENING   see `FtpTransfer`
    READING   pieces of the burst                          READING
    READING   ... its end, or a pause after it             READING   ReadFile of missing pieces, 4 at a time
    READING   the file is complete                         CLOSING   TerminateSession
    READING   NAK: the file is not open any more           OPENING   OpenFileRO, `tries` in all
    CLOSING   answered, or no answer in time               DONE
    any       no answer in time                            same      the same request
    any       another NAK, or timeout                      FAILED    TerminateSession

`measure` returns the length of the file from its first bytes: ArduPilot reports 1 MiB for all generated files.
CalcFileCRC32 is not used. ArduPilot computes it over another reading of the file, in pieces of 64 bytes, and up to 4.6
the unused numbers of an item depend on where a piece begins (`mission_dat`): the answer says nothing about these bytes.
"""

from collections.abc import Callable

from gcs.errors import GcsError, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.ftp.payload import DATA_MAX, FtpError, FtpOpcode, FtpPayload
from gcs.link.protocols.ftp.transfer import FtpTransfer
from gcs.link.protocols.machine import MachineState
from gcs.link.wire.message import Message

_WINDOW = 4  # ArduPilot queues five requests
_BURST_MIN = 12 * DATA_MAX  # less than this is read piece by piece
_SIZE_MAX = 1 << 18
_STRETCHES_MAX = 256  # a burst that loses every second piece of 60 kB leaves 126


class FtpReader(FtpTransfer):
    """One file. `measure` returns its length, at most 256 KiB, from its first `head` bytes, or raises `PeerError`."""

    def __init__(
        self, path: str, exchange: Exchange, measure: Callable[[bytes], int], head: int, *, tries: int = 4
    ) -> None:
        super().__init__(FtpOpcode.OPEN_FILE_RO, path, exchange, tries)
        self._measure = measure
        self._head = head
        self._received = ReceivedBytes(_SIZE_MAX)
        self._size: int | None = None
        self._burst_end_s: float | None = None  # when a burst counts as over if no more arrives
        self._piece_s: float | None = None
        self._spacing_s = 0.0

    @property
    def data(self) -> bytes:
        """The whole file. Raises `ProtocolMisuse` before it is complete."""
        if self.state is not MachineState.DONE:
            raise ProtocolMisuse("the file of an FtpReader was read before it was complete.")
        return self._received.first(self._size or 0) or b""

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        both = [at_s for at_s in (self._burst_end_s, super().deadline_s) if at_s is not None]
        return None if self.done else min(both, default=None)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message; none if it belongs to another conversation."""
        if self.done:
            return []
        reply = self._requests.reply(message)
        if reply is None:
            return []
        matched = self._requests.match(message, now_s)
        if reply.req_opcode == FtpOpcode.BURST_READ_FILE:
            in_burst = self.state is MachineState.READING and reply.session == self._session
            return self._burst(reply, now_s) if in_burst else []
        if matched is None:
            return []
        if self.state is MachineState.OPENING:
            messages = self._opened(reply, now_s)
            if messages is not None:
                return messages
            self.state = MachineState.READING
            return [self._request_burst(0, now_s)]
        if self.state is MachineState.CLOSING:
            return self._finish(None)
        if reply.opcode == FtpOpcode.NAK:
            return self._refused(reply, now_s)
        self._store(reply, now_s)
        return self._advance(now_s)

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        messages = super().tick(now_s)
        if self._burst_end_s is not None and now_s >= self._burst_end_s:
            self._burst_end_s = None
            messages += self._request_missing(now_s)
        return messages

    def _open(self, now_s: float) -> list[Message]:
        self._burst_end_s = self._piece_s = self._size = None
        self._received.clear()
        return super()._open(now_s)

    def _burst(self, reply: FtpPayload, now_s: float) -> list[Message]:
        self._requests.drop(FtpOpcode.BURST_READ_FILE)
        if reply.opcode == FtpOpcode.NAK:
            self._burst_end_s = None
            return self._request_missing(now_s) if reply.error == FtpError.END_OF_FILE else self._refused(reply, now_s)
        if self._piece_s is not None:
            self._spacing_s = max(self._spacing_s, now_s - self._piece_s)
        self._piece_s = now_s
        timers = self._timers
        pause_s = timers.burst_spacings * self._spacing_s if self._spacing_s else timers.burst_pause_s
        self._burst_end_s = now_s + max(self._requests.wait_s, pause_s)
        self._store(reply, now_s)
        last = self._size is not None and reply.offset + len(reply.data) >= self._size
        if reply.burst_complete or last:
            self._burst_end_s = None
        return self._advance(now_s)

    def _store(self, reply: FtpPayload, now_s: float) -> None:
        """Store a piece. Only new bytes are progress: a peer that answers anything else ends by the timeout."""
        if self._received.add(reply.offset, reply.data):
            self._requests.progressed(now_s)

    def _advance(self, now_s: float) -> list[Message]:
        head = self._received.first(self._head) if self._size is None else None
        if head is not None:
            try:
                self._size = self._measure(head)
            except GcsError as error:
                return self._finish(error)
            self._requests.allow(self._size)
        if self._size is not None and not self._gaps():
            self._burst_end_s = None
            self._requests.drop()
            self.state = MachineState.CLOSING
            return [self._requests.request(FtpOpcode.TERMINATE_SESSION, now_s, session=self._session)]
        return [] if self._burst_end_s is not None else self._request_missing(now_s)

    def _request_missing(self, now_s: float) -> list[Message]:
        """Requests for what is missing: a burst if it is much, else some pieces at a time."""
        gaps = self._gaps()
        requested = {one.offset for one in self._requests.open_requests(FtpOpcode.READ_FILE)}
        if self._requests.open_requests(FtpOpcode.BURST_READ_FILE):
            return []
        if not requested and sum(length for _, length in gaps) >= _BURST_MIN:
            return [self._request_burst(gaps[0][0], now_s)]
        pieces = [
            (at, min(DATA_MAX, start + length - at))
            for start, length in gaps
            for at in range(start, start + length, DATA_MAX)
        ]
        return [
            self._requests.request(FtpOpcode.READ_FILE, now_s, session=self._session, offset=at, size=size)
            for at, size in [piece for piece in pieces if piece[0] not in requested][: max(_WINDOW - len(requested), 0)]
        ]

    def _gaps(self) -> list[tuple[int, int]]:
        return self._received.gaps(DATA_MAX if self._size is None else self._size)

    def _request_burst(self, offset: int, now_s: float) -> Message:
        self._piece_s = None
        message = self._requests.request(
            FtpOpcode.BURST_READ_FILE, now_s, session=self._session, offset=offset, size=DATA_MAX
        )
        self._requests.numbers.skip()
        return message

    def _fail(self, error: GcsError) -> list[Message]:
        return self._finish(None if self.state is MachineState.CLOSING and isinstance(error, PeerTimeout) else error)

    def _finish(self, error: GcsError | None) -> list[Message]:
        opened = self.state is MachineState.READING
        self._requests.drop()
        self._burst_end_s = None
        self.error = error
        self.state = MachineState.DONE if error is None else MachineState.FAILED
        if not opened:
            return []
        seq = self._requests.numbers.next_seq()
        return [FtpPayload(seq, self._session, FtpOpcode.TERMINATE_SESSION).message(self._requests.peer)]


class ReceivedBytes:
    """Pieces of one file of at most `limit` bytes, in any order: which are new, which are missing.

    The first copy of a byte counts. A piece that would leave too many gaps is dropped, as if it had been lost: a peer
    that answers with single bytes at random places costs neither memory nor time.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._data = bytearray()
        self._have: list[tuple[int, int]] = []  # begin and end of what has arrived, in order, apart from each other

    def clear(self) -> None:
        """Forget everything."""
        self._data.clear()
        self._have.clear()

    def add(self, offset: int, piece: bytes) -> bool:
        """Store what is new of a piece; return whether anything was."""
        end = offset + len(piece)
        if not piece or offset < 0 or end > self._limit:
            return False
        missing = _gaps(self._have, offset, end)
        near = [span for span in self._have if span[0] <= end and offset <= span[1]]
        if not missing or len(self._have) - len(near) >= _STRETCHES_MAX:
            return False
        self._data.extend(bytes(max(end - len(self._data), 0)))
        for begin, until in missing:
            self._data[begin:until] = piece[begin - offset : until - offset]
        far = [span for span in self._have if span not in near]
        joined = min([offset, *(span[0] for span in near)]), max([end, *(span[1] for span in near)])
        self._have = sorted([*far, joined])
        return True

    def gaps(self, size: int) -> list[tuple[int, int]]:
        """Return (offset, length) of what is missing of the first `size` bytes."""
        return [(begin, until - begin) for begin, until in _gaps(self._have, 0, size)]

    def first(self, size: int) -> bytes | None:
        """Return the first `size` bytes; None while one of them is missing."""
        return None if _gaps(self._have, 0, size) else bytes(self._data[:size])


def _gaps(have: list[tuple[int, int]], begin: int, end: int) -> list[tuple[int, int]]:
    found, here = [], begin
    for start, until in have:
        if start >= end:
            break
        if start > here:
            found.append((here, start))
        here = max(here, until)
    return [*found, (here, end)] if here < end else found
