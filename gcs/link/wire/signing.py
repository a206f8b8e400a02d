"""MAVLink 2 signing: signs frames, and accepts or rejects signed ones.

Specification: https://mavlink.io/en/guide/message_signing.html.
A signature is 13 bytes behind the checksum: link id, time in 10 µs since the beginning of 2015, and the first 6 bytes
of SHA-256 over the key and everything before them. Timestamps only increase. No `repr` and no error shows a key.
"""

import hashlib
import hmac
from dataclasses import dataclass, field

KEY_BYTES = 32
EPOCH_UNIX_S = 1_420_070_400  # 2015-01-01
TICKS_PER_S = 100_000

_V2, _FLAGS_AT, _SIGNED = 0xFD, 2, 0x01
_SYSID_AT, _COMPID_AT = 5, 6
_LENGTH, _HASH = 13, 6
_STALE_TICKS = 60 * TICKS_PER_S  # the first frame of a station may be this old


@dataclass(frozen=True)
class Signature:
    """The key, link id and time that sign one frame."""

    key: bytes = field(repr=False)
    link_id: int
    ticks: int


def is_signed(frame: bytes) -> bool:
    """Whether the frame carries a signature, valid or not."""
    return len(frame) > _LENGTH and frame[0] == _V2 and bool(frame[_FLAGS_AT] & _SIGNED)


class Signing:
    """The key and the clock of one station. Without a key nothing is signed and every frame is accepted.

    `ticks` is the signing time at `now_s` of any monotonic clock. It advances with that clock, with accepted frames and
    with its own signatures, and never runs back.
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
        """Use `key` from now on. A key of zeros switches signing off."""
        self._key = key if any(key) else b""
        self._ticks, self._now_s = ticks, now_s
        self._heard.clear()

    def signature(self, now_s: float) -> Signature | None:
        """Return the signature of the next frame to send; None while signing is off."""
        if not self._key:
            return None
        self._ticks = self._at(now_s) + 1
        self._now_s = now_s
        return Signature(self._key, self._link_id, self._ticks)

    def accepts(self, frame: bytes, now_s: float) -> bool:
        """Whether this frame is valid, and with that the newest of its sender: its copies are rejected."""
        if not self.is_valid(frame, now_s):
            return False
        self.note(frame, now_s)
        return True

    def is_valid(self, frame: bytes, now_s: float) -> bool:
        """Whether this frame is signed with the key and newer than all earlier frames of its sender."""
        if not self._key:
            return True
        if not is_signed(frame):
            return False
        sender, ticks = _stamp(frame)
        if ticks <= self._heard.get(sender, self._at(now_s) - _STALE_TICKS):
            return False
        signed, signature = frame[:-_HASH], frame[-_HASH:]
        return hmac.compare_digest(hashlib.sha256(self._key + signed).digest()[:_HASH], signature)

    def note(self, frame: bytes, now_s: float) -> None:
        """Make a valid frame the newest one of its sender."""
        if self._key:
            sender, ticks = _stamp(frame)
            self._heard[sender] = ticks
            self._ticks, self._now_s = max(self._at(now_s), ticks), now_s

    def _at(self, now_s: float) -> int:
        return self._ticks + max(round((now_s - self._now_s) * TICKS_PER_S), 0)


def _stamp(frame: bytes) -> tuple[tuple[int, int, int], int]:
    """The sender (link id, system, component) and the time of a signed frame."""
    ticks = int.from_bytes(frame[-_LENGTH + 1 : -_HASH], "little")
    return (frame[-_LENGTH], frame[_SYSID_AT], frame[_COMPID_AT]), ticks
