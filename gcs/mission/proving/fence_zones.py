"""A fence file as the areas of a scenario: what is inside it is a keep-in area, what is outside it a no-fly zone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from pydantic import ValidationError

from gcs.errors import FileFormatError
from gcs.frames import geodetic_to_ned
from gcs.mission.formats.any_mission import load_fence
from gcs.mission.geofence import GeoPoint
from gcs.scenario.schema.scenario import KeepIn, NoFlyZone, Scenario
from gcs.scenario.values.si import local_origin

_QUARTER = 32  # edges of a quarter of a circle to stay in: their corners are on it, so that the area is smaller


def within_fence(scenario: Scenario, file: Path) -> Scenario:
    """The scenario with the areas of a fence too, at all heights. With several areas to stay in, each must be kept.

    Raises `FileFormatError` for a file without a fence, or with an area that crosses itself.
    """
    fence, origin = load_fence(file), local_origin(scenario)

    def flat(points: Sequence[GeoPoint]) -> list[tuple[float, float]]:
        lat, lon = np.array([point.place_deg for point in points]).T
        places = geodetic_to_ned(lat, lon, origin.alt_amsl_m, origin)
        return [(north, east) for north, east, _ in places.tolist()]

    keep_in, no_fly = list(scenario.keep_in), list(scenario.no_fly)
    try:
        for number, polygon in enumerate(fence.polygons, start=1):
            corners = tuple(flat(polygon.points))
            if not (area := shapely.Polygon(corners)).is_valid:
                text = f"{file}: polygon {number} of the fence crosses itself: {shapely.is_valid_reason(area)}."
                raise FileFormatError(text, hint="give its corners in order")
            if polygon.inclusion:
                keep_in.append(KeepIn(polygon_m=corners))
            else:
                no_fly.append(NoFlyZone(polygon_m=corners))
        for circle in fence.circles:
            ((north_m, east_m),) = flat([circle.center])
            if circle.inclusion:
                ring = shapely.Point(north_m, east_m).buffer(circle.radius_m, quad_segs=_QUARTER)
                keep_in.append(KeepIn(polygon_m=tuple((n, e) for n, e in ring.exterior.coords[:-1])))
            else:
                no_fly.append(NoFlyZone(north_m=north_m, east_m=east_m, radius_m=circle.radius_m))
    except ValidationError as error:
        text = f"{file}: an area of the fence cannot be kept beside the scenario's origin: {error.errors()[0]['msg']}."
        raise FileFormatError(text, hint="give the fence of this place, with fewer corners") from error
    return scenario.model_copy(update={"keep_in": tuple(keep_in), "no_fly": tuple(no_fly)})
