"""The choice of the upload: a mission goes to its vehicle as one file or item by item, with a fallback."""

from __future__ import annotations

from enum import StrEnum

from gcs.autopilots.traits import link_behaviour
from gcs.errors import GcsError
from gcs.link.microservices.machine import Machine
from gcs.link.wire.message import Message
from gcs.mavlink import MissionType

FILE_ITEMS_MIN = 5  # a short file takes six round trips and one for the capability; n items take n + 3


class Transfer(StrEnum):
    """AUTO sends a file if that is faster and the vehicle reports MAVLink FTP; if the file fails, it sends items."""

    AUTO = "auto"
    ITEMS = "items"
    FILE = "file"


def uploads_as_file(transfer: Transfer, autopilot: int, mission_type: int, items: int) -> bool:
    """Whether to try a file: only flight missions, and only where the autopilot takes files.

    Clearing has a message of its own.
    """
    files = link_behaviour(autopilot).mission_files
    if transfer is Transfer.ITEMS or not files or mission_type != MissionType.MISSION:
        return False
    return items >= (FILE_ITEMS_MIN if transfer is Transfer.AUTO else 1)


class Preferred:
    """Two machines for one upload: the second starts if the first fails."""

    def __init__(self, first: Machine, second: Machine) -> None:
        self._machine = first
        self._second: Machine | None = second

    @property
    def done(self) -> bool:
        """Whether one has succeeded (`error` is None) or both have failed."""
        return self._machine.done and (self._second is None or self._machine.error is None)

    @property
    def error(self) -> GcsError | None:
        """The error of the last machine."""
        return self._machine.error

    @error.setter
    def error(self, error: GcsError | None) -> None:
        self._machine.error = error

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        return self._machine.deadline_s

    def start(self, now_s: float) -> list[Message]:
        """Start the first machine."""
        return self._machine.start(now_s) + self._advance(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message."""
        return self._machine.receive(message, now_s) + self._advance(now_s)

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        return self._machine.tick(now_s) + self._advance(now_s)

    def cancel(self) -> list[Message]:
        """End the upload without fallback."""
        self._second = None
        return self._machine.cancel()

    def _advance(self, now_s: float) -> list[Message]:
        if self._second is None or not self._machine.done or self._machine.error is None:
            return []
        self._machine, self._second = self._second, None
        return self._machine.start(now_s)
