"""The side from which a formation is drawn: from above, or the side where an upright one looks largest."""

import math
from dataclasses import dataclass

import numpy as np

from gcs.types import Array

_DOTS_PT = 25.0  # over the root of the number of vehicles: a hundred are still dots side by side
_UPRIGHT, _THIN = 0.3, 1.5  # height over width, and over depth: flatter and deeper shapes are seen from above
_AXES_DEG = {0: "north", 90: "east"}


@dataclass(frozen=True)
class ShapeView:
    """A plane of places in NED: what is to the right in it, and what is up, with their names."""

    right_ned: Array  # (3,)
    up_ned: Array  # (3,)
    labels: tuple[str, str]

    @property
    def is_side(self) -> bool:
        """Whether height is up."""
        return bool(self.up_ned[2])

    @property
    def words(self) -> str:
        """From where it is seen."""
        return "from the side" if self.is_side else "from above"

    def flat(self, places_ned_m: Array) -> Array:
        """Places (..., 3) in the plane (..., 2): to the right and up, m."""
        return np.stack([places_ned_m @ self.right_ned, places_ned_m @ self.up_ned], axis=-1)


FROM_ABOVE = ShapeView(np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]), ("east", "north"))


def dot_pt(vehicles: int, largest_pt: float) -> float:
    """The size of a vehicle's dot in a picture of a shape, in points."""
    return min(largest_pt, _DOTS_PT / math.sqrt(vehicles))


def view_of(places_ned_m: Array) -> ShapeView:
    """The view of a shape (V, 3): from above; from the side where it is thin, and not flat."""
    places_ned_m = places_ned_m[np.isfinite(places_ned_m).all(axis=1)]
    if len(places_ned_m) < 2:
        return FROM_ABOVE
    level = places_ned_m[:, :2] - places_ned_m[:, :2].mean(axis=0)
    along, across = np.linalg.svd(level)[2]
    along = along * (-1.0 if along[int(np.abs(along).argmax())] < 0.0 else 1.0)  # north or east is to the right
    height_m = float(np.ptp(places_ned_m[:, 2]))
    if height_m <= max(_UPRIGHT * float(np.ptp(level @ along)), _THIN * float(np.ptp(level @ across))):
        return FROM_ABOVE
    towards_deg = round(float(np.degrees(np.arctan2(along[1], along[0])))) % 360
    label = _AXES_DEG.get(towards_deg, f"{towards_deg}°")
    return ShapeView(np.append(along, 0.0), np.array([0.0, 0.0, -1.0]), (label, "up"))
