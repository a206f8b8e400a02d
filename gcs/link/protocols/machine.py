"""Protocol machines: their interface, and the tables of transitions that they follow.

Time is an argument: seconds of any monotonic clock. tools/reference.py prints the tables into docs/links.md.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, StrEnum, auto
from typing import Generic, Protocol, Self, TypeVar

from gcs.errors import GcsError, ProtocolMisuse
from gcs.link.protocols.exchange import Exchange
from gcs.link.wire.message import Message


class Machine(Protocol):
    """One conversation with one vehicle: messages in, messages out, `done` at the end."""

    @property
    def error(self) -> GcsError | None:
        """Why it failed; None before the end, and if it succeeded."""

    @property
    def done(self) -> bool:
        """Whether it has ended: with success if `error` is None."""

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""

    def start(self, now_s: float) -> list[Message]:
        """Return the first messages to send. Raises `ProtocolMisuse` if called twice."""

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message; none if it belongs to another conversation."""

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""

    def cancel(self) -> list[Message]:
        """End the conversation; return the messages that end it on the vehicle."""


class MachineState(Enum):
    """The states of all tables: each machine begins in IDLE and ends in DONE or FAILED."""

    IDLE = auto()
    OFFERED = auto()
    SENDING = auto()
    ALL_SENT = auto()
    LISTED = auto()
    PULLING = auto()
    SENT = auto()
    OPENING = auto()
    WRITING = auto()
    SEALING = auto()
    READING = auto()
    WAITING = auto()
    RUNNING = auto()
    CLOSING = auto()
    DONE = auto()
    FAILED = auto()


class MachineEvent(StrEnum):
    """The events of all tables, in the words of the document."""

    START = "start"
    COUNT = "MISSION_COUNT"
    REQUEST_LIST = "MISSION_REQUEST_LIST"
    REQUEST = "MISSION_REQUEST(_INT)"
    ITEM = "MISSION_ITEM(_INT)"
    UNUSABLE_ITEM = "an item that is refused"
    DIFFERENT_ITEM = "an item of another meaning"
    MISSION_ACK = "MISSION_ACK"
    COMMAND_ACK = "COMMAND_ACK"
    ENDED = "the transfer ended"
    WAIT = "no answer in time"
    LIMIT = "time limit"
    CANCEL = "cancel"


M_contra = TypeVar("M_contra", contravariant=True)


@dataclass(frozen=True)
class Guard(Generic[M_contra]):
    """A condition in words, for the document, and as a function of the machine and the message."""

    words: str
    holds: Callable[[M_contra, Message], bool]


@dataclass(frozen=True)
class Transition(Generic[M_contra]):
    """One transition. `sends` and `rule` are for the document; `when` None: always; `to` None: the same state."""

    states: tuple[MachineState, ...]
    event: MachineEvent
    when: Guard[M_contra] | None
    to: MachineState | None
    action: Callable[[M_contra, Message, float], list[Message]]  # the message and the time; returns what to send
    sends: str = ""
    rule: str = ""


class Table(Generic[M_contra]):
    """The rows of one machine. It follows the first one for its state and the event whose condition holds."""

    def __init__(self, *rows: Transition[M_contra]) -> None:
        self.rows = rows
        self.at: dict[tuple[MachineState, MachineEvent], list[Transition[M_contra]]] = {}
        for row in rows:
            for state in row.states:
                self.at.setdefault((state, row.event), []).append(row)


TIMER = Message("", {})  # the message of an event that is none


class TableMachine:
    """A machine that follows a table."""

    def __init__(self, table: Table[Self], exchange: Exchange) -> None:
        self.state = MachineState.IDLE
        self.error: GcsError | None = None
        self.exchange = exchange
        self.peer = exchange.peer
        self._table: Table[Self] = table

    @property
    def done(self) -> bool:
        """Whether it has ended: with success if `error` is None."""
        return self.state is MachineState.DONE or self.state is MachineState.FAILED

    def start(self, now_s: float) -> list[Message]:
        """Return the first messages to send. Raises `ProtocolMisuse` if called twice."""
        if self.state is not MachineState.IDLE:
            raise ProtocolMisuse(f"one {type(self).__name__} was started twice: create a new one.")
        return self._follow(MachineEvent.START, TIMER, now_s)

    def cancel(self) -> list[Message]:
        """End the conversation; return the messages that end it on the vehicle."""
        return self._follow(MachineEvent.CANCEL, TIMER, 0.0)

    def _follow(self, event: MachineEvent, message: Message, now_s: float) -> list[Message]:
        """Take the action of the row to follow, then its state; without a row nothing changes."""
        row = self._row(event, message)
        if row is None:
            return []
        messages = row.action(self, message, now_s)
        if row.to is not None:
            self.state = row.to
        return messages

    def _row(self, event: MachineEvent, message: Message) -> Transition[Self] | None:
        for row in self._table.at.get((self.state, event), ()):
            if row.when is None or row.when.holds(self, message):
                return row
        return None

    def _fail(self, error: GcsError) -> list[Message]:
        self.error = error
        return []


def ignore(_machine: object, _message: Message, _now_s: float) -> list[Message]:
    """The action of a row that does nothing."""
    return []
