"""The ground from which heights of a drawing count: an elevation model, or level ground at the origin's altitude."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs.errors import UsageError
from gcs.frames import Origin, ned_to_geodetic, place_up_m
from gcs.mission.drawings.drawing import Place
from gcs.scenario.schema.heightmap import Region, Relief
from gcs.types import Array

DEM_HINT = "give an elevation model that covers the route, and 100 m and the formation beside it"
_BESIDE_M = 50.0  # round the points
_STEP_M = 10.0
_NOWHERE = Origin(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Ground:
    """The ground round a route. Without a relief it is level, at the origin's altitude."""

    file: Path | None = None
    at: Origin = _NOWHERE  # of the relief, at mean sea level
    relief: Relief | None = None

    def alt_amsl_m(self, place: Place) -> float | None:
        """The altitude of the ground at a place; None where it is not known."""
        if self.relief is None:
            return None
        north_m, east_m, _ = place_up_m(*place, 0.0, self.at)
        if not _holds(self.relief.north_m, north_m) or not _holds(self.relief.east_m, east_m):
            return None
        return float(self.relief.height_m(np.array(north_m), np.array(east_m)))

    def height_m(self, place: Place, origin: Origin) -> float:
        """The height of the ground at a place above an origin."""
        under_m = self.alt_amsl_m(place)
        return 0.0 if under_m is None else under_m - origin.alt_amsl_m

    def under_m(self, points_m: Array, origin: Origin) -> Array:
        """The ground (N,) above an origin, under points (N, 2), north and east of it, m."""
        lat, lon, _ = ned_to_geodetic(np.column_stack([points_m, np.zeros(len(points_m))]), origin)
        if self.relief is None:
            return np.zeros(len(points_m))
        north_m, east_m, _ = place_up_m(lat, lon, 0.0, self.at).T
        return self.relief.height_m(north_m, east_m) - origin.alt_amsl_m

    def along(self, places: Sequence[Place], origin: Origin) -> list[Array]:
        """For each line between places (M, 2): distance along the line, height of the ground above the origin, m."""
        lat, lon = np.array(places).T
        points_m = place_up_m(lat, lon, 0.0, self.at if self.relief is not None else origin)[:, :2]
        found = []
        for first, last in itertools.pairwise(points_m):
            length_m = float(np.linalg.norm(last - first))
            if self.relief is None:
                found.append(np.array([[0.0, 0.0], [length_m, 0.0]]))
                continue
            way_m = np.linspace(0.0, length_m, 2 + int(length_m / _STEP_M))
            north_m, east_m = (first + np.linspace(0.0, 1.0, len(way_m))[:, None] * (last - first)).T
            found.append(np.column_stack([way_m, self.relief.height_m(north_m, east_m) - origin.alt_amsl_m]))
        return found


LEVEL = Ground()


def ground_of(file: Path, places: Sequence[Place]) -> Ground:
    """The ground of an elevation model round places. Raises `UsageError` for one that cannot be used there."""
    from gcs.scenario.environment.dem import DemError, read_dem  # noqa: PLC0415 (GDAL takes long to load)

    at = Origin(*places[0], 0.0)
    lat, lon = np.array(places).T
    points_m = place_up_m(lat, lon, 0.0, at)[:, :2]
    low, high = points_m.min(axis=0) - _BESIDE_M, points_m.max(axis=0) + _BESIDE_M
    try:
        relief = read_dem(file, at, Region((low[0], high[0]), (low[1], high[1])))
    except DemError as error:
        text = f"--terrain {file}: {error}"
        raise UsageError(f"{text}.", hint=DEM_HINT) from None
    return Ground(file, at, relief)


def _holds(bounds_m: tuple[float, float], value_m: float) -> bool:
    return bool(bounds_m[0] <= value_m <= bounds_m[1])
