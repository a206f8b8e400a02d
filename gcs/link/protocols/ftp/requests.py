"""FtpRequests: the open requests of MAVLink FTP to one vehicle; numbered, repeated until answered, matched to answers.

A reply carries the number of its request plus one. A repeated request keeps its number, so that a server that has
answered it sends the same answer again (https://mavlink.io/en/services/ftp.html). Numbers continue from one transfer to
the next, so that a late or repeated answer matches no request.
"""

from __future__ import annotations

from dataclasses import dataclass

from gcs.errors import PeerTimeout
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.ftp.payload import NAME, FtpOpcode, FtpPayload, read_payload
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
