"""The linear parser against the plain one, which tries every place: the same frames on every lawful link, whatever its
noise; and whatever comes, the work is bounded by its length."""

from __future__ import annotations

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.link.wire.codec import _SCANNER, Codec
from gcs.link.wire.frame_scanner import frame_length
from gcs.link.wire.message import Message
from gcs.link.wire.signing_keys import signing_with
from tests.property.link.test_codec_fuzz import MESSAGES

PER_BYTE, FREE, LARGEST = 4, 2048, 280 + 32
ENDS = (b"", b"\xfe", b"\xfd")
BEAT = {"type": 2, "autopilot": 3, "base_mode": 0, "custom_mode": 7, "system_status": 3, "mavlink_version": 3}
HEARTBEAT = Message("HEARTBEAT", BEAT)


class PlainParser:
    """Tries a checksum at every place where a header could be, and joins what a chunk has cut."""

    def __init__(self) -> None:
        self.tail = b""
        self.dialect = dialect.MAVLink(None)

    def feed(self, data: bytes) -> list[bytes]:
        if self.tail and not self._begins_with_frame(data):
            data = self.tail + data
        found, at, cut = [], 0, -1
        while at < len(data):
            length = frame_length(data, at)
            if length > len(data) - at:
                cut, length = at if cut < 0 else cut, 0
            frame = data[at : at + length]
            if length and self._is_right(frame):
                found.append(frame)
                cut = -1
                at += length
            elif length and self._is_unknown(frame) and data[at + length : at + length + 1] in ENDS:
                cut = at if cut < 0 and at + length == len(data) else cut
                at += length
            else:
                at += 1
        self.tail = data[cut:] if cut >= 0 else b""
        return found

    def _begins_with_frame(self, data: bytes) -> bool:
        length = frame_length(data, 0) if data else 0
        return 0 < length <= len(data) and self._is_right(data[:length])

    def _is_right(self, frame: bytes) -> bool:
        if self._is_unknown(frame):
            return False
        try:
            self.dialect.decode(bytearray(frame))
        except dialect.MAVError:
            return False
        return True

    @staticmethod
    def _is_unknown(frame: bytes) -> bool:
        return (int.from_bytes(frame[7:10], "little") if frame[0] == 0xFD else frame[5]) not in dialect.mavlink_map


def as_v1(frame: bytes) -> bytes:
    """The same message in MAVLink 1, with its zeros."""
    kind = dialect.mavlink_map[int.from_bytes(frame[7:10], "little")]
    payload = frame[10 : 10 + frame[1]].ljust(kind.unpacker.size, b"\0")
    body = bytes([len(payload), frame[4], frame[5], frame[6], kind.id]) + payload
    return b"\xfe" + body + dialect.x25crc(body + bytes([kind.crc_extra])).crc.to_bytes(2, "little")


@st.composite
def pieces(draw: st.DrawFn) -> bytes:
    """A frame of any kind, whole or damaged; a text; noise."""
    kind = draw(st.sampled_from(("v2", "v1", "signed", "unknown", "damaged", "text", "noise")))
    if kind == "text":
        return draw(st.text(max_size=40)).encode()
    if kind == "noise":
        return draw(st.binary(max_size=20) | st.lists(st.sampled_from(b"\xfd\xfe\x00\x01\x09"), max_size=20).map(bytes))
    if kind == "unknown":
        payload = draw(st.binary(min_size=1, max_size=30))
        return bytes([0xFD, len(payload), 0, 0, 7, 1, 1, 0x0F, 0xFF, 0x0F]) + payload + b"\0\0"
    signature = signing_with(bytes(range(32)), 0.0, 2e9).signature(1.0) if kind == "signed" else None
    frame = bytearray(Codec(1, 1).encode(draw(MESSAGES), signature))
    if kind == "v1":
        return as_v1(bytes(frame))
    if kind == "damaged":
        frame[draw(st.integers(0, len(frame) - 1))] ^= draw(st.integers(1, 255))
    return bytes(frame)


CUT_BEHIND_UNKNOWN = bytes.fromhex("fefc020000000101fd0000003030a0")  # as unknown, it would eat the next two bytes


@settings(deadline=None)
@example([CUT_BEHIND_UNKNOWN, Codec(1, 1).encode(HEARTBEAT)], [1])
@given(st.lists(pieces(), max_size=12), st.lists(st.integers(1, 90), min_size=1, max_size=8))
def test_the_frames_of_a_lawful_stream_are_those_of_the_plain_parser(parts: list[bytes], cuts: list[int]) -> None:
    stream, codec, plain, turn = b"".join(parts), Codec(255, 190), PlainParser(), 0
    while stream:
        size = cuts[turn % len(cuts)]
        chunk, stream, turn = stream[:size], stream[size:], turn + 1
        assert [message.raw for message in codec.decode(chunk, "serial")] == plain.feed(chunk)
    assert codec.dropped_bytes == 0


@settings(deadline=None)
@given(st.lists(pieces(), max_size=40))
def test_a_long_datagram_has_the_frames_of_the_plain_parser(parts: list[bytes]) -> None:
    assert _SCANNER.scan(b"".join(parts)).frames == PlainParser().feed(b"".join(parts))


HEADERS = st.one_of(
    st.builds(
        lambda size, flags, number: bytes([0xFD, size, flags, 0, 0, 1, 1, number, 0, 0]),
        st.integers(0, 255),
        st.sampled_from((0, 1, 1, 0xFD)),
        st.sampled_from((0, 1, 110, 248, 254)),
    ),
    st.builds(lambda size, number: bytes([0xFE, size, 0, 1, 1, number]), st.integers(0, 255), st.integers(0, 255)),
    st.sampled_from((b"\xfd", b"\xfe", b"\xfd\xfe", b"\xfe\xfd", b"\xfd\xff\x00", b"\xfd\x00\x01", b"")),
    st.binary(max_size=12),
)


@settings(deadline=None)
@given(st.lists(HEADERS, min_size=1, max_size=6), st.integers(1, 400), st.binary(max_size=30))
@example([b"\xfe"], 20_000, b"")
@example([b"\xfd"], 20_000, b"")
@example([b"\xfd\xfe"], 10_000, b"")
@example([bytes([0xFD, 255, 1, 0, 0, 1, 1, 0, 0, 0])], 3_000, b"")
@example([bytes([0xFE, 254, 0, 1, 1, 110])], 4_000, b"")
def test_the_work_is_linear_in_what_came(period: list[bytes], times: int, rest: bytes) -> None:
    data = b"".join(period) * times + rest
    found = _SCANNER.scan(data)
    assert found.work <= PER_BYTE * len(data) + FREE + LARGEST
    assert len(found.tail) < LARGEST


@pytest.mark.parametrize("octet", [0xFE, 0xFD])
def test_what_cannot_be_a_frame_costs_no_checksum(octet: int) -> None:
    found = _SCANNER.scan(bytes([octet]) * 65_000)
    assert not found.frames
    assert found.work < LARGEST
    assert len(found.tail) < 8


def test_headers_that_promise_frames_without_end_are_dropped_whole() -> None:
    codec = Codec(255, 190)
    assert codec.decode(bytes([0xFD, 255, 0, 0, 0, 1, 1, 0, 0, 0]) * 6_500, "stranger") == []
    assert codec.dropped_bytes > 50_000
    assert not codec._tails


@pytest.mark.parametrize("octet", [0xFE, 0xFD])
def test_a_good_frame_behind_a_damaged_one_full_of_markers_is_heard(octet: int) -> None:
    payload = {"target_network": 0, "target_system": 1, "target_component": 1, "payload": [octet] * 251}
    damaged = bytearray(Codec(1, 1).encode(Message("FILE_TRANSFER_PROTOCOL", payload)))
    damaged[40] ^= 1
    heard = Codec(255, 190).decode(bytes(damaged) + Codec(1, 1).encode(HEARTBEAT))
    assert [message.name for message in heard] == ["HEARTBEAT"]


@pytest.mark.parametrize("before", [b"\xfd", b"\xfd\xfd", b"\xfe\xfd", b"Q\xfd\xfe\xfd", b"\xfd" * 300])
def test_a_good_frame_right_behind_markers_is_heard(before: bytes) -> None:
    empty = Message("STATUSTEXT", {"severity": 0, "text": "", "id": 0, "chunk_seq": 0})  # of one byte, as flags are
    for message in (HEARTBEAT, empty):
        frame = Codec(1, 1).encode(message)
        assert [m.name for m in Codec(255, 190).decode(before + frame)] == [message.name]


def test_a_chunk_that_ends_where_an_unknown_frame_would_costs_no_good_one() -> None:
    stream, codec = CUT_BEHIND_UNKNOWN[-7:] + Codec(1, 1).encode(HEARTBEAT), Codec(255, 190)
    heard = codec.decode(stream[:12], "serial") + codec.decode(stream[12:], "serial")
    assert [message.name for message in heard] == ["HEARTBEAT"]


def test_the_tails_of_many_sources_are_bounded_and_the_newest_kept() -> None:
    codec, whole = Codec(255, 190), Codec(1, 1).encode(HEARTBEAT)
    for source in range(1_000):
        codec.decode(whole[:12], source)
    assert len(codec._tails) <= 64
    assert [m.name for m in codec.decode(whole[12:], 999)] == ["HEARTBEAT"]
    assert codec.decode(whole[:12], "stranger", joins=False) == []
    assert "stranger" not in codec._tails
