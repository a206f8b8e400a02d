"""A TCP connection to a vehicle, a router or a simulator, reconnected once a second after it broke."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from gcs.errors import LinkError, ProtocolMisuse
from gcs.link.endpoints.base import LinkSpec, Receive
from gcs.link.endpoints.ip_address import Address, host_port, plain_address

_CONNECT_S = 5.0
_RECONNECT_S = 1.0
_LARGEST = 65_536
_QUEUE_MAX = 1 << 18  # bytes; if the peer does not read, further frames are lost


class TcpEndpoint:
    """One connection to `spec`. Frames sent while it is broken are lost."""

    def __init__(self, spec: LinkSpec) -> None:
        self.spec = spec
        self.lost = 0  # frames
        self._reader: asyncio.StreamReader | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._reading: asyncio.Task[None] | None = None

    @property
    def local_address(self) -> Address:
        """The local address of the connection. Raises `ProtocolMisuse` before `open`."""
        if self._writer is None:
            raise ProtocolMisuse(f"{self.spec} is not open.")
        return plain_address(self._writer.get_extra_info("sockname"))

    async def open(self, receive: Receive) -> None:
        """Connect; `receive` gets all bytes that arrive. Raises `LinkError` if no program listens at the address."""
        if self._reading is not None:
            raise ProtocolMisuse(f"{self.spec} was opened twice.")
        host, port = self.spec.address
        try:
            await self._connect()
        except TimeoutError:
            raise LinkError(
                f"{host_port(host, port)} did not answer within {_CONNECT_S:g} s.", hint="check host, port and network"
            ) from None
        except OSError as error:
            raise LinkError(
                f"no TCP connection to {host_port(host, port)}: {error.strerror or error}.",
                hint="start the vehicle or simulator first, or check host and port",
            ) from error
        self._reading = asyncio.ensure_future(self._read(receive))

    def send(self, data: bytes, address: Address | None = None) -> None:
        """Send one frame to the peer. It is lost if the connection is broken or the queue is full."""
        del address  # a TCP connection has one peer
        writer = self._writer
        if writer is None or writer.is_closing() or writer.transport.get_write_buffer_size() > _QUEUE_MAX:
            self.lost += 1
            return
        writer.write(data)

    def close(self) -> None:
        """Close the connection. A second call has no effect."""
        if self._reading is not None:
            self._reading.cancel()
        if self._writer is not None:
            self._writer.close()

    async def _connect(self) -> None:
        async with asyncio.timeout(_CONNECT_S):
            self._reader, self._writer = await asyncio.open_connection(*self.spec.address)

    async def _read(self, receive: Receive) -> None:
        while True:
            if self._reader is not None:
                with suppress(OSError):
                    while data := await self._reader.read(_LARGEST):
                        receive(data, self.spec.address)
                        await asyncio.sleep(0)  # timers get their turn however much arrives
            if self._writer is not None:
                self._writer.close()
            self._reader = self._writer = None
            await asyncio.sleep(_RECONNECT_S)
            with suppress(OSError, TimeoutError):
                await self._connect()
