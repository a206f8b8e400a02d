"""Words for modes and versions, and the share of frames that are lost."""

import random

import pytest

from gcs.autopilots.traits import Autopilot, autopilot_name, mode_name
from gcs.link.session.status_report import version_text
from gcs.link.wire.codec import Codec
from gcs.link.wire.frame_scanner import LinkQuality
from gcs.link.wire.message import Message


@pytest.mark.parametrize(
    ("autopilot", "custom_mode", "name"),
    [
        (3, 4, "GUIDED"),
        (3, 3, "AUTO"),
        (3, 99, "mode 99"),
        (12, 6 << 16, "OFFBOARD"),
        (12, 4 << 16 | 4 << 24, "MISSION"),
        (12, 14 << 16, "mode 14.0"),
        (0, 5, "mode 5"),
    ],
)
def test_modes_have_names(autopilot, custom_mode, name):
    assert mode_name(autopilot, custom_mode) == name


def test_autopilots_have_names():
    assert [autopilot_name(n) for n in (3, 12, 77)] == ["ArduCopter", "PX4", "autopilot 77"]


def test_versions():
    assert version_text(0x040506FF) == "4.5.6"
    assert version_text(0x01110040) == "1.17.0-alpha"


@pytest.mark.parametrize(("flags", "good"), [(0x33F, True), (0xA7, False), (0x33F | 0x80, False), (0x400, False)])
def test_ardupilot_filter_flags_as_recorded(flags, good):
    assert Autopilot.ARDUPILOT.traits.link.estimator.is_ready("EKF_STATUS_REPORT", {"flags": flags}) is good


@pytest.mark.parametrize(("flags", "good"), [(1023, True), (229, False)])
def test_px4_filter_flags_as_recorded(flags, good):
    assert Autopilot.PX4.traits.link.estimator.is_ready("ESTIMATOR_STATUS", {"flags": flags}) is good


def frames(count):
    codec = Codec(1, 1)
    return [codec.encode(Message("MISSION_CURRENT", {"seq": 0})) for _ in range(count)]


def test_lost_frames_are_counted_across_the_end_of_numbers():
    quality = LinkQuality()
    assert quality.loss is None
    kept = [frame for n, frame in enumerate(frames(1000)) if n % 4]
    for frame in kept:
        quality.receive(frame)
    assert quality.loss == pytest.approx(0.25, abs=0.002)


def test_order_does_not_matter_to_the_share():
    shuffled, rng = frames(600), random.Random(1)
    for n in range(0, 600, 10):
        part = shuffled[n : n + 5]
        rng.shuffle(part)
        shuffled[n : n + 5] = part
    quality = LinkQuality()
    for frame in shuffled:
        quality.receive(frame)
    assert quality.loss == pytest.approx(0.0, abs=0.02)


def test_a_radio_that_repeats_frames_hides_no_loss() -> None:
    quality = LinkQuality()
    for number in range(0, 200, 2):
        for _ in range(3):
            quality.receive(bytes((0xFD, 0, 0, 0, number)))
    assert quality.loss == pytest.approx(0.5, abs=0.01)


def test_the_modes_of_a_plane_are_not_named_as_a_copters() -> None:
    assert mode_name(3, 4, 2) == "GUIDED"
    assert mode_name(3, 4, 1) == "mode 4"  # ACRO
