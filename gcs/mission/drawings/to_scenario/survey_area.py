"""The area of a drawing that is to be surveyed, with everything else that the drawing holds.

The field is what the file itself means to be surveyed, else its one polygon that is no fence, else its one fence to
stay in. Exclusions are no-fly zones, which are not surveyed; other fences are areas to stay in.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from gcs.errors import UsageError
from gcs.frames import Origin, geodetic_to_ned, place_up_m
from gcs.mission.drawings.drawing import Drawing, DrawnArea
from gcs.mission.drawings.labels import Label, LeftOut, sentences
from gcs.mission.drawings.to_scenario.drawn_areas import AreaTables, Spot, area_in_metres, area_tables

_NAMED = 5  # polygons that a sentence names
_HOME_NEAR_M = 20_000.0
_SLIVER_M2 = 1.0  # a smaller part of a field is what rounding leaves beside a zone


@dataclass(frozen=True)
class SurveyArea:
    """A field as it is surveyed: (north, east), m, from the origin, without its no-fly zones."""

    drawing: Drawing
    field: DrawnArea
    origin: Origin
    altitude_is: str  # where the altitude of the origin is from; empty where it is not known
    surveyed: shapely.Polygon
    avoided: tuple[shapely.Polygon, ...]  # the no-fly zones
    others: tuple[DrawnArea, ...]  # all areas but the field; holes that are avoided are among them

    def tables(self, spots: Sequence[Spot]) -> AreaTables:
        """The other areas as tables of a scenario whose leader flies to these points.

        Raises `FileFormatError` for points that leave an area to stay in, or lie in a no-fly zone.
        """
        return area_tables(self.drawing, self.others, spots, self.origin)

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """What is not carried over of the drawing, or is changed, besides its areas."""
        said = [*self.drawing.left_out]
        text = "not flown: the passes of the survey are the route"
        if self.field in self.drawing.surveys:
            text_of_own = "its heights, camera and angle are not carried over; give --height, --swath and --angle"
            said.append(LeftOut(self.field.label, text_of_own))
        if self.drawing.line is not None:
            said.append(LeftOut(self.drawing.line, text))
        else:
            said += [LeftOut(point.label, text) for point in self.drawing.points]
        if self.drawing.speed_mps is not None:
            said.append(
                LeftOut(Label("the speed"), f"{self.drawing.speed_mps:g} m/s is not carried over; give it as --speed")
            )
        if self.field.inside:
            said.append(LeftOut(self.field.label, "surveyed; vehicles turn outside of it, so it is no area to stay in"))
        return tuple(said)


def survey_area(
    drawing: Drawing, at: tuple[float, float, float | None] | None = None, *, avoid_holes: bool = False
) -> SurveyArea:
    """The field of a drawing, with the origin `at`, else at the field's first corner.

    Raises UsageError for a drawing without exactly one field, and for one that no-fly zones divide.
    """
    drawn = _field(drawing)
    others = tuple(area for area in drawing.areas if area is not drawn)
    if avoid_holes:
        holes = enumerate(drawn.holes, start=1)
        others += tuple(DrawnArea(hole, drawn.label.part("hole", number), False) for number, hole in holes)
    origin, altitude_is = _origin(drawing, drawn, at)
    zones = [area_in_metres(drawing, area, origin) for area in others if area.inside is False]
    field = _in_metres(drawing, drawn, origin)
    left = shapely.set_precision(field.difference(shapely.union_all([shape for _, shape in zones])), 0.01)
    parts = [part for part in shapely.get_parts(left) if part.area > _SLIVER_M2]
    if len(parts) != 1:
        what = f"divide it into {len(parts)} parts" if parts else "leave nothing of it"
        named = " and ".join(str(area.label) for area, shape in zones if shape.intersects(field))
        raise UsageError(
            f"{drawing.where(drawn.label)}: {drawn.label} cannot be surveyed as one: {named} {what}.",
            hint="draw each part in a file of its own" if parts else "draw the area outside of no-fly zones",
        )
    return SurveyArea(drawing, drawn, origin, altitude_is, parts[0], tuple(shape for _, shape in zones), others)


def _field(drawing: Drawing) -> DrawnArea:
    polygons = [area for area in drawing.areas if area.radius_m is None]
    meant = [[*drawing.surveys]] + [[area for area in polygons if area.inside is kind] for kind in (None, True)]
    found = next((areas for areas in meant if areas), [])
    if not found or (drawing.lost_surveys and not drawing.surveys):  # not a fence in place of what was meant
        said = "; ".join(sentences(drawing.left_out, drawing.unit)[:_NAMED])
        text = f"{drawing.source} has no polygon to survey{f' ({said})' if said else ''}."
        raise UsageError(text, hint="draw the area as a polygon")
    if len(found) > 1:
        named = ", ".join(str(area.label) for area in found[:_NAMED]) + (", ..." if len(found) > _NAMED else "")
        raise UsageError(f"{drawing.source} has {len(found)} polygons: {named}.", hint="keep one of them in the file")
    return found[0]


def _origin(drawing: Drawing, drawn: DrawnArea, at: tuple[float, float, float | None] | None) -> tuple[Origin, str]:
    """The origin, and where its altitude is from; empty where nobody said it: 0 m."""
    place = drawn.corners[0] if at is None else at[:2]
    if at is not None and at[2] is not None:
        return Origin(*place, at[2]), "--at"
    home = drawing.home
    if home is not None:
        away_m = geodetic_to_ned(home.lat_deg, home.lon_deg, home.alt_amsl_m, Origin(*place, home.alt_amsl_m))
        if float(np.linalg.norm(away_m)) <= _HOME_NEAR_M:
            return Origin(*place, home.alt_amsl_m), "the planned home"
    return Origin(*place, 0.0), ""


def _in_metres(drawing: Drawing, drawn: DrawnArea, at: Origin) -> shapely.Polygon:
    """The area (north, east), m, from the origin. Raises UsageError for one that crosses itself."""
    rings = []
    for ring in (drawn.corners, *drawn.holes):
        lat_deg, lon_deg = np.array(ring).T
        rings.append(np.round(place_up_m(lat_deg, lon_deg, 0.0, at)[:, :2], 2))
    area = shapely.Polygon(rings[0], rings[1:])
    if not area.is_valid or area.area <= 0.0:
        reason = shapely.is_valid_reason(area) if not area.is_valid else "it has no area"
        raise UsageError(
            f"{drawing.where(drawn.label)}: {drawn.label} is no area: {reason} (north east, m).",
            hint="draw its corners in order",
        )
    return area
