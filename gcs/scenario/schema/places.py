"""The tables of the ground and of what stands on it, and of a drawn route and a survey.

[terrain], [[no_fly]], [[keep_in]], [[route]] and [survey].
"""

import itertools
import re
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

import shapely
from pydantic import Field
from shapely.geometry.base import BaseGeometry

from gcs.scenario.schema.degree_keys import CENTRE, POLYGON, POSITION, SUMMITS
from gcs.scenario.schema.fields import (
    FLIGHT_MAX_S,
    Coordinate,
    Findings,
    Height,
    Length,
    Number,
    Part,
    Place,
    Point,
    Speed,
    Turn,
    left_out,
)
from gcs.scenario.schema.heightmap import Relief

_LISTED_MAX = 500  # mountains, moves of a zone
CORNERS_MAX = 500
ROUTE_MAX = 100  # points, all rounds together
WavePhase = Annotated[Number, Field(ge=-1000, le=1000)]
WaveNumber = Annotated[Number, Field(ge=-1000, le=1000)]
_Coordinates = Annotated[tuple[Coordinate, ...], Field(max_length=_LISTED_MAX)]
_Lengths = Annotated[tuple[Length, ...], Field(max_length=_LISTED_MAX)]
MoveTime = Annotated[Number, Field(ge=-20_000, le=20_000)]
_Instant = Annotated[Number, Field(ge=0, le=FLIGHT_MAX_S)]
_HoldLength = Annotated[Number, Field(ge=0.1, le=3600)]


class Ripple(Part):
    """Eq. 52: |sin(y + a) + b sin(x) + c cos(d r) + e cos(y) + f sin(g r)|; x north, y east, r distance, m."""

    a: WavePhase = Field(description="phase of the wave east, rad")
    b: Height = Field(description="height of the wave north, m")
    c: Height = Field(description="height of the first rings around the origin, m")
    d: WaveNumber = Field(description="wave number of the first rings, rad/m")
    e: Height = Field(description="height of the second wave east, m")
    f: Height = Field(description="height of the second rings, m")
    g: WaveNumber = Field(description="wave number of the second rings, rad/m")


class Mountains(Part):
    """The mountains of Eq. 53: one entry per mountain in every list."""

    degree_keys = (SUMMITS,)

    north_m: _Coordinates = Field(default=(), description="summits, m north of the origin")
    east_m: _Coordinates = Field(default=(), description="summits, m east of the origin")
    height_m: tuple[Height, ...] = Field(default=(), max_length=_LISTED_MAX, description="summits, m above height 0")
    spread_north_m: _Lengths = Field(default=(), description="decay length north and south, m")
    spread_east_m: _Lengths = Field(default=(), description="decay length east and west, m")

    @property
    def rows(self) -> Iterator[tuple[float, float, float, float, float]]:
        """Height, north, east, and the spreads north and east of each mountain, m."""
        lists = self.height_m, self.north_m, self.east_m, self.spread_north_m, self.spread_east_m
        return zip(*lists, strict=True)

    def _disagreements(self) -> Findings:
        lengths = {key: len(getattr(self, key)) for key in type(self).model_fields}
        if len(set(lengths.values())) > 1:
            beside = dict(zip(SUMMITS.metres, SUMMITS.degrees, strict=True))
            names = {key: f"{key} or {beside[key]}" if key in beside else key for key in lengths}
            found = ", ".join(f"{names[key]} {length}" for key, length in lengths.items())
            text = f"lists must be equally long, one entry per mountain; lengths are {found}"
            yield (), text, "complete the short ones"


class Dem(Part):
    """An elevation model: heights above mean sea level, in a file that GDAL reads (GeoTIFF, SRTM .hgt)."""

    file: str = Field(description="path of the file, relative to the scenario's folder")
    unit: Literal["m", "ft"] | None = Field(
        default=None, description="unit of its heights, where the file does not name one"
    )


class Terrain(Part):
    """The ground: the larger of ripple and sum of mountains, or an elevation model. Left out: level, at height 0."""

    ripple: Ripple | None = Field(default=None, description="Eq. 52; left out: no ripple")
    mountains: Mountains = Field(default=Mountains(), description="Eq. 53; left out: no mountains")
    dem: Dem | None = Field(default=None, description="an elevation model instead of formulas")
    relief: Relief | None = Field(
        default=None, description="the heights read from the elevation model; the program writes it"
    )

    def _disagreements(self) -> Findings:
        if self.dem is not None and (self.ripple is not None or self.mountains.height_m):
            yield ("dem",), "is the whole ground", "remove ripple and mountains, or remove [terrain.dem]"


class NoFlyZone(Part):
    """A no-fly zone: a disk (Eq. 21) or a polygon, which may move; or the geozones of a file.

    Planner and returns keep out of it at every height and at all times; proofs count its heights and times.
    """

    degree_keys = (CENTRE, POLYGON)
    file_keys: ClassVar[tuple[str, ...]] = ("flown_utc", "permitted", "geoid_m")

    north_m: Coordinate | None = Field(default=None, description="disk: centre, m north of the origin")
    east_m: Coordinate | None = Field(default=None, description="disk: centre, m east of the origin")
    radius_m: Length | None = Field(default=None, description="disk: R_j, m")
    polygon_m: tuple[Point, ...] | None = Field(
        default=None,
        max_length=CORNERS_MAX,
        description="polygon, instead of a disk: its corners in order, [north, east], m",
    )
    moves: tuple[tuple[MoveTime, Coordinate, Coordinate], ...] = Field(
        default=(),
        max_length=_LISTED_MAX,
        description="displacement over time, linear in between: [t s, north m, east m], in order of time",
    )
    height_m: tuple[Height, Height] | None = left_out(
        "lower and upper end, m above height 0; left out: without limits in height"
    )
    in_force_s: tuple[MoveTime, MoveTime] | None = left_out(
        "from when until when it holds, plan time, s; left out: at all times"
    )
    file: str | None = left_out(
        "instead of a disk or polygon: path of a file of geozones (ED-269 or ED-318), relative to the scenario's folder"
    )
    flown_utc: tuple[str, str] | None = left_out(
        "with file: from when until when the plan may be flown, as 2026-11-28T10:00:00Z; "
        "left out: all zones hold at all times"
    )
    permitted: tuple[str, ...] | None = Field(
        default=None,
        max_length=_LISTED_MAX,
        exclude_if=lambda names: names is None,
        description="with file: identifiers of the zones that you are permitted to enter",
    )
    geoid_m: Annotated[Number, Field(ge=-110, le=90)] | None = left_out(
        "with file: height of mean sea level above the WGS-84 ellipsoid at the origin; left out: whatever it may be, m"
    )

    def _disagreements(self) -> Findings:
        if self.file is not None:
            for key in ("north_m", "east_m", "radius_m", "polygon_m", "moves", "height_m", "in_force_s"):
                if getattr(self, key):
                    yield (key,), "stands beside file, whose zones have places of their own", "remove one of the two"
            return
        for key in self.file_keys:
            if getattr(self, key) is not None:
                yield (key,), "is about the zones of a file", "give file too, or remove it"
        disk = {"north_m": self.north_m, "east_m": self.east_m, "radius_m": self.radius_m}
        lacking = [key for key, value in disk.items() if value is None]
        if self.polygon_m is None:
            for key in lacking:
                text = "missing; a disk needs north_m, east_m (or lat_deg, lon_deg) and radius_m"
                yield (key,), text, "give it, or give polygon_m or polygon_deg"
        elif len(lacking) < len(disk):
            beside = "radius_m" if self.radius_m is not None else "the centre of a disk"
            yield ("polygon_m",), f"stands beside {beside}", "keep the polygon or the disk"
        if self.polygon_m is not None:
            yield from polygon_findings(self.polygon_m)
        for key in ("height_m", "in_force_s"):
            ends = getattr(self, key)
            if ends is not None and ends[1] <= ends[0]:
                yield (key,), "must begin below its end", "give the lower number first"
        times = [move[0] for move in self.moves]
        if any(b <= a for a, b in itertools.pairwise(times)):
            yield ("moves",), "must be in order of time", "make each time later than the one before"


GeozoneNotes = Annotated[
    tuple[str, ...],
    Field(
        max_length=1000,
        exclude_if=lambda notes: not notes,
        description="how the zones of a file were taken, in sentences; the program writes it",
    ),
]
ZonesBeyond = Annotated[
    tuple[NoFlyZone, ...],
    Field(
        max_length=256,
        exclude_if=lambda zones: not zones,
        description="zones above the box, or not in force during the flight, which only `gcs prove` counts; the "
        "program writes it",
    ),
]


def polygon_findings(corners: tuple[Point, ...]) -> Findings:
    """Yield what is wrong with the corners of a polygon, under its key `polygon_m`."""
    if len(corners) < 3:
        yield ("polygon_m",), f"has {len(corners)} corners; a polygon needs at least 3"
    elif (shape := shapely.Polygon(corners)) and not shape.is_valid:
        long = r"-?\d+\.\d{4,}(?!\d*e)"  # coordinates: to a millimetre
        reason = re.sub(long, lambda found: f"{float(found[0]):.3f}", shapely.is_valid_reason(shape))
        yield ("polygon_m",), f"crosses itself: {reason} (north east, m)", "give the corners in order"
    elif shape.area <= 0.0:
        yield ("polygon_m",), "has no area: its corners are on one line", "move a corner"


class RoutePoint(Part):
    """A point that the leader passes between start and end, in the order of the file."""

    degree_keys = (POSITION,)

    name: Annotated[str, Field(max_length=100)] | None = left_out("name, as reports and maps show it")
    position_m: Place = Field(description="north, east, height, m")
    height_above_ground_m: Length | None = left_out(
        "instead of a height in position_m or position_deg: height above the ground there, m; between two such points "
        "the leader follows the ground"
    )
    radius_m: Length | None = Field(
        default=None,
        description="the leader passes within this distance, in any direction; left out: through the point, m",
    )
    at_s: _Instant | None = Field(default=None, description="the leader is there at this time, s")
    after_s: _Instant | None = Field(default=None, description="the leader is there at this time or later, s")
    by_s: _Instant | None = Field(default=None, description="the leader is there at this time or sooner, s")
    speed_mps: Speed | None = Field(default=None, description="speed of the leader there, m/s")
    heading_deg: Turn | None = Field(default=None, description="yaw of the leader there, degrees")
    hold_s: _HoldLength | None = Field(default=None, description="the leader hovers there for this time, s")
    corridor_m: Length | Literal["free"] | None = left_out(
        "of the leg to this point: largest distance of the leader beside the line, m"
    )
    height_tolerance_m: Length | Literal["free"] | None = left_out(
        "of the leg to this point: largest distance of the leader above or below the line, m"
    )
    shape: str | None = Field(
        default=None, description="name of the shape from here on; the change begins when the leader is there"
    )

    def _disagreements(self) -> Findings:
        if self.at_s is not None:
            for key in ("after_s", "by_s"):
                if getattr(self, key) is not None:
                    yield (key,), f"at_s = {self.at_s:g} sets the time already", "keep one of the two"
        elif self.after_s is not None and self.by_s is not None and self.after_s >= self.by_s:
            yield ("by_s",), f"must be more than after_s = {self.after_s:g}"
        if self.hold_s is not None and self.radius_m is not None:
            yield ("radius_m",), "the leader hovers at the point itself", "remove radius_m or hold_s"
        if self.hold_s is not None and self.speed_mps is not None:
            yield ("speed_mps",), "the leader hovers here", "remove speed_mps or hold_s"


class LegsTable(Part):
    """How near the leader keeps to the straight lines that lead from point to point of [[route]].

    A key of a point is for the leg that leads to it. Where the line is in the way of zones or ground, a limit that is
    left out gives way, and the plan says so.
    """

    corridor_m: Length | Literal["free"] | None = left_out(
        "largest distance of the leader beside the line, m; left out: what rounding the corners needs, at least 1 m"
    )
    height_tolerance_m: Length | Literal["free"] | None = left_out(
        "largest distance of the leader above or below the line, m; left out: 1 m"
    )
    height_above_ground_m: Length | None = left_out(
        "of start, points and end whose position gives no height, m above the ground there"
    )
    heading_tolerance_deg: Annotated[Number, Field(ge=0.1, le=180)] | Literal["free"] = Field(
        default=5.0,
        description="largest difference of the leader's yaw where both ends of a leg have one heading, degrees",
    )


class _Polygon(Part):
    degree_keys = (POLYGON,)

    polygon_m: tuple[Point, ...] = Field(max_length=CORNERS_MAX, description="its corners in order, [north, east], m")

    def _disagreements(self) -> Findings:
        yield from polygon_findings(self.polygon_m)

    @property
    def area(self) -> shapely.Polygon:
        """The area (north, east), m."""
        return shapely.Polygon(self.polygon_m)


class KeepIn(_Polygon):
    """An area that no vehicle leaves, at any height. With several, vehicles stay inside each of them."""

    @property
    def moves(self) -> tuple[tuple[float, float, float], ...]:
        """The displacements over time that a zone may have: none."""
        return ()

    @property
    def height_m(self) -> None:
        """The heights that a zone may have: all."""

    @property
    def in_force_s(self) -> None:
        """The times that a zone may have: all."""


class SurveyHole(_Polygon):
    """A part of the area that needs no coverage, a pond for example. Vehicles may cross it: [[no_fly]] forbids that."""


class SurveyTable(Part):
    """The area that the flight surveys. Plans do not depend on it: its coverage is proved from the planned tracks."""

    degree_keys = (POLYGON,)

    swath_m: Length = Field(description="a vehicle sees all places within half of this width, m")
    height_above_ground_m: Length | None = left_out(
        "height above the ground from which swath_m is seen: from half of it, half of the width; left out: swath_m is "
        "seen from every height, m"
    )
    polygon_m: tuple[Point, ...] = Field(max_length=CORNERS_MAX, description="its corners in order, [north, east], m")
    hole: tuple[SurveyHole, ...] = Field(default=(), max_length=100, description="parts that need no coverage")

    def _disagreements(self) -> Findings:
        yield from polygon_findings(self.polygon_m)
        if shapely.Polygon(self.polygon_m).is_valid and self.area.is_empty:
            yield ("hole",), "leave nothing of the area", "remove one of them"

    @property
    def area(self) -> BaseGeometry:
        """The area without its holes (north, east), m."""
        area: BaseGeometry = shapely.Polygon(self.polygon_m)
        for hole in self.hole:
            area = area.difference(hole.area)
        return area
