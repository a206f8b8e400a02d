"""A vehicle's clock for others, and its trust."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message, Station
from gcs.link.wire.signing import TICKS_PER_S, Signature
from sim_bridge.fleet import plain_scenario
from sim_bridge.personality import ARDUPILOT, PX4, Personality
from sim_bridge.protocol.conversation import Conversation, TimesyncResponder
from sim_bridge.sim.vehicle_factory import VehicleFactory

ME = Station(3, 1)
KEY = bytes(range(32))
NOON = 37_519_421_111_903
S = 1_000_000_000


def asked(ts1: int = 17) -> Message:
    return Message("TIMESYNC", {"tc1": 0, "ts1": ts1}, 255, 190)


def set_up(key: bytes = KEY, ticks: int = NOON) -> Message:
    fields = {"target_system": 3, "target_component": 1, "secret_key": list(key), "initial_timestamp": ticks}
    return Message("SETUP_SIGNING", fields, 255, 190)


def came(message: Message, signature: Signature | None = None) -> Message:
    """A message as it came over the wire."""
    (message,) = Codec(3, 1).decode(Codec(255, 190).encode(message, signature))
    return message


@pytest.mark.parametrize(("personality", "step_ns"), [(ARDUPILOT, 1_000), (PX4, 4_000_000)], ids=["ardupilot", "px4"])
@given(t_ns=st.integers(1, 10**15))
def test_the_clock_goes_on_in_the_originals_steps(personality, step_ns, t_ns):
    (answer,) = TimesyncResponder(personality.replies, ME).receive(asked(), t_ns)
    assert answer.fields["ts1"] == 17
    assert answer.fields["tc1"] % step_ns == 0
    assert 0 <= t_ns - answer.fields["tc1"] < step_ns


def test_answers_are_not_answered():
    answer = Message("TIMESYNC", {"tc1": 5, "ts1": 17}, 255, 190)
    assert TimesyncResponder(ARDUPILOT.replies, ME).receive(answer, S) == []


def test_ardupilot_asks_every_ten_seconds_px4_never():
    asks = TimesyncResponder(ARDUPILOT.replies, ME)
    questions = [(t, m.fields) for t in range(5, 40) for m in asks.due(t * S)]
    assert [t for t, _ in questions] == [15, 25, 35]
    assert questions[0][1] == {"tc1": 0, "ts1": 15 * S + 3}
    never = TimesyncResponder(PX4.replies, ME)
    assert [m for t in range(100) for m in never.due(t * S)] == []


def vehicle(personality: Personality) -> Conversation:
    return VehicleFactory(plain_scenario(ME.sysid), personality, 1, 1.8e9).vehicle(ME.sysid - 1)


def believes(trusting: Conversation, signature: Signature | None, now_s: float) -> bool:
    """Whether a question with this signature is answered."""
    return bool(trusting.receive(came(asked(), signature), now_s))


def test_after_set_up_only_signed_messages_are_heard_and_all_are_signed():
    trusting = vehicle(ARDUPILOT)
    assert believes(trusting, None, 0.0)
    assert trusting.signature(0.0) is None
    trusting.receive(came(set_up()), 0.0)
    assert not believes(trusting, None, 1.0)
    assert not believes(trusting, Signature(bytes(32), 0, NOON + 1), 1.0)
    assert not believes(trusting, Signature(KEY, 0, NOON - 61 * TICKS_PER_S), 1.0)
    assert believes(trusting, Signature(KEY, 0, NOON + 1), 1.0)
    signature = trusting.signature(1.0)
    assert signature is not None
    assert signature.key == KEY


def test_a_key_of_zeros_switches_it_off():
    trusting = vehicle(ARDUPILOT)
    trusting.receive(came(set_up()), 0.0)
    trusting.receive(came(set_up(bytes(32), 0), Signature(KEY, 0, NOON + 1)), 1.0)
    assert believes(trusting, None, 1.0)
    assert trusting.signature(1.0) is None


def test_nobody_changes_the_key_of_a_vehicle_that_is_armed():
    trusting = vehicle(ARDUPILOT)
    trusting.autopilot.arming.arm(0.0)
    trusting.receive(came(set_up()), 0.0)
    assert trusting.signature(0.0) is None


def test_a_key_of_another_length_is_none():
    trusting = vehicle(ARDUPILOT)
    trusting.receive(set_up(b"short"), 0.0)
    assert trusting.signature(0.0) is None


def test_px4_does_not_know_it():
    trusting = vehicle(PX4)
    trusting.receive(came(set_up()), 0.0)
    assert trusting.signature(0.0) is None
    assert believes(trusting, None, 0.0)
