"""The inclusion fence, and the area that returns avoid.

Areas are shapely polygons with (north, east) as coordinates, m.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np
import shapely

from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import Zone, displacement_m, nearest_zone_m, outline
from gcs.scenario.schema.scenario import KeepIn, Scenario
from gcs.types import Array

INCLUSION_MARGIN_M = 10.0
# A plan may touch a zone's edge, and no vehicle keeps its path to the centimetre: the fence is then this far beyond.
EXCLUSION_SLACK_M = 2.0  # ArduPilot's FENCE_MARGIN
_CORNERS_MAX = 32
_AREA_CORNERS_MAX = 40  # in keep-in areas: autopilots store few, also for no-fly zones
_LEAST_SLACK_M = 0.5
_PLACES_GRID_M = 2.0**-10
_BEGINS_AT = np.array([math.cos(1.0), math.sin(1.0)])  # the corner farthest this way: no track runs across it
_GRID_S = 0.5
_TOO_LARGE_M = 0.5  # of a disk's outline, at its corners
_DISK_CORNERS = (12, 96)
_BEYOND_M = 1e4  # how far the area outside the fence reaches


def planned_places_m(plan: Plan) -> Array:
    """All places (N, 2) of a plan, north and east: tracks every `_GRID_S`, pads and landing points."""
    t_s = np.linspace(plan.t_start_s, plan.t_end_s, int(np.ceil((plan.t_end_s - plan.t_start_s) / _GRID_S)) + 1)
    leader = plan.leader_trajectory.state(t_s)[:, POSITION]
    tracks = (leader + plan.offsets(t_s))[..., :2].reshape(-1, 2)
    return np.concatenate([tracks, plan.pads_ned_m[:, :2], plan.landing_points_ned_m[:, :2]])


def inclusion_corners(places_m: Array) -> Array:
    """Corners (C, 2) of a convex polygon around all places (N, 2), with the margin, in `_CORNERS_MAX` corners.

    Places on a straight track make corners or make none, by their last bits. So the hull is that of places on a fine
    grid, simplified from one certain corner on; simplifying moves it inwards by less than the slack that is added.
    """
    hull = shapely.MultiPoint(np.round(places_m / _PLACES_GRID_M) * _PLACES_GRID_M).convex_hull
    ring = shapely.get_coordinates(hull)[:-1]
    first = int(np.argmax(ring @ _BEGINS_AT)) if len(ring) > 2 else 0
    hull = shapely.Polygon(np.roll(ring, -first, axis=0)) if len(ring) > 2 else hull
    slack_m = _LEAST_SLACK_M
    while True:
        rough = hull.simplify(slack_m)
        # Vehicles in one straight track make a line, whose round ends would have more corners at any slack.
        grown = rough.buffer(INCLUSION_MARGIN_M + slack_m, join_style="mitre", cap_style="square").convex_hull
        corners = np.array(grown.exterior.coords)[:-1]
        if len(corners) <= _CORNERS_MAX:
            return corners
        slack_m *= 2.0


def reachable_m(scenario: Scenario) -> Array:
    """The corners (4, 2) of the limits of a scenario, north and east: no plan of it leaves them."""
    north_m, east_m = scenario.limits.north_m, scenario.limits.east_m
    return np.array([(north, east) for north in north_m for east in east_m])


def inclusion_area(places_m: Array, keep_in: Sequence[KeepIn], later_m: Array | None = None) -> shapely.Polygon:
    """The fence's inclusion around all places (N, 2): their hull with the margin, and its part in all keep-in areas.

    An area grows where places are nearer to its edge than `EXCLUSION_SLACK_M`, and where it has too many corners.
    `later_m` (M, 2) are places that other plans may reach: they are in the hull too, and may touch every area's edge.
    """
    hull = shapely.Polygon(inclusion_corners(places_m if later_m is None else np.concatenate([places_m, later_m])))
    inside, points = hull, shapely.points(places_m)
    for area in keep_in:
        nearest_m = float(nearest_zone_m([area], np.zeros(1), places_m[:, 0], places_m[:, 1]).min())
        nearest_m = nearest_m if later_m is None else min(nearest_m, 0.0)
        grown = area.area.buffer(max(EXCLUSION_SLACK_M - nearest_m, 0.0), join_style="mitre", mitre_limit=2.0)
        inside = inside.intersection(grown)
    rough_m, rough = 0.5 * _LEAST_SLACK_M, inside
    while True:
        parts = [part for part in shapely.get_parts(rough) if part.geom_type == "Polygon"]
        whole = max(parts, key=lambda part: int(np.count_nonzero(shapely.covers(part, points))))
        if len(shapely.get_coordinates(whole)) <= _AREA_CORNERS_MAX:
            return whole
        rough_m *= 2.0
        rough = inside.buffer(rough_m, join_style="mitre", mitre_limit=2.0).simplify(rough_m).intersection(hull)


def inside_m(corners_m: Array, places_ned_m: Array) -> Array:
    """Distances (...) of positions (..., 3) from the nearest side of a convex polygon (C, 2); negative outside."""
    along = np.roll(corners_m, -1, axis=0) - corners_m
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    if not shapely.Polygon(corners_m).exterior.is_ccw:
        inward = -inward
    flat = places_ned_m[..., :2]
    sides = [(flat - corner) @ normal for corner, normal in zip(corners_m, inward, strict=True)]
    return np.asarray(np.min(sides, axis=0))


def outside_area(inclusion: shapely.Polygon, clearance_m: float) -> shapely.Geometry:
    """The area outside the fence, and inside less than `clearance_m` from its edge."""
    within = inclusion.buffer(-clearance_m, join_style="mitre")
    return shapely.box(*np.array(inclusion.bounds) + _BEYOND_M * np.array([-1, -1, 1, 1])).difference(within)


def swept_area(zone: Zone, clearance_m: float, from_s: float, to_s: float) -> shapely.Geometry:
    """The area that a zone covers at some time in [from_s, to_s] of plan time, with a clearance around it."""
    area = _grown(zone, clearance_m)
    if not zone.moves:
        return area
    changes_s = [move[0] for move in zone.moves if from_s < move[0] < to_s]
    places = displacement_m(zone, np.array([from_s, *changes_s, to_s]))
    parts = [area] if _is_convex(area) else shapely.constrained_delaunay_triangles(area).geoms
    swept = [
        shapely.union(_moved(part, a), _moved(part, b)).convex_hull  # exact: the part is convex and moves straight
        for part in parts
        for a, b in itertools.pairwise(places)
    ]
    return shapely.union_all(swept)


def _grown(zone: Zone, clearance_m: float) -> shapely.Polygon:
    if isinstance(zone, KeepIn) or zone.radius_m is None:
        return outline(zone).buffer(clearance_m, join_style="mitre", mitre_limit=2.0)
    radius_m = zone.radius_m + clearance_m
    corners = math.ceil(math.pi / math.acos(radius_m / (radius_m + _TOO_LARGE_M)))
    corners = 4 * math.ceil(min(max(corners, _DISK_CORNERS[0]), _DISK_CORNERS[1]) / 4)
    around_m = radius_m / math.cos(math.pi / corners)
    return shapely.Point(zone.north_m, zone.east_m).buffer(around_m, quad_segs=corners // 4)


def _is_convex(area: shapely.Polygon) -> bool:
    return bool(math.isclose(area.area, area.convex_hull.area, rel_tol=1e-9))


def _moved(area: shapely.Geometry, by_m: Array) -> shapely.Geometry:
    return shapely.transform(area, lambda places: places + by_m)
