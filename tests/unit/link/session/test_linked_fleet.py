"""Which of the components that share a system id the ground station talks to, and what it says when it hears nobody."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerTimeout
from gcs.link.session.linked_fleet import LinkedFleet
from gcs.link.session.unknown_systems import LinkNotice
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from gcs.link.wire.signing import KEY_BYTES, Signature
from gcs.link.wire.signing_keys import signing_with
from gcs.mavlink import MavType
from tests.virtual_clock import VirtualLoop

ADDRESS = ("127.0.0.1", 5760)
BEAT: dict[str, Any] = {"base_mode": 1, "custom_mode": 0, "system_status": 3, "mavlink_version": 3}


def run(scene: Coroutine[Any, Any, None]) -> None:
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        runner.run(scene)


def beat(kind: int, autopilot: int, component: int) -> bytes:
    return Codec(1, component).encode(Message("HEARTBEAT", BEAT | {"type": int(kind), "autopilot": autopilot}))


@pytest.mark.parametrize("kind", [MavType.ONBOARD_CONTROLLER, MavType.GIMBAL, MavType.CAMERA, MavType.GCS])
@pytest.mark.parametrize("autopilot", [0, 3, 8])
def test_a_payload_that_is_heard_first_is_not_the_vehicle(kind: MavType, autopilot: int) -> None:
    async def scene() -> None:
        fleet = LinkedFleet("udpin:127.0.0.1:0")
        fleet._receive(0, beat(kind, autopilot, 191), ADDRESS)
        assert not fleet.sessions
        fleet._receive(0, beat(MavType.QUADROTOR, Autopilot.PX4, 1), ADDRESS)
        assert fleet.sessions[1].station == (1, 1)
        assert fleet.sessions[1].autopilot == Autopilot.PX4

    run(scene())


@pytest.mark.parametrize("signed", [True, False])
def test_a_vehicle_that_signs_and_gets_no_answer_without_a_key_is_said_to(*, signed: bool) -> None:
    async def scene() -> None:
        notices: list[LinkNotice] = []
        fleet = LinkedFleet("udpin:127.0.0.1:0", on_notice=notices.append)
        heart = Message("HEARTBEAT", BEAT | {"type": 2, "autopilot": 3})
        signature = Signature(bytes([7]) * KEY_BYTES, 0, 1 << 47) if signed else None
        fleet._receive(0, Codec(1, 1).encode(heart, signature), ADDRESS)
        session = fleet.sessions[1]
        session._send = lambda _: None
        reason = "signs its frames, and no key is set here"
        assert [notice.system for notice in notices if reason in notice.text] == [1] * signed
        for asked in (session.command(400, 1.0), session.read_parameters(["RTL_ALT"])):
            with pytest.raises(PeerTimeout) as silence:
                await asked
            assert (reason in silence.value.hint) == signed

    run(scene())


def test_frames_that_are_not_signed_with_the_key_are_said_where_nobody_is_heard() -> None:
    async def scene() -> None:
        signing = signing_with(bytes([7]) * KEY_BYTES, asyncio.get_running_loop().time())
        fleet = LinkedFleet("udpin:127.0.0.1:0", signing=signing)
        foreign = Signature(bytes([8]) * KEY_BYTES, 0, 1 << 47)
        heart = Message("HEARTBEAT", BEAT | {"type": 2, "autopilot": 3})
        for frame in (beat(2, 3, 1), Codec(1, 1).encode(heart, foreign)):
            fleet._receive(0, frame, ADDRESS)
        with pytest.raises(PeerTimeout, match="2 frames were not signed with our key"):
            await fleet.vehicles([1], 1.0)
        with pytest.raises(PeerTimeout, match="2 frames were not signed with our key"):
            await fleet.vehicles_left({1: 3}, 1.0, settle_s=1.0)

    run(scene())
