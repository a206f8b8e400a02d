"""A man in the middle: every datagram between vehicles and ground station passes, is changed, or is made up.

Each vehicle has a socket of its own towards the ground station, so that what it is said to say comes from its address.
It is a process of its own: beside emulated vehicles in one process it would be too slow. Enter it before they start.
"""

from __future__ import annotations

import heapq
import itertools
import math
import multiprocessing
import random
import select
import socket
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message

LOOPBACK = "127.0.0.1"
_FORK = multiprocessing.get_context("fork")
# What becomes of a datagram: (delay in s, bytes) of all that arrives. `up` is towards the vehicle.
Change = Callable[[bytes, bool], list[tuple[float, bytes]]]


class ManInTheMiddle:
    """Vehicles call `port`; the ground station listens on `ground_port`. `change` decides what arrives."""

    def __init__(self, ground_port: int, change: Change) -> None:
        self._change = change
        self._ground = LOOPBACK, ground_port
        self._listening = self._socket()
        self.port: int = self._listening.getsockname()[1]
        self._towards: dict[tuple[str, int], socket.socket] = {}  # by the vehicle's address
        self._late: list[tuple[float, int, socket.socket, tuple[str, int], bytes]] = []
        self._order = itertools.count()
        self._over = _FORK.Event()
        self._process = _FORK.Process(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._process.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._process.join()
        for one in (self._listening, *self._towards.values()):
            one.close()

    def _run(self) -> None:
        while not self._over.is_set():
            pause_s = min(max(self._late[0][0] - time.monotonic(), 0.0), 0.05) if self._late else 0.05
            ready, _, _ = select.select([self._listening, *self._towards.values()], [], [], pause_s)
            for one in ready:
                self._take(one)
            while self._late and self._late[0][0] <= time.monotonic():
                _, _, sender, address, data = heapq.heappop(self._late)
                self._send(sender, address, data)

    def _take(self, one: socket.socket) -> None:
        try:
            data, source = one.recvfrom(65_536)
        except OSError:
            return
        if one is self._listening:
            if source not in self._towards:
                self._towards[source] = self._socket()
            sender, address, up = self._towards[source], self._ground, False
        else:
            vehicle = next((at for at, towards in self._towards.items() if towards is one), None)
            if vehicle is None:
                return
            sender, address, up = self._listening, vehicle, True
        for delay_s, changed in self._change(data, up):
            if delay_s > 0.0:
                heapq.heappush(self._late, (time.monotonic() + delay_s, next(self._order), sender, address, changed))
            else:
                self._send(sender, address, changed)

    def _send(self, sender: socket.socket, address: tuple[str, int], data: bytes) -> None:
        try:
            sender.sendto(data, address)
        except OSError:
            return

    def _socket(self) -> socket.socket:
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.bind((LOOPBACK, 0))
        made.setblocking(False)
        return made


class Damage:
    """Every datagram arrives, and with it `copies` of it with flipped bits, cut, glued together, in any order.

    `lost` is the chance that only the damaged ones arrive. No damaged frame has a valid checksum but by chance.
    """

    def __init__(self, seed: int, copies: int, lost: float = 0.0) -> None:
        self._damaged = _FORK.Value("Q", 0)
        self._rng = random.Random(seed)
        self._copies, self._lost = copies, lost
        self._before = b"\xfd"

    @property
    def damaged(self) -> int:
        """How many damaged datagrams were sent."""
        return int(self._damaged.value)

    def __call__(self, data: bytes, up: bool) -> list[tuple[float, bytes]]:
        rng = self._rng
        found = [(0.0, self._broken(data)) for _ in range(self._copies)]
        self._damaged.value += len(found)
        if rng.random() >= self._lost:
            found.append((rng.choice([0.0, 0.0, 0.0, 0.05]), data))
            if rng.random() < 0.1:
                found.append((0.02, data))
        rng.shuffle(found)
        self._before = data
        return found

    def _broken(self, data: bytes) -> bytes:
        rng, broken = self._rng, bytearray(data)
        kind = rng.randrange(5)
        if kind == 0:
            return bytes(broken[: rng.randrange(1, len(broken))])
        if kind == 1:
            cut = rng.randrange(len(broken))
            return bytes(self._before[:cut] + broken[cut + 1 :]) or b"\xfd"
        if kind == 2:
            return rng.randbytes(rng.randrange(1, 300))
        for _ in range(rng.choice([1, 2, 8, 30])):
            broken[rng.randrange(len(broken))] ^= 1 << rng.randrange(8)
        if bytes(broken) == data:
            broken[-1] ^= 1
        return bytes(broken)


WILD_FLOATS = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e-40, 3e38, -3e38, 1e6)


class Lies:
    """Fields of what vehicles say are changed, with a valid checksum: the vehicle itself lies, or a radio does.

    `chance` is that of a lie in a message of one of `names`; None: of any.
    """

    def __init__(self, seed: int, chance: float, names: frozenset[str] | None = None) -> None:
        self._told = _FORK.Value("Q", 0)
        self._rng = random.Random(seed)
        self._chance, self._names = chance, names
        self._codec = Codec(1, 1)

    @property
    def told(self) -> int:
        """How many lies were sent."""
        return int(self._told.value)

    def __call__(self, data: bytes, up: bool) -> list[tuple[float, bytes]]:
        if up or self._rng.random() >= self._chance:
            return [(0.0, data)]
        messages = list(self._codec.decode(data, "middle"))
        if not messages or (self._names is not None and messages[0].name not in self._names):
            return [(0.0, data)]
        return [(0.0, self._lie(one)) for one in messages]

    def _lie(self, message: Message) -> bytes:
        rng, fields = self._rng, dict(message.fields)
        for name in rng.sample(sorted(fields), min(len(fields), rng.choice([1, 1, 3]))):
            fields[name] = self._wild(fields[name])
        try:
            lie = self._codec.encode(Message(message.name, fields, message.sysid, message.compid))
        except Exception:  # a value outside its field: another one
            return message.raw
        self._told.value += lie != message.raw
        return lie

    def _wild(self, value: Any) -> Any:
        rng = self._rng
        if isinstance(value, bool | float):
            return rng.choice(WILD_FLOATS) if rng.random() < 0.7 else value * rng.choice([-1.0, 1e3, 1.1])
        if isinstance(value, int):
            edge = rng.choice([7, 8, 15, 16, 31, 32, 63, 64])
            return rng.choice([0, 1, -1, value ^ 1, value + 1, value ^ (1 << rng.randrange(16)), (1 << edge) - 1])
        if isinstance(value, str):
            return rng.choice(["", "Crash: Disarming", "\x1b[2J", value[::-1]])
        if isinstance(value, bytes):
            return rng.randbytes(len(value))
        return [rng.randrange(256) for _ in value]
