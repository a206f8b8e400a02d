"""Events of an autopilot, and their STATUSTEXT queue."""

from dataclasses import dataclass

from gcs.mavlink import Severity
from sim_bridge.personality import Note
from sim_bridge.personality.modes import Words


@dataclass(frozen=True)
class Said:
    """A text for STATUSTEXT."""

    severity: Severity
    text: str


@dataclass(frozen=True)
class Reached:
    """An item for MISSION_ITEM_REACHED."""

    seq: int


@dataclass(frozen=True)
class Placed:
    """Home was set or moved."""


@dataclass(frozen=True)
class ModeChanged:
    """The mode changed, so HEARTBEAT changes."""


Event = Said | Reached | Placed | ModeChanged


class EventQueue:
    """Collects events, and words them as this autopilot does. `events` are not yet reported."""

    def __init__(self, words: Words) -> None:
        self._words = words
        self.events: list[Event] = []

    def add_text(self, note: Note, **quoted: object) -> None:
        """Queue the text of this autopilot for `note`, if it has one."""
        known = self._words.get(note)
        if known is not None:
            severity, text = known
            self.events.append(Said(severity, text.format(**quoted)))

    def add(self, *events: Event) -> None:
        """Queue events."""
        self.events.extend(events)
