"""One vehicle's mission as mission files of every format hold it: writers take it, readers return it.

In JSON files it finds the line of a value.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError
from gcs.mission.formats.vendor_quirks import Quirk
from gcs.mission.geofence import NO_FENCE, Geofence, RallyPoint
from gcs.mission.model import Home, MissionItem

Key = str | int
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\],]|[^\s{}\[\]:,"]+')


@dataclass(frozen=True)
class MissionFile:
    """The mission of one vehicle. `home` is None if the file has no home (PX4's `.waypoints`)."""

    source: str
    firmware: Autopilot
    home: Home | None
    items: tuple[MissionItem, ...]
    geofence: Geofence = NO_FENCE
    rally: tuple[RallyPoint, ...] = ()
    speed_mps: float | None = None  # until an item changes it
    lines: tuple[int, ...] = ()  # of every item, where the format has a line for each
    text: str = ""  # of a JSON file, in which `line` finds the lines
    items_path: tuple[str, ...] = ("mission", "items")  # of the items in it
    jumps_from: int = 1  # the number DO_JUMP gives the first item: 1 in a `.plan`, its seq on the wire
    parameters: Mapping[str, float] = field(default_factory=dict, compare=False)  # that the vehicle has, if known
    quirks: tuple[Quirk, ...] = ()  # what was read although it is not as the format has it

    def seq(self, index: int) -> int:
        """The number ground stations show for item `index`: home counts where the autopilot counts it."""
        return index + self.firmware.home_is_item_0

    def line(self, index: int) -> int | None:
        """The line of the file on which item `index` stands."""
        if self.lines:
            return self.lines[index]
        return line_of(self.text, (*self.items_path, index)) if self.text else None


def line_of(text: str, path: Sequence[Key]) -> int:
    """The line, from 1, on which the value at `path` begins, or the innermost value around it that exists."""
    wanted = tuple(path)
    here: list[Key | None] = []  # key or index inside each open bracket; None if an object's key comes next
    found, depth = 0, -1
    for token in _TOKEN.finditer(text):
        word = token.group()
        if word in "}]":
            del here[-1:]
        elif word == ",":
            if here:
                last = here[-1]
                here[-1] = last + 1 if isinstance(last, int) else None
        elif here and here[-1] is None:
            here[-1] = word[1:-1]
        else:
            if len(here) > depth and tuple(here) == wanted[: len(here)]:
                found, depth = token.start(), len(here)
                if depth == len(wanted):
                    break
            if word in "{[":
                here.append(0 if word == "[" else None)
    return text.count("\n", 0, found) + 1


def refused(text: str, source: str, path: Sequence[Key], reason: str, *, hint: str = "") -> FileFormatError:
    """The error for one value, with its line. If the text is not JSON, the reason contains the line."""
    syntax = re.fullmatch(r"Invalid JSON: (.*) at line (\d+) column \d+", reason)
    if syntax:
        return FileFormatError(f"{source}, line {syntax[2]}: not JSON: {syntax[1]}.")
    key = ".".join(map(str, path))
    return FileFormatError(f"{source}, line {line_of(text, path)}: {f'{key}: ' if key else ''}{reason}.", hint=hint)
