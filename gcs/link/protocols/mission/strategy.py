"""How a mission is uploaded: as one file or item by item, with a fallback."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from gcs.autopilots.traits import autopilot_name, link_behaviour
from gcs.errors import GcsError, listed
from gcs.link.protocols.machine import Machine
from gcs.link.wire.message import Message
from gcs.mavlink import MissionType

FILE_ITEMS_MIN = 5  # a short file takes six round trips and one for the capability; n items take n + 3


class Transfer(StrEnum):
    """AUTO sends a file if that is faster and the vehicle reports MAVLink FTP; if the file fails, it sends items."""

    AUTO = "auto"
    ITEMS = "items"
    FILE = "file"


@dataclass(frozen=True)
class SentAs:
    """How a mission went to its vehicle (ITEMS or FILE), and why so."""

    transfer: Transfer
    reason: str

    def __str__(self) -> str:
        way = "as a file" if self.transfer is Transfer.FILE else "item by item"
        return f"{way} ({self.reason})"


def sent_words(sent: Mapping[int, SentAs]) -> str:
    """Return how missions went, by vehicle, in words: "vehicles 1, 2: as a file (it reports MAVLink FTP)"."""
    by_way: dict[SentAs, list[int]] = {}
    for sysid, way in sorted(sent.items()):
        by_way.setdefault(way, []).append(sysid)
    return "; ".join(f"vehicles {listed(sysids)}: {way}" for way, sysids in by_way.items())


def sent_data(sent: Mapping[int, SentAs]) -> list[dict[str, int | str]]:
    """Return how missions went, for JSON."""
    return [{"vehicle": sysid, "sent_as": way.transfer.value, "why": way.reason} for sysid, way in sorted(sent.items())]


def planned(transfer: Transfer, autopilot: int, mission_type: int, items: int) -> SentAs:
    """Return how items are to be sent: flight missions as a file, where the autopilot takes files.

    AUTO still depends on what the vehicle reports. Clearing has a message of its own.
    """
    if transfer is Transfer.ITEMS:
        return SentAs(Transfer.ITEMS, "--transfer items")
    if mission_type != MissionType.MISSION:
        return SentAs(Transfer.ITEMS, "fences and rally points are short")
    if not link_behaviour(autopilot).mission_files:
        return SentAs(Transfer.ITEMS, f"{autopilot_name(autopilot)} takes no files")
    least = FILE_ITEMS_MIN if transfer is Transfer.AUTO else 1
    if items < least:
        return SentAs(Transfer.ITEMS, f"fewer than {least} items")
    return SentAs(Transfer.FILE, "it reports MAVLink FTP" if transfer is Transfer.AUTO else "--transfer file")


class Preferred:
    """Two machines for one upload: the second starts if the first fails."""

    def __init__(self, first: Machine, second: Machine) -> None:
        self._machine = first
        self._second: Machine | None = second
        self.failed: GcsError | None = None  # why the second was started

    @property
    def done(self) -> bool:
        """Whether one has succeeded (`error` is None) or both have failed."""
        return self._machine.done and (self._second is None or self._machine.error is None)

    @property
    def error(self) -> GcsError | None:
        """The error of the last machine."""
        return self._machine.error

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
        self.failed = self._machine.error
        self._machine, self._second = self._second, None
        return self._machine.start(now_s)
