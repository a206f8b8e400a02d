"""How many of a vehicle's frames arrive, counted by the gaps in their numbers.

Knows: the sequence number in a frame's header. Does not know: messages, clocks.
"""

from __future__ import annotations

_V2 = 0xFD
_FAR_BACK = 128  # a number so far ahead comes from behind: the frame was overtaken, or is a copy


class LinkQuality:
    """Counts the frames of one component of one vehicle."""

    def __init__(self) -> None:
        self.received = 0
        self.lost = 0
        self._last = -1

    @property
    def loss(self) -> float | None:
        """The share of frames that did not arrive; None before any did."""
        return self.lost / (self.received + self.lost) if self.received else None

    def receive(self, frame: bytes) -> None:
        """Take note of a whole frame."""
        if not frame:
            return
        number = frame[4] if frame[0] == _V2 else frame[2]
        gap = (number - self._last - 1) & 0xFF if self._last >= 0 else 0
        self.received += 1
        if gap >= _FAR_BACK:
            self.lost = max(self.lost - 1, 0)  # it had been counted as lost
            return
        self.lost += gap
        self._last = number
