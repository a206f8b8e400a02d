"""A vehicle that answers uploads with forged messages: they end in time, and nothing unequal is ever accepted."""

from __future__ import annotations

import itertools
import random
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerError
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.ftp.payload import NAME, FtpError, FtpOpcode, FtpPayload, read_payload
from gcs.link.protocols.ftp.reader import ReceivedBytes
from gcs.link.protocols.mission.file_upload import FileUpload
from gcs.link.protocols.mission.mission_dat import HEADER, ITEM, MAGIC, write_mission_file
from gcs.link.protocols.mission.receiver import MissionReceiver
from gcs.link.protocols.mission.strategy import Preferred
from gcs.link.protocols.mission.verified_upload import VerifiedUpload
from gcs.link.wire.message import GROUND, Message
from tests.air import VEHICLE, Air, Weather, mission_of

ITEMS = mission_of(60, seed=2)
DELAY_S = 0.05
LONGEST_S = 3600.0
ANSWERS_MAX = 200_000  # of the ground station
RNG = st.integers(0, 2**32).map(random.Random)


def said(payload):
    message = payload.message(GROUND)
    return Message(message.name, dict(message.fields), *VEHICLE)


def too_long(seq, session, opcode):
    raw = struct.pack("<H6BI", seq, session, FtpOpcode.ACK, 255, opcode, 0, 0, 0) + bytes(239)
    return Message(NAME, {**GROUND.target, "target_network": 0, "payload": list(raw)}, *VEHICLE)


def answers(request, honest, rng):
    """One forged answer to a request for a file."""
    kind = rng.randrange(14)
    seq, session, opcode = (request.seq + 1) % 0x10000, request.session, request.opcode
    data = rng.randbytes(rng.randrange(240))
    ack = FtpPayload(seq, session, FtpOpcode.ACK, request.offset, data, opcode)
    if kind == 0:
        return [said(FtpPayload(rng.randrange(0x10000), session, FtpOpcode.ACK, request.offset, data, opcode))]
    if kind == 1:
        return [said(FtpPayload(seq, rng.randrange(256), FtpOpcode.ACK, request.offset, data, opcode))]
    if kind == 2:
        return [too_long(seq, session, opcode)]
    if kind == 3:
        return [said(FtpPayload(seq, session, FtpOpcode.ACK, rng.randrange(1 << 32), data, opcode))]
    if kind == 4:
        return [said(FtpPayload(seq, session, FtpOpcode.NAK, 0, bytes([rng.randrange(256)]), opcode))]
    if kind == 5:
        return [said(FtpPayload(seq, session, FtpOpcode.NAK, 0, b"", opcode))]
    if kind == 6:
        return [said(FtpPayload(seq, session, FtpOpcode.ACK, 0, b"", opcode))]
    if kind == 7:
        return [said(FtpPayload(seq, session, FtpOpcode.NAK, 0, bytes([FtpError.END_OF_FILE]), opcode))]
    if kind == 8:
        grown = HEADER.pack(MAGIC, 0, 0, 0, rng.choice([61, 4096, 65535]))
        return [said(FtpPayload(seq, session, FtpOpcode.ACK, 0, grown + data[:200], opcode))]
    if kind == 9:
        burst = FtpOpcode.BURST_READ_FILE
        pieces = [(seq + n, rng.randrange(1 << 18), rng.randbytes(rng.choice([1, 239]))) for n in range(50)]
        return [said(FtpPayload(n % 0x10000, session, FtpOpcode.ACK, at, d, burst)) for n, at, d in pieces]
    if kind == 10:
        return []
    if kind == 11:
        return [said(ack), *honest]
    return honest


def wild(machine, air, rng, *, forged, until_s=LONGEST_S):
    """Run a machine against a vehicle that forges `forged` of its answers; return the answers that were heard."""
    now_s, heard = 0.0, 0
    outbox = list(machine.start(0.0))
    while not machine.done:
        inbox = []
        for message in outbox:
            sent = Message(message.name, dict(message.fields), *GROUND)
            honest = air.files.receive(sent, now_s) + air.shelf.receive(sent, now_s)
            honest = [Message(m.name, dict(m.fields), *VEHICLE) for m in honest]
            request = read_payload(sent) if sent.name == NAME else None
            if rng.random() >= forged:
                inbox += honest
            elif request is not None:
                inbox += answers(request, honest, rng)
            else:
                inbox += items_forged(honest, rng)
        deadline_s = machine.deadline_s
        arrive_s = now_s + DELAY_S if inbox else float("inf")
        assert deadline_s is not None or inbox, "it waits for nothing"
        now_s = min(arrive_s, max(now_s, deadline_s) if deadline_s is not None else arrive_s)
        assert now_s < until_s, "it does not end"
        outbox = []
        for message in inbox:
            outbox += machine.receive(message, now_s)
        outbox += machine.tick(now_s) + air.shelf.tick(now_s)
        heard += len(outbox)
        assert heard < ANSWERS_MAX
    return now_s


def items_forged(honest, rng):
    """Answers of the mission protocol with wild numbers, types and counts, in any order."""
    forged = []
    for message in honest:
        fields = dict(message.fields)
        kind = rng.randrange(8)
        if kind == 0 and "seq" in fields:
            fields["seq"] = rng.choice([0, 1, fields["seq"] + 1, 4000, 65535])
        elif kind == 1 and message.name == "MISSION_COUNT":
            fields["count"] = rng.choice([0, 1, 61, 4096, 65535])
        elif kind == 2:
            fields["mission_type"] = rng.choice([1, 2, 255])
        elif kind == 3 and message.name == "MISSION_ITEM_INT":
            fields |= {"param1": rng.choice([float("nan"), float("inf"), 1e38]), "z": float("nan")}
        elif kind == 4:
            forged.append(Message("MISSION_ACK", {**GROUND.target, "type": rng.randrange(20), "mission_type": 0}, 3, 1))
        elif kind == 5:
            forged.append(Message("MISSION_REQUEST", {**GROUND.target, "seq": rng.randrange(65536)}, 3, 1))
            forged.append(Message("MISSION_COUNT", {**GROUND.target, "count": 65535, "mission_type": 0}, 3, 1))
        elif kind == 6:
            forged.append(
                Message(
                    "MISSION_ITEM",
                    {**dict.fromkeys(("param1", "param2", "param3", "param4"), 0.0), **GROUND.target}
                    | {"seq": fields.get("seq", 0), "x": rng.choice([float("nan"), 3e38]), "y": 0.0, "z": 0.0}
                    | {"command": 16, "frame": 3, "current": 0, "autocontinue": 1, "mission_type": 0},
                    3,
                    1,
                )
            )
        elif kind == 7:
            continue
        forged.append(Message(message.name, fields, *VEHICLE))
    rng.shuffle(forged)
    return forged


def file_upload():
    return FileUpload(ITEMS, Exchange(VEHICLE, Autopilot.ARDUPILOT))


def either():
    return Preferred(file_upload(), VerifiedUpload(ITEMS, Exchange(VEHICLE, Autopilot.ARDUPILOT)))


@given(RNG, st.sampled_from([0.02, 0.2, 1.0]), st.sampled_from([file_upload, either]))
@settings(max_examples=40, deadline=None)
def test_forged_answers_end_in_time_and_nothing_unequal_is_accepted(rng, forged, make):
    machine, air = make(), Air(Autopilot.ARDUPILOT, Weather(), 0)
    wild(machine, air, rng, forged=forged, until_s=4 * LONGEST_S)
    assert machine.error is None or isinstance(machine.error, PeerError)


@given(RNG)
@settings(max_examples=40, deadline=None)
def test_forged_mission_items_end_in_time(rng):
    machine, air = (
        VerifiedUpload(ITEMS, Exchange(VEHICLE, Autopilot.ARDUPILOT)),
        Air(Autopilot.ARDUPILOT, Weather(), 0),
    )
    wild(machine, air, rng, forged=0.3, until_s=4 * LONGEST_S)
    assert machine.error is None or isinstance(machine.error, PeerError)


def answering(what):
    """An upload whose every read is answered with `what(request, file)`; writes are acknowledged."""
    whole, machine = write_mission_file(ITEMS), file_upload()
    sizes, now_s, outbox = [], 0.0, list(machine.start(0.0))
    for turn in itertools.count():
        assert turn < ANSWERS_MAX, "it never ends"
        inbox = []
        for message in outbox:
            request = read_payload(message)
            if request.opcode in (FtpOpcode.READ_FILE, FtpOpcode.BURST_READ_FILE):
                inbox += what(request, whole)
            else:
                inbox.append(FtpPayload((request.seq + 1) % 65536, request.session, 128, 0, b"", request.opcode))
        now_s = now_s + 0.01 if inbox else max(now_s, machine.deadline_s)
        outbox = [sent for reply in inbox for sent in machine.receive(said(reply), now_s)] + machine.tick(now_s)
        sizes.append(len(outbox))
        if machine.done:
            break
    assert max(sizes) < 100
    return machine, now_s


def ack(request, offset, data, opcode=None):
    return FtpPayload((request.seq + 1) % 65536, request.session, 128, offset, data, opcode or request.opcode)


def nak(request, code):
    return FtpPayload((request.seq + 1) % 65536, request.session, 129, 0, bytes([code]), request.opcode)


def header_then(rest):
    return lambda r, whole: [ack(r, 0, whole[:100])] if r.offset == 0 else rest(r, whole)


NOWHERE = {
    "nothing but acknowledgements": lambda r, _: [ack(r, r.offset, b"")],
    "the end of the file, always": lambda r, _: [nak(r, FtpError.END_OF_FILE)],
    "a header, then the end of the file": header_then(lambda r, _: [nak(r, FtpError.END_OF_FILE)]),
    "a header, then nothing new": header_then(lambda r, whole: [ack(r, 0, whole[:50])]),
    "the same piece as a burst without end": lambda r, whole: [ack(r, 0, whole[:200], FtpOpcode.BURST_READ_FILE)] * 9,
    "one byte at a time": lambda r, whole: [ack(r, r.offset, whole[r.offset : r.offset + 1] * (r.offset < 300))],
    "a file that is longer": lambda r, _: [ack(r, r.offset, HEADER.pack(MAGIC, 0, 0, 0, 4000) + bytes(200))],
    "no file of this type": lambda r, _: [ack(r, r.offset, HEADER.pack(MAGIC, 1, 0, 0, 60) + bytes(200))],
    "single bytes far apart": lambda r, _: [ack(r, 2 * n + 1000, b"x", FtpOpcode.BURST_READ_FILE) for n in range(60)],
}
LONG = ("the same piece as a burst without end", "one byte at a time", "single bytes far apart")


@pytest.mark.parametrize(
    "what", [pytest.param(NOWHERE[one], id=one, marks=[pytest.mark.slow] * (one in LONG)) for one in NOWHERE]
)
def test_a_read_back_that_leads_nowhere_ends(what):
    machine, now_s = answering(what)
    assert isinstance(machine.error, PeerError)
    assert now_s < 600.0


@pytest.mark.parametrize("at", [HEADER.size + ITEM.size, HEADER.size + 30 * ITEM.size + 16, 10 + 60 * ITEM.size - 8])
def test_one_changed_byte_in_the_read_back_is_never_accepted(at):
    def changed(request, whole):
        data = bytearray(whole)
        data[at] ^= 0x20
        return [ack(request, request.offset, bytes(data[request.offset : request.offset + 239]))]

    machine, _ = answering(changed)
    assert isinstance(machine.error, PeerError)


def test_a_count_beyond_every_autopilot_ends_a_download():
    receiver = MissionReceiver(Exchange(VEHICLE, estimates=False))
    receiver.start(0.0)
    count = Message("MISSION_COUNT", {**GROUND.target, "count": 65535, "mission_type": 0}, *VEHICLE)
    (sent,) = receiver.receive(count, 0.1)
    assert sent.name == "MISSION_ACK" and isinstance(receiver.error, PeerError)


@given(st.lists(st.tuples(st.integers(0, 120), st.binary(max_size=30)), max_size=40))
def test_the_first_copy_of_a_byte_counts(pieces):
    received, model = ReceivedBytes(100), {}
    for offset, data in pieces:
        fits = offset + len(data) <= 100
        new = {offset + n: byte for n, byte in enumerate(data) if offset + n not in model} if fits else {}
        assert received.add(offset, data) == bool(new)
        model |= new
    missing = {at for begin, length in received.gaps(100) for at in range(begin, begin + length)}
    assert missing == set(range(100)) - set(model)
    whole = received.first(100)
    assert whole == (None if missing else bytes(model[n] for n in range(100)))
