"""What every protocol machine offers.

Knows: nothing of any protocol. Time is an argument, seconds of any monotonic clock.
"""

from __future__ import annotations

from typing import Protocol

from gcs.errors import GcsError
from gcs.link.wire.message import Message


class Machine(Protocol):
    """Lives for one conversation: messages in, messages out, `done` at the end."""

    error: GcsError | None

    @property
    def done(self) -> bool:
        """Whether it ended, well (`error` is None) or badly."""

    @property
    def deadline_s(self) -> float | None:
        """When to call `tick`."""

    def start(self, now_s: float) -> list[Message]:
        """The first messages."""

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """The answers to a message."""

    def tick(self, now_s: float) -> list[Message]:
        """The messages that time calls for."""

    def cancel(self) -> list[Message]:
        """Ends it from our side; what the peer has to be told."""
