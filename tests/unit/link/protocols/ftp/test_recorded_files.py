"""A mission file on a recorded ArduCopter 4.5.6, and how often a file goes to and fro.

`tests/recorded/mission_dat.jsonl` holds what a ground station wrote, what it read, and the answer to CalcFileCRC32.
"""

import json
from collections import Counter
from pathlib import Path

import pytest

from gcs.autopilots.mission_commands import has_position
from gcs.autopilots.traits import Autopilot
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.ftp.payload import FtpError, FtpOpcode, FtpPayload, read_payload
from gcs.link.protocols.mission.file_upload import FileUpload
from gcs.link.protocols.mission.mission_dat import ITEM, read_mission_file
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.protocols.mission.strategy import Preferred, Transfer
from gcs.link.protocols.mission.verified_upload import VerifiedUpload
from gcs.link.wire.message import GROUND, Message
from gcs.mavlink import MissionType
from sim_bridge.missions.ftp_files import crc32, piece_of
from tests.air import VEHICLE, Air, Weather, mission_of

CALM = Weather(0.05, 0.0, 0.0, 0.0)
ITEMS = mission_of(20, seed=1)


def recorded_files():
    """What the ground station wrote to two ArduCopters 4.5.6, what it read, and the answer to CalcFileCRC32."""
    path = Path(__file__).parents[4] / "recorded" / "mission_dat.jsonl"
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


@pytest.mark.parametrize("row", recorded_files(), ids=lambda row: row["vehicle"])
def test_a_recorded_file_is_equal_item_by_item(row):
    """Its bytes are not those that were written, and their checksum is not the one that was answered."""
    written, read = bytes.fromhex(row["written"]), bytes.fromhex(row["read"])
    wanted, on_board = (read_mission_file(data, MissionType.MISSION, VEHICLE) for data in (written, read))
    assert compare_missions(wanted[1:], on_board[1:], autopilot=row["autopilot"]) == []
    assert crc32(read) != int.from_bytes(bytes.fromhex(row["crc32"]), "little")


@pytest.mark.parametrize("row", recorded_files(), ids=lambda row: row["vehicle"])
def test_recorded_bytes_and_checksum_follow_from_the_size_of_the_pieces(row):
    """The emulated vehicle reads as the real one does: every byte, and all four of the checksum."""
    read = bytes.fromhex(row["read"])
    items = [ITEM.unpack(data) for data in batched(read[10:], ITEM.size)]
    bare = [values if has_position(values[8]) else (*values[:4], 0, 0, 0.0, *values[7:]) for values in items]
    data = read[:10] + b"".join(ITEM.pack(*values) for values in bare)
    again = b"".join(piece_of(data, offset, row["piece"]) for offset in range(0, len(data), row["piece"]))
    assert again == read
    crc = 0
    for offset in range(0, len(data), 64):
        crc = crc32(piece_of(data, offset, 64), crc)
    assert crc.to_bytes(4, "little").hex() == row["crc32"]


def batched(data, size):
    return [data[at : at + size] for at in range(0, len(data), size)]


def test_a_file_is_sent_once_and_read_once():
    """Six real vehicles got it twice, and gave it back six times, because of a checksum over other bytes."""
    air = Air(Autopilot.ARDUPILOT, CALM, 0)
    seen = Counter()
    receive = air.files.receive

    def counted(message, now_s):
        request = read_payload(message)
        if request is not None:
            seen[FtpOpcode(request.opcode)] += 1
        return receive(message, now_s)

    air.files.receive = counted
    arrived = air.deliver(mission_of(60, 5), transfer=Transfer.AUTO)
    assert arrived.error is None and arrived.held and arrived.as_file
    assert (seen[FtpOpcode.CREATE_FILE], seen[FtpOpcode.OPEN_FILE_RO]) == (1, 1)
    assert seen[FtpOpcode.BURST_READ_FILE] == 1


def test_a_file_that_reads_back_different_is_followed_by_items_at_once():
    """One file, one read-back, then items, once."""
    air = Air(Autopilot.ARDUPILOT, CALM, 0)
    air.files._files.write = lambda path, data: True  # type: ignore[method-assign]
    arrived = air.deliver(ITEMS, transfer=Transfer.AUTO)
    assert arrived.error is None and arrived.held and not arrived.as_file
    assert arrived.tries == 1


def test_the_reason_of_the_fallback_is_kept():
    either = Preferred(
        FileUpload(ITEMS, Exchange(VEHICLE, Autopilot.ARDUPILOT)),
        VerifiedUpload(ITEMS, Exchange(VEHICLE, Autopilot.ARDUPILOT)),
    )
    (create,) = either.start(0.0)
    assert either.failed is None
    asked = read_payload(create)
    refusal = FtpPayload(
        asked.seq + 1, asked.session, FtpOpcode.NAK, 0, bytes([FtpError.UNKNOWN_COMMAND]), asked.opcode
    )
    message = refusal.message(GROUND)
    sent = either.receive(Message(message.name, message.fields, *VEHICLE), 0.1)
    assert "command not known" in either.failed.message
    assert sent[-1].name == "MISSION_COUNT"
