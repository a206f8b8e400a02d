"""Proved coverage of a survey's area by the planned tracks.

A vehicle sees all places within half the swath of its track between T0 and the arrival. The proof takes less than that:
the track is a chain of chords, and the radius is smaller by as much as the true track may be away from them. Between
instants `h` apart it is within h² / 8 times the largest acceleration, which Taylor models bound. Dropping a corner of
the chain moves it by at most `_CHORD_M`. Circles are polygons inside of them.

Where [survey] gives a height above the ground, the swath of a piece of track is that of the lowest height in it.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from gcs.physics.states import POSITION
from gcs.plan.trajectory.energy import battery_model
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof.polynomials import enclosed
from gcs.scenario.environment.ground_distance import steepness
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.places import SurveyTable
from gcs.types import Array
from gcs.util.cache import once

_STEP_S = 0.1
_CHORD_M = 0.005
_PIECE = 20  # instants in a piece of track with one swath
_QUARTER = 32  # corners of a quarter of a circle: it is too small by 0.03 % of its radius
_SEEN_M2 = 1e-4  # a smaller remainder is rounding: 1 cm by 1 cm
_SQUARE_M_PER_HA = 10_000.0


@dataclass(frozen=True)
class Uncovered:
    """A part of the area that is not covered, with a place inside it."""

    area_m2: float
    north_m: float
    east_m: float


@dataclass(frozen=True)
class Coverage:
    """What the vehicles of a plan see of a survey's area; shapes are (north, east), m."""

    area: BaseGeometry  # without its holes
    covered: BaseGeometry  # by all vehicles, also outside of the area
    uncovered: BaseGeometry
    tracks: shapely.MultiLineString  # one line for each vehicle, in order, within 5 mm of chords of its track
    swath_m: float
    slack_m: float  # by so much the proof takes the swath's half as smaller
    used: Array  # (V,) share of a full battery that each vehicle uses from take-off to landing
    reserve: float  # share of a full battery that stays

    @property
    def share(self) -> float:
        """Covered part of the area, 0 to 1."""
        return 1.0 - float(self.uncovered.area) / float(self.area.area)

    @property
    def is_complete(self) -> bool:
        """Whether nothing is left out."""
        return bool(self.uncovered.is_empty)

    @property
    def overlap(self) -> float:
        """By how much swath times length of all tracks inside the area exceeds it, as a share of it."""
        inside_m = float(shapely.intersection(self.tracks, self.area).length)
        return self.swath_m * inside_m / float(self.area.area) - 1.0

    @property
    def covered_ha(self) -> float:
        """The covered part of the area, hectares."""
        return float(self.area.area - self.uncovered.area) / _SQUARE_M_PER_HA

    @property
    def ha_per_battery(self) -> float:
        """Covered area for each full battery that is flown down to the reserve, hectares."""
        return self.covered_ha * (1.0 - self.reserve) / float(self.used.sum())

    def gaps(self) -> list[Uncovered]:
        """The parts that are not covered, the largest first."""
        parts = sorted(shapely.get_parts(self.uncovered), key=lambda part: -part.area)
        places = [part.representative_point() for part in parts]
        return [Uncovered(float(part.area), place.x, place.y) for part, place in zip(parts, places, strict=True)]


@once
def coverage(plan: Plan) -> Coverage | None:
    """The coverage of a plan's survey; None where its scenario has no [survey]."""
    survey = plan.scenario.survey
    if survey is None:
        return None
    # Instants (N,) between T0 and the arrival, all joints among them
    even = np.linspace(0.0, plan.flight_s, max(2, round(plan.flight_s / _STEP_S) + 1))
    joints = plan.joints_s[(plan.joints_s > 0.0) & (plan.joints_s < plan.flight_s)]
    t_s = np.unique(np.concatenate([even, joints]))
    slack_m = _bow_m(plan, t_s) + _CHORD_M
    places = plan.states(t_s)[..., POSITION]  # (V, N, 3)
    tracks = [shapely.simplify(shapely.LineString(t), _CHORD_M, preserve_topology=False) for t in places[..., :2]]
    if survey.height_above_ground_m is None:
        swept = [_swept(track, max(0.5 * survey.swath_m - slack_m, 0.0)) for track in tracks]
    else:
        heights_m = _heights_m(plan, t_s, places)
        swept = [seen(survey, track, above, slack_m) for track, above in zip(places[..., :2], heights_m, strict=True)]
    covered = shapely.union_all(swept)
    left = uncovered(survey.area, covered)
    return Coverage(
        area=survey.area,
        covered=covered,
        uncovered=shapely.MultiPolygon(left),
        tracks=shapely.MultiLineString(tracks),
        swath_m=survey.swath_m,
        slack_m=slack_m,
        used=battery_model(plan).used[:, -1],
        reserve=plan.scenario.preflight.reserve,
    )


def _bow_m(plan: Plan, t_s: Array) -> float:
    """How far the track of any vehicle may be from its chords between instants (N,), horizontally."""
    accel_mps2 = np.hypot(*np.moveaxis(_largest(plan, t_s, 2)[:, :2], 1, 0))  # (V, N)
    return float(np.max(np.diff(t_s) ** 2 / 8.0 * accel_mps2))


def _largest(plan: Plan, t_s: Array, derivative: int) -> Array:
    """Bounds (V, 3, N - 1) of a derivative of every vehicle's place between instants (N,)."""
    leader = enclosed(plan.leader_trajectory.state, t_s[:-1], t_s[1:], 2, derivative)[:3].size()
    factors = enclosed(plan.shape.functions, t_s[:-1], t_s[1:], 2, derivative).size()  # (K, N - 1)
    return np.asarray(leader + np.einsum("kva,kn->van", np.abs(plan.shape.basis_ned_m), factors))


def _heights_m(plan: Plan, t_s: Array, places: Array) -> Array:
    """Least heights (V, N - 1) above the ground between instants (N,) with places (V, N, 3)."""
    terrain, speeds = plan.scenario.terrain, _largest(plan, t_s, 1)
    above_m = -places[..., 2] - ground_height_m(terrain, places[..., 0], places[..., 1])
    falls_mps = speeds[:, 2] + steepness(terrain) * np.hypot(speeds[:, 0], speeds[:, 1])
    return np.asarray(np.minimum(above_m[:, :-1], above_m[:, 1:]) - 0.5 * np.diff(t_s) * falls_mps)


def uncovered(area: BaseGeometry, covered: BaseGeometry) -> list[BaseGeometry]:
    """The parts of an area that are not covered."""
    parts = shapely.get_parts(shapely.difference(area, covered))
    return [part for part in parts if part.area > _SEEN_M2]


def seen(survey: SurveyTable, track: Array, heights_m: Array, slack_m: float = 0.0) -> BaseGeometry:
    """What is within half of the swath, less a slack, of each piece of a track (N, 2), north and east.

    The swath is that of the least heights (N - 1,) above the ground between two instants.
    """
    share = np.ones(len(heights_m))
    if survey.height_above_ground_m is not None:
        share = heights_m / survey.height_above_ground_m
    half_m, swept = 0.5 * survey.swath_m * share, []
    for first in range(0, len(half_m), _PIECE):
        piece = shapely.LineString(track[first : first + _PIECE + 1])
        radius_m = float(half_m[first : first + _PIECE].min()) - slack_m
        swept.append(_swept(shapely.simplify(piece, _CHORD_M, preserve_topology=False), max(radius_m, 0.0)))
    return shapely.union_all(swept)


def _swept(track: shapely.LineString, radius_m: float) -> BaseGeometry:
    """What is within the radius of a chain of chords: each chord by itself, which has no concave corners."""
    corners = np.array(track.coords)
    chords = shapely.linestrings(np.stack([corners[:-1], corners[1:]], axis=1))
    return shapely.union_all(shapely.buffer(chords, radius_m, quad_segs=_QUARTER))
