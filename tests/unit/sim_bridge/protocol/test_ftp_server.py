"""The emulated MAVLink FTP server: what it serves, which requests conflict, and that hostile bytes change nothing."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.autopilots.traits import Autopilot
from gcs.link.protocols.ftp.payload import DATA_MAX, FtpError, FtpOpcode, FtpPayload, read_payload
from gcs.link.protocols.mission.mission_dat import (
    HEADER,
    ITEM,
    MAGIC,
    path_of,
    pieces_of,
    read_mission_file,
    write_mission_file,
)
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import Capability, FenceCommand, MissionType
from gcs.mission.model import MissionItem
from sim_bridge.missions.ftp_files import items_in
from sim_bridge.personality import ARDUPILOT, PX4
from tests.air import VEHICLE, Air, Weather, mission_of

PATH = path_of(MissionType.MISSION)
OTHER = Station(254, 190)
NEW = mission_of(20, seed=5)
OPEN, CREATE, WRITE, READ = FtpOpcode.OPEN_FILE_RO, FtpOpcode.CREATE_FILE, FtpOpcode.WRITE_FILE, FtpOpcode.READ_FILE
BURST, END, RESET = FtpOpcode.BURST_READ_FILE, FtpOpcode.TERMINATE_SESSION, FtpOpcode.RESET_SESSIONS


class Client:
    """Asks an emulated vehicle's files, one question at a time, with numbers that go on."""

    def __init__(self, air=None, station=GROUND):
        self.air = air or Air(Autopilot.ARDUPILOT, Weather(), 0)
        self.station = station
        self.seq = 100

    def ask(self, opcode, session=1, offset=0, data=b"", size=None, now_s=0.0, seq=None):
        self.seq = self.seq + 500 if seq is None else seq
        request = FtpPayload(self.seq, session, opcode, offset, data, size=size).message(VEHICLE)
        asked = Message(request.name, request.fields, *self.station)
        return [read_payload(one) for one in self.air.files.receive(asked, now_s)]

    def one(self, opcode, *more, **changed):
        (reply,) = self.ask(opcode, *more, **changed)
        assert (reply.seq, reply.req_opcode) == ((self.seq + 1) % 0x10000, opcode)
        return reply

    def refused(self, opcode, *more, **changed):
        reply = self.one(opcode, *more, **changed)
        assert reply.opcode == FtpOpcode.NAK
        return reply.error

    def write(self, data, path=PATH, pieces=None):
        assert self.one(CREATE, data=path.encode()).opcode == FtpOpcode.ACK
        for offset, piece in pieces or pieces_of(data):
            assert self.one(WRITE, offset=offset, data=piece).opcode == FtpOpcode.ACK
        return self.one(END)

    @property
    def held(self):
        return self.air.shelf.items()


def test_a_file_is_read_in_pieces_or_as_a_burst_until_it_ends():
    client = Client()
    opened = client.one(OPEN, data=PATH.encode())
    assert int.from_bytes(opened.data, "little") == 1 << 20  # whatever its length
    *pieces, end = client.ask(BURST, size=80)
    whole = b"".join(piece.data for piece in pieces)
    assert [piece.offset for piece in pieces] == list(range(0, len(whole), 80))
    assert (end.opcode, end.error, end.burst_complete) == (FtpOpcode.NAK, FtpError.END_OF_FILE, True)
    assert not any(piece.burst_complete for piece in pieces)
    assert compare_missions(client.held, read_mission_file(whole, 0, VEHICLE), autopilot=Autopilot.ARDUPILOT) == []
    assert client.one(READ, offset=30, size=50).data == whole[30:80]
    assert client.refused(READ, offset=len(whole), size=1) == FtpError.END_OF_FILE
    checksum = client.one(FtpOpcode.CALC_FILE_CRC32, data=PATH.encode())
    assert int.from_bytes(checksum.data, "little") == client.air.files._files.checksum(PATH)
    client.air.files.wrong_checksums = True
    assert client.one(FtpOpcode.CALC_FILE_CRC32, data=PATH.encode()).data != checksum.data
    assert client.refused(WRITE, data=b"x") == FtpError.FAIL


def test_a_file_written_replaces_the_mission_when_it_is_closed():
    client = Client()
    before = client.held
    data = write_mission_file(NEW)
    assert client.one(CREATE, data=PATH.encode()).opcode == FtpOpcode.ACK
    for offset, piece in reversed(pieces_of(data)):
        client.one(WRITE, offset=offset, data=piece)
    assert client.held == before
    assert client.refused(READ, size=10) == FtpError.FAIL
    client.one(END)
    assert compare_missions(NEW[1:], client.held[1:], autopilot=Autopilot.ARDUPILOT) == []
    assert client.held[0].alt_m == 400.0  # home is the vehicle's own


def test_a_part_is_replaced_where_a_file_says_so():
    client = Client()
    before = client.held
    data = HEADER.pack(MAGIC, 0, 1, 4, 2) + write_mission_file(NEW)[HEADER.size :][: 2 * ITEM.size]
    client.write(data, pieces=[(0, data)])
    assert compare_missions((*before[1:4], *NEW[:2], *before[6:]), client.held[1:], autopilot=Autopilot.ARDUPILOT) == []


@pytest.mark.parametrize(
    "spoil",
    [
        lambda d: b"",
        lambda d: d[:5],
        lambda d: d[:-1],
        lambda d: b"\0" * len(d),
        lambda d: b"\0\0" + d[2:],
        lambda d: d[: HEADER.size + 3 * ITEM.size] + bytes(ITEM.size) + d[HEADER.size + 4 * ITEM.size :],
        lambda d: d[:8] + b"\xff\xff" + d[10:],
    ],
)
def test_a_file_that_is_none_changes_nothing_and_is_acknowledged_all_the_same(spoil):
    client = Client()
    before = client.held
    data = spoil(write_mission_file(NEW))
    pieces = [(at, data[at : at + DATA_MAX]) for at in range(0, len(data), DATA_MAX)]
    assert client.write(data, pieces=pieces or [(0, b"")]).opcode == FtpOpcode.ACK
    assert client.held == before


def test_an_item_that_does_not_please_leaves_those_before_it():
    client = Client()
    bad = (*NEW[:7], replace(NEW[7], command=9999), *NEW[8:])
    client.write(write_mission_file(bad))
    assert compare_missions(NEW[1:7], client.held[1:], autopilot=Autopilot.ARDUPILOT) == []


def test_fences_are_taken_whole_and_rally_points_too():
    client = Client()
    corners = [MissionItem(FenceCommand.POLYGON_INCLUSION, 0, (3.0, 0.0, 0.0, 0.0), n, n * n, 0.0) for n in range(3)]
    client.write(write_mission_file(corners, 1), path_of(1))
    assert len(client.air.shelf.items(1)) == 3
    client.write(write_mission_file(corners[:2], 1), path_of(1))
    assert len(client.air.shelf.items(1)) == 3  # no polygon
    point = MissionItem(5100, 3, (0.0, 0.0, 0.0, 0.0), 470000000, 80000000, 30.0)
    client.write(write_mission_file([point], 2), path_of(2))
    assert len(client.air.shelf.items(2)) == 1


def test_one_session_for_all():
    first = Client()
    second = Client(first.air, OTHER)
    assert first.refused(READ, size=9) == first.refused(WRITE, data=b"x") == FtpError.FILE_NOT_FOUND
    first.one(OPEN, data=PATH.encode())
    assert first.refused(OPEN, data=PATH.encode()) == first.refused(CREATE, data=PATH.encode()) == FtpError.FAIL
    assert second.refused(CREATE, session=2, data=PATH.encode(), now_s=2.9) == FtpError.INVALID_SESSION
    assert second.one(RESET, session=2, now_s=2.9).opcode == FtpOpcode.ACK  # and does nothing
    assert (
        second.refused(CREATE, session=2, data=PATH.encode(), now_s=5.8) == FtpError.INVALID_SESSION
    )  # it was spoken to
    assert second.one(CREATE, session=2, data=PATH.encode(), now_s=9.0).opcode == FtpOpcode.ACK
    assert first.refused(READ, size=9, now_s=9.0) == FtpError.INVALID_SESSION
    assert second.one(RESET, session=2, now_s=9.0).opcode == FtpOpcode.ACK
    assert first.one(OPEN, data=PATH.encode(), now_s=9.0).opcode == FtpOpcode.ACK


def test_a_whole_file_is_taken_even_if_somebody_else_closes_it():
    """Why a writer sends the header last: a file left open is closed by the next client."""
    first = Client()
    second = Client(first.air, OTHER)
    before = first.held
    first.one(CREATE, data=PATH.encode())
    header, *rest = pieces_of(write_mission_file(NEW))
    for offset, piece in rest:
        first.one(WRITE, offset=offset, data=piece)
    second.one(OPEN, session=9, data=PATH.encode(), now_s=4.0)
    assert first.held == before
    second.one(END, session=9, now_s=4.0)
    first.write(b"", pieces=[*rest, header])
    assert compare_missions(NEW[1:], first.held[1:], autopilot=Autopilot.ARDUPILOT) == []


def test_a_repeated_request_gets_the_same_answer_once_more():
    client = Client()
    first = client.ask(CREATE, data=PATH.encode())
    assert client.ask(CREATE, data=PATH.encode(), seq=client.seq) == first
    assert client.refused(CREATE, data=PATH.encode()) == FtpError.FAIL  # another number
    client.one(END)
    client.one(OPEN, data=PATH.encode())
    *_, end = client.ask(BURST, size=DATA_MAX)
    assert client.ask(READ, size=9, seq=end.seq - 1) == [end]  # taken for repeated


@pytest.mark.parametrize(
    "path", [b"", b"@MISSION", b"@MISSION/mission.dat\0", b"/etc/passwd", b"\xff\xfe", b"a" * DATA_MAX]
)
def test_there_are_no_other_files(path):
    client = Client()
    wanted = FtpError.INVALID_DATA_SIZE if not path or path.endswith((b"\0", b"\xfe")) else FtpError.FILE_NOT_FOUND
    assert client.refused(OPEN, data=path) == client.refused(CREATE, data=path) == wanted


def test_what_it_does_not_do_it_says():
    client = Client()
    for opcode in (3, 8, 9, 10, 12, 13, 77, 255):
        assert client.refused(opcode, data=PATH.encode()) == FtpError.UNKNOWN_COMMAND
    assert client.one(FtpOpcode.NONE).opcode == FtpOpcode.ACK
    assert client.ask(FtpOpcode.ACK) == client.ask(FtpOpcode.NAK) == []
    assert client.refused(FtpOpcode.CALC_FILE_CRC32, data=b"x") == FtpError.FILE_NOT_FOUND


def test_a_file_does_not_grow_for_ever():
    client = Client()
    client.one(CREATE, data=PATH.encode())
    assert client.refused(WRITE, offset=0xFFFFFF00, data=b"x") == FtpError.FAIL_ERRNO
    assert client.one(WRITE, offset=2_000_000, data=b"x").opcode == FtpOpcode.ACK


# Requests as they may come, whole headers among them: any bytes, and those that reach deep.
_payloads = st.one_of(
    st.binary(min_size=251, max_size=251),
    st.builds(
        lambda seq, session, opcode, offset, data: FtpPayload(seq, session, opcode, offset, data).packed(),
        st.integers(0, 3),
        st.integers(0, 2),
        st.sampled_from(list(FtpOpcode)),
        st.sampled_from([0, 1, 10, 48, 238, 1 << 20, 0xFFFFFFFF]),
        st.sampled_from(
            [b"", PATH.encode(), path_of(1).encode(), b"\1" * DATA_MAX, b"\0" * 10, HEADER.pack(MAGIC, 0, 0, 0, 1)]
        ),
    ),
)


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(_payloads, st.sampled_from([0.0, 0.1, 4.0])), max_size=25))
def test_hostile_bytes_change_nothing_and_the_next_honest_file_is_taken(attacks):
    air = Air(Autopilot.ARDUPILOT, Weather(), 0)
    before = {kind: air.shelf.items(kind) for kind in range(3)}
    now_s = 0.0
    for raw, later_s in attacks:
        now_s += later_s
        fields = {"target_network": 0, "target_system": 3, "target_component": 1, "payload": list(raw)}
        for answer in air.files.receive(Message("FILE_TRANSFER_PROTOCOL", fields, *OTHER), now_s):
            assert read_payload(answer).opcode in (FtpOpcode.ACK, FtpOpcode.NAK)
    assert {kind: air.shelf.items(kind) for kind in range(3)} == before
    client = Client(air)
    client.one(END, session=1, now_s=now_s + 10.0)
    client.one(CREATE, session=1, data=PATH.encode(), now_s=now_s + 20.0)
    for offset, piece in pieces_of(write_mission_file(NEW)):
        client.one(WRITE, offset=offset, data=piece, now_s=now_s + 20.0)
    client.one(END, now_s=now_s + 20.0)
    assert compare_missions(NEW[1:], client.held[1:], autopilot=Autopilot.ARDUPILOT) == []


def test_only_ardupilot_claims_and_has_it():
    assert ARDUPILOT.capabilities & Capability.FTP
    assert not PX4.capabilities & Capability.FTP
    assert ARDUPILOT.missions.as_files and not PX4.missions.as_files


def test_the_items_of_a_piece_are_known_by_their_numbers():
    pieces = [
        FtpPayload(1, 1, WRITE, offset, data).message(VEHICLE) for offset, data in pieces_of(write_mission_file(NEW))
    ]
    assert [items_in(piece) for piece in pieces] == [range(6), range(6, 12), range(12, 18), range(18, 20)]
    assert items_in(FtpPayload(1, 1, READ, 0, size=100).message(VEHICLE)) == range(0)
    assert items_in(FtpPayload(1, 1, WRITE, 0, b"1234").message(VEHICLE)) == range(0)
