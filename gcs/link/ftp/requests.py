"""Requests of MAVLink FTP under way to one vehicle: numbered, repeated until answered, matched with their answers.

Knows: sequence and session numbers, when to ask again. Does not know: what the requests are for, clocks (time is an
argument).

A reply carries its request's number plus one, and a repeated request the number it had: a server that has answered it
already says the same again (https://mavlink.io/en/services/ftp.html). Numbers go on from one transfer to the next, so
that what comes late, or twice, fits no question.
"""

from __future__ import annotations

from dataclasses import dataclass

from gcs.errors import PeerTimeout
from gcs.link.ftp.payload import NAME, FtpOpcode, FtpPayload, read_payload
from gcs.link.microservices.rtt import RttEstimator
from gcs.link.wire.message import Message, Station

_SEQS, _SESSIONS = 0x10000, 255
_BURST_MAX = 4096


class FtpNumbers:
    """The numbers given out so far to one vehicle."""

    def __init__(self, seq: int = 0, session: int = 0) -> None:
        self._seq, self._session = seq % _SEQS, session % _SESSIONS

    def next_seq(self) -> int:
        """Of the next request."""
        self._seq = (self._seq + 1) % _SEQS
        return self._seq

    def skip(self) -> None:
        """Leave out what a burst's replies may use: ArduPilot tells repeated requests by its last reply's number."""
        self._seq = (self._seq + _BURST_MAX) % _SEQS

    def next_session(self) -> int:
        """For the next file, 1 to 255: servers take the client's number, or answer with one of their own."""
        self._session = self._session % _SESSIONS + 1
        return self._session


@dataclass
class _Asked:
    payload: FtpPayload
    asked_s: float
    resend_s: float
    repeats: int = 0


class FtpRequests:
    """What is awaited from one vehicle."""

    def __init__(
        self, peer: Station, me: Station, numbers: FtpNumbers, round_trip: RttEstimator, give_up_s: float
    ) -> None:
        self.peer = peer
        self.me = me
        self.numbers = numbers
        self.heard = False  # it knows MAVLink FTP
        self._round_trip = round_trip
        self._patience_s = give_up_s
        self._give_up_s: float | None = None
        self._asked: dict[int, _Asked] = {}

    def __len__(self) -> int:
        return len(self._asked)

    @property
    def deadline_s(self) -> float | None:
        """When `tick` next has something to do."""
        if self._give_up_s is None:
            return None
        return min([self._give_up_s, *(one.resend_s for one in self._asked.values())])

    @property
    def wait_s(self) -> float:
        """How long an answer may take."""
        return self._round_trip.wait_s()

    def ask(
        self,
        opcode: FtpOpcode,
        now_s: float,
        *,
        session: int,
        offset: int = 0,
        data: bytes = b"",
        size: int | None = None,
    ) -> Message:
        """A new request."""
        payload = FtpPayload(self.numbers.next_seq(), session, opcode, offset, data, size=size)
        self._asked[payload.seq] = _Asked(payload, now_s, now_s + self._round_trip.wait_s())
        if self._give_up_s is None:
            self.progressed(now_s)
        return payload.message(self.peer)

    def take(self, message: Message, now_s: float) -> tuple[FtpPayload, FtpPayload] | None:
        """A request and its reply, which is no longer awaited then; None for anything else."""
        reply = self.reply(message)
        if reply is None:
            return None
        asked = self._asked.get((reply.seq - 1) % _SEQS)
        if asked is None or reply.req_opcode != asked.payload.opcode:
            return None
        del self._asked[asked.payload.seq]
        if not asked.repeats:
            self._round_trip.learn(now_s - asked.asked_s)
        self.progressed(now_s)
        return asked.payload, reply

    def reply(self, message: Message) -> FtpPayload | None:
        """What a message of the peer's to us answers, whatever was asked."""
        if message.name != NAME or not message.comes_from(self.peer) or not message.is_for(self.me):
            return None
        reply = read_payload(message)
        if reply is None or reply.opcode not in (FtpOpcode.ACK, FtpOpcode.NAK):
            return None
        self.heard = True
        return reply

    def progressed(self, now_s: float) -> None:
        """Something came of it: patience begins anew."""
        self._give_up_s = now_s + self._patience_s

    def drop(self, opcode: int | None = None) -> None:
        """Nothing is awaited any more, or nothing that asked for `opcode`."""
        self._asked = {
            seq: one for seq, one in self._asked.items() if opcode is not None and one.payload.opcode != opcode
        }

    def awaits(self, opcode: int) -> list[FtpPayload]:
        """What has been asked with `opcode` and not been answered."""
        return [one.payload for one in self._asked.values() if one.payload.opcode == opcode]

    def tick(self, now_s: float) -> list[Message]:
        """What has to be asked again."""
        again = []
        for one in self._asked.values():
            if now_s >= one.resend_s:
                one.repeats += 1
                one.resend_s = now_s + self._round_trip.wait_s(one.repeats)
                again.append(one.payload.message(self.peer))
        return again

    def gave_up(self, path: str, now_s: float) -> PeerTimeout | None:
        """The error, once patience has ended."""
        if self._give_up_s is None or now_s < self._give_up_s:
            return None
        said = "stopped answering about" if self.heard else "does not answer to MAVLink FTP, asked for"
        return PeerTimeout(
            f"{self.peer} {said} {path}.",
            hint="check the link, or send the mission item by item (--transfer items)",
        )
