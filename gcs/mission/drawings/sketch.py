"""A drawing while it is read: every element of a file becomes a point, line, area or sentence here.

The route of a map is one of its lines, else its single points in their order.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gcs.errors import FileFormatError, counted
from gcs.frames import Origin, geodetic_to_ned
from gcs.mission.drawings.drawing import (
    Datum,
    Drawing,
    DrawnArea,
    DrawnPoint,
    Place,
    meaning_of,
    ring,
    tidy,
)
from gcs.mission.drawings.labels import Label, LeftOut
from gcs.mission.drawings.line_pieces import LinePiece, joined
from gcs.mission.model import Home

_SAME_M = 5.0  # a named point so near to a corner of the line names it
_LEAST = 2  # points of a line
_NO_FIX = (0.0, 0.0)  # where a receiver without a fix says that it is


@dataclass(frozen=True)
class DrawnLine:
    """A line of a map. `recorded`: a receiver wrote it on its way."""

    label: Label
    points: tuple[DrawnPoint, ...]
    recorded: bool = False


@dataclass
class Sketch:
    """What was found so far. On a map with lines, `points` stand beside them."""

    source: str
    points: list[DrawnPoint] = field(default_factory=list)
    lines: list[DrawnLine] = field(default_factory=list)
    areas: list[DrawnArea] = field(default_factory=list)
    surveys: list[DrawnArea] = field(default_factory=list)
    lost_surveys: list[Label] = field(default_factory=list)
    left_out: list[LeftOut] = field(default_factory=list)
    unit: str = "line"  # of the numbers of labels

    def add_line(self, label: Label, pieces: Sequence[LinePiece], *, recorded: bool = False) -> None:
        """Add a line that a file has in pieces, each with its own label; those that touch are one.

        Pieces with less than two points, and those that lie apart, are left out with a sentence; so are the points of a
        recorded line at 0 N 0 E.
        """
        drawn = []
        if not pieces:
            self.leave_out(label, "has no point; not carried over")
        for whole in pieces:
            piece = self._with_fix(whole) if recorded else whole
            if len(piece.points) < _LEAST:
                self.leave_out(piece.label, f"has {'only one' if piece.points else 'no'} point; not carried over")
            else:
                drawn.append(piece)
        if not drawn:
            return
        first, said = joined(drawn, recorded=recorded)
        self.left_out += said
        is_whole = len(first.points) > len(drawn[0].points) or len(drawn) == 1
        self.lines.append(DrawnLine(label if is_whole else first.label, first.points, recorded))

    def _with_fix(self, piece: LinePiece) -> LinePiece:
        points = tuple(point for point in piece.points if point.place != _NO_FIX)
        if lost := len(piece.points) - len(points):
            text = f"{lost} of its {len(piece.points)} points are at 0 N 0 E, where a receiver had no fix"
            self.leave_out(piece.label, f"{text}; not carried over")
        return replace(piece, points=points)

    def add_area(
        self,
        label: Label,
        edge: Sequence[Place],
        holes: Sequence[Sequence[Place]] = (),
        inside: bool | None = None,
        *,
        survey: bool = False,
    ) -> None:
        """Add a polygon; an edge without corners is left out with a sentence. Raises ValueError for under 3 corners.

        `survey`: the file itself means it to be surveyed.
        """
        if not edge:
            self.leave_out(label, "has no corner; not carried over")
            return
        for number, hole in enumerate(holes, start=1):
            if not hole:
                self.leave_out(label.part("hole", number), "has no corner; not carried over")
        inner = tuple(ring(hole, label) for hole in holes if hole)
        (self.surveys if survey else self.areas).append(DrawnArea(ring(edge, label), label, inside, inner))

    def drawing(self, *, home: Home | None = None, speed_mps: float | None = None, returns: bool = False) -> Drawing:
        """The drawing whose route is the first drawn line, else the first recorded one, else the points.

        What is not flown is left out with a sentence.
        """
        points, flown = self.points, None
        if self.lines:
            flown = next((line for line in self.lines if not line.recorded), self.lines[0])
            for line in self.lines:
                if line is not flown:
                    text = f"not flown: the route is {flown.label}; a file per route carries it over"
                    self.leave_out(line.label, text)
            points = self._named(flown)
        datums = {point.datum for point in points}
        at_sea_m = [point.height_m for point in points if point.datum is Datum.SEA]
        if at_sea_m and not any(at_sea_m) and datums <= {Datum.SEA, Datum.NONE}:
            points = [replace(point, datum=Datum.NONE) for point in points]
            self.leave_out(Label("heights"), "all are 0 m above the sea, as converters write it for none; read as none")
        return Drawing(
            self.source,
            tuple(points),
            tuple(self.areas),
            recorded=flown is not None and flown.recorded,
            left_out=tuple(self.left_out),
            line=None if flown is None else flown.label,
            surveys=tuple(self.surveys),
            lost_surveys=tuple(self.lost_surveys),
            unit=self.unit if any((label.at_line or 0) > 1 for label in self._labels) else "",
            home=home,
            speed_mps=speed_mps,
            returns=returns,
        )

    @property
    def _labels(self) -> Iterator[Label]:
        """The labels of everything in the file that was read or left out."""
        drawn = itertools.chain(self.points, *(line.points for line in self.lines))
        yield from (point.label for point in drawn)
        yield from (line.label for line in self.lines)
        yield from (area.label for area in (*self.areas, *self.surveys))
        yield from (one.label for one in self.left_out)
        yield from self.lost_surveys

    def _named(self, line: DrawnLine) -> list[DrawnPoint]:
        """The points of a line, with the names of those beside it that are on it."""
        points = list(line.points)
        if not self.points:
            return points
        origin = Origin(*points[0].place, 0.0)
        lat, lon = np.array([point.place for point in points]).T
        places_m = geodetic_to_ned(lat, lon, 0.0, origin)
        for spot in self.points:
            away_m = np.linalg.norm(places_m - geodetic_to_ned(*spot.place, 0.0, origin), axis=1)
            row = int(away_m.argmin())
            if away_m[row] > _SAME_M:
                self.leave_out(spot.label, f"not on the route, {line.label}; not carried over")
            elif spot.name and not points[row].name:
                points[row] = replace(points[row], name=spot.name)
            elif spot.name != points[row].name:
                self.leave_out(spot.label, f"stands at {points[row].label}; not carried over")
        return points

    def leave_out(self, label: Label, text: str) -> None:
        """Add a sentence."""
        self.left_out.append(LeftOut(label, text))

    def leave_out_data(self, what: str, lines: Mapping[str, Sequence[int]], of: str) -> None:
        """Add a sentence for each name of data that says something of a flight, with the lines of its elements."""
        for key, each in lines.items():
            label = Label(f"{what} '{tidy(key)}' of {counted(len(each), of)}", line=each[0])
            self.leave_out(label, f"not carried over: {meaning_of(key)}")

    def refused(self, label: Label, text: str, hint: str) -> FileFormatError:
        """The error for one thing, with its line."""
        where = self.source if label.at_line is None else f"{self.source}, {self.unit} {label.at_line}"
        return FileFormatError(f"{where}: {label} {text}.", hint=hint)
