"""What came of one step.

Knows: nothing but its own lines. Does not know: how they were found, which are meant.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Verdict:
    """One step, or one stretch of telemetry, and what differs in it, each difference one line."""

    title: str
    t_s: float
    differences: list[str] = field(default_factory=list)
