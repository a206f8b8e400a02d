"""One vehicle's mission as mission files of every format hold it: writers take it, readers return it.

`lines_of` finds the lines of values in a JSON text.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
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

    @property
    def item_lines(self) -> list[int]:
        """The line of every item."""
        if self.lines or not self.text:
            return list(self.lines)
        paths: list[tuple[Key, ...]] = [(*self.items_path, index) for index in range(len(self.items))]
        found = lines_of(self.text, paths)
        return [found[path] for path in paths]


def line_of(text: str, path: Sequence[Key]) -> int:
    """The line, from 1, on which the value at `path` begins, or the innermost value around it that exists."""
    around = lines_of(text, {tuple(path[:depth]) for depth in range(len(path) + 1)})
    return around[max(around, key=len)] if around else 1


def lines_of(text: str, paths: Iterable[tuple[Key, ...]]) -> dict[tuple[Key, ...], int]:
    """The lines, from 1, on which the values at `paths` begin: of those that exist."""
    return lines_at(text, offsets_of(text, paths))


def lines_at(text: str, offsets: Mapping[tuple[Key, ...], int]) -> dict[tuple[Key, ...], int]:
    """The lines, from 1, of places in a text, which are in their order."""
    found: dict[tuple[Key, ...], int] = {}
    line, counted_to = 1, 0
    for path, at in offsets.items():
        line, counted_to = line + text.count("\n", counted_to, at), at
        found[path] = line
    return found


def offsets_of(text: str, paths: Iterable[tuple[Key, ...]]) -> dict[tuple[Key, ...], int]:
    """The offset in a JSON text of each value in `paths` that exists, in the order of the text."""
    wanted = set(paths)
    deepest = max(map(len, wanted), default=-1)
    here: list[Key | None] = []  # key or index inside each open bracket; None if an object's key comes next
    found: dict[tuple[Key, ...], int] = {}
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
            at = tuple(here) if len(here) <= deepest else None
            if at in wanted and at not in found:
                found[at] = token.start()  # type: ignore[index]
                if len(found) == len(wanted):
                    break
            if word in "{[":
                here.append(0 if word == "[" else None)
    return found


def refused(text: str, source: str, path: Sequence[Key], reason: str, *, hint: str = "") -> FileFormatError:
    """The error for one value, with its line. If the text is not JSON, the reason contains the line."""
    syntax = re.fullmatch(r"Invalid JSON: (.*) at line (\d+) column \d+", reason)
    if syntax:
        return FileFormatError(f"{source}, line {syntax[2]}: not JSON: {syntax[1]}.")
    key = ".".join(map(str, path))
    return FileFormatError(f"{source}, line {line_of(text, path)}: {f'{key}: ' if key else ''}{reason}.", hint=hint)
