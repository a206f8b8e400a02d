"""A serial line: a telemetry radio or a USB cable, opened again when it is plugged in again.

Knows: one device by pyserial, the event loop. Does not know: messages; where frames begin is the codec's business.
"""

from __future__ import annotations

import asyncio
import os
from contextlib import suppress

import serial

from gcs.errors import LinkError, ProtocolMisuse
from gcs.link.endpoints.base import Address, LinkSpec, Receive

_AGAIN_S = 1.0
_LARGEST = 65_536
_MOST_WAITING = 1 << 14  # bytes: some seconds of a slow radio; what comes on top is lost


class SerialEndpoint:
    """Opens `spec` for itself alone; reads and writes without ever waiting."""

    def __init__(self, spec: LinkSpec) -> None:
        self.spec = spec
        self.lost = 0  # frames
        self._port: serial.Serial | None = None
        self._receive: Receive | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._waiting = bytearray()
        self._again: asyncio.TimerHandle | None = None
        self._closed = False

    @property
    def local_address(self) -> Address:
        """Device and baud rate."""
        return self.spec.address

    async def open(self, receive: Receive) -> None:
        """Starts to receive. Raises `LinkError` when the device is not there, taken, or not ours to open."""
        if self._receive is not None:
            raise ProtocolMisuse(f"{self.spec} was opened twice.")
        self._loop, self._receive = asyncio.get_running_loop(), receive
        try:
            self._open()
        except (OSError, ValueError) as error:
            raise LinkError(
                f"the serial line {self.spec.host} cannot be opened at {self.spec.port} baud: {_reason(error)}.",
                hint="check the device's name, that nobody else uses it, and your permission to (group dialout)",
            ) from error

    def send(self, data: bytes, address: Address | None = None) -> None:
        """Queues a frame; a line that is too slow or unplugged loses it."""
        del address  # there is one peer
        if self._port is None or self._loop is None or len(self._waiting) + len(data) > _MOST_WAITING:
            self.lost += 1
            return
        idle = not self._waiting
        self._waiting += data
        if idle:
            self._write()

    def close(self) -> None:
        """Lets the device go. Harmless the second time."""
        self._closed = True
        if self._again is not None:
            self._again.cancel()
        self._drop()

    def _open(self) -> None:
        device, baud = self.spec.address
        port = serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
        os.set_blocking(port.fileno(), False)
        self._port = port
        if self._loop is not None:
            self._loop.add_reader(port.fileno(), self._read)

    def _read(self) -> None:
        if self._port is None or self._receive is None:
            return
        try:
            data = os.read(self._port.fileno(), _LARGEST)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            data = b""
        if data:
            self._receive(data, self.spec.address)
        else:
            self._unplugged()

    def _write(self) -> None:
        if self._port is None or self._loop is None:
            return
        file = self._port.fileno()
        try:
            written = os.write(file, self._waiting)
        except (BlockingIOError, InterruptedError):
            written = 0
        except OSError:
            self._unplugged()
            return
        del self._waiting[:written]
        if self._waiting:
            self._loop.add_writer(file, self._write)
        else:
            self._loop.remove_writer(file)

    def _unplugged(self) -> None:
        self._drop()
        if self._loop is not None and not self._closed:
            self._again = self._loop.call_later(_AGAIN_S, self._plugged)

    def _plugged(self) -> None:
        try:
            self._open()
        except (OSError, ValueError):
            self._unplugged()

    def _drop(self) -> None:
        port, self._port = self._port, None
        self._waiting.clear()
        if port is not None and self._loop is not None:
            self._loop.remove_reader(port.fileno())
            self._loop.remove_writer(port.fileno())
            with suppress(OSError):
                port.close()


def _reason(error: Exception) -> str:
    return os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
