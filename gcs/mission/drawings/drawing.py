"""A drawing: the points of a route, areas, and what a scenario cannot carry over of the file."""

import contextlib
import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

from gcs.errors import FileFormatError
from gcs.frames import wrapped_deg
from gcs.mission.drawings.labels import Label, LeftOut
from gcs.mission.model import Home
from gcs.util.bounded_file import AtLine

NAME_MAX = 100
AREA_HEIGHTS = "not carried over: an area has none"
INSIDE_UNSAID = "whether vehicles stay inside is read from where the route is"
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
    label: Label
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
    label: Label
    inside: bool | None = None
    holes: tuple[tuple[Place, ...], ...] = ()
    radius_m: float | None = None


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
    line: Label | None = None  # whose points are the route; None where they are points or items
    surveys: tuple[DrawnArea, ...] = ()  # areas that the file itself means to be surveyed
    lost_surveys: tuple[Label, ...] = ()  # those whose area was not read
    unit: str = ""  # what its labels have numbers of: "line", or "column" where the whole file is one line; empty: none

    def where(self, label: Label) -> str:
        """The file, and the line of a thing in it: "valley.kml, line 12"."""
        return f"{self.source}{self._at(label)}"

    def named(self, label: Label) -> str:
        """The label with its line: "item 4 (NAV_WAYPOINT), line 9"."""
        return f"{label}{self._at(label)}"

    def _at(self, label: Label) -> str:
        return f", {self.unit} {label.at_line}" if self.unit and label.at_line is not None else ""


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


def on_earth(lat_deg: float, lon_deg: float, label: Label | None = None) -> Place:
    """A place, with a longitude from -180 to 180. Raises ValueError for one that is not on Earth."""
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 360.0):
        at = "" if label is None else f"{label}: "
        raise ValueError(f"{at}latitude {lat_deg:g}, longitude {lon_deg:g} is not on Earth")
    return lat_deg, float(wrapped_deg(lon_deg))


def ring(corners: Sequence[Place], label: Label) -> tuple[Place, ...]:
    """The corners of a ring without those that repeat the one before, or the first. Raises ValueError for under 3."""
    open_ring = [place for place, _ in itertools.groupby(corners)]
    while len(open_ring) > 1 and open_ring[-1] == open_ring[0]:
        open_ring.pop()
    if len(open_ring) < 3:
        raise ValueError(f"{label} has {len(open_ring)} corners; an area has at least 3")
    return tuple(open_ring)
