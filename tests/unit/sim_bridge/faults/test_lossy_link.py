"""A bad link: chances that hold, fates that do not depend on the rest of the traffic."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from sim_bridge.faults.lossy_link import OVERTAKEN_S, LinkImpairment, LossyLink, break_bits, content

FRAMES = 4000


def setpoint(n: int, codec: Codec) -> bytes:
    return codec.encode(Message("SYSTEM_TIME", {"time_unix_usec": n, "time_boot_ms": 40 * n}))


def beat(codec: Codec) -> bytes:
    fields = {"type": 6, "autopilot": 8, "base_mode": 0, "custom_mode": 0, "system_status": 4, "mavlink_version": 3}
    return codec.encode(Message("HEARTBEAT", fields))


def said(frames: list[bytes]) -> list[int]:
    return [m.fields["time_unix_usec"] for f in frames for m in Codec(9, 9).decode(f) if m.name == "SYSTEM_TIME"]


def carried(impairment: LinkImpairment, *, beats: int = 0, seed: int = 3, count: int = FRAMES) -> list[bytes]:
    """What comes of `count` frames sent at 25 Hz with other traffic among them."""
    link, codec = LossyLink(seed, 1), Codec(255, 190)
    link.impairment = impairment
    arrived = []
    for n in range(count):
        arrived += link.take(0.04 * n)
        link.put(setpoint(n, codec), 0.04 * n)
        for _ in range(beats * (n % 3)):
            link.put(beat(codec), 0.04 * n)
    return [*arrived, *link.take(1e9)]


def test_without_trouble_everything_passes_at_once():
    link, codec = LossyLink(1), Codec(255, 190)
    frames = [setpoint(n, codec) for n in range(5)]
    for frame in frames:
        link.put(frame, 1.0)
    assert list(link.take(0.99)) == []
    assert list(link.take(1.0)) == frames


@pytest.mark.parametrize("chance", [0.05, 0.2, 0.7])
def test_chances_hold(chance):
    """Within four standard deviations of a binomial."""
    width = 4.0 * (FRAMES * chance * (1.0 - chance)) ** 0.5
    assert abs(len(carried(LinkImpairment(loss=chance))) - FRAMES * (1.0 - chance)) < width
    assert abs(len(carried(LinkImpairment(duplicate=chance))) - FRAMES * (1.0 + chance)) < width
    broken = FRAMES - len(said(carried(LinkImpairment(corrupt=chance))))
    assert abs(broken - FRAMES * chance) < width
    in_turn = said(carried(LinkImpairment(reorder=chance)))
    overtaken = sum(1 for n in range(FRAMES) if n + 1 < FRAMES and in_turn.index(n) > in_turn.index(n + 1))
    assert abs(overtaken - FRAMES * chance * (1.0 - chance)) < width


def test_delay_lies_where_it_should_and_all_values_are_as_likely():
    link, codec = LossyLink(1), Codec(255, 190)
    link.impairment = LinkImpairment(delay_s=0.3, jitter_s=0.1)
    for n in range(FRAMES):
        link.put(setpoint(n, codec), 10.0)
    arrived = [len(list(link.take(10.0 + 0.01 * k))) for k in range(50)]
    assert sum(arrived[:20]) == 0
    assert sum(arrived) == FRAMES
    assert sum(arrived[41:]) == 0
    assert min(arrived[21:41]) > 0.6 * FRAMES / 20
    assert max(arrived[21:41]) < 1.4 * FRAMES / 20


def test_an_overtaken_frame_comes_after_those_that_left_within_a_tenth_of_a_second():
    link, codec = LossyLink(5), Codec(255, 190)
    link.impairment = LinkImpairment(reorder=1.0)
    link.put(setpoint(1, codec), 0.0)
    link.impairment = LinkImpairment()
    link.put(setpoint(2, codec), 0.9 * OVERTAKEN_S)
    link.put(setpoint(3, codec), 1.1 * OVERTAKEN_S)
    assert said(list(link.take(1.0))) == [2, 1, 3]


@pytest.mark.parametrize(
    "impairment",
    [
        LinkImpairment(loss=0.3),
        LinkImpairment(loss=0.1, duplicate=0.2, reorder=0.2, corrupt=0.1, delay_s=0.2, jitter_s=0.2),
    ],
)
def test_the_fate_of_a_frame_does_not_depend_on_other_traffic(impairment):
    alone = said(carried(impairment))
    assert alone != list(range(FRAMES))
    assert said(carried(impairment, beats=1)) == said(carried(impairment, beats=4)) == alone


def test_other_seeds_and_directions_have_other_fates():
    fates = [tuple(said(carried(LinkImpairment(loss=0.5), seed=seed, count=200))) for seed in range(20)]
    assert len(set(fates)) == 20


def test_what_is_said_again_has_a_new_chance():
    """A command that is repeated until it is heard must be heard some day."""
    link, codec = LossyLink(2), Codec(255, 190)
    link.impairment = LinkImpairment(loss=0.5)
    for n in range(400):
        link.put(beat(codec), float(n))
    assert 150 < len(list(link.take(1e9))) < 250


@given(st.integers(1, 30), st.floats(0, 1, exclude_max=True), st.floats(0, 1, exclude_max=True))
def test_broken_bits_are_one_to_eight_and_never_undo_each_other(size, where, bits):
    frame = bytes(range(size))
    broken = break_bits(frame, where, bits)
    turned = sum((a ^ b).bit_count() for a, b in zip(frame, broken, strict=True))
    assert turned == min(1 + int(bits * 8), 8)


def test_content_is_payload_number_and_source():
    one, other = Codec(255, 190), Codec(255, 190)
    beat(other)
    assert content(setpoint(7, one)) == content(setpoint(7, other))
    assert setpoint(7, one) != setpoint(7, other)
    assert content(setpoint(7, one)) != content(setpoint(8, one))
    assert content(setpoint(7, one)) != content(setpoint(7, Codec(254, 190)))
    v1 = bytes([0xFE, 2, 17, 255, 190, 0, 1, 2, 33, 44])
    assert content(v1) == bytes([255, 190, 0, 1, 2])


def test_a_flood_does_not_fill_the_memory():
    link, codec = LossyLink(2), Codec(255, 190)
    link.impairment = LinkImpairment(delay_s=1e6)
    frame = beat(codec)
    for _ in range(20_000):
        link.put(frame, 0.0)
    assert len(list(link.take(1e9))) == 1 << 14
