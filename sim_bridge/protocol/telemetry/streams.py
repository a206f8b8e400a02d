"""Message rates: which messages a vehicle can send, and which are due, in simulated time."""

import math

from gcs.link.wire.message import Message
from gcs.mavlink import MessageId
from sim_bridge.protocol.telemetry import identity, motion, vitals
from sim_bridge.protocol.telemetry.instruments import Builder, Sources

_LONGEST_US = 2**31 - 1  # the largest interval that MESSAGE_INTERVAL can hold
_BUILDERS: dict[MessageId, Builder] = {**vitals.BUILDERS, **motion.BUILDERS, **identity.BUILDERS}
_NAMES: dict[int, str] = {number: number.name for number in _BUILDERS}
_SAME_S = 1e-6
_FAST_S = 0.2
_LATER_S = 1e12  # after any flight
_ALL_GROUPS = 0  # REQUEST_DATA_STREAM's id for every group


class Telemetry:
    """Builds messages, and decides which are due."""

    def __init__(self, sources: Sources) -> None:
        self.sources = sources
        self._streams = sources.personality.streams
        self._known: dict[int, Builder] = {n: build for n, build in _BUILDERS.items() if n not in self._streams.unsent}
        self._interval_s: dict[int, float] = {number: 1.0 / hz for number, hz in self._streams.unasked_hz.items()}
        self._due_s: dict[int, float] = {}
        self._next_s = -math.inf
        self._sent_contents: dict[int, int] = {}  # which contents of a message were sent last

    def due(self, t_s: float) -> list[Message]:
        """Return the messages that are due."""
        if t_s < self._next_s - _SAME_S:
            return []
        if math.isinf(self._next_s):
            self._switch_on(t_s)
        messages = []
        for number, due_s in self._due_s.items():
            if due_s <= t_s + _SAME_S:
                self._due_s[number] = max(due_s + self._given_s(self._interval_s[number]), t_s)
                message = self._message(number) if number not in self._streams.mute else None
                if message is not None:
                    messages.append(message)
                    if number in self._streams.contents_s:
                        self._sent_contents[number] = self._contents(number)
        self._next_s = min(self._due_s.values(), default=_LATER_S)
        return messages

    def _message(self, number: int) -> Message | None:
        fields = self._known[number](self.sources) if number in self._known else None
        return None if fields is None else Message(_NAMES[number], fields)

    def build(self, *numbers: int) -> list[Message]:
        """Return these messages as of now, without those that are unknown or have no data yet."""
        return [message for message in map(self._message, numbers) if message is not None]

    def has_newer(self, number: int) -> bool:
        """Whether a message has other contents than the last one of it that was sent."""
        return number not in self._streams.contents_s or self._contents(number) != self._sent_contents.get(number)

    def build_requested(self, number: int) -> list[Message]:
        """Return message `number` as of now, if it has data, and count it as sent."""
        built = self.build(number)
        if built and number in self._streams.contents_s:
            self._sent_contents[number] = self._contents(number)
        return built

    def knows(self, number: int) -> bool:
        """Whether the vehicle can send message `number`."""
        return number in self._known

    def streams(self, number: int) -> bool:
        """Whether the rate of message `number` can be changed."""
        return self.knows(number) and number not in self._streams.fixed

    def interval_us(self, number: int) -> int:
        """Return the value of MESSAGE_INTERVAL: microseconds, -1 if the message is not streamed."""
        return round(self._interval_s[number] * 1e6) if number in self._interval_s else -1

    def set_interval(self, number: int, interval_us: float) -> None:
        """Send message `number` at this interval; below 0 never, 0 at the autopilot's default."""
        self._interval_s.pop(number, None)
        self._due_s.pop(number, None)
        if interval_us == 0.0 and self._streams.default_hz:
            interval_us = 1e6 / self._streams.default_hz
        if interval_us > 0:
            self._interval_s[number] = min(interval_us, _LONGEST_US) / 1e6
            self._due_s[number] = t_s = self.sources.instruments.t_s
            self._next_s = min(self._next_s, t_s)

    def set_group(self, group: int, rate_hz: float) -> None:
        """REQUEST_DATA_STREAM: send a group of messages at this rate, 0 for never."""
        groups = self._streams.groups
        numbers = groups.get(group, frozenset()) if group != _ALL_GROUPS else frozenset().union(*groups.values())
        for number in sorted(numbers):
            self.set_interval(number, 1e6 / rate_hz if rate_hz > 0.0 else -1.0)

    def _contents(self, number: int) -> int:
        """Return the number of a message's contents, counted by the boot clock, which differs between vehicles."""
        return int(self.sources.instruments.boot_ms / (1000.0 * self._streams.contents_s[number]))

    def _given_s(self, interval_s: float) -> float:
        return interval_s if interval_s >= _FAST_S else interval_s / self._streams.fast_share

    def _switch_on(self, t_s: float) -> None:
        """Schedule every message for the first time after its own interval."""
        for number, interval_s in self._interval_s.items():
            self._due_s.setdefault(number, t_s + self.sources.personality.boot.pace * interval_s)
