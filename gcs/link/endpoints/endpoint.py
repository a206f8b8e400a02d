"""The endpoints of the ground station, on asyncio: UDP for many vehicles, TCP and serial lines for one peer."""

import asyncio
import os
import socket
from contextlib import suppress

import serial

from gcs.errors import LinkError, ProtocolMisuse
from gcs.link.endpoints.addresses import Address, caller_host, host_port, plain_address, resolve_udp
from gcs.link.endpoints.base import DEFAULT_BAUD, LinkMode, LinkSpec, Receive, parse_link_spec
from gcs.link.endpoints.lockstep_endpoint import LockstepEndpoint
from gcs.link.endpoints.ports import BUFFER_BYTES, ByteStream, UdpPort

_CONNECT_S = 5.0
_REOPEN_S = 1.0
_TCP_QUEUE_BYTES = 1 << 18
_SERIAL_QUEUE_BYTES = 1 << 14  # some seconds of a slow radio


class UdpEndpoint:
    """A listening socket (udpin), or one that calls a peer (udpout).

    A caller sends to the port of the called host that answered last: routers answer from another one.
    """

    def __init__(self, spec: LinkSpec | str) -> None:
        self.spec = parse_link_spec(spec) if isinstance(spec, str) else spec
        self._port: UdpPort | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._receive: Receive | None = None
        self._called: Address | None = None
        self._peer: Address | None = None
        self._lost = 0

    @property
    def local_address(self) -> Address:
        """The address this socket is bound to. Raises `ProtocolMisuse` before `open`."""
        if self._port is None:
            raise ProtocolMisuse(f"{self.spec} is not open.")
        return self._port.address

    @property
    def lost(self) -> int:
        """How many frames the operating system did not accept."""
        return self._lost if self._port is None else self._port.lost

    async def open(self, receive: Receive | None) -> None:
        """Start to receive; `receive` is called for every datagram. Without it nothing is read. Raises `LinkError`."""
        if self._port is not None:
            raise ProtocolMisuse(f"{self.spec} was opened twice.")
        self._loop = loop = asyncio.get_running_loop()
        family, address = await loop.run_in_executor(None, resolve_udp, *self.spec.address)
        calls = self.spec.mode is LinkMode.CALL
        here = (caller_host(family, address[0]), 0) if calls else address
        least = 1  # byte: the operating system takes its least
        self._port = UdpPort(family, here, self.spec, receive_bytes=least if receive is None else BUFFER_BYTES)
        self._peer = self._called = address if calls else None
        self._receive = receive
        if receive is not None:
            loop.add_reader(self._port.file, self._read)

    def send(self, data: bytes, address: Address | None = None) -> None:
        """Send one datagram to `address`, or to the peer (udpout) if that is None. It may be lost."""
        target = address or self._peer
        if self._port is None or target is None:
            raise ProtocolMisuse(f"{self.spec} cannot send: it is not open or has no peer.")
        self._port.send(data, target)

    def close(self) -> None:
        """Release the port. A second call has no effect."""
        if self._loop is not None and self._port is not None:
            self._loop.remove_reader(self._port.file)
            self._port.close()
            self._lost, self._port = self._port.lost, None

    def _read(self) -> None:
        if self._port is None or self._receive is None:
            return
        for data, address in self._port.read():
            if self._called is not None and address[0] == self._called[0]:
                self._peer = address
            self._receive(data, address)


class StreamEndpoint:
    """A TCP connection or a serial line, opened again once a second after it broke. What is sent meanwhile is lost."""

    def __init__(self, spec: LinkSpec) -> None:
        self.spec = spec
        self.lost = 0  # frames
        self._local = spec.address
        self._stream: ByteStream | None = None
        self._waits = False  # for the stream to take more
        self._loop: asyncio.AbstractEventLoop | None = None
        self._receive: Receive | None = None
        self._broken = asyncio.Event()
        self._reopening: asyncio.Task[None] | None = None

    @property
    def local_address(self) -> Address:
        """The local address of the connection; of a serial line the device and its baud rate."""
        return self._local

    async def open(self, receive: Receive) -> None:
        """Connect; `receive` gets all bytes that arrive. Raises `LinkError` that says why there is no connection."""
        if self._reopening is not None:
            raise ProtocolMisuse(f"{self.spec} was opened twice.")
        self._loop, self._receive = asyncio.get_running_loop(), receive
        await self._connect(self._loop)
        self._reopening = asyncio.ensure_future(self._reopen(self._loop))

    def send(self, data: bytes, address: Address | None = None) -> None:
        """Send one frame to the peer. It is lost if the line is broken or its queue is full."""
        del address  # there is one peer
        if self._stream is None or not self._stream.put(data):
            self.lost += 1
        elif not self._waits:
            self._write()

    def close(self) -> None:
        """Close the line. A second call has no effect."""
        if self._reopening is not None:
            self._reopening.cancel()
        self._drop()

    async def _connect(self, loop: asyncio.AbstractEventLoop) -> None:
        if self.spec.mode is LinkMode.SERIAL:
            self._stream = ByteStream(_serial_line(self.spec), _SERIAL_QUEUE_BYTES)
        else:
            connection = await _connection(self.spec)
            self._local = plain_address(connection.getsockname())
            self._stream = ByteStream(connection, _TCP_QUEUE_BYTES)
        loop.add_reader(self._stream.file, self._read)

    async def _reopen(self, loop: asyncio.AbstractEventLoop) -> None:
        while True:
            await self._broken.wait()
            await asyncio.sleep(_REOPEN_S)
            with suppress(LinkError):
                await self._connect(loop)
                self._broken.clear()

    def _read(self) -> None:
        if self._stream is None or self._receive is None:
            return
        data = self._stream.read()
        if data is None:
            self._drop()
            self._broken.set()
        elif data:
            self._receive(data, self.spec.address)

    def _write(self) -> None:
        if self._stream is None or self._loop is None:
            return
        waited, self._waits = self._waits, self._stream.flush()
        if self._waits and not waited:
            self._loop.add_writer(self._stream.file, self._write)
        elif waited and not self._waits:
            self._loop.remove_writer(self._stream.file)

    def _drop(self) -> None:
        stream, self._stream, self._waits = self._stream, None, False
        if stream is not None and self._loop is not None:
            self._loop.remove_reader(stream.file)
            self._loop.remove_writer(stream.file)
            with suppress(OSError):
                stream.close()


Endpoint = UdpEndpoint | StreamEndpoint | LockstepEndpoint


def make_endpoint(spec: LinkSpec | str) -> Endpoint:
    """Return the endpoint of a spec, not open yet. Raises `UsageError` for text that names no link."""
    spec = parse_link_spec(spec) if isinstance(spec, str) else spec
    return StreamEndpoint(spec) if spec.mode in (LinkMode.TCP, LinkMode.SERIAL) else UdpEndpoint(spec)


async def _connection(spec: LinkSpec) -> socket.socket:
    where = host_port(*spec.address)
    try:
        async with asyncio.timeout(_CONNECT_S):
            return await _connected(*spec.address)
    except TimeoutError:
        raise LinkError(
            f"{where} did not answer within {_CONNECT_S:g} s.", hint="check host, port and network"
        ) from None
    except OSError as error:
        raise LinkError(
            f"no TCP connection to {where}: {error.strerror or error}.",
            hint="start the vehicle or simulator first, or check host and port",
        ) from error


async def _connected(host: str, port: int) -> socket.socket:
    loop = asyncio.get_running_loop()
    failure = OSError(f"{host} has no address")
    try:
        found = await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except UnicodeError:  # a name that is too long
        found = []
    for family, kind, _, _, address in found:
        sock = socket.socket(family, kind)
        try:
            sock.setblocking(False)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            await loop.sock_connect(sock, address)
        except BaseException as error:
            sock.close()
            if not isinstance(error, OSError):
                raise
            failure = error
        else:
            return sock
    raise failure


def _serial_line(spec: LinkSpec) -> serial.Serial:
    device, baud = spec.address
    try:
        return serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
    except Exception as error:  # one that is unplugged while it is opened raises termios.error, which is no OSError
        hint = "check the device name and your permission (group dialout), and close other programs that use it"
        if ":" in device:  # of a device by its path, or of a baud rate that is no number
            hint = f"the baud rate is the number after the last colon, for example {DEFAULT_BAUD}; else {hint}"
        number = error.args[0] if error.args and isinstance(error.args[0], int) else 0
        why = os.strerror(number) if number else str(error)
        raise LinkError(f"the serial line {device} cannot be opened at {baud} baud: {why}.", hint=hint) from error
