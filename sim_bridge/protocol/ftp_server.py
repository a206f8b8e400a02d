"""MAVLink FTP as ArduCopter 4.5 serves it: one session for all stations; a written file takes effect when it is closed.

- A request whose number plus one is that of the last reply gets that reply again; only one reply is remembered. The
  last reply of a burst has a number that also fits later requests.
- The client names its session. While a file is open, other sessions get INVALID_SESSION. After 3 s without a reply
  the next request closes the file. Ending a session that is not open is acknowledged without effect.
- TerminateSession and ResetSessions close the file; they are acknowledged even if its content is refused.
- Written files may have holes, which read as zeros.
"""

from dataclasses import dataclass, replace

from gcs.link.protocols.ftp.payload import DATA_MAX, NAME, FtpError, FtpOpcode, FtpPayload, read_payload
from gcs.link.wire.message import Message, Station
from sim_bridge.missions.ftp_files import WRITTEN_MAX, MissionFiles

_IDLE_S = 3.0
_SEQS = 0x10000
_REPORTED_SIZE = 1 << 20  # of every file of @MISSION: the real size is known only when the file is generated
_BURST_MAX = 2000
_ALL_BITS = 0xFFFFFFFF
_NO_SPACE = 28  # ENOSPC
_WRITES = (FtpOpcode.CREATE_FILE, FtpOpcode.OPEN_FILE_WO)


@dataclass
class _Open:
    path: str
    session: int
    contents: bytearray
    writing: bool


class FileServer:
    """The file server of one vehicle. It survives any bytes; only a whole, valid file changes anything."""

    def __init__(self, files: MissionFiles) -> None:
        self._files = files
        self.wrong_checksums = False  # a fault
        self._open: _Open | None = None
        self._replied_s = 0.0
        self._last: tuple[Station, list[FtpPayload]] = Station(0, 0), []  # what a repeated request gets again

    def suffer(self, *, wrong_checksums: bool) -> None:
        """Have this fault from now on, or not any more."""
        self.wrong_checksums = wrong_checksums

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Answer a FILE_TRANSFER_PROTOCOL message."""
        if message.name != NAME:
            return []
        request = read_payload(message)
        peer = message.source
        if request is None:
            raw = bytes(message.fields["payload"]).ljust(4, b"\0")
            seq, session, opcode = int.from_bytes(raw[:2], "little"), raw[2], raw[3]
            request = FtpPayload(seq, session, opcode)
            return self._reply(peer, [_nak(request, FtpError.INVALID_DATA_SIZE)], now_s)
        if request.opcode in (FtpOpcode.ACK, FtpOpcode.NAK):
            return []
        last_peer, replies = self._last
        if last_peer == peer and replies:
            final = replies[-1]
            if final.session == request.session and final.seq == (request.seq + 1) % _SEQS:
                return self._reply(peer, [final], now_s)
        return self._reply(peer, self._answer(request, now_s), now_s)

    def _reply(self, peer: Station, replies: list[FtpPayload], now_s: float) -> list[Message]:
        self._last = peer, replies
        if replies:
            self._replied_s = now_s
        return [reply.message(peer) for reply in replies]

    def _answer(self, request: FtpPayload, now_s: float) -> list[FtpPayload]:
        ends = request.opcode in (FtpOpcode.TERMINATE_SESSION, FtpOpcode.RESET_SESSIONS)
        if self._open is not None and request.session != self._open.session:
            if ends:
                return [_ack(request)]
            if now_s - self._replied_s < _IDLE_S:
                return [_nak(request, FtpError.INVALID_SESSION)]
            self._close()
        if ends:
            self._close()
            return [_ack(request)]
        match request.opcode:
            case FtpOpcode.NONE:
                return [_ack(request)]
            case FtpOpcode.OPEN_FILE_RO | FtpOpcode.CREATE_FILE | FtpOpcode.OPEN_FILE_WO:
                return [self._opened(request, now_s)]
            case FtpOpcode.WRITE_FILE:
                return [self._written(request)]
            case FtpOpcode.READ_FILE:
                return [self._read(request)]
            case FtpOpcode.BURST_READ_FILE:
                return self._burst(request)
            case FtpOpcode.CALC_FILE_CRC32:
                path = _path(request)
                if not self._files.has(path):
                    return [_nak(request, FtpError.FILE_NOT_FOUND)]
                checksum = self._files.checksum(path) ^ (_ALL_BITS if self.wrong_checksums else 0)
                return [_ack(request, checksum.to_bytes(4, "little"))]
            case _:
                return [_nak(request, FtpError.UNKNOWN_COMMAND)]

    def _opened(self, request: FtpPayload, now_s: float) -> FtpPayload:
        writing = request.opcode in _WRITES
        if self._open is not None and not writing and now_s - self._replied_s > _IDLE_S:
            self._close()
        if self._open is not None:
            return _nak(request, FtpError.FAIL)
        path = _path(request)
        if not path or len(path.encode()) != len(request.data):
            return _nak(request, FtpError.INVALID_DATA_SIZE)
        if not self._files.has(path):
            return _nak(request, FtpError.FILE_NOT_FOUND)
        contents = bytearray() if writing else bytearray(self._files.read(path))
        self._open = _Open(path, request.session, contents, writing)
        return _ack(request) if writing else _ack(request, _REPORTED_SIZE.to_bytes(4, "little"))

    def _written(self, request: FtpPayload) -> FtpPayload:
        if self._open is None:
            return _nak(request, FtpError.FILE_NOT_FOUND)
        if not self._open.writing:
            return _nak(request, FtpError.FAIL)
        contents, end = self._open.contents, request.offset + len(request.data)
        if end > WRITTEN_MAX:
            return _nak(request, FtpError.FAIL_ERRNO, _NO_SPACE)
        contents.extend(bytes(max(end - len(contents), 0)))
        contents[request.offset : end] = request.data
        return replace(_ack(request), offset=request.offset)

    def _read(self, request: FtpPayload) -> FtpPayload:
        refused = self._not_readable(request)
        if refused is not None:
            return refused
        return self._piece(request, request.offset, len(request.data))

    def _burst(self, request: FtpPayload) -> list[FtpPayload]:
        refused = self._not_readable(request)
        if refused is not None:
            return [refused]
        size = len(request.data) or DATA_MAX
        replies: list[FtpPayload] = []
        offset = request.offset
        while len(replies) < _BURST_MAX:
            piece = self._piece(request, offset, size)
            seq = (request.seq + 1 + len(replies)) % _SEQS
            ended = piece.opcode == FtpOpcode.NAK
            replies.append(
                replace(piece, seq=seq, offset=offset, burst_complete=ended or len(replies) == _BURST_MAX - 1)
            )
            if ended:
                break
            offset += len(piece.data)
        return replies

    def _not_readable(self, request: FtpPayload) -> FtpPayload | None:
        if self._open is None:
            return _nak(request, FtpError.FILE_NOT_FOUND)
        return _nak(request, FtpError.FAIL) if self._open.writing else None

    def _piece(self, request: FtpPayload, offset: int, size: int) -> FtpPayload:
        data = self._files.piece(bytes(self._open.contents), offset, size) if self._open is not None else b""
        if not data:
            return _nak(request, FtpError.END_OF_FILE)
        return replace(_ack(request, data), offset=offset)

    def _close(self) -> None:
        closed, self._open = self._open, None
        if closed is not None and closed.writing:
            self._files.write(closed.path, bytes(closed.contents))


def _path(request: FtpPayload) -> str:
    return request.data.partition(b"\0")[0].decode("utf-8", "replace")


def _ack(request: FtpPayload, data: bytes = b"") -> FtpPayload:
    return FtpPayload((request.seq + 1) % _SEQS, request.session, FtpOpcode.ACK, 0, data, request.opcode)


def _nak(request: FtpPayload, error: FtpError, *more: int) -> FtpPayload:
    data = bytes((error, *more))
    return FtpPayload((request.seq + 1) % _SEQS, request.session, FtpOpcode.NAK, 0, data, request.opcode)
