"""What an autopilot has to tell the outside, and the voice that puts it into words.

Knows: kinds of news. Does not know: messages, and any autopilot's words.
"""

from __future__ import annotations

from dataclasses import dataclass

from gcs.mavlink import Severity
from sim_bridge.personality import Note
from sim_bridge.personality.wording import Words


@dataclass(frozen=True)
class Said:
    """Something for STATUSTEXT."""

    severity: Severity
    text: str


@dataclass(frozen=True)
class Reached:
    """Something for MISSION_ITEM_REACHED."""

    seq: int


@dataclass(frozen=True)
class Placed:
    """Home is known, or somewhere else than before."""


@dataclass(frozen=True)
class ModeChanged:
    """HEARTBEAT has news."""


Event = Said | Reached | Placed | ModeChanged


class Voice:
    """Says things in one autopilot's words; `events` is what has yet to be told."""

    def __init__(self, words: Words) -> None:
        self._words = words
        self.events: list[Event] = []

    def say(self, note: Note, **quoted: object) -> None:
        """Say what this autopilot says on the occasion, if anything."""
        known = self._words.get(note)
        if known is not None:
            severity, text = known
            self.events.append(Said(severity, text.format(**quoted)))

    def tell(self, *events: Event) -> None:
        """Pass news on."""
        self.events.extend(events)
