"""The reasons of a vehicle that is not ready, as each autopilot words them."""

from __future__ import annotations

import pytest

from gcs.autopilots.traits import Autopilot, link_behaviour
from gcs.link.protocols.statustext import VehicleTexts
from gcs.link.wire.message import Message


def say(texts: VehicleTexts, text: str, now_s: float, number: int = 0, part: int = 0) -> None:
    texts.receive(Message("STATUSTEXT", {"severity": 2, "text": text, "id": number, "chunk_seq": part}, 1, 1), now_s)


@pytest.mark.parametrize(
    ("autopilot", "reason"),
    [(Autopilot.ARDUPILOT, "PreArm: Need Position Estimate"), (Autopilot.PX4, "Preflight Fail: Accel 0 uncalibrated")],
)
def test_reasons_since_a_time_are_told_once(autopilot: Autopilot, reason: str) -> None:
    texts = VehicleTexts(link_behaviour(autopilot).startup_texts)
    say(texts, f"{reason} long ago", 1.0)
    for now_s in (40.0, 45.0):
        say(texts, reason, now_s)
        say(texts, "EKF3 IMU0 is using GPS", now_s)
    assert texts.startup(10.0) == (reason,)
    assert texts.startup(46.0) == ()


def test_a_reason_in_two_chunks_is_one() -> None:
    texts = VehicleTexts(link_behaviour(Autopilot.PX4).startup_texts)
    whole = "Preflight Fail: Compass inconsistent with the others, calibrate it"
    say(texts, whole[:50], 1.0, 7, 0)
    say(texts, whole[50:], 1.1, 7, 1)
    assert texts.startup(0.0) == (whole,)
    assert VehicleTexts(()).startup(0.0) == ()
