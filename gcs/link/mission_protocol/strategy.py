"""Which way a mission takes to its vehicle: as one file, or item by item.

Knows: the choice, and how to fall back. Does not know: the ways themselves, sockets, clocks (time is an argument).
"""

from __future__ import annotations

from enum import StrEnum

from gcs.autopilots.traits import Autopilot
from gcs.errors import GcsError
from gcs.link.microservices.machine import Machine
from gcs.link.wire.message import Message
from gcs.mavlink import MissionType

FILE_ITEMS_MIN = 5  # a file of few takes six round trips and one to ask for the ability, n items n + 3


class Transfer(StrEnum):
    """AUTO sends a file where that is faster and the vehicle claims to take files, and items where it then does not."""

    AUTO = "auto"
    ITEMS = "items"
    FILE = "file"


def uploads_as_file(transfer: Transfer, autopilot: int, mission_type: int, items: int) -> bool:
    """Whether a file may be tried: flight missions of ArduPilot only; clearing goes by a message of its own."""
    if transfer is Transfer.ITEMS or autopilot != Autopilot.ARDUPILOT or mission_type != MissionType.MISSION:
        return False
    return items >= (FILE_ITEMS_MIN if transfer is Transfer.AUTO else 1)


class Preferred:
    """Two machines with one aim: the second begins where the first fails."""

    def __init__(self, first: Machine, second: Machine) -> None:
        self._machine = first
        self._second: Machine | None = second

    @property
    def done(self) -> bool:
        """Whether the aim is reached (`error` is None) or both have failed."""
        return self._machine.done and (self._second is None or self._machine.error is None)

    @property
    def error(self) -> GcsError | None:
        """Of the machine that ran last."""
        return self._machine.error

    @error.setter
    def error(self, error: GcsError | None) -> None:
        self._machine.error = error

    @property
    def deadline_s(self) -> float | None:
        """When `tick` next has something to do."""
        return self._machine.deadline_s

    def start(self, now_s: float) -> list[Message]:
        """Begins the first."""
        return self._machine.start(now_s) + self._go_on(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """What the message calls for."""
        return self._machine.receive(message, now_s) + self._go_on(now_s)

    def tick(self, now_s: float) -> list[Message]:
        """What the passing of time calls for."""
        return self._machine.tick(now_s) + self._go_on(now_s)

    def cancel(self) -> list[Message]:
        """Ends it from our side."""
        self._second = None
        return self._machine.cancel()

    def _go_on(self, now_s: float) -> list[Message]:
        if self._second is None or not self._machine.done or self._machine.error is None:
            return []
        self._machine, self._second = self._second, None
        return self._machine.start(now_s)
