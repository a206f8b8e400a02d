"""Checks that fence, rally points, home and flight of a vehicle agree, by the rules of its autopilot.

Fences are areas in the plane here: their heights are parameters, not items.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from gcs.errors import counted
from gcs.frames import geodetic_to_ned
from gcs.mission.check.findings import Finding, Level, Rule
from gcs.mission.check.item_checks import found
from gcs.mission.flight_limits import Surroundings
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.geofence import GeoPoint, RallyPoint
from gcs.mission.predicted.planned_flight import PredictedFlight, home_of
from gcs.types import Array

_ROUND = 64  # segments of a quarter circle: 1 cm of 140 m
_TOUCH_M = 0.02  # rounding of degE7, and the corners of circles
_UNDERGROUND_M = 1.0
_SAMPLES = 50  # along a leg that leaves the fence


def check_safety(mission: MissionFile, flight: PredictedFlight, around: Surroundings) -> Iterator[Finding]:
    """Findings about one vehicle's fence, rally points, home and flight."""
    firmware = mission.firmware
    support = firmware.traits.missions
    count = mission.geofence.vertices
    if count > support.fence_items_max:
        message = f"fence of {counted(count, 'point')}; {firmware.title} stores at most {support.fence_items_max}"
        yield found(mission, Rule.FENCE, Level.ERROR, message)
    if len(mission.rally) > support.rally_points_max:
        message = f"{len(mission.rally)} rally points; {firmware.title} stores at most {support.rally_points_max}"
        yield found(mission, Rule.RALLY, Level.ERROR, message)
    areas = list(_areas(mission, around))
    for number, (area, inclusion) in enumerate(areas, start=1):
        if not area.is_valid:
            kind = "inclusion" if inclusion else "exclusion"
            message = f"{kind} {number} of the fence crosses itself: {shapely.is_valid_reason(area)}"
            yield found(mission, Rule.FENCE, Level.ERROR, message)
    sound = [(area, inclusion) for area, inclusion in areas if area.is_valid]
    rally = [(f"rally point {n}", *_rally_ned(p, mission, around)) for n, p in enumerate(mission.rally, start=1)]
    if around.ground is not None:
        for name, point, alt_m in rally:
            ground_m = float(around.height_of_ground_m(point, 0.0))
            if alt_m < ground_m - _UNDERGROUND_M:
                yield found(mission, Rule.RALLY, Level.ERROR, f"{name} is {ground_m - alt_m:.1f} m below the ground")
    if not sound:
        return
    allowed = _allowed(sound, support.inside_every_inclusion)
    if allowed.is_empty:
        yield found(mission, Rule.FENCE, Level.ERROR, "the fence leaves no place to fly in")
        return
    ends = [flight.ned_m[0]]  # no autopilot returns to a rally point outside the fence
    rules = ((Rule.FENCE, "home", flight.ned_m[0]), *((Rule.RALLY, name, point) for name, point, _ in rally))
    for rule, name, point in rules:
        out_m = allowed.distance(shapely.Point(point[1], point[0]))
        if out_m > _TOUCH_M:
            yield found(mission, rule, Level.ERROR, f"{name} is {out_m:.1f} m outside the fence")
        elif rule is Rule.RALLY:
            ends.append(point)
    yield from _flight_inside(mission, flight, allowed)
    yield from _return_tracks(mission, flight, allowed, ends)


def check_rally_apart(missions: Sequence[MissionFile], around: Surroundings, separation_m: float) -> Iterator[Finding]:
    """Findings for rally points of two vehicles that are less than `separation_m` apart."""
    points = [
        (mission, number, _rally_ned(point, mission, around)[0])
        for mission in missions
        for number, point in enumerate(mission.rally, start=1)
    ]
    if len(points) < 2:
        return
    tree = shapely.STRtree([shapely.Point(p[1], p[0]) for _, _, p in points])
    for row, (mission, number, point) in enumerate(points):
        near = tree.query(shapely.Point(point[1], point[0]), predicate="dwithin", distance=separation_m)
        for other in near.tolist():
            if other > row and points[other][0] is not mission:
                away_m = float(np.hypot(*(points[other][2] - point)[:2]))
                if away_m < separation_m:
                    message = (
                        f"rally point {number} is {away_m:.2f} m from one of {points[other][0].source}; "
                        f"at least {separation_m:g} m required"
                    )
                    yield found(mission, Rule.RALLY, Level.ERROR, message)


def _allowed(areas: list[tuple[shapely.Polygon, bool]], every: bool) -> shapely.Geometry:
    inclusions = [area for area, inclusion in areas if inclusion]
    exclusions = [area for area, inclusion in areas if not inclusion]
    allowed: shapely.Geometry = shapely.box(-1e7, -1e7, 1e7, 1e7)
    if inclusions:
        allowed = shapely.intersection_all(inclusions) if every else shapely.union_all(inclusions)
    return allowed.difference(shapely.union_all(exclusions)) if exclusions else allowed


def _flight_inside(mission: MissionFile, flight: PredictedFlight, allowed: shapely.Geometry) -> Iterator[Finding]:
    knots = _knots(flight)
    flat = flight.ned_m[knots][:, [1, 0]]
    within = allowed.buffer(_TOUCH_M)
    if flight.bent_m.any():  # a flight that is bent may be beside its legs
        within = within.buffer(-float(flight.bent_m.max()), join_style="mitre")
    if len(flat) < 2 or within.covers(shapely.LineString(flat)):
        return
    legs = shapely.linestrings(np.stack([flat[:-1], flat[1:]], axis=1))
    out = ~shapely.covers(within, legs)
    leg = int(np.flatnonzero(out)[0])
    outside = shapely.difference(legs[leg], within)
    samples = shapely.get_coordinates(shapely.segmentize(outside, max(outside.length / _SAMPLES, _TOUCH_M)))
    deep_m = float(np.max(shapely.distance(allowed, shapely.points(samples)), initial=0.0))
    message = f"leaves the fence, here by {deep_m:.1f} m, on {int(out.sum())} of {len(legs)} legs"
    item, t_s = int(flight.item[knots[leg + 1]]), float(flight.t_s[knots[leg]])
    yield found(mission, Rule.FENCE, Level.ERROR, message, item, t_s)


def _return_tracks(
    mission: MissionFile, flight: PredictedFlight, allowed: shapely.Geometry, places: list[Array]
) -> Iterator[Finding]:
    """A warning where straight return tracks leave the fence: autopilots do not fly around its exclusions."""
    knots = _knots(flight)
    flat = flight.ned_m[knots][:, [1, 0]]
    ends = np.array([place[[1, 0]] for place in places])
    nearest = ends[np.argmin(np.linalg.norm(flat[:, None] - ends, axis=-1), axis=1)]
    tracks = shapely.linestrings(np.stack([flat, nearest], axis=1))
    out = ~shapely.covers(allowed.buffer(_TOUCH_M), tracks)
    if out.any():
        knot = int(knots[np.flatnonzero(out)[0]])
        message = (
            f"the straight return track leaves the fence from {int(out.sum())} of {len(flat)} points of the flight"
        )
        yield found(mission, Rule.RETURN, Level.WARNING, message, int(flight.item[knot]), float(flight.t_s[knot]))


def _knots(flight: PredictedFlight) -> NDArray[np.intp]:
    """Rows of the flight's knots, of its vertical descent the last alone."""
    inside = (flight.t_s > flight.down_s) & (np.arange(len(flight.t_s)) < len(flight.t_s) - 1)
    return np.flatnonzero(~inside)


def _areas(mission: MissionFile, around: Surroundings) -> Iterator[tuple[shapely.Polygon, bool]]:
    """All areas of the fence in the plane (east, north), m, and whether each is an inclusion."""
    fence = mission.geofence
    for polygon in fence.polygons:
        corners = _flat(polygon.points, around)
        yield shapely.Polygon(corners[:, [1, 0]]), polygon.inclusion
    for circle in fence.circles:
        center = _flat([circle.center], around)[0]
        # Corners inside a circle to stay in, and around one to stay out of.
        reach_m = circle.radius_m if circle.inclusion else circle.radius_m / math.cos(0.25 * math.pi / _ROUND)
        yield shapely.Point(center[1], center[0]).buffer(reach_m, quad_segs=_ROUND), circle.inclusion


def _flat(places: Sequence[GeoPoint], around: Surroundings) -> Array:
    lat, lon = np.array([place.place_deg for place in places]).T
    return geodetic_to_ned(lat, lon, around.origin.alt_amsl_m, around.origin)


def _rally_ned(point: RallyPoint, mission: MissionFile, around: Surroundings) -> tuple[Array, float]:
    """The rally point in NED, and its height above the origin's."""
    home = home_of(mission, around)
    amsl_m = home.alt_amsl_m + point.alt_m
    place = geodetic_to_ned(*point.place.place_deg, amsl_m, around.origin)
    return place, -float(place[2])
