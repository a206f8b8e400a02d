"""The payload of FILE_TRANSFER_PROTOCOL and the meaning of its error codes (https://mavlink.io/en/services/ftp.html).

seq uint16 | session | opcode | size | req_opcode | burst_complete | padding (uint8 each) | offset uint32 | data
"""

import struct
from dataclasses import dataclass
from enum import IntEnum

from gcs.errors import PeerRefusal
from gcs.link.wire.message import Message, Station
from gcs.mavlink import WordedEnum
from gcs.mavlink_names import named_words

NAME = "FILE_TRANSFER_PROTOCOL"
DATA_MAX = 239
_PAYLOAD = 251
_HEAD = struct.Struct("<H6BI")


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


class FtpError(WordedEnum):
    """MAV_FTP_ERR: the first byte of a NAK."""

    NONE = 0, "no reason given"
    FAIL = 1, "failed, or another file is open"
    FAIL_ERRNO = 2, "its file system failed"
    INVALID_DATA_SIZE = 3, "size not valid"
    INVALID_SESSION = 4, "session not open"
    NO_SESSIONS_AVAILABLE = 5, "all sessions in use"
    END_OF_FILE = 6, "end of file"
    UNKNOWN_COMMAND = 7, "command not known"
    FILE_EXISTS = 8, "file exists already"
    FILE_PROTECTED = 9, "file is write-protected"
    FILE_NOT_FOUND = 10, "no such file, or it is not open"


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
    size: int | None = None  # the requested size of a read; None means the length of `data`

    def packed(self) -> bytes:
        """The 251 bytes of the payload."""
        size = len(self.data) if self.size is None else self.size
        head = _HEAD.pack(
            self.seq, self.session, self.opcode, size, self.req_opcode, self.burst_complete, 0, self.offset
        )
        return (head + self.data).ljust(_PAYLOAD, b"\0")

    def message(self, peer: Station) -> Message:
        """Return FILE_TRANSFER_PROTOCOL to `peer`."""
        return Message(NAME, {**peer.target, "target_network": 0, "payload": list(self.packed())})

    @property
    def error(self) -> int:
        """The MAV_FTP_ERR of a NAK."""
        return self.data[0] if self.data else FtpError.FAIL


def read_payload(message: Message) -> FtpPayload | None:
    """Return the payload of a message; None if its sizes are invalid.

    For a read request `size` is the requested size; `data` is padded to this size.
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
    """The vehicle answered NAK. `code` is the MAV_FTP_ERR, `number` the errno of its file system."""

    def __init__(self, peer: Station, path: str, reply: FtpPayload) -> None:
        code, number = reply.error, reply.data[1] if len(reply.data) > 1 else 0
        words = named_words(FtpError, code, "MAV_FTP_ERR", f"MAV_FTP_ERR {code}")
        errno = f", errno {number}" if number else ""
        super().__init__(
            f"{peer} refused {_opcode_words(reply.req_opcode)} of {path}: {words}{errno}.",
            hint="send the mission item by item (--transfer items); no vehicle was armed",
        )
        self.opcode = reply.req_opcode
        self.code = code
        self.number = number


def _opcode_words(opcode: int) -> str:
    try:
        return FtpOpcode(opcode).name.replace("_", " ").lower()
    except ValueError:
        return f"command {opcode}"
