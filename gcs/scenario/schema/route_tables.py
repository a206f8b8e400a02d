"""The tables of a drawn route, of the area to stay in, and of a survey: [[route]], [[keep_in]] and [survey]."""

from __future__ import annotations

from typing import Annotated

import shapely
from pydantic import Field
from shapely.geometry.base import BaseGeometry

from gcs.scenario.schema.degree_keys import POLYGON, POSITION
from gcs.scenario.schema.fields import (
    FLIGHT_MAX_S,
    Findings,
    Length,
    Number,
    Part,
    Place,
    Point,
    Speed,
    Turn,
    left_out,
)
from gcs.scenario.schema.ground_tables import CORNERS_MAX, polygon_findings

ROUTE_MAX = 100  # points, all rounds together

_Instant = Annotated[Number, Field(ge=0, le=FLIGHT_MAX_S)]
_HoldLength = Annotated[Number, Field(ge=0.1, le=3600)]


class RoutePoint(Part):
    """A point that the leader passes between start and end, in the order of the file."""

    degree_keys = (POSITION,)

    name: Annotated[str, Field(max_length=100)] | None = left_out("name, as reports and maps show it")
    position_m: Place = Field(description="north, east, height, m")
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
    shape: str | None = Field(
        default=None, description="name of the shape from here on; the change begins when the leader is there"
    )

    def _disagreements(self) -> Findings:
        if self.at_s is not None:
            for key in ("after_s", "by_s"):
                if getattr(self, key) is not None:
                    yield (key,), f"at_s = {self.at_s:g} sets the time already. Keep one of the two"
        elif self.after_s is not None and self.by_s is not None and self.after_s >= self.by_s:
            yield ("by_s",), f"must be more than after_s = {self.after_s:g}"
        if self.hold_s is not None and self.radius_m is not None:
            yield ("radius_m",), "the leader hovers at the point itself. Remove radius_m or hold_s"
        if self.hold_s is not None and self.speed_mps is not None:
            yield ("speed_mps",), "the leader hovers here. Remove speed_mps or hold_s"


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


class SurveyHole(_Polygon):
    """A part of the area that needs no coverage, a pond for example. Vehicles may cross it: [[no_fly]] forbids that."""


class SurveyTable(Part):
    """The area that the flight surveys. Plans do not depend on it: its coverage is proved from the planned tracks."""

    degree_keys = (POLYGON,)

    swath_m: Length = Field(description="a vehicle sees all places within half of this width, m")
    polygon_m: tuple[Point, ...] = Field(max_length=CORNERS_MAX, description="its corners in order, [north, east], m")
    hole: tuple[SurveyHole, ...] = Field(default=(), max_length=100, description="parts that need no coverage")

    def _disagreements(self) -> Findings:
        yield from polygon_findings(self.polygon_m)
        if shapely.Polygon(self.polygon_m).is_valid and self.area.is_empty:
            yield ("hole",), "leave nothing of the area. Remove one of them"

    @property
    def area(self) -> BaseGeometry:
        """The area without its holes (north, east), m."""
        area: BaseGeometry = shapely.Polygon(self.polygon_m)
        for hole in self.hole:
            area = area.difference(hole.area)
        return area
