from hypothesis import given
from hypothesis import strategies as st

from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message

NUMBER = st.floats(width=32, allow_nan=False)
MESSAGES = st.one_of(
    st.builds(
        lambda t, v: Message(
            "ATTITUDE",
            dict(zip(("time_boot_ms", "roll", "pitch", "yaw"), (t, *v[:3]), strict=True))
            | dict(zip(("rollspeed", "pitchspeed", "yawspeed"), v[3:], strict=True)),
        ),
        st.integers(0, 2**32 - 1),
        st.tuples(*[NUMBER] * 6),
    ),
    st.builds(
        lambda s, t: Message("STATUSTEXT", {"severity": s, "text": t, "id": 0, "chunk_seq": 0}),
        st.integers(0, 7),
        st.text(st.characters(exclude_characters="\0", exclude_categories=("Cs",)), max_size=12),
    ),
    st.builds(
        lambda c: Message("MISSION_COUNT", {"target_system": 1, "target_component": 1, "count": c, "mission_type": 0}),
        st.integers(0, 65535),
    ),
)


def same(received, sent):
    return received.name == sent.name and all(received.fields[k] == v for k, v in sent.fields.items())


@given(st.lists(MESSAGES, max_size=6))
def test_round_trip_of_datagrams_with_several_frames(messages):
    vehicle = Codec(1, 1)
    received = Codec(255, 190).decode(b"".join(vehicle.encode(m) for m in messages))
    assert len(received) == len(messages)
    assert all(same(r, m) for r, m in zip(received, messages, strict=True))


@given(st.lists(st.binary(max_size=400), max_size=4))
def test_garbage_never_raises_and_a_good_frame_after_it_is_heard(chunks):
    codec = Codec(255, 190)
    for chunk in chunks:
        codec.decode(chunk)
    count = Message("MISSION_COUNT", {"target_system": 1, "target_component": 1, "count": 3, "mission_type": 0})
    assert any(same(m, count) for m in codec.decode(Codec(1, 1).encode(count)))


@given(st.lists(MESSAGES, min_size=1, max_size=5), st.data())
def test_one_damaged_frame_costs_one_message(messages, data):
    vehicle = Codec(1, 1)
    frames = [bytearray(vehicle.encode(m)) for m in messages]
    victim = data.draw(st.integers(0, len(frames) - 1))
    position = data.draw(st.integers(0, len(frames[victim]) - 1))
    frames[victim][position] ^= data.draw(st.integers(1, 255))
    received = Codec(255, 190).decode(b"".join(map(bytes, frames)))
    expected = [m for n, m in enumerate(messages) if n != victim]
    assert len(received) == len(expected)
    assert all(same(r, m) for r, m in zip(received, expected, strict=True))


@given(st.lists(MESSAGES, min_size=1, max_size=4), st.lists(st.integers(1, 30), min_size=1))
def test_a_stream_cut_anywhere_loses_nothing(messages, cuts):
    vehicle = Codec(1, 1)
    stream = b"".join(vehicle.encode(m) for m in messages)
    codec, received, turn = Codec(255, 190), [], 0
    while stream:
        size = cuts[turn % len(cuts)]
        received += codec.decode(stream[:size], "serial")
        stream, turn = stream[size:], turn + 1
    assert [m.name for m in received] == [m.name for m in messages]
