"""What went wrong in a flight, and what was done, as lines of its log.

Knows: plain values. Does not know: files, rules.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Event:
    """One line: at an instant something happened to a vehicle, or it was told something, by a rule."""

    unix_s: float  # GNSS time
    t_s: float  # plan time
    sysid: int
    what: str
    rule: str = ""

    def __str__(self) -> str:
        return f"t = {self.t_s:.1f} s: vehicle {self.sysid} {self.what}. {self.rule}".rstrip(". ")
