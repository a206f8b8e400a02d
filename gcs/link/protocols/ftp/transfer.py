"""What reading and writing a file by MAVLink FTP have in common: states, opening, end."""

from dataclasses import dataclass

from gcs.errors import GcsError, PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.ftp.payload import NAME, FtpError, FtpOpcode, FtpPayload, FtpRefused, read_payload
from gcs.link.protocols.machine import MachineState
from gcs.link.wire.message import Message

_SEQS = 0x10000


@dataclass
class _Request:
    payload: FtpPayload
    sent_s: float
    resend_s: float
    repeats: int = 0


class FtpRequests:
    """The open requests to one vehicle.

    They time out after `give_up_s` without any progress, and when the whole transfer is slower than `slowest_Bps`.
    """

    def __init__(self, exchange: Exchange) -> None:
        self.peer = exchange.peer
        self.numbers = exchange.numbers
        self.heard = False  # the vehicle answers to MAVLink FTP
        self._exchange = exchange
        self._round_trip = exchange.round_trip
        self._timers = timers = exchange.timers.ftp
        self._timeout_s = timers.give_up_s
        self._limit_s = timers.limit_s
        self._began_s: float | None = None
        self._give_up_s: float | None = None
        self._open: dict[int, _Request] = {}

    def __len__(self) -> int:
        return len(self._open)

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        if self._give_up_s is None:
            return None
        end_s = self._give_up_s if self._began_s is None else min(self._give_up_s, self._began_s + self._limit_s)
        return min([end_s, *(one.resend_s for one in self._open.values())])

    @property
    def wait_s(self) -> float:
        """The wait for an answer before a request is repeated."""
        return self._round_trip.wait_s()

    def request(
        self,
        opcode: FtpOpcode,
        now_s: float,
        *,
        session: int,
        offset: int = 0,
        data: bytes = b"",
        size: int | None = None,
    ) -> Message:
        """Return a new request, which is open until it is answered."""
        payload = FtpPayload(self.numbers.next_seq(), session, opcode, offset, data, size=size)
        self._open[payload.seq] = _Request(payload, now_s, now_s + self._round_trip.wait_s())
        if self._began_s is None:
            self._began_s = now_s
            self.progressed(now_s)
        return payload.message(self.peer)

    def match(self, message: Message, now_s: float) -> tuple[FtpPayload, FtpPayload] | None:
        """Return a request and its reply, and close the request; None for any other message. It is no progress yet."""
        reply = self.reply(message)
        if reply is None:
            return None
        request = self._open.get((reply.seq - 1) % _SEQS)
        if request is None or reply.req_opcode != request.payload.opcode:
            return None
        del self._open[request.payload.seq]
        if not request.repeats:
            self._round_trip.learn(now_s - request.sent_s)
        return request.payload, reply

    def reply(self, message: Message) -> FtpPayload | None:
        """Return the vehicle's reply to any request of ours; None for any other message."""
        if message.name != NAME or not self._exchange.hears(message):
            return None
        reply = read_payload(message)
        if reply is None or reply.opcode not in (FtpOpcode.ACK, FtpOpcode.NAK):
            return None
        self.heard = True
        return reply

    def allow(self, size: int) -> None:
        """Extend the time limit of the transfer to that of a file of `size` bytes."""
        self._limit_s = self._timers.limit_s + size / self._timers.slowest_Bps

    def progressed(self, now_s: float) -> None:
        """Restart the timeout."""
        self._give_up_s = now_s + self._timeout_s

    def drop(self, opcode: int | None = None) -> None:
        """Close all requests, or those of `opcode`."""
        self._open = {
            seq: one for seq, one in self._open.items() if opcode is not None and one.payload.opcode != opcode
        }

    def open_requests(self, opcode: int) -> list[FtpPayload]:
        """Return the open requests of `opcode`."""
        return [one.payload for one in self._open.values() if one.payload.opcode == opcode]

    def tick(self, now_s: float) -> list[Message]:
        """Return the requests to repeat."""
        repeated = []
        for one in self._open.values():
            if now_s >= one.resend_s:
                one.repeats += 1
                one.resend_s = now_s + self._round_trip.wait_s(one.repeats)
                repeated.append(one.payload.message(self.peer))
        return repeated

    def timed_out(self, path: str, now_s: float) -> PeerTimeout | None:
        """Return the error once `timeout_s` has passed without progress."""
        if self._began_s is not None and now_s >= self._began_s + self._limit_s:
            return PeerTimeout(
                f"{self.peer} answers too slowly: {path} was not complete within {self._limit_s:.0f} s.",
                hint="check the link, or send the mission item by item (--transfer items)",
            )
        if self._give_up_s is None or now_s < self._give_up_s:
            return None
        silence = "stopped answering" if self.heard else "does not answer to MAVLink FTP"
        return PeerTimeout(
            f"{self.peer} {silence}: no answer about {path} within {self._timeout_s:g} s.",
            hint="check the link, or send the mission item by item (--transfer items)",
        )


_RESETS = frozenset({FtpError.FAIL, FtpError.NO_SESSIONS_AVAILABLE})
_TEMPORARY = _RESETS | {FtpError.INVALID_SESSION}
_CLOSED = frozenset({FtpError.FAIL, FtpError.INVALID_SESSION, FtpError.FILE_NOT_FOUND})


class FtpTransfer:
    """One file of one vehicle, opened with `opcode` at most `tries` times, also while another file is open.

    ArduPilot has one session for all stations (4.5), or some (4.7). ResetSessions closes a file that an earlier
    transfer of ours left open. The server closes a file of another station after 3 s without any request; therefore we
    send no request for 3.4 s.
    """

    def __init__(self, opcode: FtpOpcode, path: str, exchange: Exchange, tries: int) -> None:
        self.state = MachineState.IDLE
        self.error: GcsError | None = None
        self._path = path
        self._timers = exchange.timers.ftp
        self._requests = FtpRequests(exchange)
        self._opcode = opcode
        self._tries = tries
        self._resets = False
        self._resume_s: float | None = None  # of opening: there is nothing to do before
        self._session = 0

    @property
    def done(self) -> bool:
        """Whether it has ended: with success if `error` is None."""
        return self.state in (MachineState.DONE, MachineState.FAILED)

    @property
    def heard(self) -> bool:
        """Whether the vehicle has answered to MAVLink FTP."""
        return self._requests.heard

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        if self.done:
            return None
        return self._requests.deadline_s if self._resume_s is None else self._resume_s

    def start(self, now_s: float) -> list[Message]:
        """Return the request for the file. Raises `ProtocolMisuse` if called twice."""
        if self.state is not MachineState.IDLE:
            raise ProtocolMisuse(f"an {type(self).__name__} was started twice: create a new one.")
        return self._open(now_s)

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        if self.done:
            return []
        if self._resume_s is not None:
            return self._open(now_s) if now_s >= self._resume_s else []
        error = self._requests.timed_out(self._path, now_s)
        return self._fail(error) if error is not None else self._requests.tick(now_s)

    def cancel(self) -> list[Message]:
        """End the transfer. The vehicle keeps its old file, unless a new one was already complete."""
        return [] if self.done else self._fail(PeerError(f"the transfer of {self._path} was cancelled."))

    def _open(self, now_s: float) -> list[Message]:
        self.state = MachineState.OPENING
        self._tries -= 1
        self._resume_s = None
        self._requests.drop()
        session = self._requests.numbers.next_session()
        return [self._requests.request(self._opcode, now_s, session=session, data=self._path.encode())]

    def _opened(self, reply: FtpPayload, now_s: float) -> list[Message] | None:
        """Process the answer to an opening request: the messages to send, or None once the file is open."""
        self._requests.progressed(now_s)
        if reply.req_opcode == FtpOpcode.RESET_SESSIONS:
            return self._open(now_s)
        if reply.opcode == FtpOpcode.ACK:
            self._session = reply.session
            return None
        if reply.error not in _TEMPORARY or self._tries <= 0:
            return self._fail(FtpRefused(self._requests.peer, self._path, reply))
        self._resets = not self._resets and reply.error in _RESETS
        if self._resets:
            return [self._requests.request(FtpOpcode.RESET_SESSIONS, now_s, session=reply.session)]
        self._resume_s = now_s + self._timers.reopen_s
        return []

    def _refused(self, reply: FtpPayload, now_s: float) -> list[Message]:
        """Open the file again if it is not open any more, and a try is left; else fail."""
        if self.state is not MachineState.CLOSING and reply.error in _CLOSED and self._tries > 0:
            return self._open(now_s)
        return self._fail(FtpRefused(self._requests.peer, self._path, reply))

    def _fail(self, error: GcsError) -> list[Message]:
        raise NotImplementedError
