"""Differences from the recorded autopilots that are meant, each with its reason.

Knows: the words in which `tools.replay.compare` tells a difference. Does not know: how differences are found.
An entry that explains nothing any more is a mistake: the tool names it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch

# Talk that an autopilot repeats on a clock of its own: compared by rate, like telemetry.
STREAMS = {
    "arducopter-*": frozenset[str](),
    "px4-*": frozenset({"HOME_POSITION", "GPS_GLOBAL_ORIGIN", "UNKNOWN_410"}),
}


@dataclass(frozen=True)
class Meant:
    """A difference that may be: where (shell patterns), which (a regular expression for the whole line), and why."""

    autopilot: str
    scene: str
    line: str
    why: str

    def covers(self, autopilot: str, scene: str, line: str) -> bool:
        """Whether this entry explains the difference."""
        here = fnmatch(autopilot, self.autopilot) and fnmatch(scene, self.scene)
        return here and re.fullmatch(self.line, line) is not None


MEANT: Sequence[Meant] = (
    Meant(
        "*",
        "*",
        r"PARAM_VALUE \S+ param_count: \d+ -> \d+",
        "the emulated vehicles have the parameters that do something",
    ),
)


def streams_of(autopilot: str) -> frozenset[str]:
    """Talk that counts as telemetry with this autopilot."""
    return next(names for pattern, names in STREAMS.items() if fnmatch(autopilot, pattern))


def why(autopilot: str, scene: str, line: str) -> Meant | None:
    """The entry that explains a difference, or None."""
    return next((entry for entry in MEANT if entry.covers(autopilot, scene, line)), None)
