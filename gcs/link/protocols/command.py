"""The MAVLink command protocol (https://mavlink.io/en/services/command.html), for the sender and for the receiver.

CommandSender sends one COMMAND_LONG or COMMAND_INT and waits for its COMMAND_ACK:

    state      event                                next       sends
    IDLE       start                                WAITING    the command, confirmation 0
    WAITING    reply_s passed, retries left         WAITING    the command, confirmation + 1
    WAITING    COMMAND_ACK IN_PROGRESS              RUNNING
    RUNNING    COMMAND_ACK IN_PROGRESS              RUNNING    (extends the timeout by progress_s, up to limit_s)
    any        COMMAND_ACK ACCEPTED                 DONE
    any        COMMAND_ACK of refusal               FAILED
    any        retries used up, progress_s, limit_s FAILED

An acknowledgement counts if it comes from the commanded vehicle, names the command, and is addressed to us or to no
station. The protocol cannot distinguish two equal commands: send the second one after the first has ended.
The reasons of a refusal come as STATUSTEXT, before or after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto

from gcs.autopilots.protocol_timers import STANDARD, CommandTimers
from gcs.errors import GcsError, PeerRefusal, PeerTimeout, ProtocolMisuse
from gcs.link.wire.message import GROUND, Message, Station
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


class CommandState(Enum):
    """See the table above."""

    IDLE = auto()
    WAITING = auto()
    RUNNING = auto()
    DONE = auto()
    FAILED = auto()


class CommandSender:
    """One command to `peer`. `params` are up to seven numbers, or up to four with a `position`."""

    def __init__(
        self,
        command: int,
        params: Sequence[float],
        peer: Station,
        *,
        position: Position | None = None,
        me: Station = GROUND,
        timers: CommandTimers = STANDARD.command,
    ) -> None:
        most = 7 if position is None else 4
        if len(params) > most:
            raise ProtocolMisuse(f"{command_name(command)} takes {most} parameters, not {len(params)}.")
        self.command = command
        self.peer = peer
        self.me = me
        self.state = CommandState.IDLE
        self.error: GcsError | None = None
        self.ack: Message | None = None  # the last acknowledgement
        self._params = (*params, *(0.0,) * (most - len(params)))
        self._position = position
        self._timers = timers
        self._confirmation = 0
        self._next_s = 0.0
        self._end_s = 0.0

    @property
    def done(self) -> bool:
        """Whether the command has ended: with success if `error` is None."""
        return self.state in (CommandState.DONE, CommandState.FAILED)

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        return None if self.done or self.state is CommandState.IDLE else min(self._next_s, self._end_s)

    def start(self, now_s: float) -> list[Message]:
        """Return the command to send. Raises `ProtocolMisuse` if called twice."""
        if self.state is not CommandState.IDLE:
            raise ProtocolMisuse("a CommandSender was started twice; make a new one for a new command.")
        self.state = CommandState.WAITING
        self._next_s = now_s + self._timers.reply_s
        self._end_s = now_s + self._timers.limit_s
        return [self._message()]

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Process the acknowledgement of this command; ignore all other messages."""
        if (
            message.name != "COMMAND_ACK"
            or self.done
            or self.state is CommandState.IDLE
            or message.fields["command"] != self.command
            or not message.comes_from(self.peer)
            or not message.is_for(self.me)
        ):
            return []
        self.ack = message
        result = message.fields["result"]
        if result == MavResult.ACCEPTED:
            self.state = CommandState.DONE
        elif result == MavResult.IN_PROGRESS:
            self.state = CommandState.RUNNING
            self._next_s = now_s + self._timers.progress_s
        else:
            self._fail(CommandRefused(self.peer, self.command, result))
        return []

    def tick(self, now_s: float) -> list[Message]:
        """Repeat the command, or end with a timeout."""
        deadline_s = self.deadline_s
        if deadline_s is None or now_s < deadline_s:
            return []
        name = command_name(self.command)
        if self.state is CommandState.RUNNING or now_s >= self._end_s:
            self._fail(PeerTimeout(f"{self.peer} did not report the end of {name} in time."))
            return []
        if self._confirmation >= self._timers.retries:
            tries = self._confirmation + 1
            self._fail(PeerTimeout(f"{self.peer} did not acknowledge {name}, sent {tries} times."))
            return []
        self._confirmation += 1
        self._next_s = now_s + self._timers.reply_s
        return [self._message()]

    def cancel(self) -> list[Message]:
        """Stop waiting. The vehicle may have executed the command; no message is sent."""
        if not self.done:
            self._fail(
                PeerTimeout(f"the wait for {self.peer} to acknowledge {command_name(self.command)} was cancelled.")
            )
        return []

    def _fail(self, error: GcsError) -> None:
        self.error = error
        self.state = CommandState.FAILED

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
