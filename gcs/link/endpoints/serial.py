"""A serial line: a telemetry radio or a USB cable, reopened once a second after it was unplugged."""

from __future__ import annotations

import asyncio
import os
from contextlib import suppress

import serial

from gcs.errors import LinkError, ProtocolMisuse
from gcs.link.endpoints.base import DEFAULT_BAUD, LinkSpec, Receive
from gcs.link.endpoints.ip_address import Address

_REOPEN_S = 1.0
_LARGEST = 65_536
_QUEUE_MAX = 1 << 14  # bytes, some seconds of a slow radio; further frames are lost


class SerialEndpoint:
    """One device, opened exclusively. Reads and writes never block."""

    def __init__(self, spec: LinkSpec) -> None:
        self.spec = spec
        self.lost = 0  # frames
        self._port: serial.Serial | None = None
        self._receive: Receive | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._queue = bytearray()
        self._reopening: asyncio.TimerHandle | None = None
        self._closed = False

    @property
    def local_address(self) -> Address:
        """The device and its baud rate."""
        return self.spec.address

    async def open(self, receive: Receive) -> None:
        """Start to receive. Raises `LinkError` if the device is missing, in use, or may not be opened."""
        if self._receive is not None:
            raise ProtocolMisuse(f"{self.spec} was opened twice.")
        self._loop, self._receive = asyncio.get_running_loop(), receive
        try:
            self._open()
        except (OSError, ValueError) as error:
            hint = "check the device name and your permission (group dialout), and close other programs that use it"
            if ":" in self.spec.host:  # of a device by its path, or of a baud rate that is no number
                hint = f"the baud rate is the number after the last colon, for example {DEFAULT_BAUD}; else {hint}"
            raise LinkError(
                f"the serial line {self.spec.host} cannot be opened at {self.spec.port} baud: {_reason(error)}.",
                hint=hint,
            ) from error

    def send(self, data: bytes, address: Address | None = None) -> None:
        """Queue one frame. It is lost if the queue is full or the line is unplugged."""
        del address  # a serial line has one peer
        if self._port is None or self._loop is None or len(self._queue) + len(data) > _QUEUE_MAX:
            self.lost += 1
            return
        idle = not self._queue
        self._queue += data
        if idle:
            self._write()

    def close(self) -> None:
        """Release the device. A second call has no effect."""
        self._closed = True
        if self._reopening is not None:
            self._reopening.cancel()
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
            written = os.write(file, self._queue)
        except (BlockingIOError, InterruptedError):
            written = 0
        except OSError:
            self._unplugged()
            return
        del self._queue[:written]
        if self._queue:
            self._loop.add_writer(file, self._write)
        else:
            self._loop.remove_writer(file)

    def _unplugged(self) -> None:
        self._drop()
        if self._loop is not None and not self._closed:
            self._reopening = self._loop.call_later(_REOPEN_S, self._reopen)

    def _reopen(self) -> None:
        try:
            self._open()
        except (OSError, ValueError):
            self._unplugged()

    def _drop(self) -> None:
        port, self._port = self._port, None
        self._queue.clear()
        if port is not None and self._loop is not None:
            self._loop.remove_reader(port.fileno())
            self._loop.remove_writer(port.fileno())
            with suppress(OSError):
                port.close()


def _reason(error: Exception) -> str:
    return os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
