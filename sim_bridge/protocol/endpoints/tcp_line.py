"""A TCP server for any number of ground stations.

The vehicles do not wait for a ground station that does not read. What does not fit into its buffer is lost, whole
frames at a time, so the stream stays readable.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator, Sequence

from gcs.errors import LinkError
from gcs.link.endpoints.ip_address import host_port, plain_address
from sim_bridge.protocol.endpoints.address import EndpointSpec
from sim_bridge.protocol.endpoints.line import LARGEST, PER_TURN, PeerAddress, Source, Watch

_MOST_STATIONS = 16
_BACKLOG_BYTES = 1 << 18


class _Connection:
    """One ground station; `number` distinguishes it from earlier ones."""

    def __init__(self, sock: socket.socket, number: int) -> None:
        self.socket = sock
        self.number = number
        self.backlog = bytearray()

    def send(self, frames: Sequence[bytes]) -> None:
        for frame in frames:
            if len(self.backlog) + len(frame) <= _BACKLOG_BYTES:
                self.backlog += frame
        try:
            del self.backlog[: self.socket.send(self.backlog)]
        except OSError:
            return


class TcpLine:
    """One server; `row` is that of the vehicle, or 0 where all share it."""

    def __init__(self, spec: EndpointSpec, row: int, watch: Watch) -> None:
        """Listen. Raises `LinkError` if the port is taken, or the host is not of this machine."""
        self._watch = watch
        self._connections: dict[int, _Connection] = {}
        self._accepted = 0
        try:
            family = socket.AF_INET6 if ":" in spec.host else socket.AF_INET
            self._server = socket.create_server((spec.host, spec.port_of(row)), family=family)
        except OSError as error:
            raise LinkError(f"{spec} cannot be opened: {error.strerror}.", hint="choose another port") from error
        self._server.setblocking(False)
        watch.add(self._server.fileno(), self)
        self.place = PeerAddress(str(spec.kind), host_port(*plain_address(self._server.getsockname())))

    def receive(self, file: int, now_s: float) -> Iterator[tuple[bytes, Source]]:
        """Return the bytes of one connection; a new connection has none yet."""
        connection = self._connections.get(file)
        if connection is None:
            self._accept()
            return
        for _ in range(PER_TURN):
            try:
                data = connection.socket.recv(LARGEST)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:
                data = b""
            if not data:
                self._drop(file)
                return
            yield data, connection.number

    def heard(self, source: Source, now_s: float) -> None:
        """Nothing to do: every connection receives telemetry from the start."""

    def send(self, frames: Sequence[bytes], now_s: float) -> None:
        """Send frames to every connection."""
        for connection in self._connections.values():
            connection.send(frames)

    def close(self) -> None:
        """Close all connections and the port."""
        for file in list(self._connections):
            self._drop(file)
        if self._server.fileno() >= 0:
            self._watch.remove(self._server.fileno())
            self._server.close()

    def _accept(self) -> None:
        try:
            sock, _ = self._server.accept()
        except OSError:
            return
        if len(self._connections) >= _MOST_STATIONS:
            sock.close()
            return
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._accepted += 1
        self._connections[sock.fileno()] = _Connection(sock, self._accepted)
        self._watch.add(sock.fileno(), self)

    def _drop(self, file: int) -> None:
        connection = self._connections.pop(file)
        self._watch.remove(file)
        connection.socket.close()
