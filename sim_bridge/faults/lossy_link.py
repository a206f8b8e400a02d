"""One direction of a bad radio link: frames are lost, doubled, overtaken, late or broken.

Knows: bytes of whole MAVLink frames, simulated time as an argument, a seed. Does not know: sockets, messages, who
asked for trouble.

What becomes of a frame depends on the seed, on what the frame says, and on how often the same was said before; never
on what else went over the link. Ground stations live in real time: a stream of setpoints meets more heartbeats in
between the slower the simulation runs, and must lose the same setpoints all the same. For the same reason delays
are simulated time, and neither the sequence number nor the signature (which holds a time of day) counts.
"""

from __future__ import annotations

import heapq
import struct
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import blake2b

OVERTAKEN_S = 0.1  # how much later a frame comes that others overtake
_KEPT = 1 << 14  # contents whose repetitions are counted
_MOST_WAITING = 1 << 14  # frames under way: what comes on top is lost, as in any queue
_MOST_BROKEN_BITS = 8
_SCALE = 2.0**-32


@dataclass(frozen=True)
class Trouble:
    """What is wrong with a link now: chances between 0 and 1, and seconds of simulated time.

    A frame comes `delay_s` late, give or take at most `jitter_s`, every value as likely as the next; so jitter
    makes frames overtake each other.
    """

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    corrupt: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0


NO_TROUBLE = Trouble()


class LossyLink:
    """Frames in, frames out, later. `trouble` may be replaced at any time and holds for frames put in from then on."""

    def __init__(self, *key: int) -> None:
        """The same key has the same effect on the same frames."""
        self.trouble = NO_TROUBLE
        self._key = struct.pack(f"<{len(key)}Q", *key)
        self._said: OrderedDict[bytes, int] = OrderedDict()
        self._under_way: list[tuple[float, int, bytes]] = []
        self._count = 0

    def put(self, frame: bytes, sent_s: float) -> None:
        """A whole frame sets out."""
        trouble = self.trouble
        if trouble == NO_TROUBLE:
            self._arrive(frame, sent_s)
            return
        lost, doubled, overtaken, broken, first, second, where, bits = self._fate(frame)
        if lost < trouble.loss:
            return
        late_s = trouble.delay_s + trouble.jitter_s * (2.0 * first - 1.0)
        if overtaken < trouble.reorder:
            late_s += OVERTAKEN_S
        damaged = break_bits(frame, where, bits) if broken < trouble.corrupt else frame
        self._arrive(damaged, sent_s + max(late_s, 0.0))
        if doubled < trouble.duplicate:
            late_s = trouble.delay_s + trouble.jitter_s * (2.0 * second - 1.0)
            self._arrive(frame, sent_s + max(late_s, 0.0))

    def take(self, t_s: float) -> Iterator[bytes]:
        """Frames that have arrived by `t_s`, in the order of their arrival."""
        while self._under_way and self._under_way[0][0] <= t_s:
            yield heapq.heappop(self._under_way)[2]

    def clear(self) -> None:
        """Nothing is under way any more."""
        self._under_way.clear()

    def _arrive(self, frame: bytes, at_s: float) -> None:
        if len(self._under_way) < _MOST_WAITING:
            self._count += 1
            heapq.heappush(self._under_way, (at_s, self._count, frame))

    def _fate(self, frame: bytes) -> tuple[float, ...]:
        """Eight numbers in [0, 1)."""
        said = content(frame)
        times = self._said.pop(said, 0)
        self._said[said] = times + 1
        if len(self._said) > _KEPT:
            self._said.popitem(last=False)
        digest = blake2b(struct.pack("<Q", times) + said, key=self._key, digest_size=32).digest()
        return tuple(word * _SCALE for word in struct.unpack("<8I", digest))


def content(frame: bytes) -> bytes:
    """What a frame says and who says it: no sequence number, checksum or signature."""
    if frame[:1] == b"\xfd":
        return frame[5 : 10 + frame[1]]
    return frame[3 : 6 + frame[1]]


def break_bits(frame: bytes, where: float, bits: float) -> bytes:
    """The frame with one to eight bits turned over, spread from a place: numbers in [0, 1) say where and how many."""
    broken, size = bytearray(frame), 8 * len(frame)
    count = 1 + int(bits * _MOST_BROKEN_BITS)
    for i in range(count):
        bit = (int(where * size) + i * (size // count)) % size
        broken[bit >> 3] ^= 1 << (bit & 7)
    return bytes(broken)
