"""TIMESYNC: how far apart two clocks are, measured by messages there and back.

Knows: the exchange `tc1 = 0, ts1 = now`, answered by `tc1 = theirs` and `ts1` unchanged. Does not know: which
clocks. Half the round trip bounds the error of a sample, so the sample with the shortest round trip is kept.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from gcs.link.wire.message import Message, Station


class TimeSample(NamedTuple):
    """One exchange: their clock minus ours, and how long it took, in seconds."""

    offset_s: float
    round_trip_s: float


class TimeSync:
    """Exchanges with one peer; the last `kept` are remembered, so that a drifting clock is followed."""

    def __init__(self, peer: Station, *, kept: int = 10) -> None:
        self._peer = peer
        self._samples: deque[TimeSample] = deque(maxlen=kept)
        self._asked_ns: set[int] = set()

    @property
    def best(self) -> TimeSample | None:
        """The sample with the shortest round trip."""
        return min(self._samples, key=lambda sample: sample.round_trip_s, default=None)

    def request(self, now_s: float) -> Message:
        """The question to send at `now_s`."""
        asked_ns = round(now_s * 1e9)
        if len(self._asked_ns) > 64:
            self._asked_ns.clear()
        self._asked_ns.add(asked_ns)
        return Message("TIMESYNC", {"tc1": 0, "ts1": asked_ns})

    def receive(self, message: Message, now_s: float) -> None:
        """Learns from an answer to a question of ours; ignores everything else."""
        if message.name != "TIMESYNC" or not message.comes_from(self._peer):
            return
        tc1, ts1 = message.fields["tc1"], message.fields["ts1"]
        if tc1 == 0 or ts1 not in self._asked_ns:
            return
        self._asked_ns.discard(ts1)
        asked_s = ts1 / 1e9
        if now_s >= asked_s:
            self._samples.append(TimeSample(tc1 / 1e9 - (asked_s + now_s) / 2, now_s - asked_s))


def answer_timesync(message: Message, own_s: float) -> Message | None:
    """The answer to a peer's question, from our clock `own_s`; None if it asks nothing."""
    if message.name != "TIMESYNC" or message.fields["tc1"] != 0:
        return None
    return Message("TIMESYNC", {"tc1": round(own_s * 1e9), "ts1": message.fields["ts1"]})
