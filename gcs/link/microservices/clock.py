"""The time on board, estimated from the boot clock (time_boot_ms), GNSS unix time (SYSTEM_TIME) and local time `now_s`.

The computer's wall clock is not used: it is no reference for a simulated vehicle that runs faster than real time.
Unix time on board is `boot + offset`; each SYSTEM_TIME measures the offset to the millisecond. Samples
(now, vehicle time) are late by the delay of the link, so the earliest are the best: with the rate r estimated over the
window, `max_i (v_i + r (now - n_i))` is the time on board, up to the least delay. The estimate is never more than
`cap_s` ahead of the newest sample: if a vehicle stops reporting, its clock stops.
"""

from __future__ import annotations

import math
from collections import deque

from gcs.link.wire.message import Message

_KEPT = 24  # samples in the window
_OFFSETS = 16
_LATE_S = 0.15  # after a standstill of this program: so long messages may be those that waited to be read


class VehicleClock:
    """The clock of one vehicle. Its rate is estimated over `window_s` of local time; `cap_s` is vehicle time."""

    def __init__(self, *, cap_s: float = 0.5, window_s: float = 1.0) -> None:
        self._cap_s = cap_s
        self._window_s = window_s
        self._reset()

    def _reset(self) -> None:
        self._offsets_s: deque[float] = deque(maxlen=_OFFSETS)
        self._offset_s: float | None = None
        self._samples: deque[tuple[float, float]] = deque(maxlen=_KEPT)  # (now_s, boot_s)
        self._rate_kept: float | None = None  # of before the last standstill
        self._late_until_s = float("-inf")
        self._newest_boot_s = float("-inf")
        self._returned_boot_s = float("-inf")

    @property
    def ready(self) -> bool:
        """Whether the unix time on board is known."""
        return self._offset_s is not None and bool(self._samples)

    @property
    def rate(self) -> float:
        """Vehicle seconds per local second; 1, or that of before a standstill, until the window is a quarter full."""
        known = 1.0 if self._rate_kept is None else self._rate_kept
        if not self._samples:
            return known
        (now_0, boot_0), (now_1, boot_1) = self._samples[0], self._samples[-1]
        span_s = now_1 - now_0
        return (boot_1 - boot_0) / span_s if span_s >= self._window_s / 4 else known

    def stood_still(self, now_s: float) -> None:
        """This program stood still until `now_s`: messages that it reads now have waited, and measure no clock."""
        self._rate_kept = self.rate
        self._samples.clear()
        self._late_until_s = now_s + _LATE_S

    def receive(self, message: Message, now_s: float) -> None:
        """Take a sample from any message with time_boot_ms, and the offset from SYSTEM_TIME."""
        boot_ms = message.fields.get("time_boot_ms")
        if not boot_ms:
            return
        boot_s = boot_ms / 1e3
        if boot_s < self._newest_boot_s - 5.0:  # the vehicle rebooted: all samples are of the old clock
            self._reset()
        if message.name == "SYSTEM_TIME" and message.fields["time_unix_usec"]:
            self._learn_offset(message.fields["time_unix_usec"] / 1e6 - boot_s)
        self.sample(now_s, boot_s)

    def sample(self, now_s: float, boot_s: float) -> None:
        """Record that the boot clock read `boot_s` when a message arrived at `now_s`."""
        if boot_s <= self._newest_boot_s:
            return
        self._newest_boot_s = boot_s
        if now_s < self._late_until_s:
            return
        if not self._samples or now_s - self._samples[-1][0] >= self._window_s / _KEPT:
            self._samples.append((now_s, boot_s))

    def unix_s(self, time_boot_ms: int) -> float | None:
        """Return the GNSS unix time of a boot clock stamp; None before SYSTEM_TIME."""
        return None if self._offset_s is None else time_boot_ms / 1e3 + self._offset_s

    def boot_ms(self, unix_s: float) -> int | None:
        """Return the boot clock stamp of a unix time; None before SYSTEM_TIME."""
        return None if self._offset_s is None else round((unix_s - self._offset_s) * 1e3)

    def now_unix_s(self, now_s: float) -> float | None:
        """Return the predicted GNSS unix time on board at `now_s`; None until `ready`. It never runs back."""
        if self._offset_s is None:
            return None
        if not self._samples:
            self._returned_boot_s = max(self._returned_boot_s, self._newest_boot_s)
            return self._returned_boot_s + self._offset_s if math.isfinite(self._returned_boot_s) else None
        rate = self.rate
        ahead_s = max(boot + rate * (now_s - then) for then, boot in self._samples)
        ahead_s = max(ahead_s, self._newest_boot_s)
        self._returned_boot_s = max(self._returned_boot_s, min(ahead_s, self._newest_boot_s + self._cap_s))
        return self._returned_boot_s + self._offset_s

    def _learn_offset(self, offset_s: float) -> None:
        if self._offsets_s and abs(offset_s - self._offsets_s[-1]) > 1.0:
            self._offsets_s.clear()  # GNSS has set the vehicle's clock
        self._offsets_s.append(offset_s)
        self._offset_s = sum(self._offsets_s) / len(self._offsets_s)
