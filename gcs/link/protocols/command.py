"""The MAVLink command protocol (https://mavlink.io/en/services/command.html), for the sender and for the receiver.

CommandSender sends one COMMAND_LONG or COMMAND_INT and waits for its COMMAND_ACK, by the table after it.

An acknowledgement counts if it comes from the commanded vehicle, names the command, and is addressed to us or to no
station. The protocol cannot distinguish two equal commands: send the second one after the first has ended.
The reasons of a refusal come as STATUSTEXT, before or after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gcs.autopilots.protocol_timers import CommandTimers
from gcs.errors import PeerRefusal, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.machine import TIMER, Guard, MachineEvent, MachineState, Table, TableMachine
from gcs.link.protocols.machine import Transition as Row
from gcs.link.wire.message import Message, Station
from gcs.mavlink import MavResult
from gcs.mavlink_names import command_name, result_words


@dataclass(frozen=True)
class Position:
    """The position of a COMMAND_INT, to 1e-7 degree. The altitude is in the frame `frame` (MAV_FRAME)."""

    frame: int
    lat_degE7: int
    lon_degE7: int
    alt_m: float


class CommandRefused(PeerRefusal):
    """The vehicle answered a command with a MAV_RESULT other than ACCEPTED."""

    def __init__(self, peer: Station, command: int, result: int, *, reason: str = "") -> None:
        because = f"; it reports: {reason}" if reason else ""
        super().__init__(f"{peer} refused {command_name(command)}: {result_words(result)}{because}.")
        self.peer = peer
        self.command = command
        self.result = result

    def because(self, reason: str) -> CommandRefused:
        """The same refusal with the vehicle's STATUSTEXT added."""
        return CommandRefused(self.peer, self.command, self.result, reason=reason)


class CommandSender(TableMachine):
    """One command to the peer. `params` are up to seven numbers, or up to four with a `position`."""

    def __init__(
        self,
        command: int,
        params: Sequence[float],
        exchange: Exchange,
        *,
        position: Position | None = None,
        timers: CommandTimers | None = None,
    ) -> None:
        super().__init__(COMMAND, exchange)
        most = 7 if position is None else 4
        if len(params) > most:
            raise ProtocolMisuse(f"{command_name(command)} takes {most} parameters, not {len(params)}.")
        self.command = command
        self.ack: Message | None = None  # the last acknowledgement
        self._params = (*params, *(0.0,) * (most - len(params)))
        self._position = position
        self._timers = timers or exchange.timers.command
        self._confirmation = 0
        self._next_s = 0.0
        self._end_s = 0.0

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        return min(self._next_s, self._end_s) if self.state in _OPEN else None

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Process the acknowledgement of this command; ignore all other messages."""
        if message.name != "COMMAND_ACK" or message.fields["command"] != self.command:
            return []
        return self._follow(_E.COMMAND_ACK, message, now_s) if self.exchange.hears(message) else []

    def tick(self, now_s: float) -> list[Message]:
        """Repeat the command, or end with a timeout."""
        if now_s >= self._end_s:
            return self._follow(_E.LIMIT, TIMER, now_s)
        return self._follow(_E.WAIT, TIMER, now_s) if now_s >= self._next_s else []

    def _send(self, _: Message, now_s: float) -> list[Message]:
        self._next_s = now_s + self._timers.reply_s
        self._end_s = now_s + self._timers.limit_s
        return [self._message()]

    def _send_again(self, _: Message, now_s: float) -> list[Message]:
        self._confirmation += 1
        self._next_s = now_s + self._timers.reply_s
        return [self._message()]

    def _accepted(self, ack: Message, _: float) -> list[Message]:
        self.ack = ack
        return []

    def _in_progress(self, ack: Message, now_s: float) -> list[Message]:
        self.ack = ack
        self._next_s = now_s + self._timers.progress_s
        return []

    def _refused(self, ack: Message, _: float) -> list[Message]:
        self.ack = ack
        return self._fail(CommandRefused(self.peer, self.command, ack.fields["result"]))

    def _unacknowledged(self, _message: Message, _now_s: float) -> list[Message]:
        tries = self._confirmation + 1
        return self._fail(
            PeerTimeout(f"{self.peer} did not acknowledge {command_name(self.command)}, sent {tries} times.")
        )

    def _unfinished(self, _message: Message, _now_s: float) -> list[Message]:
        return self._fail(PeerTimeout(f"{self.peer} did not report the end of {command_name(self.command)} in time."))

    def _cancelled(self, _message: Message, _now_s: float) -> list[Message]:
        """Stop waiting. The vehicle may have executed the command; no message is sent."""
        name = command_name(self.command)
        return self._fail(PeerTimeout(f"the wait for {self.peer} to acknowledge {name} was cancelled."))

    def _message(self) -> Message:
        fields: dict[str, float | int] = {
            **self.peer.target,
            "command": int(self.command),
            **{f"param{n}": value for n, value in enumerate(self._params, start=1)},
        }
        position = self._position
        if position is None:
            return Message("COMMAND_LONG", {**fields, "confirmation": self._confirmation})
        return Message(
            "COMMAND_INT",
            {
                **fields,
                "frame": position.frame,
                "current": 0,
                "autocontinue": 0,
                "x": position.lat_degE7,
                "y": position.lon_degE7,
                "z": position.alt_m,
            },
        )


_E, _S = MachineEvent, MachineState
_M = CommandSender
_OPEN = (_S.WAITING, _S.RUNNING)
_If = Guard[_M]
_RETRIES = _If("`retries` are left", lambda m, _: m._confirmation < m._timers.retries)
_ACCEPTED = _If("ACCEPTED", lambda _, ack: ack.fields["result"] == MavResult.ACCEPTED)
_IN_PROGRESS = _If("IN_PROGRESS", lambda _, ack: ack.fields["result"] == MavResult.IN_PROGRESS)

COMMAND: Table[CommandSender] = Table(
    Row((_S.IDLE,), _E.START, None, _S.WAITING, _M._send, "the command, confirmation 0"),
    Row((_S.WAITING,), _E.WAIT, _RETRIES, None, _M._send_again, "the command, confirmation + 1"),
    Row((_S.WAITING,), _E.WAIT, None, _S.FAILED, _M._unacknowledged),
    Row((_S.RUNNING,), _E.WAIT, None, _S.FAILED, _M._unfinished),
    Row(_OPEN, _E.COMMAND_ACK, _ACCEPTED, _S.DONE, _M._accepted),
    Row(_OPEN, _E.COMMAND_ACK, _IN_PROGRESS, _S.RUNNING, _M._in_progress),
    Row(_OPEN, _E.COMMAND_ACK, None, _S.FAILED, _M._refused),
    Row(_OPEN, _E.LIMIT, None, _S.FAILED, _M._unfinished),
    Row((_S.IDLE, *_OPEN), _E.CANCEL, None, _S.FAILED, _M._cancelled),
)


class CommandMemory:
    """The receiver's memory: recognises a repeated COMMAND_LONG, to acknowledge it again without executing it again.

    A repetition is the same command with the same parameters from the same station, `confirmation` above 0,
    within `memory_s` of the last answer.
    """

    def __init__(self, memory_s: float = 10.0) -> None:
        self._memory_s = memory_s
        self._answers: dict[Station, tuple[tuple[object, ...], Message, float]] = {}

    def repeated(self, message: Message, now_s: float) -> Message | None:
        """Return the acknowledgement to send again, or None if the command is new."""
        known = self._answers.get(message.source)
        if known is None or not message.fields.get("confirmation"):
            return None
        key, ack, then_s = known
        return ack if key == _command_key(message) and now_s - then_s <= self._memory_s else None

    def answered(self, message: Message, ack: Message, now_s: float) -> None:
        """Record the acknowledgement of a command."""
        self._answers[message.source] = (_command_key(message), ack, now_s)


def command_ack(command: Message, result: int, *, progress: int = 0) -> Message:
    """Return the COMMAND_ACK to the sender of a COMMAND_LONG or COMMAND_INT."""
    return Message(
        "COMMAND_ACK",
        {"command": command.fields["command"], "result": int(result), "progress": progress, **command.source.target},
    )


def _command_key(message: Message) -> tuple[object, ...]:
    return tuple((k, repr(v)) for k, v in message.fields.items() if k != "confirmation")
