"""MAVLink FTP: what a FILE_TRANSFER_PROTOCOL payload says, and what a vehicle's no means.

Knows: opcodes, error codes and the payload's layout (https://mavlink.io/en/services/ftp.html). Does not know:
conversations (`ftp_requests`, `ftp_writer`, `ftp_reader`), what files contain (`mission_file`).

    seq uint16 | session | opcode | size | req_opcode | burst_complete | padding (uint8 each) | offset uint32 | data
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum

from gcs.errors import PeerRefusal
from gcs.link.wire.message import Message, Station

NAME = "FILE_TRANSFER_PROTOCOL"
DATA_MAX = 239
_PAYLOAD = 251
_HEAD = struct.Struct("<H6BI")
_ALL_BITS = 0xFFFFFFFF


class FtpOpcode(IntEnum):
    """MAV_FTP_OPCODE."""

    NONE = 0
    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CREATE_FILE = 6
    WRITE_FILE = 7
    REMOVE_FILE = 8
    CREATE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    OPEN_FILE_WO = 11
    TRUNCATE_FILE = 12
    RENAME = 13
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


class FtpError(IntEnum):
    """MAV_FTP_ERR: the first byte of a NAK."""

    NONE = 0
    FAIL = 1
    FAIL_ERRNO = 2
    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_EXISTS = 8
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


_WORDS = {
    FtpError.NONE: "no reason given",
    FtpError.FAIL: "failed, or another file is open",
    FtpError.FAIL_ERRNO: "its file system failed",
    FtpError.INVALID_DATA_SIZE: "size not valid",
    FtpError.INVALID_SESSION: "session not open",
    FtpError.NO_SESSIONS_AVAILABLE: "all sessions in use",
    FtpError.END_OF_FILE: "end of file",
    FtpError.UNKNOWN_COMMAND: "command not known",
    FtpError.FILE_EXISTS: "file exists already",
    FtpError.FILE_PROTECTED: "file is write-protected",
    FtpError.FILE_NOT_FOUND: "no such file, or it is not open",
}


@dataclass(frozen=True)
class FtpPayload:
    """One request or reply."""

    seq: int
    session: int
    opcode: int
    offset: int = 0
    data: bytes = b""
    req_opcode: int = 0
    burst_complete: bool = False
    size: int | None = None  # of what a read asks for; None is the length of `data`

    def packed(self) -> bytes:
        """The 251 bytes of the payload."""
        size = len(self.data) if self.size is None else self.size
        head = _HEAD.pack(
            self.seq, self.session, self.opcode, size, self.req_opcode, self.burst_complete, 0, self.offset
        )
        return (head + self.data).ljust(_PAYLOAD, b"\0")

    def message(self, target: Station) -> Message:
        """FILE_TRANSFER_PROTOCOL to `target`."""
        fields = {"target_network": 0, "target_system": target.sysid, "target_component": target.compid}
        return Message(NAME, {**fields, "payload": list(self.packed())})

    @property
    def error(self) -> int:
        """Of a NAK: MAV_FTP_ERR."""
        return self.data[0] if self.data else FtpError.FAIL


def read_payload(message: Message) -> FtpPayload | None:
    """What the message says; None where its sizes are impossible.

    Of a request without data, a read, `size` is what it asks for; `data` has as many bytes all the same.
    """
    raw = bytes(message.fields["payload"])
    if len(raw) < _HEAD.size:
        return None
    seq, session, opcode, size, req_opcode, burst_complete, _, offset = _HEAD.unpack_from(raw)
    if size > DATA_MAX:
        return None
    data = raw[_HEAD.size : _HEAD.size + size].ljust(size, b"\0")
    return FtpPayload(seq, session, opcode, offset, data, req_opcode, bool(burst_complete), size)


class FtpRefused(PeerRefusal):
    """The vehicle answered NAK to `opcode`; `code` is the MAV_FTP_ERR, `number` its file system's own."""

    def __init__(self, peer: Station, path: str, opcode: int, code: int, number: int = 0) -> None:
        known = code in tuple(FtpError)
        words = f"{_WORDS[FtpError(code)]} (MAV_FTP_ERR_{FtpError(code).name})" if known else f"MAV_FTP_ERR {code}"
        errno = f", number {number}" if number else ""
        super().__init__(
            f"{peer} refused {_asked(opcode)} of {path}: {words}{errno}.",
            hint="nothing was armed; send the mission item by item (--transfer items)",
        )
        self.opcode = opcode
        self.code = code
        self.number = number


def refusal(peer: Station, path: str, reply: FtpPayload) -> FtpRefused:
    """The error of a NAK."""
    return FtpRefused(peer, path, reply.req_opcode, reply.error, reply.data[1] if len(reply.data) > 1 else 0)


def crc32(data: bytes) -> int:
    """The checksum of CalcFileCRC32: the usual polynomial from 0, and not inverted at the end."""
    return zlib.crc32(data, _ALL_BITS) ^ _ALL_BITS


def _asked(opcode: int) -> str:
    try:
        return FtpOpcode(opcode).name.replace("_", " ").lower()
    except ValueError:
        return f"command {opcode}"
