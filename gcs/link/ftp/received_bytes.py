"""The bytes of a file that have arrived: which are new, which are missing. Whatever arrives, it stays small.

The first copy of a byte counts. A piece that would leave too many gaps is dropped, as if it had been lost: a peer that
answers with single bytes at random places costs neither memory nor time.
"""

from __future__ import annotations

_STRETCHES_MAX = 256  # a burst that loses every second piece of 60 kB leaves 126


class ReceivedBytes:
    """Pieces of one file of at most `limit` bytes, in any order."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._data = bytearray()
        self._have: list[tuple[int, int]] = []  # begin and end of what has arrived, in order, apart from each other

    def clear(self) -> None:
        """Forget everything."""
        self._data.clear()
        self._have.clear()

    def add(self, offset: int, piece: bytes) -> bool:
        """Store what is new of a piece; return whether anything was."""
        end = offset + len(piece)
        if not piece or offset < 0 or end > self._limit:
            return False
        missing = _gaps(self._have, offset, end)
        near = [span for span in self._have if span[0] <= end and offset <= span[1]]
        if not missing or len(self._have) - len(near) >= _STRETCHES_MAX:
            return False
        self._data.extend(bytes(max(end - len(self._data), 0)))
        for begin, until in missing:
            self._data[begin:until] = piece[begin - offset : until - offset]
        far = [span for span in self._have if span not in near]
        joined = min([offset, *(span[0] for span in near)]), max([end, *(span[1] for span in near)])
        self._have = sorted([*far, joined])
        return True

    def gaps(self, size: int) -> list[tuple[int, int]]:
        """Return (offset, length) of what is missing of the first `size` bytes."""
        return [(begin, until - begin) for begin, until in _gaps(self._have, 0, size)]

    def first(self, size: int) -> bytes | None:
        """Return the first `size` bytes; None while one of them is missing."""
        return None if _gaps(self._have, 0, size) else bytes(self._data[:size])


def _gaps(have: list[tuple[int, int]], begin: int, end: int) -> list[tuple[int, int]]:
    """Return the (begin, end) within these bounds that no stretch covers."""
    found, here = [], begin
    for start, until in have:
        if start >= end:
            break
        if start > here:
            found.append((here, start))
        here = max(here, until)
    return [*found, (here, end)] if here < end else found
