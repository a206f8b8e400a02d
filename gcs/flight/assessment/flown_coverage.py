"""What a flight has seen of its survey's area, by the tracks that were flown."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely

from gcs.flight.assessment.route_passing import Track
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.coverage import seen, uncovered
from gcs.scenario.environment.terrain import ground_height_m
from gcs.types import JsonObject

_GAP_S = 2.0  # without a position: what is seen in it is not known


@dataclass(frozen=True)
class FlownCoverage:
    """The area of a survey, what was seen of it, and the largest part that was not (north, east, m²)."""

    area_m2: float
    seen_m2: float
    missed: tuple[tuple[float, float, float], ...]  # the largest first

    @property
    def share(self) -> float:
        """Seen part of the area, 0 to 1."""
        return self.seen_m2 / self.area_m2

    def data(self) -> JsonObject:
        """The values for `--json`."""
        names = "north_m", "east_m", "area_m2"
        return {"share": self.share, "missed": [dict(zip(names, part, strict=True)) for part in self.missed]}


def flown_coverage(plan: Plan, tracks: Mapping[int, Track]) -> FlownCoverage | None:
    """What the vehicles of `tracks` saw between T0 and the arrival; None where the scenario has no [survey].

    Tracks are straight between two positions, and unknown where these are more than 2 s apart.
    """
    survey = plan.scenario.survey
    if survey is None:
        return None
    swept = []
    for t_s, places in tracks.values():
        known = (t_s >= 0.0) & (t_s <= plan.flight_s) & np.isfinite(places).all(axis=1)
        times, track = t_s[known], places[known]
        for rows in np.split(np.arange(len(times)), np.flatnonzero(np.diff(times) > _GAP_S) + 1):
            if len(rows) > 1:
                north, east, down = track[rows].T
                above_m = -down - ground_height_m(plan.scenario.terrain, north, east)
                swept.append(seen(survey, track[rows, :2], np.minimum(above_m[:-1], above_m[1:])))
    left = sorted(uncovered(survey.area, shapely.union_all(swept)), key=lambda part: -part.area)
    inside = [part.representative_point() for part in left]
    missed = tuple((place.x, place.y, float(part.area)) for place, part in zip(inside, left, strict=True))
    area_m2 = float(survey.area.area)
    return FlownCoverage(area_m2, area_m2 - sum(m2 for _, _, m2 in missed), missed)
