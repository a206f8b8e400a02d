from gcs.link.protocols.statustext import StatusText, StatusTextJoiner
from gcs.link.wire.message import Message, Station

LONG = "Preflight Fail: " + "x" * 34 + "Check mag calibration"
PARTS = (LONG[:50], LONG[50:])


def chunk(text, seq, number=5, sysid=1):
    return Message("STATUSTEXT", {"severity": 4, "text": text, "id": number, "chunk_seq": seq}, sysid, 1)


def test_short_texts_pass():
    assert StatusTextJoiner().receive(chunk("hello", 0, number=0), 0.0) == [StatusText(Station(1, 1), 4, "hello")]


def test_chunks_are_joined_in_any_order_and_per_source():
    for order in ((0, 1), (1, 0)):
        joiner = StatusTextJoiner()
        assert joiner.receive(chunk(PARTS[order[0]], order[0]), 0.0) == []
        assert joiner.receive(chunk(PARTS[order[1]], order[1], sysid=2), 0.0) == []
        assert [t.text for t in joiner.receive(chunk(PARTS[order[1]], order[1]), 0.1)] == [LONG]


def test_a_missing_chunk_is_shown_as_missing():
    joiner = StatusTextJoiner(timeout_s=2.0)
    joiner.receive(chunk(PARTS[1], 1), 0.0)
    joiner.receive(chunk(PARTS[0], 0, number=6), 1.0)
    assert joiner.deadline_s == 2.0
    assert [t.text for t in joiner.tick(2.0)] == ["[...]" + PARTS[1]]
    assert [t.text for t in joiner.tick(3.0)] == [PARTS[0] + "[...]"]
    assert joiner.deadline_s is None


def test_a_doubled_chunk_is_no_text_of_its_own():
    joiner = StatusTextJoiner(timeout_s=2.0)
    joiner.receive(chunk(PARTS[0], 0), 0.0)
    assert [t.text for t in joiner.receive(chunk(PARTS[1], 1), 0.1)] == [LONG]
    assert joiner.receive(chunk(PARTS[1], 1), 0.2) == []
    assert joiner.receive(chunk(PARTS[0], 0), 0.3) == []
    assert joiner.tick(10.0) == []
    assert [t.text for t in joiner.receive(chunk("after a reboot", 0), 10.0)] == ["after a reboot"]
