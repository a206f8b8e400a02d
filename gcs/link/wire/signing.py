"""MAVLink 2 signing: what a frame is signed with, and whether a frame that came is to be believed.

Knows: where the signature stands in a frame, and the rule that time only goes forward. Does not know: messages,
clocks (time is an argument), where keys are kept. Keys are never shown: not in `repr`, not in errors.

A signature is 13 bytes behind the checksum: link id, time in 10 µs since the beginning of 2015, and the first 6 bytes
of SHA-256 over the key and everything before them.
"""

from __future__ import annotations

import hashlib
import hmac
from dataclasses import dataclass, field

KEY_BYTES = 32
EPOCH_UNIX_S = 1_420_070_400  # 2015-01-01
TICKS_PER_S = 100_000

_V2, _FLAGS_AT, _SIGNED = 0xFD, 2, 0x01
_SYSID_AT, _COMPID_AT = 5, 6
_LENGTH, _HASH = 13, 6
_STALE_TICKS = 60 * TICKS_PER_S  # a station that was never heard may be so far behind


@dataclass(frozen=True)
class Signature:
    """What to sign a frame with."""

    key: bytes = field(repr=False)
    link_id: int
    ticks: int


def is_signed(frame: bytes) -> bool:
    """Whether the frame carries a signature, good or bad."""
    return len(frame) > _LENGTH and frame[0] == _V2 and bool(frame[_FLAGS_AT] & _SIGNED)


class Signing:
    """One station's key and clock. Without a key nothing is signed and everything is believed.

    `ticks` is the station's time at `now_s` of any monotonic clock; it follows that clock, what it is shown by others
    and what it signs itself, and never goes back.
    """

    def __init__(self, link_id: int = 0) -> None:
        self._link_id = link_id
        self._key = b""
        self._ticks = 0
        self._now_s = 0.0
        self._heard: dict[tuple[int, int, int], int] = {}

    @property
    def on(self) -> bool:
        """Whether there is a key."""
        return bool(self._key)

    def set_up(self, key: bytes, ticks: int, now_s: float) -> None:
        """Use `key` from now on; one of zeros alone switches signing off."""
        self._key = key if any(key) else b""
        self._ticks, self._now_s = ticks, now_s
        self._heard.clear()

    def signature(self, now_s: float) -> Signature | None:
        """For the next frame to be sent; None while signing is off."""
        if not self._key:
            return None
        self._ticks = self._at(now_s) + 1
        self._now_s = now_s
        return Signature(self._key, self._link_id, self._ticks)

    def believes(self, frame: bytes, now_s: float, *, note: bool = True) -> bool:
        """Whether to listen to this frame: signed with the key, and newer than all before of its sender.

        With `note` it counts as heard from then on, and its copies as replayed.
        """
        if not self._key:
            return True
        if not is_signed(frame):
            return False
        signed, signature = frame[:-_HASH], frame[-_HASH:]
        right = hashlib.sha256(self._key + signed).digest()[:_HASH]
        if not hmac.compare_digest(right, signature):
            return False
        link_id, ticks = frame[-_LENGTH], int.from_bytes(frame[-_LENGTH + 1 : -_HASH], "little")
        sender = (link_id, frame[_SYSID_AT], frame[_COMPID_AT])
        if ticks <= self._heard.get(sender, self._at(now_s) - _STALE_TICKS):
            return False
        if not note:
            return True
        self._heard[sender] = ticks
        self._ticks, self._now_s = max(self._at(now_s), ticks), now_s
        return True

    def _at(self, now_s: float) -> int:
        return self._ticks + max(round((now_s - self._now_s) * TICKS_PER_S), 0)
