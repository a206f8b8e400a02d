"""MAVLink FTP from the ground's side, against the emulated server or a scripted one, on a fake clock."""

from __future__ import annotations

import struct
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.exchange import Exchange, FtpNumbers
from gcs.link.protocols.ftp.payload import DATA_MAX, FtpError, FtpOpcode, FtpPayload, FtpRefused, read_payload
from gcs.link.protocols.ftp.reader import FtpReader
from gcs.link.protocols.ftp.writer import FtpWriter
from gcs.link.protocols.machine import MachineState
from gcs.link.protocols.mission.file_upload import FileUpload
from gcs.link.protocols.mission.item_messages import item_to_message
from gcs.link.protocols.mission.mission_dat import (
    ITEM,
    MAGIC,
    length_of,
    path_of,
    pieces_of,
    read_mission_file,
    write_mission_file,
)
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.protocols.mission.strategy import FILE_ITEMS_MIN, Transfer, planned
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MissionType
from tests.air import VEHICLE, Air, Weather, mission_of

CALM = Weather(0.05, 0.0, 0.0, 0.0)
PATH = path_of(MissionType.MISSION)
ITEMS = mission_of(20, seed=1)
EVERY_CODE = [code for code in FtpError if code is not FtpError.NONE]


def answer(request, opcode=FtpOpcode.ACK, source=VEHICLE, **changed):
    asked = read_payload(request)
    reply = FtpPayload(asked.seq + 1, asked.session, opcode, asked.offset, b"", asked.opcode)
    message = replace(reply, **changed).message(GROUND)
    return Message(message.name, message.fields, *source)


def refuse(request, code, *more):
    return answer(request, FtpOpcode.NAK, data=bytes((code, *more)))


def opcodes(messages):
    return [read_payload(message).opcode for message in messages]


def test_a_payload_looks_as_documented():
    raw = FtpPayload(0x1234, 5, FtpOpcode.WRITE_FILE, 0xA0B0C0D0, b"abc", 9, True).packed()
    assert raw[:15] == bytes.fromhex("34 12 05 07 03 09 01 00 d0 c0 b0 a0") + b"abc"
    assert len(raw) == 251
    assert not any(raw[15:])


@given(st.binary(min_size=251, max_size=251))
def test_any_payload_is_read_or_refused(raw):
    message = Message("FILE_TRANSFER_PROTOCOL", {"target_system": 255, "target_component": 190, "payload": list(raw)})
    read = read_payload(message)
    assert (read is None) == (raw[4] > DATA_MAX)
    assert read is None or read.data == raw[12 : 12 + raw[4]]


def test_it_travels_through_the_codec():
    message = FtpPayload(7, 1, FtpOpcode.CREATE_FILE, 0, PATH.encode()).message(VEHICLE)
    there = Codec(1, 1).decode(Codec(255, 190).encode(message))[0]
    assert read_payload(there) == replace(read_payload(message), size=len(PATH))


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_a_mission_file_is_made_of_the_wires_own_items(kind):
    data = write_mission_file(ITEMS, kind)
    assert struct.unpack("<5H", data[:10]) == (MAGIC, kind, 0, 0, len(ITEMS))
    frame = Codec(255, 190).encode(item_to_message(ITEMS[3], 3, Station(0, 0), mission_type=kind))
    assert data[10 + 3 * 38 :][:38] == frame[10:-2].ljust(38, b"\0")
    assert compare_missions(ITEMS, read_mission_file(data, kind, VEHICLE), autopilot=Autopilot.PX4) == []


@pytest.mark.parametrize("count", [1, 5, 6, 7, 12, 13, 100, 650])
def test_pieces_end_where_items_end(count):
    data = bytes(range(1, 200)) * 200
    data = data[: 10 + count * ITEM.size]
    pieces = pieces_of(data)
    assert b"".join(piece for _, piece in pieces) == data
    assert all(len(piece) <= DATA_MAX for _, piece in pieces)
    assert pieces[0][0] == 0
    assert all((offset - 10) % ITEM.size == 0 for offset, _ in pieces[1:])


@pytest.mark.parametrize(
    "spoil",
    [
        lambda data: b"",
        lambda data: data[:9],
        lambda data: data[:-1],
        lambda data: data + b"\0",
        lambda data: b"\0\0" + data[2:],
        lambda data: data[:2] + b"\1" + data[3:],  # another type
        lambda data: data[:6] + b"\1" + data[7:],  # begins at item 1
        lambda data: data[:8] + b"\xff\xff" + data[10:],
    ],
)
def test_half_a_file_is_never_believed(spoil):
    with pytest.raises(PeerError, match="vehicle 3 sent a mission file"):
        read_mission_file(spoil(write_mission_file(ITEMS)), MissionType.MISSION, VEHICLE)


@settings(max_examples=120, deadline=None)
@given(
    st.integers(0, 2**32),
    st.sampled_from([0.0, 0.05, 0.2, 0.4, 0.8, 1.0]),
    st.sampled_from([0.0, 0.05, 0.4]),
    st.sampled_from([0.0, 0.02, 0.3]),
    st.sampled_from([1, 6, 7, 40]),
    st.sampled_from([Transfer.AUTO, Transfer.FILE]),
)
def test_what_is_believed_is_held(seed, loss, round_trip_s, mischief, count, transfer):
    air = Air(Autopilot.ARDUPILOT, Weather(round_trip_s, loss, mischief, mischief), seed)
    arrived = air.deliver(mission_of(count, seed), transfer=transfer)
    assert arrived.error is None or isinstance(arrived.error, PeerError)
    assert arrived.held or arrived.error is not None
    assert arrived.error is None or loss > 0.2 or mischief > 0.1
    assert arrived.error is not None or loss < 1.0


def test_a_file_costs_a_tenth_of_the_round_trips():
    as_file = Air(Autopilot.ARDUPILOT, CALM, 0).deliver(mission_of(100, 0), transfer=Transfer.AUTO)
    by_items = Air(Autopilot.ARDUPILOT, CALM, 0).deliver(mission_of(100, 0), transfer=Transfer.ITEMS)
    assert as_file.as_file and not by_items.as_file
    assert as_file.sent_s < 8 * 0.05
    assert as_file.total_s < min(12 * 0.05, by_items.total_s / 10)


def test_a_file_is_preferred_where_it_is_faster():
    def uploads_as_file(*args):
        way = planned(*args)
        assert (
            way.reason
            and str(way) == f"{'as a file' if way.transfer is Transfer.FILE else 'item by item'} ({way.reason})"
        )
        return way.transfer is Transfer.FILE

    assert uploads_as_file(Transfer.AUTO, Autopilot.ARDUPILOT, MissionType.MISSION, FILE_ITEMS_MIN)
    assert not uploads_as_file(Transfer.AUTO, Autopilot.ARDUPILOT, MissionType.MISSION, FILE_ITEMS_MIN - 1)
    assert uploads_as_file(Transfer.FILE, Autopilot.ARDUPILOT, MissionType.MISSION, 1)
    for transfer in (Transfer.AUTO, Transfer.FILE):
        assert not uploads_as_file(transfer, Autopilot.ARDUPILOT, MissionType.MISSION, 0)
        assert not uploads_as_file(transfer, Autopilot.ARDUPILOT, MissionType.RALLY, 50)
        assert not uploads_as_file(transfer, Autopilot.PX4, MissionType.MISSION, 50)
    assert not uploads_as_file(Transfer.ITEMS, Autopilot.ARDUPILOT, MissionType.MISSION, 50)
    for count, quicker in ((FILE_ITEMS_MIN, True), (FILE_ITEMS_MIN - 1, False)):
        both = [
            Air(Autopilot.ARDUPILOT, CALM, 0).deliver(mission_of(count, 0), transfer=t)
            for t in (Transfer.FILE, Transfer.ITEMS)
        ]
        asked_s = CALM.round_trip_s  # whether it takes files
        assert (both[0].total_s + asked_s < both[1].total_s - 1e-9) is quicker


def test_who_does_not_answer_to_files_gets_items():
    air = Air(Autopilot.ARDUPILOT, CALM, 0)
    air.files = None
    arrived = air.deliver(ITEMS, transfer=Transfer.AUTO)
    assert arrived.error is None and arrived.held and not arrived.as_file
    air = Air(Autopilot.ARDUPILOT, CALM, 0)
    air.files = None
    arrived = air.deliver(ITEMS, transfer=Transfer.FILE)
    assert isinstance(arrived.error, PeerTimeout)
    assert "does not answer to MAVLink FTP" in arrived.error.message
    assert len(air.shelf.items()) == 12  # what it held before


def test_an_item_that_does_not_please_is_named_by_the_other_way():
    bad = (*ITEMS[:9], replace(ITEMS[9], command=9999), *ITEMS[10:])
    arrived = Air(Autopilot.ARDUPILOT, CALM, 0).deliver(bad, transfer=Transfer.AUTO)
    assert "item 9" in arrived.error.message
    arrived = Air(Autopilot.ARDUPILOT, CALM, 0).deliver(bad, transfer=Transfer.FILE)
    assert (
        "the mission read back from vehicle 3 differs from what was sent: item 8: number of items"
        in arrived.error.message
    )


def test_an_older_session_in_the_way_is_ended_or_waited_out():
    for session in (1, 77):  # the writer's own next number, and another client's
        air = Air(Autopilot.ARDUPILOT, CALM, 0)
        opened = FtpPayload(900, session, FtpOpcode.CREATE_FILE, 0, PATH.encode()).message(VEHICLE)
        air.files.receive(Message(opened.name, opened.fields, *Station(254, 190)), 0.0)
        arrived = air.deliver(ITEMS, transfer=Transfer.FILE)
        assert arrived.error is None and arrived.held
        assert arrived.total_s < 5.0


class Writing:
    """A writer of 20 items, with a file that is open."""

    def __init__(self):
        self.pieces = pieces_of(write_mission_file(ITEMS))
        self.writer = FtpWriter(PATH, self.pieces, Exchange(VEHICLE))
        (self.create,) = self.writer.start(0.0)

    def opened(self):
        return self.writer.receive(answer(self.create), 0.01)

    def until(self, state):
        """Everything is acknowledged until that state is entered; what was sent then."""
        messages = self.opened()
        while self.writer.state is not state:
            messages = [more for one in messages for more in self.writer.receive(answer(one), 0.02)]
        return messages


def test_the_piece_that_makes_it_a_file_goes_last():
    writing = Writing()
    first = writing.opened()
    assert [read_payload(one).offset for one in first] == [offset for offset, _ in writing.pieces[1:5]]
    (seal,) = Writing().until(MachineState.SEALING)
    assert (read_payload(seal).offset, read_payload(seal).data) == writing.pieces[0]
    (close,) = Writing().until(MachineState.CLOSING)
    assert opcodes([close]) == [FtpOpcode.TERMINATE_SESSION]


def test_a_cancelled_file_is_made_none_before_it_is_closed():
    for state in (MachineState.WRITING, MachineState.SEALING, MachineState.CLOSING):
        writing = Writing()
        writing.until(state)
        told = writing.writer.cancel()
        assert opcodes(told) == [FtpOpcode.WRITE_FILE] * 2 + [FtpOpcode.TERMINATE_SESSION] * 2
        assert read_payload(told[0]).offset == 0 and not any(read_payload(told[0]).data)
        assert writing.writer.done and writing.writer.error is not None
        assert writing.writer.cancel() == []
    assert Writing().writer.cancel() == []


def test_answers_to_other_questions_count_for_nothing():
    writing = Writing()
    create = writing.create
    for wrong in (
        answer(create, source=Station(9, 1)),
        answer(create, seq=read_payload(create).seq),
        answer(create, req_opcode=FtpOpcode.WRITE_FILE),
        answer(create, FtpOpcode.CREATE_FILE),
        Message(
            "FILE_TRANSFER_PROTOCOL", {"target_system": 255, "target_component": 190, "payload": [255] * 251}, *VEHICLE
        ),
        Message("FILE_TRANSFER_PROTOCOL", {**answer(create).fields, "target_system": 17}, *VEHICLE),
    ):
        assert writing.writer.receive(wrong, 0.01) == []
        assert writing.writer.state is MachineState.OPENING
    writes = writing.opened()
    assert writing.opened() == []  # the same answer once more
    assert len(writing.writer.receive(answer(writes[0]), 0.02)) <= 1
    assert writing.writer.receive(answer(writes[0]), 0.02) == []


@pytest.mark.parametrize("code", EVERY_CODE)
def test_every_no_ends_it_or_leads_to_another_try(code):
    """On opening, on writing, on closing; in the end with an error that says what was refused, and why."""
    for state in (MachineState.OPENING, MachineState.WRITING, MachineState.SEALING, MachineState.CLOSING):
        writing = Writing()
        messages = [writing.create] if state is MachineState.OPENING else writing.until(state)
        now_s = 0.1
        for _ in range(40):
            messages = writing.writer.receive(refuse(messages[0], code, 22), now_s)
            if writing.writer.done:
                break
            while not messages:
                now_s = max(now_s, writing.writer.deadline_s)
                messages = writing.writer.tick(now_s)
        error = writing.writer.error
        assert isinstance(error, FtpRefused)
        assert (error.code, error.number) == (code, 22)
        assert PATH in error.message and code.name in error.message
        assert now_s < 30.0


def test_an_unknown_refusal_is_named_by_its_number():
    def refused(opcode, code):
        return FtpRefused(VEHICLE, PATH, FtpPayload(1, 1, FtpOpcode.NAK, data=bytes([code]), req_opcode=opcode))

    assert "MAV_FTP_ERR 99" in refused(FtpOpcode.CREATE_FILE, 99).message
    assert "command 77" in refused(77, 1).message


def test_what_got_no_answer_is_said_again_under_the_same_number():
    writing = Writing()
    again = writing.writer.tick(writing.writer.deadline_s)
    assert [read_payload(one) for one in again] == [read_payload(writing.create)]
    now_s = 0.0
    while not writing.writer.done:
        now_s = max(now_s, writing.writer.deadline_s)
        writing.writer.tick(now_s)
    assert isinstance(writing.writer.error, PeerTimeout)
    assert 8.0 < now_s < 12.0


def test_a_no_to_the_end_of_a_file_is_final():
    writing = Writing()
    (close,) = writing.until(MachineState.CLOSING)
    assert FtpOpcode.CREATE_FILE not in opcodes(writing.writer.receive(refuse(close, FtpError.FAIL, 22), 0.1))
    assert writing.writer.state is MachineState.FAILED


def test_numbers_go_on_from_one_file_to_the_next_and_begin_anew():
    numbers = FtpNumbers(0xFFFE, 254)
    assert [numbers.next_seq() for _ in range(3)] == [0xFFFF, 0, 1]
    assert [numbers.next_session() for _ in range(3)] == [255, 1, 2]


def reading(data, measure=None):
    """A reader that has opened a file, and the request of the burst."""
    reader = FtpReader(PATH, Exchange(VEHICLE), measure or (lambda head: length_of(head, 0, VEHICLE)), 10)
    (opening,) = reader.start(0.0)
    (burst,) = reader.receive(answer(opening, data=(1 << 20).to_bytes(4, "little")), 0.01)
    return reader, burst


def burst_of(request, data, size=DATA_MAX):
    asked = read_payload(request)
    pieces = [(at, data[at : at + size]) for at in range(0, len(data), size)]
    return [answer(request, seq=asked.seq + 1 + n, offset=at, data=piece) for n, (at, piece) in enumerate(pieces)]


def test_a_cancelled_reading_asks_for_nothing_more():
    data = write_mission_file(mission_of(40, 3))
    reader, request = reading(data)
    reader.receive(burst_of(request, data)[0], 0.02)
    assert opcodes(reader.cancel()) == [FtpOpcode.TERMINATE_SESSION]
    assert reader.deadline_s is None
    assert reader.tick(60.0) == []


def finish(reader, sent):
    assert opcodes(sent) == [FtpOpcode.TERMINATE_SESSION]
    assert not reader.done
    reader.receive(answer(sent[0]), 0.1)


@given(st.randoms(use_true_random=False), st.integers(0, 5))
@settings(max_examples=60, deadline=None)
def test_a_burst_with_holes_in_any_order_is_filled(random, lost):
    data = write_mission_file(mission_of(40, 3))
    reader, request = reading(data)
    pieces = burst_of(request, data, random.choice([80, 238, 239]))
    random.shuffle(pieces)
    missing, here = pieces[:lost], [*pieces[lost:], *pieces[lost : lost + 2]]
    sent = [more for piece in here for more in reader.receive(piece, 0.02)]
    now_s = 0.03
    for _ in range(200):
        if sent and FtpOpcode.TERMINATE_SESSION in opcodes(sent):
            break
        asked = [read_payload(one) for one in sent if read_payload(one).opcode == FtpOpcode.READ_FILE]
        replies = [answer(ask.message(VEHICLE), data=data[ask.offset : ask.offset + ask.size]) for ask in asked]
        sent = [more for one in replies for more in reader.receive(one, now_s)]
        if not sent:
            now_s = max(now_s, reader.deadline_s)
            sent = reader.tick(now_s)
    finish(reader, sent[-1:])
    assert reader.done and reader.error is None
    assert reader.data == data
    assert missing == pieces[:lost]


def test_an_unanswered_close_does_not_spoil_what_was_read():
    data = write_mission_file(ITEMS)
    reader, request = reading(data)
    sent = [more for piece in burst_of(request, data) for more in reader.receive(piece, 0.02)]
    assert opcodes(sent) == [FtpOpcode.TERMINATE_SESSION]
    with pytest.raises(ProtocolMisuse):
        _ = reader.data
    while not reader.done:
        reader.tick(reader.deadline_s)
    assert reader.error is None
    assert reader.data == data


def test_a_file_that_is_none_ends_the_reading():
    reader, request = reading(b"")
    sent = reader.receive(burst_of(request, b"not a mission at all")[0], 0.02)
    assert "mission file with an invalid header" in reader.error.message
    assert opcodes(sent) == [FtpOpcode.TERMINATE_SESSION]


@pytest.mark.parametrize("code", EVERY_CODE)
def test_every_no_to_a_reader_ends_it_or_leads_to_another_try(code):
    reader, burst = reading(b"")
    message, now_s = burst, 0.1
    for _ in range(400):
        sent = reader.receive(refuse(message, code), now_s)
        while not sent and not reader.done:
            now_s = max(now_s, reader.deadline_s)
            sent = reader.tick(now_s)
        if reader.done:
            break
        message = sent[-1]
    assert isinstance(reader.error, FtpRefused)
    assert reader.error.code == code
    assert now_s < 30.0


def test_machines_live_for_one_file():
    writing = Writing()
    with pytest.raises(ProtocolMisuse):
        writing.writer.start(0.0)
    with pytest.raises(ProtocolMisuse):
        FtpWriter(PATH, [], Exchange(VEHICLE)).start(0.0)
    reader, _ = reading(b"")
    with pytest.raises(ProtocolMisuse):
        reader.start(0.0)
    delivery = FileUpload(ITEMS, Exchange(VEHICLE, Autopilot.ARDUPILOT))
    delivery.start(0.0)
    with pytest.raises(ProtocolMisuse):
        delivery.start(0.0)
    delivery.cancel()
    assert "cancelled" in delivery.error.message


def test_a_file_that_was_closed_and_not_taken_is_found_out_by_reading():
    """The vehicle acknowledges, and keeps something else."""
    air = Air(Autopilot.ARDUPILOT, CALM, 0)
    air.files._files.write = lambda path, data: True  # type: ignore[method-assign]
    arrived = air.deliver(ITEMS, transfer=Transfer.FILE)
    assert "the mission read back from vehicle 3 differs from what was sent" in arrived.error.message
    assert not arrived.held


def test_a_vehicle_that_falls_silent_half_way_is_tried_once_more():
    air = Air(Autopilot.ARDUPILOT, CALM, 0)
    receive, deaf = air.files.receive, []

    def seldom(message, now_s):
        """Deaf for 12 s from the first piece on, longer than the timeout."""
        if read_payload(message).opcode == FtpOpcode.WRITE_FILE:
            deaf.append(now_s)
        return [] if deaf and now_s - deaf[0] < 12.0 else receive(message, now_s)

    air.files.receive = seldom
    arrived = air.deliver(ITEMS, transfer=Transfer.FILE)
    assert arrived.error is None and arrived.held and arrived.as_file
    assert 12.0 < arrived.total_s < 20.0
