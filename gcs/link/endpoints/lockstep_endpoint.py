"""The link to emulated vehicles that this program started, and whose time it shares.

Time advances in turns. The vehicles send what they have to say at an instant, and the next instant at which they could
say more. The station reads it and acts, as its timers have it, until it can only wait for that next instant; then it
sends what it has for them, and until when it would wait. The vehicles get that at the second step after theirs, and
take the step between while the station acts. Nobody's turn has a length of its own, so neither a busy machine nor a
fast one changes what is said when: the flight is the same to the last bit.
"""

import asyncio
import socket
import struct

from gcs.errors import ProtocolMisuse
from gcs.link.endpoints.addresses import Address
from gcs.link.endpoints.base import LinkMode, LinkSpec, Receive
from gcs.util.steady_loop import SteadyLoop

FROM_VEHICLES = struct.Struct("<ddI")  # this instant, the next one, s of emulated time; bytes of frames that follow
FROM_STATION = struct.Struct("<dI")  # until when the station waits, s of emulated time; bytes of frames that follow
ADDRESS: Address = ("lockstep", 0)
_LARGEST = 1 << 18  # bytes read at once


class Turns:
    """One end of the socket: whole turns of the other end, and our own. It waits only to write."""

    def __init__(self, sock: socket.socket, head: struct.Struct) -> None:
        """`head` is the form of the other end's turns; its last field counts the bytes that follow."""
        self.ended = False
        self._socket = sock
        self._head = head
        self._unread = bytearray()

    @property
    def file(self) -> int:
        """The file descriptor; -1 after `close`."""
        return self._socket.fileno()

    def read(self) -> tuple[tuple[float, ...], bytes] | None:
        """Return the times and the frames of the other end's turn; None if it is not complete yet, or `ended`."""
        while (lacks := self._lacks()) > 0:  # never a byte of the turn after it, which stays with the socket
            try:
                data = self._socket.recv(min(lacks, _LARGEST), socket.MSG_DONTWAIT)
            except BlockingIOError:
                return None
            except OSError:
                data = b""
            if not data:
                self.ended = True
                return None
            self._unread += data
        *times_s, _ = self._head.unpack_from(self._unread)
        frames = bytes(self._unread[self._head.size :])
        self._unread.clear()
        return tuple(times_s), frames

    def _lacks(self) -> int:
        """The bytes that are still to come of the turn, as far as is known."""
        if len(self._unread) < self._head.size:
            return self._head.size - len(self._unread)
        size: int = self._head.unpack_from(self._unread)[-1]
        return self._head.size + size - len(self._unread)

    def write(self, turn: bytes) -> None:
        """Send our turn."""
        try:
            self._socket.sendall(turn)
        except OSError:
            self.ended = True

    def close(self) -> None:
        """Release the socket. A second call has no effect."""
        self._socket.close()


class LockstepEndpoint:
    """The station's end. While it is open, the event loop has the vehicles' time: see `SteadyLoop.follow`."""

    def __init__(self, sock: socket.socket) -> None:
        """`sock` is connected to `sim-bridge --link lockstep:FD`."""
        self.spec = LinkSpec(LinkMode.TCP, *ADDRESS)
        self.lost = 0  # frames: none ever is
        self.now_s = 0.0  # emulated
        self._next_s = 0.0  # nothing arrives before
        self._waits = False  # for the vehicles' turn
        self._turns = Turns(sock, FROM_VEHICLES)
        self._frames = bytearray()
        self._loop: SteadyLoop | None = None
        self._receive: Receive | None = None

    @property
    def local_address(self) -> Address:
        """A name, because no other program can send here."""
        return ADDRESS

    async def open(self, receive: Receive | None) -> None:
        """Share the vehicles' time from now on; `receive` gets what they send. Raises `ProtocolMisuse`."""
        loop = asyncio.get_running_loop()
        if self._loop is not None or not isinstance(loop, SteadyLoop):
            raise ProtocolMisuse("emulated time needs an event loop of its own, and is shared once.")
        self._loop, self._receive = loop, receive
        loop.follow(self)

    def send(self, data: bytes, address: Address | None = None) -> None:
        """Send frames at the end of this turn."""
        del address  # there is one peer
        self._frames += data

    def comes_to(self, t_s: float) -> bool:
        """Advance to `t_s` if the vehicles say nothing before it; else let them go on, and return False."""
        if self._waits:
            return False
        if t_s < self._next_s:
            self.now_s = max(self.now_s, t_s)
            return True
        self._turns.write(FROM_STATION.pack(t_s, len(self._frames)) + self._frames)
        self._frames.clear()
        self._waits = True
        if self._loop is not None:
            self._loop.add_reader(self._turns.file, self._read)
        return False

    def close(self) -> None:
        """Close the socket: the event loop goes back to real time. A second call has no effect."""
        loop, self._loop = self._loop, None
        if loop is not None:
            loop.remove_reader(self._turns.file)
            loop.follow(None)
        self._turns.close()

    def _read(self) -> None:
        turn = self._turns.read()
        if self._turns.ended and self._loop is not None:  # silent vehicles are what every timeout is for
            self._loop.remove_reader(self._turns.file)
            self._loop.follow(None)
        if turn is None:
            return
        if self._loop is not None:  # the next turn may be there already, and is not looked at before this one ends
            self._loop.remove_reader(self._turns.file)
        (self.now_s, self._next_s), frames = turn
        self._waits = False
        if frames and self._receive is not None:
            self._receive(frames, ADDRESS)
