"""TIMESYNC (https://mavlink.io/en/services/timesync.html): the offset between two clocks, measured by round trips.

We send `tc1 = 0, ts1 = now`; the vehicle answers with `tc1` = its time and `ts1` unchanged. Half the round trip bounds
the error of a sample, so the sample with the shortest round trip is used.
"""

from collections import deque
from typing import NamedTuple

from gcs.link.wire.message import Message, Station


class TimeSample(NamedTuple):
    """One exchange: the vehicle's clock minus ours, and the round trip, in seconds."""

    offset_s: float
    round_trip_s: float


class TimeSync:
    """Exchanges with one vehicle. The last `kept` samples count, so that a drifting clock is followed."""

    def __init__(self, peer: Station, *, kept: int = 10) -> None:
        self._peer = peer
        self._samples: deque[TimeSample] = deque(maxlen=kept)
        self._sent_ns: set[int] = set()

    @property
    def best(self) -> TimeSample | None:
        """The sample with the shortest round trip."""
        return min(self._samples, key=lambda sample: sample.round_trip_s, default=None)

    def request(self, now_s: float) -> Message:
        """Return the request to send at `now_s`."""
        sent_ns = round(now_s * 1e9)
        if len(self._sent_ns) > 64:
            self._sent_ns.clear()
        self._sent_ns.add(sent_ns)
        return Message("TIMESYNC", {"tc1": 0, "ts1": sent_ns})

    def receive(self, message: Message, now_s: float) -> None:
        """Take a sample from an answer to our request; ignore all other messages."""
        if message.name != "TIMESYNC" or not message.comes_from(self._peer):
            return
        tc1, ts1 = message.fields["tc1"], message.fields["ts1"]
        if tc1 == 0 or ts1 not in self._sent_ns:
            return
        self._sent_ns.discard(ts1)
        sent_s = ts1 / 1e9
        if now_s >= sent_s:
            self._samples.append(TimeSample(tc1 / 1e9 - (sent_s + now_s) / 2, now_s - sent_s))


def ping_answers(message: Message) -> list[Message]:
    """PING (https://mavlink.io/en/services/ping.html): a vehicle asks whether the station has read up to here.

    Return the answer to a request, which has no address; none to an answer.
    """
    fields = message.fields
    if fields["target_system"] or fields["target_component"]:
        return []
    return [Message("PING", {"time_usec": fields["time_usec"], "seq": fields["seq"]} | message.source.target)]
