"""FileUpload: uploads a mission to ArduPilot as one file (MAVLink FTP), reads the file back and compares it.

It runs FtpWriter and FtpReader, by the table at the end. A closed file proves nothing, and after a refused close the
contents are unknown: only the read-back counts. It is compared item by item. A difference would come again: items sent
one by one show which of them is refused.
"""

from collections.abc import Sequence

from gcs.errors import GcsError, PeerError, PeerTimeout
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.ftp.reader import FtpReader
from gcs.link.protocols.ftp.writer import FtpWriter
from gcs.link.protocols.machine import TIMER, Guard, MachineEvent, MachineState, Table, ignore
from gcs.link.protocols.machine import Transition as Row
from gcs.link.protocols.mission.mission_dat import (
    HEADER,
    ITEM,
    length_of,
    path_of,
    pieces_of,
    read_mission_file,
    write_mission_file,
)
from gcs.link.protocols.mission.read_back import compare_missions, read_back_error
from gcs.link.protocols.mission.rules import UploadMachine
from gcs.link.wire.message import Message
from gcs.mavlink import MissionType
from gcs.mission.model import MissionItem

_READS = 3  # read-backs of one upload
_PATH = path_of(MissionType.MISSION)
_E, _S = MachineEvent, MachineState


class FileUpload(UploadMachine):
    """All items of a flight mission with home as item 0. Home reads back as the vehicle's own and is not compared."""

    def __init__(self, items: Sequence[MissionItem], exchange: Exchange, *, tries: int = 2) -> None:
        super().__init__(FILE_UPLOAD, exchange, items, MissionType.MISSION)
        self._tries = tries

    def _difference(self) -> GcsError | None:
        if not isinstance(self._machine, FtpReader):
            return None
        try:
            on_board = read_mission_file(self._machine.data, MissionType.MISSION, self.peer)
        except PeerError as invalid:
            return invalid
        differences = compare_missions(self.items[1:], on_board[1:], autopilot=self.exchange.autopilot)
        return read_back_error(self.peer, MissionType.MISSION, differences) if differences else None

    def _is_broken(self) -> bool:
        """Whether the transfer that has ended did not work: a read-back that differs did."""
        return self._machine is not None and self._machine.error is not None

    def _may_write_again(self) -> bool:
        heard = isinstance(self._machine, FtpWriter) and self._machine.heard
        return isinstance(self._failure, PeerTimeout) and heard and self._tries > 0

    def _write(self, _: Message, now_s: float) -> list[Message]:
        self._tries -= 1
        self._machine = FtpWriter(_PATH, pieces_of(write_mission_file(self.items)), self.exchange)
        return self._machine.start(now_s)

    def _read_back(self, _: Message, now_s: float) -> list[Message]:
        self._reads = 0
        return self._read(TIMER, now_s)

    def _read(self, _: Message, now_s: float) -> list[Message]:
        self._reads += 1
        self._machine = FtpReader(_PATH, self.exchange, self._length, HEADER.size)
        return self._machine.start(now_s)

    def _length(self, head: bytes) -> int:
        """The length of the file on board. Raises `PeerError` if it is longer than the one that was written."""
        length, written = length_of(head, MissionType.MISSION, self.peer), HEADER.size + len(self.items) * ITEM.size
        if length > written:
            raise PeerError(f"{self.peer} sent a mission file of {length} bytes; {written} were written.")
        return length


_M = FileUpload
_If = Guard[_M]
_CLOSED = _If("the file was closed", lambda m, _: m._failure is None)
_WRITE_AGAIN = _If("timeout after some answers, fewer than `tries` times", lambda m, _: m._may_write_again())
_EQUAL = _If("equal by meaning", lambda m, _: m._failure is None)
_READ_AGAIN = _If(f"refused, or timeout, fewer than {_READS} times", lambda m, _: m._is_broken() and m._reads < _READS)
_TRIES = _If("refused, or timeout, written fewer than `tries` times", lambda m, _: m._is_broken() and m._tries > 0)

FILE_UPLOAD: Table[FileUpload] = Table(
    Row((_S.IDLE,), _E.START, None, _S.WRITING, _M._write, "the start of an FtpWriter"),
    Row((_S.WRITING,), _E.ENDED, _CLOSED, _S.READING, _M._read_back, "the start of an FtpReader"),
    Row((_S.WRITING,), _E.ENDED, _WRITE_AGAIN, None, _M._write, "the file again"),
    Row((_S.WRITING,), _E.ENDED, None, _S.FAILED, _M._end),
    Row((_S.READING,), _E.ENDED, _EQUAL, _S.DONE, ignore),
    Row((_S.READING,), _E.ENDED, _READ_AGAIN, None, _M._read, "the read-back again"),
    Row((_S.READING,), _E.ENDED, _TRIES, _S.WRITING, _M._write, "the file again"),
    Row((_S.READING,), _E.ENDED, None, _S.FAILED, _M._end),
    Row((_S.IDLE, _S.WRITING, _S.READING), _E.CANCEL, None, _S.FAILED, _M._cancelled, "the end of a transfer"),
)
