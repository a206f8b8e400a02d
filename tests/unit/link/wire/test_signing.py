"""Signed frames, against the signing of the library that others use."""

from __future__ import annotations

import logging

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from gcs.link.wire.signing import EPOCH_UNIX_S, TICKS_PER_S, Signature, Signing, is_signed

KEY = bytes(range(32))
OTHER = bytes(range(1, 33))
NOON = 37_519_421_111_903  # some day, in ticks
BEAT = Message(
    "HEARTBEAT",
    {"type": 2, "autopilot": 3, "base_mode": 0, "custom_mode": 0, "system_status": 3, "mavlink_version": 3},
)


def frame(key: bytes = KEY, ticks: int = NOON, *, link_id: int = 7, sysid: int = 255) -> bytes:
    return Codec(sysid, 190).encode(BEAT, Signature(key, link_id, ticks))


def keyed() -> Signing:
    signing = Signing()
    signing.set_up(KEY, NOON, 100.0)
    return signing


def other_implementation(key: bytes, ticks: int) -> dialect.MAVLink:
    mav = dialect.MAVLink(None, 255, 190)
    mav.signing.secret_key, mav.signing.timestamp, mav.signing.sign_outgoing = key, ticks, True
    return mav


def test_others_believe_our_signature_and_not_one_bit_less():
    data = bytearray(frame())
    assert is_signed(bytes(data))
    assert other_implementation(KEY, NOON).decode(data).get_type() == "HEARTBEAT"
    assert data[-13] == 7
    data[-1] ^= 1
    with pytest.raises(dialect.MAVError):
        other_implementation(KEY, NOON).decode(data)


def test_we_believe_what_others_sign():
    signed = other_implementation(KEY, NOON).heartbeat_encode(6, 8, 0, 0, 4).pack(other_implementation(KEY, NOON + 5))
    assert keyed().accepts(signed, 100.0)
    assert not keyed().accepts(
        other_implementation(OTHER, NOON).heartbeat_encode(6, 8, 0, 0, 4).pack(other_implementation(OTHER, NOON)), 100.0
    )


def test_a_signed_frame_is_a_message_like_any_other():
    (message,) = Codec(1, 1).decode(frame())
    assert message == Message(BEAT.name, BEAT.fields, 255, 190)


def test_the_codec_signs_only_what_it_is_told_to_sign():
    codec = Codec(1, 1)
    assert is_signed(codec.encode(BEAT, Signature(KEY, 0, NOON)))
    assert not is_signed(codec.encode(BEAT))


def test_without_a_key_everything_is_believed_and_nothing_signed():
    signing = Signing()
    assert not signing.on
    assert signing.accepts(Codec(255, 190).encode(BEAT), 0.0)
    assert signing.accepts(frame(OTHER), 0.0)
    assert signing.signature(0.0) is None


def test_with_a_key_only_it_is_believed():
    signing = keyed()
    assert signing.on
    assert not signing.accepts(Codec(255, 190).encode(BEAT), 100.0)
    assert not signing.accepts(b"", 100.0)
    assert not signing.accepts(frame(OTHER), 100.0)
    assert signing.accepts(frame(), 100.0)


def test_time_goes_forward_for_each_sender_by_itself():
    signing = keyed()
    assert signing.accepts(frame(ticks=NOON), 100.0)
    assert not signing.accepts(frame(ticks=NOON), 100.0)
    assert not signing.accepts(frame(ticks=NOON - 1), 100.0)
    assert signing.accepts(frame(ticks=NOON + 1), 100.0)
    assert signing.accepts(frame(ticks=NOON, link_id=8), 100.0)
    assert signing.accepts(frame(ticks=NOON, sysid=254), 100.0)


def test_who_was_never_heard_may_be_a_minute_behind():
    minute = 60 * TICKS_PER_S
    assert keyed().accepts(frame(ticks=NOON - minute + 1), 100.0)
    assert not keyed().accepts(frame(ticks=NOON - minute), 100.0)
    assert not keyed().accepts(frame(ticks=NOON), 161.0)  # its own clock has gone on


def test_a_false_frame_does_not_silence_the_true_one():
    signing = keyed()
    assert not signing.accepts(frame(OTHER, NOON + 10**9), 100.0)
    assert signing.accepts(frame(ticks=NOON), 100.0)


def test_own_signatures_never_repeat_a_time_and_follow_the_clock():
    signing = keyed()
    ticks = [signing.signature(now_s).ticks for now_s in (100.0, 100.0, 101.0, 100.5)]
    assert ticks == sorted(set(ticks))
    assert ticks[2] >= NOON + TICKS_PER_S
    signing.accepts(frame(ticks=NOON + 10**7), 101.0)
    assert signing.signature(101.0).ticks > NOON + 10**7


def test_a_key_of_zeros_switches_signing_off():
    signing = keyed()
    signing.set_up(bytes(32), 0, 101.0)
    assert not signing.on
    assert signing.accepts(Codec(255, 190).encode(BEAT), 101.0)


def test_keys_are_not_shown(caplog):
    caplog.set_level(logging.DEBUG)
    signing = keyed()
    signing.accepts(frame(OTHER), 100.0)
    shown = f"{Signature(KEY, 0, NOON)!r} {signing!r} {caplog.text}"
    assert "key" not in shown
    assert KEY.hex() not in shown
    assert repr(KEY) not in shown


def test_the_epoch_is_2015():
    assert EPOCH_UNIX_S == 45 * 365 * 86_400 + 11 * 86_400
