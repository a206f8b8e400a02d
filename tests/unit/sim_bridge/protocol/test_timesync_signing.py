"""A vehicle's clock for others, and its trust."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message, Station
from gcs.link.wire.signing import TICKS_PER_S, Signature
from sim_bridge.personality import ARDUPILOT, PX4
from sim_bridge.protocol.conversation import SigningState, TimesyncResponder

ME = Station(3, 1)
KEY = bytes(range(32))
NOON = 37_519_421_111_903
S = 1_000_000_000


def asked(ts1: int = 17) -> Message:
    return Message("TIMESYNC", {"tc1": 0, "ts1": ts1}, 255, 190)


def set_up(key: bytes = KEY, ticks: int = NOON) -> Message:
    fields = {"target_system": 3, "target_component": 1, "secret_key": list(key), "initial_timestamp": ticks}
    return Message("SETUP_SIGNING", fields, 255, 190)


def came(signature: Signature | None) -> Message:
    """A question as it came over the wire."""
    (message,) = Codec(3, 1).decode(Codec(255, 190).encode(asked(), signature))
    return message


@pytest.mark.parametrize(("personality", "step_ns"), [(ARDUPILOT, 1_000), (PX4, 4_000_000)], ids=["ardupilot", "px4"])
@given(t_ns=st.integers(1, 10**15))
def test_the_clock_goes_on_in_the_originals_steps(personality, step_ns, t_ns):
    (answer,) = TimesyncResponder(personality.link, ME).receive(asked(), t_ns)
    assert answer.fields["ts1"] == 17
    assert answer.fields["tc1"] % step_ns == 0
    assert 0 <= t_ns - answer.fields["tc1"] < step_ns


def test_answers_are_not_answered():
    answer = Message("TIMESYNC", {"tc1": 5, "ts1": 17}, 255, 190)
    assert TimesyncResponder(ARDUPILOT.link, ME).receive(answer, S) == []


def test_ardupilot_asks_every_ten_seconds_px4_never():
    asks = TimesyncResponder(ARDUPILOT.link, ME)
    questions = [(t, m.fields) for t in range(5, 40) for m in asks.due(t * S)]
    assert [t for t, _ in questions] == [15, 25, 35]
    assert questions[0][1] == {"tc1": 0, "ts1": 15 * S + 3}
    never = TimesyncResponder(PX4.link, ME)
    assert [m for t in range(100) for m in never.due(t * S)] == []


def test_after_set_up_only_signed_messages_are_heard_and_all_are_signed():
    trust = SigningState(ARDUPILOT.link)
    assert trust.believes(came(None), 0.0)
    assert trust.signature(0.0) is None
    trust.set_up(set_up(), 0.0, armed=False)
    assert not trust.believes(came(None), 1.0)
    assert not trust.believes(came(Signature(bytes(32), 0, NOON + 1)), 1.0)
    assert not trust.believes(came(Signature(KEY, 0, NOON - 61 * TICKS_PER_S)), 1.0)
    assert trust.believes(came(Signature(KEY, 0, NOON + 1)), 1.0)
    signature = trust.signature(1.0)
    assert signature is not None
    assert signature.key == KEY


def test_a_key_of_zeros_switches_it_off():
    trust = SigningState(ARDUPILOT.link)
    trust.set_up(set_up(), 0.0, armed=False)
    trust.set_up(set_up(bytes(32), 0), 1.0, armed=False)
    assert trust.believes(came(None), 1.0)
    assert trust.signature(1.0) is None


def test_nobody_changes_the_key_of_a_vehicle_that_is_armed():
    trust = SigningState(ARDUPILOT.link)
    trust.set_up(set_up(), 0.0, armed=True)
    assert trust.signature(0.0) is None


def test_a_key_of_another_length_is_none():
    trust = SigningState(ARDUPILOT.link)
    trust.set_up(set_up(b"short"), 0.0, armed=False)
    assert trust.signature(0.0) is None


def test_px4_does_not_know_it():
    trust = SigningState(PX4.link)
    trust.set_up(set_up(), 0.0, armed=False)
    assert trust.signature(0.0) is None
    assert trust.believes(came(None), 0.0)
