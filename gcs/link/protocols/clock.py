"""The time on board, estimated from the boot clock (time_boot_ms), GNSS unix time (SYSTEM_TIME) and local time `now_s`.

The computer's wall clock is not used: it is no reference for a simulated vehicle that runs faster than real time.
Unix time on board is `boot + offset`; each SYSTEM_TIME measures the offset to the millisecond. Samples
(now, vehicle time) are late by the delay of the link, so the earliest are the best: with the rate r estimated over the
window, `max_i (v_i + r (now - n_i))` is the time on board, up to the least delay. The estimate is never more than
`cap_s` ahead of the newest sample: if a vehicle stops reporting, its clock stops.

A clock that is held follows its boot clock: it corrects its offset slowly, and does not follow a jump of GNSS time.
What is not plausible is dropped: unix times outside 2010 to 2100, and a single boot time that runs back or far ahead.
"""

import math
from collections import deque
from statistics import median

from gcs.link.wire.message import Message

JUMP_S = 0.5  # GNSS time that is further than this from the boot clock has jumped
_BACK_S = 0.4  # ... and is back within this
_SLEW = 0.02  # seconds of correction in a second: simulators of PX4 need 0.011
_PLAUSIBLE_UNIX_S = (1_262_304_000.0, 4_102_444_800.0)  # the years 2010 to 2099
_BOOT_MS = 2**32
_KEPT = 24  # samples in the window
_OFFSETS = 16
_REPORTS = 3  # of a held clock: their median counts, so one wrong report changes nothing
_REBOOT_S, _AHEAD_S = 5.0, 5.0  # a boot time that is further back, or ahead of what its rate explains, is odd
_RATES = 3.0  # a vehicle may become so much faster between two messages
_CONFIRM = 3  # odd boot times in a row are a clock that began anew
# After a pause of this program, messages are unread until one is this near its predicted time, or for this long.
_NEAR_S, _UNREAD_S = 0.25, 1.0


class VehicleClock:
    """The clock of one vehicle. Its rate is estimated over `window_s` of local time; `cap_s` is vehicle time."""

    def __init__(self, *, cap_s: float = 0.5, window_s: float = 1.0) -> None:
        self._cap_s = cap_s
        self._window_s = window_s
        self.held = False
        self.restarts = 0  # how often the boot clock began anew
        self._reset()

    def _reset(self) -> None:
        self._offsets_s: deque[float] = deque(maxlen=_OFFSETS)
        self._offset_s: float | None = None
        self._reported_s: deque[float] = deque(maxlen=_REPORTS)  # offsets reported since the clock is held
        self._corrected_boot_s = 0.0
        self._jumped = False
        self._forget_samples()

    def _forget_samples(self) -> None:
        self._samples: deque[tuple[float, float]] = deque(maxlen=_KEPT)  # (now_s, boot_s)
        self._rate_kept: float | None = None  # before the last pause of this program
        self._resumed: tuple[float, float] | None = None  # now_s and boot_s at its end, predicted
        self._newest_boot_s = float("-inf")
        self._newest_s = float("-inf")  # local time of the newest sample
        self._odd_boot_s: list[float] = []
        self._returned_boot_s = float("-inf")
        self._ahead_known: tuple[float, int, tuple[float, float]] | None = None
        self._ahead = (0.0, 0.0)  # the sample that is furthest ahead
        self._read: tuple[float, tuple[float, bool] | None] | None = None  # local time, and the reading at it
        self._measure_rate()

    @property
    def ready(self) -> bool:
        """Whether the unix time on board is known."""
        return self._offset_s is not None and bool(self._samples)

    @property
    def rate(self) -> float:
        """Vehicle seconds per local second; until the window is a quarter full 1, or the rate before a pause."""
        return self._rate

    def _measure_rate(self) -> None:
        """Know the rate anew: it is asked for far more often than samples come."""
        self._read = None
        self._rate = 1.0 if self._rate_kept is None else self._rate_kept
        if self._samples:
            (now_0, boot_0), (now_1, boot_1) = self._samples[0], self._samples[-1]
            span_s = now_1 - now_0
            if span_s >= self._window_s / 4:
                self._rate = (boot_1 - boot_0) / span_s

    def stood_still(self, now_s: float) -> None:
        """Start a new window after a pause of this program: messages read now have waited, and measure no rate."""
        if not self._samples:
            return
        rate = self._rate_kept = self.rate
        self._resumed = now_s, max(boot + rate * (now_s - then) for then, boot in self._samples)
        self._samples.clear()
        self._measure_rate()

    def is_behind(self, now_s: float) -> bool:
        """Whether messages that arrived in a pause of this program may still be unread."""
        if self._resumed is None:
            return False
        then_s, boot_s = self._resumed
        rate = self.rate
        near_s = boot_s + rate * (now_s - then_s) - _NEAR_S * max(rate, 1.0)
        if self._newest_boot_s >= near_s or now_s - then_s > _UNREAD_S:
            self._resumed = None
        return self._resumed is not None

    @property
    def gnss_off_s(self) -> float:
        """GNSS time as reported, minus the unix time of the held clock; 0 while it is not held."""
        if self._offset_s is None or not self._reported_s:
            return 0.0
        return median(self._reported_s) - self._offset_s

    @property
    def jumped(self) -> bool:
        """Whether GNSS time has jumped while the clock is held, and has not come back."""
        return self._jumped

    def hold(self) -> None:
        """From now on follow the boot clock; GNSS time corrects it slowly."""
        if not self.held:
            self.held = True
            self._adopt(self._offset_s)

    def set_unix_s(self, unix_s: float, now_s: float) -> None:
        """Have this clock read `unix_s` at `now_s`; what GNSS time says remains known."""
        shown_s = self.now_unix_s(now_s)
        if shown_s is None or self._offset_s is None:
            return
        self._offset_s += unix_s - shown_s
        self._read = None
        self._offsets_s.clear()
        self._look_for_jump()

    def follow_gnss(self) -> None:
        """Use GNSS time as reported: the boot clock has jumped."""
        if self._offset_s is not None:
            self._adopt(self._offset_s + self.gnss_off_s)

    def receive(self, message: Message, now_s: float) -> None:
        """Take a sample from any message with time_boot_ms, and the offset from SYSTEM_TIME."""
        boot_ms = message.fields.get("time_boot_ms")
        if not isinstance(boot_ms, int) or not 0 < boot_ms < _BOOT_MS:
            return
        boot_s = boot_ms / 1e3
        if not self._plausible(boot_s, now_s):
            return
        if message.name == "SYSTEM_TIME":
            unix_s = message.fields["time_unix_usec"] / 1e6
            if _PLAUSIBLE_UNIX_S[0] <= unix_s < _PLAUSIBLE_UNIX_S[1]:
                self._learn_offset(unix_s - boot_s, boot_s)
        self.sample(now_s, boot_s)

    def sample(self, now_s: float, boot_s: float) -> None:
        """Record that the boot clock read `boot_s` when a message arrived at `now_s`."""
        if boot_s <= self._newest_boot_s:
            return
        self._newest_boot_s, self._newest_s = boot_s, now_s
        self._read = None
        if self.is_behind(now_s):
            return
        if not self._samples or now_s - self._samples[-1][0] >= self._window_s / _KEPT:
            self._samples.append((now_s, boot_s))
            self._measure_rate()

    def unix_s(self, time_boot_ms: int) -> float | None:
        """Return the unix time of a boot clock stamp; None before SYSTEM_TIME."""
        return None if self._offset_s is None else time_boot_ms / 1e3 + self._offset_s

    def boot_ms(self, unix_s: float) -> int | None:
        """Return the boot clock stamp of a unix time, within its 32 bits; None before SYSTEM_TIME."""
        if self._offset_s is None:
            return None
        return min(max(round((unix_s - self._offset_s) * 1e3), 0), _BOOT_MS - 1)

    def now_unix_s(self, now_s: float) -> float | None:
        """Return the predicted unix time on board at `now_s`; None until `ready`.

        It runs back only when the offset is corrected.
        """
        reading = self.reading(now_s)
        return None if reading is None else reading[0]

    def reading(self, now_s: float) -> tuple[float, bool] | None:
        """Return the unix time at `now_s`, and whether the clock has stopped because the vehicle does not report."""
        if self._read is None or self._read[0] != now_s:  # asked often at one instant
            self._read = now_s, self._reading(now_s)
        return self._read[1]

    def _reading(self, now_s: float) -> tuple[float, bool] | None:
        if self._offset_s is None or not math.isfinite(self._newest_boot_s):
            return None
        known = bool(self._samples) or (self._rate_kept is not None and not self.is_behind(now_s))
        ahead_s, most_s = self._ahead_boot_s(now_s), self._newest_boot_s + (self._cap_s if known else 0.0)
        self._returned_boot_s = max(self._returned_boot_s, min(ahead_s, most_s))
        return self._returned_boot_s + self._offset_s, ahead_s >= most_s

    @property
    def heard_unix_s(self) -> float:
        """The unix time on board of its newest report; -inf before SYSTEM_TIME."""
        return -math.inf if self._offset_s is None else self._newest_boot_s + self._offset_s

    def uncapped_unix_s(self, now_s: float) -> float | None:
        """Return the predicted unix time, however long ago the vehicle reported; None until `ready`."""
        ready = self._offset_s is not None and math.isfinite(self._newest_boot_s)
        return self._ahead_boot_s(now_s) + (self._offset_s or 0.0) if ready else None

    def _ahead_boot_s(self, now_s: float) -> float:
        rate = self.rate
        samples = self._samples or ((self._newest_s, self._newest_boot_s),)
        known = (rate, len(samples), samples[-1])
        if known != self._ahead_known:  # asked often, between two samples
            self._ahead_known = known
            self._ahead = max(samples, key=lambda sample: sample[1] - rate * sample[0])
        then, boot = self._ahead
        return max(boot + rate * (now_s - then), self._newest_boot_s)

    def _plausible(self, boot_s: float, now_s: float) -> bool:
        """Whether to use this boot time. Odd ones in a row are the clock of a vehicle that rebooted or jumped."""
        if not math.isfinite(self._newest_boot_s):
            return True
        explained_s = _AHEAD_S + _RATES * max(self.rate, 1.0) * max(now_s - self._newest_s, 0.0)
        if not self._samples:
            explained_s = math.inf  # it is unknown how long the messages have waited
        back = boot_s < self._newest_boot_s - _REBOOT_S
        if not back and boot_s <= self._newest_boot_s + explained_s:
            self._odd_boot_s.clear()
            return True
        if self._odd_boot_s and not 0.0 < boot_s - self._odd_boot_s[-1] < explained_s:
            self._odd_boot_s.clear()
        self._odd_boot_s.append(boot_s)
        if len(self._odd_boot_s) < _CONFIRM:
            return False
        if back:  # the vehicle rebooted: all samples are of the old clock
            self._reset()
            self.restarts += 1
        else:
            self._forget_samples()
        return True

    def _learn_offset(self, offset_s: float, boot_s: float) -> None:
        self._read = None
        if self.held and self._offset_s is not None:
            assert self._offset_s is not None
            self._reported_s.append(offset_s)
            self._look_for_jump()
            passed_s = max(boot_s - self._corrected_boot_s, 0.0)
            self._corrected_boot_s = max(boot_s, self._corrected_boot_s)
            if not self._jumped and abs(offset_s - self._offset_s) <= JUMP_S:
                self._offsets_s.append(offset_s)
                off_s = sum(self._offsets_s) / len(self._offsets_s) - self._offset_s
                most_s = _SLEW * min(passed_s, 1.0)
                self._offset_s += min(max(off_s, -most_s), most_s)
            return
        if self._offsets_s and abs(offset_s - self._offsets_s[-1]) > JUMP_S:
            self._offsets_s.clear()  # GNSS has set the vehicle's clock
        self._offsets_s.append(offset_s)
        self._adopt(sum(self._offsets_s) / len(self._offsets_s))

    def _adopt(self, offset_s: float | None) -> None:
        self._read = None
        self._offset_s = offset_s
        self._jumped = False
        self._reported_s.clear()
        self._corrected_boot_s = max(self._newest_boot_s, 0.0)
        if self.held and offset_s is not None:
            self._offsets_s = deque([s for s in self._offsets_s if abs(s - offset_s) <= JUMP_S], _OFFSETS)
            self._reported_s.extend([offset_s] * _REPORTS)

    def _look_for_jump(self) -> None:
        off_s = abs(self.gnss_off_s)
        self._jumped = off_s > (_BACK_S if self._jumped else JUMP_S)
