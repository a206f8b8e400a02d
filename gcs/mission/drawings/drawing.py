"""A drawing: the points of a route, areas, and what a scenario cannot carry over of the file."""

import contextlib
import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from gcs.errors import FileFormatError
from gcs.frames import wrapped_deg
from gcs.mission.model import Home
from gcs.util.bounded_file import AtLine

NAME_MAX = 100
AREA_HEIGHTS = "not carried over: an area has none"
INSIDE_UNSAID = "whether vehicles stay inside is read from where the route is"
_SHOWN_MAX = 60  # of a name in a sentence
_REASON_MAX = 300
_UNSEEN = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]+")
Place = tuple[float, float]  # latitude, longitude, degrees


class Datum(StrEnum):
    """What a drawn height is counted from."""

    HOME = "home"
    SEA = "mean sea level"
    GROUND = "the ground"
    NONE = "nothing"  # the point has no height


@dataclass(frozen=True)
class DrawnPoint:
    """A point of a route: its place, its height in metres above its datum, and what was drawn with it.

    `label` names it in sentences: "item 4 (NAV_WAYPOINT)". `speed_mps` is the speed that was drawn for the leg to it.
    """

    place: Place
    height_m: float
    datum: Datum
    label: str
    name: str = ""
    speed_mps: float | None = None
    hold_s: float = 0.0
    radius_m: float = 0.0


@dataclass(frozen=True)
class DrawnArea:
    """A polygon: its corners, its holes, and whether vehicles stay inside it; None where the file does not say so.

    With a radius it is a disk, whose only corner is its centre.
    """

    corners: tuple[Place, ...]
    label: str
    inside: bool | None = None
    holes: tuple[tuple[Place, ...], ...] = ()
    radius_m: float | None = None


@dataclass(frozen=True)
class LeftOut:
    """What is not carried over, or is changed: the thing in the file, and the rest of a sentence about it."""

    label: str
    text: str

    def __str__(self) -> str:
        return f"{self.label}: {self.text}"


class FileLines(dict[str, int]):
    """Where things are in a file, by their labels: lines, or columns where the whole file is one line."""

    unit = "line"


@dataclass(frozen=True)
class Drawing:
    """The contents of a drawn file. `speed_mps` counts where a point has none of its own."""

    source: str
    points: tuple[DrawnPoint, ...]
    areas: tuple[DrawnArea, ...] = ()
    home: Home | None = None
    speed_mps: float | None = None
    returns: bool = False  # to its start, after the last point
    recorded: bool = False  # by a receiver on the way, with many more points than a person draws
    left_out: tuple[LeftOut, ...] = ()
    line: str = ""  # the label of the line whose points are the route; empty where they are points or items
    surveys: tuple[DrawnArea, ...] = ()  # areas that the file itself means to be surveyed
    lost_surveys: tuple[str, ...] = ()  # the labels of those whose area was not read
    file_lines: FileLines = field(default_factory=FileLines, compare=False)

    def where(self, label: str) -> str:
        """The file, and the line of what has this label: "valley.kml, line 12"."""
        line = line_of_label(label, self.file_lines)
        return self.source if line is None else f"{self.source}, {self.file_lines.unit} {line}"

    def named(self, label: str) -> str:
        """The label with its line: "item 4 (NAV_WAYPOINT), line 9"."""
        line = line_of_label(label, self.file_lines)
        return label if line is None else f"{label}, {self.file_lines.unit} {line}"


def line_of_label(label: str, file_lines: Mapping[str, int]) -> int | None:
    """The line of a thing, else of what it is a part of; None where the file has no lines."""
    parts = label.split(" of ")
    wholes = (" of ".join(parts[first:]) for first in range(len(parts)))
    return next((file_lines[whole] for whole in wholes if whole in file_lines), None)


# What a drawing can say beside its places, by the words that programs have for it
_MEANINGS = {
    **dict.fromkeys(("alt", "altitude", "ele", "elevation", "height", "heightm", "z"), "a height beside a place"),
    **dict.fromkeys(("altitudem", "agl", "heightagl", "altitudeagl"), "a height beside a place"),
    **dict.fromkeys(("speed", "speedmps", "velocity", "speedms", "cruisespeed"), "a speed"),
    **dict.fromkeys(("hold", "holds", "holdtime", "delay", "loitertime", "staytime"), "a hold"),
    **dict.fromkeys(("heading", "headingdeg", "yaw", "course"), "a heading"),
    **dict.fromkeys(("radius", "radiusm"), "a radius"),
}
KML_DATUMS = {  # by altitude mode
    **{"absolute": Datum.SEA, "relativeToGround": Datum.GROUND},
    **dict.fromkeys(("clampToGround", "clampToSeaFloor", ""), Datum.NONE),
}


def meaning_of(key: str) -> str:
    """What a property of this name says of a flight: "a speed"; empty for every other name."""
    return _MEANINGS.get(re.sub(r"[^a-z]", "", key.lower()), "")


@contextlib.contextmanager
def on_line(line: int, unit: str = "line") -> Iterator[None]:
    """Names a line, or a column, in a ValueError."""
    try:
        yield
    except ValueError as error:
        raise AtLine(f"{unit} {line}: {error}") from error


def refusal(source: str, error: Exception, kind: str) -> FileFormatError:
    """The error for a file of this kind, "KML", whose reader has raised another one."""
    reason = str(error)[:_REASON_MAX]
    at = ", " if isinstance(error, AtLine) else ": "
    return FileFormatError(f"{source}{at}{reason}.", hint=f"correct it there, or save the drawing again as {kind}")


def tidy(name: str) -> str:
    """A name from a file: one line, without unseen characters, of at most `NAME_MAX` characters."""
    return _UNSEEN.sub(" ", name).strip()[:NAME_MAX].strip()


def labelled(what: str, number: int, name: str = "") -> str:
    """How sentences call a thing: 'line 2 ("Ridge")'."""
    short = name if len(name) <= _SHOWN_MAX else f"{name[: _SHOWN_MAX - 3]}..."
    return f"{what} {number}" + (f' ("{short}")' if short else "")


def part_of(label: str, what: str, number: int, count: int) -> str:
    """How sentences call one of the parts of a thing: 'segment 2 of track 1'; a thing with one part is that part."""
    return label if count == 1 else f"{what} {number} of {label}"


def on_earth(lat_deg: float, lon_deg: float, label: str = "") -> Place:
    """A place, with a longitude from -180 to 180. Raises ValueError for one that is not on Earth."""
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 360.0):
        at = f"{label}: " if label else ""
        raise ValueError(f"{at}latitude {lat_deg:g}, longitude {lon_deg:g} is not on Earth")
    return lat_deg, float(wrapped_deg(lon_deg))


def ring(corners: Sequence[Place], label: str) -> tuple[Place, ...]:
    """The corners of a ring without those that repeat the one before, or the first. Raises ValueError for under 3."""
    open_ring = [place for place, _ in itertools.groupby(corners)]
    while len(open_ring) > 1 and open_ring[-1] == open_ring[0]:
        open_ring.pop()
    if len(open_ring) < 3:
        raise ValueError(f"{label} has {len(open_ring)} corners; an area has at least 3")
    return tuple(open_ring)


def sentences(left_out: Iterable[LeftOut], file_lines: FileLines | None = None) -> list[str]:
    """The sentences with their lines, equal ones joined: "items 3, 4 and 7 (DO_SET_ROI), lines 6, 7 and 10: ..."."""
    joined: dict[tuple[str, str, str], list[str]] = {}
    of: dict[tuple[str, str, str], list[int | None]] = {}
    for one in left_out:
        what, number, rest = _parts(one.label)
        key = what, rest, one.text
        numbers = joined.setdefault(key, [])
        if number not in numbers:
            numbers.append(number)
        of.setdefault(key, []).append(line_of_label(one.label, file_lines or {}))
    found, unit = [], FileLines.unit if file_lines is None else file_lines.unit
    for (what, rest, text), numbers in joined.items():
        many, number = ("", numbers[0]) if len(numbers) == 1 else ("s", _listed(numbers))
        lines = sorted({line for line in of[what, rest, text] if line is not None})
        on = f", {unit}{'s' * (len(lines) > 1)} {_listed(list(map(str, lines)))}" if lines else ""
        found.append(f"{what}{many}{' ' * bool(number)}{number}{rest}{on}: {text}")
    return found


def _listed(numbers: Sequence[str]) -> str:
    """Numbers as a list, with runs of three and more: "2, 4 to 9 and 12"."""
    runs: list[list[int]] = []
    for number in map(int, numbers):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    parts = [part for run in runs for part in ([f"{run[0]} to {run[-1]}"] if len(run) > 2 else map(str, run))]
    return f"{', '.join(parts[:-1])} and {parts[-1]}" if len(parts) > 1 else parts[0]


def _parts(label: str) -> tuple[str, str, str]:
    """A label's noun, its number, and what follows."""
    found = re.fullmatch(r"([A-Za-z -]+) ([0-9]+)(.*)", label, re.DOTALL)
    return (found[1], found[2], found[3]) if found else (label, "", "")
