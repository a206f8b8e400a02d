"""FtpWriter: writes a file to a vehicle by MAVLink FTP, several pieces at a time. It is valid only at the very end.

It follows https://mavlink.io/en/services/ftp.html. A server uses a file when it is closed, and closes it for many
reasons: a lost session, a new one, a reset. Therefore the piece at offset 0, which contains the header, is written
last: a file closed earlier is invalid, and the vehicle keeps its old mission.

    state    event                                        next     sends
    IDLE     start                                        OPENING  CreateFile
    OPENING  ACK                                          WRITING  WriteFile of the first pieces
    OPENING  NAK: another file or session is open         OPENING  see `FtpTransfer`
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

from collections.abc import Sequence

from gcs.errors import GcsError, ProtocolMisuse
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.ftp.payload import FtpOpcode, FtpPayload
from gcs.link.protocols.ftp.transfer import FtpTransfer
from gcs.link.protocols.machine import MachineState
from gcs.link.wire.message import Message

_WINDOW = 4  # ArduPilot queues five requests


class FtpWriter(FtpTransfer):
    """One file, as pieces of at most 239 bytes by offset, the first of them at 0."""

    def __init__(self, path: str, pieces: Sequence[tuple[int, bytes]], exchange: Exchange, *, tries: int = 5) -> None:
        super().__init__(FtpOpcode.CREATE_FILE, path, exchange, tries)
        self._pieces = tuple(pieces)
        self._left: list[tuple[int, bytes]] = []
        self._requests.allow(sum(len(data) for _, data in self._pieces))

    def start(self, now_s: float) -> list[Message]:
        """Return the request for the file. Raises `ProtocolMisuse` if called twice, or without a piece at offset 0."""
        if not self._pieces or self._pieces[0][0] != 0:
            raise ProtocolMisuse("an FtpWriter needs pieces, the first of them at offset 0.")
        return super().start(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message; none if it belongs to another conversation."""
        if self.done:
            return []
        matched = self._requests.match(message, now_s)
        if matched is None:
            return []
        _, reply = matched
        if self.state is MachineState.OPENING:
            messages = self._opened(reply, now_s)
            if messages is not None:
                return messages
            self.state = MachineState.WRITING
        elif reply.opcode == FtpOpcode.NAK:
            return self._refused(reply, now_s)
        self._requests.progressed(now_s)
        return self._advance(now_s)

    def _open(self, now_s: float) -> list[Message]:
        self._left = list(self._pieces[1:])
        return super()._open(now_s)

    def _advance(self, now_s: float) -> list[Message]:
        if self.state is MachineState.SEALING:
            self.state = MachineState.CLOSING
            return [self._requests.request(FtpOpcode.TERMINATE_SESSION, now_s, session=self._session)]
        if self.state is MachineState.CLOSING:
            self.state = MachineState.DONE
            return []
        messages = []
        while self._left and len(self._requests) < _WINDOW:
            messages.append(self._write(self._left.pop(0), now_s))
        if not len(self._requests):
            self.state = MachineState.SEALING
            messages.append(self._write(self._pieces[0], now_s))
        return messages

    def _write(self, piece: tuple[int, bytes], now_s: float) -> Message:
        offset, data = piece
        return self._requests.request(FtpOpcode.WRITE_FILE, now_s, session=self._session, offset=offset, data=data)

    def _fail(self, error: GcsError) -> list[Message]:
        opened = self.state in (MachineState.WRITING, MachineState.SEALING, MachineState.CLOSING)
        self._requests.drop()
        self.error = error
        self.state = MachineState.FAILED
        return self._invalidate() if opened else []

    def _invalidate(self) -> list[Message]:
        """Messages that make the open file invalid. All are sent twice, because no answer is awaited."""
        numbers, peer = self._requests.numbers, self._requests.peer
        zeros = bytes(len(self._pieces[0][1]))
        write = FtpPayload(numbers.next_seq(), self._session, FtpOpcode.WRITE_FILE, 0, zeros).message(peer)
        close = FtpPayload(numbers.next_seq(), self._session, FtpOpcode.TERMINATE_SESSION).message(peer)
        return [write, write, close, close]
