"""What time is it on board? Three clocks brought together.

Knows: the vehicle's boot clock (time_boot_ms), GNSS unix time (SYSTEM_TIME), the local monotonic `now_s`.
Does not know: the wall clock, which says nothing about a simulated vehicle that runs faster than real time.

Unix time on board is `boot + offset`; each SYSTEM_TIME measures the offset to the millisecond. Samples
(now, vehicle time) lie late by the link's delay, so the earliest ones are the best: with the rate r estimated
over the window, `max_i (v_i + r (now - n_i))` is the time on board, up to the least delay. It is never more
than `cap_s` ahead of the newest sample: a vehicle that stops reporting stops the clock.
"""

from __future__ import annotations

from collections import deque

from gcs.link.wire.message import Message

_KEPT = 24  # samples in the window
_OFFSETS = 16


class VehicleClock:
    """One vehicle's clock. `window_s` (local time) is what its rate is estimated over; `cap_s` is vehicle time."""

    def __init__(self, *, cap_s: float = 0.5, window_s: float = 1.0) -> None:
        self._cap_s = cap_s
        self._window_s = window_s
        self._reset()

    def _reset(self) -> None:
        self._offsets_s: deque[float] = deque(maxlen=_OFFSETS)
        self._offset_s: float | None = None
        self._samples: deque[tuple[float, float]] = deque(maxlen=_KEPT)  # (now_s, boot_s)
        self._newest_boot_s = float("-inf")
        self._said_boot_s = float("-inf")

    @property
    def ready(self) -> bool:
        """Whether unix time on board is known."""
        return self._offset_s is not None and bool(self._samples)

    @property
    def rate(self) -> float:
        """Vehicle seconds per local second; 1 until it is known better."""
        if not self._samples:
            return 1.0
        (now_0, boot_0), (now_1, boot_1) = self._samples[0], self._samples[-1]
        span_s = now_1 - now_0
        return (boot_1 - boot_0) / span_s if span_s >= self._window_s / 4 else 1.0

    def receive(self, message: Message, now_s: float) -> None:
        """Learns from any message that carries time_boot_ms, and from SYSTEM_TIME."""
        boot_ms = message.fields.get("time_boot_ms")
        if not boot_ms:
            return
        boot_s = boot_ms / 1e3
        if boot_s < self._newest_boot_s - 5.0:  # it rebooted: everything known is about another clock
            self._reset()
        if message.name == "SYSTEM_TIME" and message.fields["time_unix_usec"]:
            self._learn_offset(message.fields["time_unix_usec"] / 1e6 - boot_s)
        self.sample(now_s, boot_s)

    def sample(self, now_s: float, boot_s: float) -> None:
        """Notes that the boot clock read `boot_s` when a message arrived at `now_s`."""
        if boot_s <= self._newest_boot_s:
            return
        self._newest_boot_s = boot_s
        if not self._samples or now_s - self._samples[-1][0] >= self._window_s / _KEPT:
            self._samples.append((now_s, boot_s))

    def unix_s(self, time_boot_ms: int) -> float | None:
        """GNSS unix time of an instant stamped with the boot clock; None before SYSTEM_TIME."""
        return None if self._offset_s is None else time_boot_ms / 1e3 + self._offset_s

    def boot_ms(self, unix_s: float) -> int | None:
        """The boot clock's reading at a unix time; None before SYSTEM_TIME."""
        return None if self._offset_s is None else round((unix_s - self._offset_s) * 1e3)

    def now_unix_s(self, now_s: float) -> float | None:
        """GNSS unix time on board at local time `now_s`, predicted; never runs back. None until `ready`."""
        if self._offset_s is None or not self._samples:
            return None
        rate = self.rate
        ahead_s = max(boot + rate * (now_s - then) for then, boot in self._samples)
        ahead_s = max(ahead_s, self._newest_boot_s)
        self._said_boot_s = max(self._said_boot_s, min(ahead_s, self._newest_boot_s + self._cap_s))
        return self._said_boot_s + self._offset_s

    def _learn_offset(self, offset_s: float) -> None:
        if self._offsets_s and abs(offset_s - self._offsets_s[-1]) > 1.0:
            self._offsets_s.clear()  # GNSS set its clock
        self._offsets_s.append(offset_s)
        self._offset_s = sum(self._offsets_s) / len(self._offsets_s)
