"""One direction of an impaired link: frames are lost, duplicated, reordered, delayed or corrupted.

The fate of a frame depends on the seed, on its content and on how often that content was sent before; never on other
frames. The ground station runs in real time, so a slower simulation puts more heartbeats between setpoints. It must
lose the same setpoints all the same. For the same reason delays are simulated time. The sequence number and the
signature, which contains a time of day, are not part of the content.
"""

import heapq
import struct
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import blake2b

OVERTAKEN_S = 0.1  # delay of a reordered frame
_KEPT = 1 << 14  # number of contents whose repetitions are counted
_MOST_WAITING = 1 << 14  # frames in transit: further ones are lost, as in any queue
_MOST_BROKEN_BITS = 8
_SCALE = 2.0**-32


@dataclass(frozen=True)
class LinkImpairment:
    """The present impairment of a link: probabilities from 0 to 1, and seconds of simulated time.

    A frame arrives `delay_s` late, plus or minus at most `jitter_s`, uniformly distributed; so jitter reorders frames.
    """

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    corrupt: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0


NO_IMPAIRMENT = LinkImpairment()


class LossyLink:
    """Takes frames and delivers them later."""

    def __init__(self, *key: int) -> None:
        """The same key has the same effect on the same frames."""
        self.impairment = NO_IMPAIRMENT
        self._key = struct.pack(f"<{len(key)}Q", *key)
        self._said: OrderedDict[bytes, int] = OrderedDict()
        self._under_way: list[tuple[float, int, bytes]] = []
        self._count = 0

    def impair(self, impairment: LinkImpairment) -> None:
        """Impair frames so that are put in from now on."""
        self.impairment = impairment

    def put(self, frame: bytes, sent_s: float) -> None:
        """Send a whole frame at `sent_s`."""
        impairment = self.impairment
        if impairment == NO_IMPAIRMENT:
            self._arrive(frame, sent_s)
            return
        lost, doubled, overtaken, broken, first, second, where, bits = self._fate(frame)
        if lost < impairment.loss:
            return
        late_s = impairment.delay_s + impairment.jitter_s * (2.0 * first - 1.0)
        if overtaken < impairment.reorder:
            late_s += OVERTAKEN_S
        damaged = break_bits(frame, where, bits) if broken < impairment.corrupt else frame
        self._arrive(damaged, sent_s + max(late_s, 0.0))
        if doubled < impairment.duplicate:
            late_s = impairment.delay_s + impairment.jitter_s * (2.0 * second - 1.0)
            self._arrive(frame, sent_s + max(late_s, 0.0))

    def take(self, t_s: float) -> Iterator[bytes]:
        """Return the frames that have arrived by `t_s`, in order of arrival."""
        while self._under_way and self._under_way[0][0] <= t_s:
            yield heapq.heappop(self._under_way)[2]

    def _arrive(self, frame: bytes, at_s: float) -> None:
        if len(self._under_way) < _MOST_WAITING:
            self._count += 1
            heapq.heappush(self._under_way, (at_s, self._count, frame))

    def _fate(self, frame: bytes) -> tuple[float, ...]:
        """Return eight numbers in [0, 1) that decide the fate of the frame."""
        said = content(frame)
        times = self._said.pop(said, 0)
        self._said[said] = times + 1
        if len(self._said) > _KEPT:
            self._said.popitem(last=False)
        digest = blake2b(struct.pack("<Q", times) + said, key=self._key, digest_size=32).digest()
        return tuple(word * _SCALE for word in struct.unpack("<8I", digest))


def content(frame: bytes) -> bytes:
    """Return the content and sender of a frame, without sequence number, checksum and signature."""
    return frame[5 : 10 + frame[1]] if frame[:1] == b"\xfd" else frame[3 : 6 + frame[1]]


def break_bits(frame: bytes, where: float, bits: float) -> bytes:
    """Return the frame with one to eight bits flipped; `where` and `bits` in [0, 1) choose their place and number."""
    broken, size = bytearray(frame), 8 * len(frame)
    count = 1 + int(bits * _MOST_BROKEN_BITS)
    for i in range(count):
        bit = (int(where * size) + i * (size // count)) % size
        broken[bit >> 3] ^= 1 << (bit & 7)
    return bytes(broken)
