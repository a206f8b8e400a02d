"""Lost frames of one vehicle, counted by the gaps in the sequence numbers of its frames."""

from __future__ import annotations

_V2 = 0xFD
_FAR_BACK = 128  # a larger gap means a late frame or a copy


class LinkQuality:
    """The frame counts of one component of one vehicle."""

    def __init__(self) -> None:
        self.received = 0
        self.lost = 0
        self._last = -1

    @property
    def loss(self) -> float | None:
        """The share of lost frames; None before the first frame."""
        return self.lost / (self.received + self.lost) if self.received else None

    def receive(self, frame: bytes) -> None:
        """Count one whole frame."""
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
