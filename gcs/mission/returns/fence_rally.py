"""The fence, rally points and returns of a plan.

All vehicles have the same fence. Its inclusion is a convex hull, so every straight return track stays inside it.
Keep-in areas cut the hull; straight return tracks may leave a concave one.
`rtl_altitudes` chooses return altitudes; `gcs.mission.check.fence_and_rally` checks the result.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from gcs.autopilots.columns import ReturnParameters, ReturnSettings
from gcs.autopilots.traits import Autopilot, FleetFirmware, one_each
from gcs.frames import Origin, ned_to_geodetic
from gcs.mission.geofence import FenceCircle, FencePolygon, Geofence, GeoPoint, RallyPoint
from gcs.mission.returns.fence_areas import EXCLUSION_SLACK_M, inclusion_area, planned_places_m, reachable_m
from gcs.mission.returns.rtl_altitudes import ReturnPlan, plan_returns
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import outline
from gcs.scenario.values.si import local_origin
from gcs.types import Array

FENCE_ABOVE_M = 10.0  # above the highest return: ArduPilot returns no higher than FENCE_MARGIN (2 m) below its fence
_ROUND_OFF_M = 0.01  # heights are sums that end on whole metres; their last bits shall not raise the fence
_TAKEOFF_DECIMALS = 3
_RADIUS_DECIMALS = _HEIGHT_DECIMALS = 2
_LEAST_RADIUS_M = 0.5


@dataclass(frozen=True)
class Zone:
    """One no-fly zone of the scenario and the part of it that is in the fence."""

    number: int
    area_m2: float  # in the scenario
    fence_area_m2: float  # 0: too small for a fence, or a moving zone: fences do not move


@dataclass(frozen=True)
class Fence:
    """The fence of a whole fleet."""

    geofence: Geofence
    zones: tuple[Zone, ...]


@dataclass(frozen=True)
class Safety:
    """Fence, rally points, returns and parameters of a fleet; one entry per vehicle, in the plan's order.

    Without proved separation of its returns, a fleet has no rally points, and no parameters of returns.
    """

    fence: Fence
    rally: tuple[tuple[RallyPoint, ...], ...]
    returns: ReturnPlan
    parameters: tuple[tuple[tuple[str, int | float], ...], ...]


def build_safety(plan: Plan, firmware: FleetFirmware) -> Safety:
    """The fence, the rally points and the returns of a plan, for the autopilot of all vehicles or that of each."""
    autopilots = one_each(firmware, len(plan.sysids))
    returns = plan_returns(plan, autopilots)
    rally = build_rally(plan, autopilots, returns) if returns.separated else ((),) * len(autopilots)
    return Safety(build_fence(plan), rally, returns, _parameters(plan, autopilots, returns))


def with_room(plan: Plan, safety: Safety, firmware: FleetFirmware) -> Safety:
    """The same for a flight whose plan may change: its fence holds every plan within the limits of the scenario."""
    top_m = max(safety.returns.top_m, plan.scenario.limits.height_m[1])
    parameters = _parameters(plan, one_each(firmware, len(plan.sysids)), replace(safety.returns, top_m=top_m))
    return replace(safety, fence=build_fence(plan, may_change=True), parameters=parameters)


def build_fence(plan: Plan, *, may_change: bool = False) -> Fence:
    """The fence: a hull around all tracks, with a margin, in all keep-in areas, less no-fly zones that do not move.

    Where the plan `may_change`, the hull is around all of the scenario's limits, and another plan may touch an edge.
    """
    places = planned_places_m(plan)
    origin = local_origin(plan.scenario)
    allowed = inclusion_area(places, plan.scenario.keep_in, reachable_m(plan.scenario) if may_change else None)
    rings = [np.array(ring.coords)[:-1] for ring in (allowed.exterior, *allowed.interiors)]
    zones: list[Zone] = []
    polygons = [FencePolygon(_places(ring, origin), inclusion=not n) for n, ring in enumerate(rings)]
    circles: list[FenceCircle] = []
    for number, zone in enumerate(plan.scenario.no_fly, start=1):
        kept = 0.0
        if zone.moves:
            pass
        elif zone.radius_m is not None:
            center = np.array([zone.north_m, zone.east_m])
            nearest_m = float(np.linalg.norm(places - center, axis=1).min())
            nearest_m = min(nearest_m, zone.radius_m) if may_change else nearest_m
            radius_m = round(min(zone.radius_m, nearest_m - EXCLUSION_SLACK_M), _RADIUS_DECIMALS)
            if radius_m >= _LEAST_RADIUS_M:
                circles.append(FenceCircle(_places(center[None], origin)[0], radius_m, inclusion=False))
                kept = np.pi * radius_m**2
        else:
            for part in _shrunk(outline(zone), places, touched=may_change):
                corners = np.array(part.exterior.coords)[:-1]
                polygons.append(FencePolygon(_places(corners, origin), inclusion=False))
                kept += part.area
        whole = np.pi * zone.radius_m**2 if zone.radius_m is not None else outline(zone).area
        zones.append(Zone(number, float(whole), float(kept)))
    return Fence(Geofence(tuple(polygons), tuple(circles)), tuple(zones))


def _parameters(plan: Plan, autopilots: Sequence[Autopilot], returns: ReturnPlan) -> tuple[ReturnParameters, ...]:
    hover_m = -plan.states(np.array([plan.airborne_s]))[:, 0, 2]
    homes_m = -plan.pads_ned_m[:, 2]
    return tuple(
        return_parameters(known, returns, row, float(homes_m[row]), float(hover_m[row] - homes_m[row]))
        for row, known in enumerate(autopilots)
    )


def _shrunk(area: shapely.Polygon, places: Array, *, touched: bool) -> list[shapely.Polygon]:
    """The parts of a no-fly zone that stay `EXCLUSION_SLACK_M` away from places (N, 2), and from its `touched` edge."""
    nearest_m = 0.0 if touched else float(shapely.distance(area, shapely.points(places)).min())
    smaller = area.buffer(-max(EXCLUSION_SLACK_M - nearest_m, 0.0), join_style="mitre")
    parts = [smaller] if smaller.geom_type == "Polygon" else list(smaller.geoms)
    return [part for part in parts if part.area >= np.pi * _LEAST_RADIUS_M**2]


def build_rally(plan: Plan, firmware: FleetFirmware, returns: ReturnPlan) -> tuple[tuple[RallyPoint, ...], ...]:
    """The rally points of each vehicle, in the plan's order, its landing point first; altitudes above its own home.

    ArduPilot returns to a rally point at the higher of its altitude and RTL_ALT. Here they are equal, or in a large
    fleet the rally point is less than a metre lower: the vehicle holds RTL_ALT, which was verified. PX4 adds
    RTL_RETURN_ALT to the rally point's altitude, so for PX4 that is the ground.
    """
    origin = local_origin(plan.scenario)
    found = []
    for row, known in enumerate(one_each(firmware, len(plan.sysids))):
        points = np.array(returns.rally_ned_m[row])
        above_m = np.round(plan.pads_ned_m[row, 2] - points[:, 2], _HEIGHT_DECIMALS)
        if known.traits.returns.rally_at_return_altitude:
            above_m[:] = returns.altitudes_m[row]
        per_m = round(1.0 / known.traits.returns.rally_step_m)
        above_m = np.floor(above_m * per_m + 1e-6) / per_m + 0.0  # what it stores
        places = _places(points[:, :2], origin)
        found.append(tuple(RallyPoint(place, alt_m) for place, alt_m in zip(places, above_m.tolist(), strict=True)))
    return tuple(found)


def _places(flat_m: Array, origin: Origin) -> tuple[GeoPoint, ...]:
    """Map positions of points (N, 2), m north and east."""
    ned_m = np.column_stack([flat_m, np.zeros(len(flat_m))])
    lat, lon, _ = ned_to_geodetic(ned_m, origin)
    return tuple(map(GeoPoint.at, lat.tolist(), lon.tolist()))


def return_parameters(
    firmware: Autopilot, returns: ReturnPlan, row: int, home_m: float, takeoff_m: float
) -> ReturnParameters:
    """Return the parameters of the vehicle in this row, with home `home_m` above the origin and a hover at `takeoff_m`.

    Altitudes count from its home. The top of the fence is rounded up to whole metres.
    """
    speeds = returns.speeds
    settings = ReturnSettings(
        altitude_m=returns.altitudes_m[row],
        cruise_mps=speeds.cruise_mps,
        climb_mps=speeds.climb_mps,
        sink_mps=speeds.sink_mps,
        wait_s=firmware.traits.returns.wait_s,
        fence_top_m=float(math.ceil(returns.top_m - home_m + FENCE_ABOVE_M - _ROUND_OFF_M)),
        takeoff_m=round(takeoff_m, _TAKEOFF_DECIMALS),
    )
    return firmware.traits.returns.parameters(settings, returns=returns.separated)
