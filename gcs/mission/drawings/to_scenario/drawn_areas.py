"""The areas of a drawing as [[keep_in]] and [[no_fly]] of a scenario; none of them may make the route impossible."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from gcs.errors import FileFormatError
from gcs.frames import Origin, ned_to_geodetic, place_up_m
from gcs.mission.drawings.drawing import Drawing, DrawnArea, Place, tidy
from gcs.mission.drawings.labels import Label, LeftOut
from gcs.scenario.schema.mistake import Mistake, degrees
from gcs.scenario.schema.places import CORNERS_MAX

KEEP_IN_MAX, NO_FLY_MAX = 16, 256
_CIRCLE_CORNERS = 64


_COMMENT_AT = 30
Spot = tuple[Label, tuple[float, float]]  # a point that is flown: its label, and its place north and east, m
_Area = tuple[DrawnArea, shapely.Polygon]  # as the scenario has it, and (north, east), m


@dataclass(frozen=True)
class AreaTables:
    """The areas to stay in, the no-fly zones, and the remarks on areas."""

    keep_in: tuple[DrawnArea, ...]
    no_fly: tuple[DrawnArea, ...]
    left_out: tuple[LeftOut, ...]

    @property
    def texts(self) -> list[str]:
        """A table of a scenario for each area, with its label as the comment."""
        heads = ["[[keep_in]]"] * len(self.keep_in) + ["[[no_fly]]"] * len(self.no_fly)
        return list(map(_table, heads, [*self.keep_in, *self.no_fly]))

    def place(self, mistake: Mistake, drawing: Drawing) -> str:
        """Where a mistake of the scenario is: the label and the line of an area in place of its key."""
        match mistake.key:
            case ("keep_in" | "no_fly" as kind, int(number), *_):
                areas = self.keep_in if kind == "keep_in" else self.no_fly
                return drawing.named(areas[number].label) if number < len(areas) else mistake.place
        return mistake.place


def area_tables(drawing: Drawing, areas: Sequence[DrawnArea], spots: Sequence[Spot], origin: Origin) -> AreaTables:
    """The areas of a drawing. One whose file does not say what it is holds the whole route, or is left out.

    Vehicles stay inside each [[keep_in]]. Fences that only together hold the route become one area, if they overlap.
    Raises `FileFormatError` for a route that leaves an area to stay in, or passes a point in a no-fly zone.
    """
    said: list[LeftOut] = []
    points = shapely.points([place_m for _, place_m in spots])
    keep_in: list[_Area] = []
    no_fly: list[_Area] = []
    holes: list[_Area] = []
    for drawn in areas:
        area = area_in_metres(drawing, drawn, origin)
        if drawn.inside is False:
            no_fly.append(area)
            if drawn.holes:
                said.append(LeftOut(drawn.label, "its holes are no-fly zone too: a zone of a scenario has none"))
        elif drawn.inside or shapely.covers(area[1], points).all():
            keep_in.append(area)
            inner = (DrawnArea(hole, drawn.label.part("hole", n)) for n, hole in enumerate(drawn.holes, start=1))
            holes += [area_in_metres(drawing, hole, origin) for hole in inner]
        else:
            text = "not round the whole route, and not carried over; if it is a no-fly zone, write it as [[no_fly]]"
            said.append(LeftOut(drawn.label, text))
    no_fly += holes
    for zone, shape in no_fly:
        inside = shapely.contains_properly(shape, points)
        if inside.any():
            label = spots[int(inside.argmax())][0]
            message = f"{drawing.where(label)}: {label} lies in {zone.label}, a no-fly zone."
            raise FileFormatError(message, hint="draw the route around it")
    keep_in, of_joined = _together(drawing, keep_in, spots, origin)
    said += of_joined
    for found, most, what in ((keep_in, KEEP_IN_MAX, "areas to stay in"), (no_fly, NO_FLY_MAX, "no-fly zones")):
        if len(found) > most:
            raise FileFormatError(f"{drawing.source}: has {len(found)} {what}; a scenario has at most {most}.")
    for one, _ in (*keep_in, *no_fly):
        if len(one.corners) > CORNERS_MAX:
            text = f"{one.label} has {len(one.corners)} corners; an area has at most {CORNERS_MAX}"
            raise FileFormatError(f"{drawing.where(one.label)}: {text}.", hint="draw it with fewer corners")
    return AreaTables(tuple(one for one, _ in keep_in), tuple(one for one, _ in no_fly), tuple(said))


def area_in_metres(drawing: Drawing, area: DrawnArea, origin: Origin) -> _Area:
    """An area as the scenario has it, and in metres. Raises `FileFormatError` for one that crosses itself."""
    if area.radius_m is None:
        lat, lon = np.array(area.corners).T
        shape = shapely.Polygon(place_up_m(lat, lon, 0.0, origin)[:, :2])
        if not shape.is_valid or shape.area <= 0.0:
            text = f"{drawing.where(area.label)}: {area.label} crosses itself."
            raise FileFormatError(text, hint="draw its corners in order")
        return area, shape
    angle = np.linspace(0.0, 2.0 * np.pi, _CIRCLE_CORNERS, endpoint=False)
    edge_m = area.radius_m * np.column_stack([np.cos(angle), np.sin(angle)])
    edge_m += place_up_m(*area.corners[0], 0.0, origin)[:2]
    if area.inside:  # [[keep_in]] has polygons only; this one lies in the circle
        area = DrawnArea(_degrees(edge_m, origin), Label(f"{area.label}, radius {area.radius_m:g} m"))
    return area, shapely.Polygon(edge_m)


def _together(
    drawing: Drawing, areas: Sequence[_Area], spots: Sequence[Spot], origin: Origin
) -> tuple[list[_Area], list[LeftOut]]:
    """The areas to stay in, each of which holds the route: as they are, or joined to one, with a remark."""
    points = shapely.points([place_m for _, place_m in spots])
    if all(shapely.covers(shape, points).all() for _, shape in areas):
        return list(areas), []
    joined = shapely.union_all([shape for _, shape in areas])
    outside = ~shapely.covers(joined, points)
    if outside.any():
        row = int(outside.argmax())
        away_m = float(shapely.distance(joined, points[row]))
        raise FileFormatError(
            f"{drawing.where(spots[row][0])}: {spots[row][0]} is {away_m:.1f} m outside {areas[0][0].label}"
            + (" and the other areas to stay in." if len(areas) > 1 else "."),
            hint="draw the route inside, or the area larger",
        )
    label = Label(" and ".join(str(area.label) for area, _ in areas))
    if joined.geom_type != "Polygon" or joined.interiors:
        text = f"{drawing.where(areas[0][0].label)}: the route leads through {label}, which are apart."
        raise FileFormatError(text, hint="join them to one area")
    corners = _degrees(np.array(joined.exterior.coords)[:-1], origin)
    remark = LeftOut(label, "the route is only in both together; one area to stay in")
    return [(DrawnArea(corners, label), joined)], [remark]


def _degrees(corners_m: np.ndarray, origin: Origin) -> tuple[Place, ...]:
    lat, lon, _ = ned_to_geodetic(np.column_stack([corners_m, np.zeros(len(corners_m))]), origin)
    return tuple((float(a), float(b)) for a, b in zip(lat, lon, strict=True))


def _table(head: str, area: DrawnArea) -> str:
    lines = [commented(head, str(area.label))]
    if area.radius_m is not None:
        (lat_deg, lon_deg), radius_m = area.corners[0], round(max(area.radius_m, 0.001), 3)
        lines += [f"lat_deg = {number_text(lat_deg)}", f"lon_deg = {number_text(lon_deg)}", f"radius_m = {radius_m!r}"]
    elif len(area.corners) <= 4:
        lines.append(f"polygon_deg = [{', '.join(map(place_text, area.corners))}]")
    else:
        rows = [", ".join(map(place_text, area.corners[at : at + 4])) for at in range(0, len(area.corners), 4)]
        lines += ["polygon_deg = [", *(f"  {row}," for row in rows), "]"]
    return "\n".join(lines) + "\n"


def place_text(place: Place) -> str:
    """A place as a list of TOML."""
    return f"[{number_text(place[0])}, {number_text(place[1])}]"


def number_text(value: float) -> str:
    """Degrees as a number of TOML, which tells 47.0 from 47."""
    text = degrees(value)
    return text if "." in text else f"{text}.0"


def commented(code: str, comment: str) -> str:
    """A line of TOML with its comment."""
    return f"{code.ljust(_COMMENT_AT - 2)}  # {tidy(comment)}"
