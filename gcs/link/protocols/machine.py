"""The interface of every protocol machine. Time is an argument: seconds of any monotonic clock."""

from __future__ import annotations

from typing import Protocol

from gcs.errors import GcsError
from gcs.link.wire.message import Message


class Machine(Protocol):
    """One conversation with one vehicle: messages in, messages out, `done` at the end."""

    error: GcsError | None

    @property
    def done(self) -> bool:
        """Whether it has ended: with success if `error` is None."""

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""

    def start(self, now_s: float) -> list[Message]:
        """Return the first messages to send."""

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message."""

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""

    def cancel(self) -> list[Message]:
        """End the conversation; return the messages that end it on the vehicle."""
