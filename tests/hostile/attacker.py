"""The attacker of this suite: a station on a socket of its own, which says what it likes as whom it likes."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterable
from types import TracebackType
from typing import Any, Self

from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from gcs.mavlink import MavState, MavType

ARDUPILOT = 3
LOOPBACK = "127.0.0.1"


class Attacker:
    """Sends datagrams to a ground station that listens on `port`. What comes back is in `heard()`."""

    def __init__(self, port: int, host: str = LOOPBACK) -> None:
        self.target = host, port
        self.codec = Codec(66, 6)
        self.sent = 0
        self._socket = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((host, 0))
        self._socket.setblocking(False)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()

    @property
    def address(self) -> tuple[str, int]:
        """Where its datagrams come from."""
        host, port = self._socket.getsockname()[:2]
        return host, port

    def throw(self, *datagrams: bytes) -> None:
        """Send bytes as they are; a full socket loses them."""
        for data in datagrams:
            try:
                self._socket.sendto(data, self.target)
            except OSError:
                continue
            self.sent += 1

    def frame(self, name: str, system: int, component: int = 1, **fields: Any) -> bytes:
        """The frame of a message from any system."""
        return self.codec.encode(Message(name, fields, system, component))

    def say(self, name: str, system: int, component: int = 1, **fields: Any) -> None:
        """Send a message as any system."""
        self.throw(self.frame(name, system, component, **fields))

    def heartbeat(self, system: int, *, mode: int = 4, armed: bool = True, autopilot: int = ARDUPILOT) -> None:
        """Send the HEARTBEAT of a vehicle."""
        self.say(
            "HEARTBEAT",
            system,
            type=int(MavType.QUADROTOR),
            autopilot=autopilot,
            base_mode=217 if armed else 89,
            custom_mode=mode,
            system_status=int(MavState.ACTIVE),
            mavlink_version=3,
        )

    def flood(self, datagrams: Iterable[bytes], rate_hz: float, seconds: float) -> int:
        """Send the datagrams at this rate for so long, and return how many. They begin again where they end."""
        frames = tuple(datagrams)
        began_s, sent = time.monotonic(), 0
        while (now_s := time.monotonic() - began_s) < seconds:
            due = int(now_s * rate_hz)
            while sent < due:
                self.throw(frames[sent % len(frames)])
                sent += 1
            time.sleep(0.001)
        return sent

    def heard(self) -> list[bytes]:
        """Return the datagrams that came for it since the last call."""
        found = []
        while True:
            try:
                found.append(self._socket.recv(65_536))
            except OSError:
                return found
