"""The scene of a plan: ground, zones, planned tracks, phases, changes of shape, curves."""

import numpy as np
import shapely

from gcs.autopilots.traits import traits_of
from gcs.flight.scene import scene_curves
from gcs.flight.scene.ground_area import area_of, ground_grid, route_labels
from gcs.flight.scene.scene_model import (
    GroundGrid,
    Happening,
    Motion,
    NamedPlace,
    Scene,
    SceneKind,
    SceneSurvey,
    SceneZone,
    TimeSpan,
)
from gcs.frames import ned_to_geodetic, unwrapped_deg
from gcs.mission.returns.fence_areas import inclusion_area, planned_places_m
from gcs.mission.returns.rtl_cases import rally_points_ned_m
from gcs.physics.states import POSITION, VELOCITY, NamedStates
from gcs.plan.formation.timeline import AUTO
from gcs.plan.trajectory.energy import battery_model
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import Zone, outline, zone_names, zones
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import KeepIn, Scenario
from gcs.scenario.values.navigation_error import judged_separation_m
from gcs.scenario.values.si import NED_FROM_UP, local_origin
from gcs.types import Array

_CELLS = 121  # of the ground along each side
_RIPPLE_M = 1.0  # a grid with larger cells misses the ripple, and shows the ground without it
_EDGE_M = 0.05  # an outline may be off by that
_LEVEL_M = 0.01
_RALLY_MOST = 60  # vehicles


def scene_of_plan(plan: Plan, kind: SceneKind = SceneKind.PLAN) -> Scene:
    """Return the scene of a plan; of a flight under way the same, before its first picture."""
    scenario, ids = plan.scenario, plan.sysids
    t_s = scene_curves.instants_s(plan.t_start_s, plan.t_end_s, len(ids))
    planned = planned_motion(plan, t_s)
    limits = limits_of(scenario)
    if kind is SceneKind.PLAN:  # a flight may use up what the plan keeps for errors of navigation
        limits["separation_m"] = scenario.limits.separation_min_m
    curves = [scene_curves.ground_curve(ids, None, planned, limits["above_ground_m"])]
    if len(ids) > 1:
        curves.append(scene_curves.separation_curve(ids, None, planned, limits["separation_m"]))
    curves.append(scene_curves.speed_curve(ids, None, planned))
    curves += scene_curves.control_curves(ids, plan.controls(inside_s(plan, t_s)))
    return Scene(
        scenario.title or scenario.name,
        kind,
        ids,
        scenario.formation.leader,
        t_s,
        ground_of(scenario, planned.places_ned_m),
        (*zones_of(scenario), fence_of(plan)),
        planned,
        phases=phases_of_plan(plan),
        changes=changes_of(plan),
        curves=tuple(curves),
        events=tuple(Happening(move.start_s, 0, f"the shape changes: {move.name}", is_bad=False) for move in plan.moves)
        if kind is SceneKind.PLAN
        else (),
        rally_ned_m=rally_of(plan),
        limits=limits,
        needed_pct=needed_pct(plan, t_s),
        survey=survey_of(plan),
        points=points_of(scenario),
        shapes=("start", *(shape.name for shape in scenario.formation.shape)),
    )


def needed_pct(plan: Plan, t_s: Array) -> Array | None:
    """Return what the rest of the plan takes of a full battery, (V, N) at plan times (N,); None if it is not known."""
    model = battery_model(plan)
    if model.full_J is None:
        return None
    used = np.array([np.interp(t_s, model.t_s, row) for row in model.used])
    return np.asarray(100.0 * (model.used[:, -1:] - used))


def survey_of(plan: Plan) -> SceneSurvey | None:
    """Return the area of [survey]."""
    survey = plan.scenario.survey
    if survey is None:
        return None
    rings = [survey.polygon_m, *(hole.polygon_m for hole in survey.hole)]
    closed = tuple(np.array([*ring, ring[0]], dtype=np.float64) for ring in rings)
    return SceneSurvey(closed, survey.swath_m, survey.height_above_ground_m, plan.flight_s)


def points_of(scenario: Scenario) -> tuple[NamedPlace, ...]:
    """Return the points of the drawn route, each as it is called on maps."""
    places = (np.array(point.position_m) * NED_FROM_UP for point in scenario.route)
    return tuple(map(NamedPlace, route_labels(scenario), places))


def rally_of(plan: Plan) -> Array | None:
    """Return the rally points (V, R, 3) that every vehicle gets; None for large fleets, whose take long to find."""
    if len(plan.sysids) > _RALLY_MOST:
        return None
    most = min(known.missions.rally_points_max for known in map(traits_of, plan.autopilots) if known)
    return rally_points_ned_m(plan, most)


def inside_s(plan: Plan, t_s: Array) -> Array:
    """Return plan times (N,), those before and after the plan as its first and last."""
    return np.clip(t_s, plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf))


def planned_motion(plan: Plan, t_s: Array) -> Motion:
    """Return the planned motion at plan times (N,) within the plan."""
    states = plan.states(inside_s(plan, t_s))
    yaw_rad = NamedStates(states).attitude_rad[..., 2]
    return scene_curves.motion_of(plan.scenario, states[..., POSITION], states[..., VELOCITY], yaw_rad)


def phases_of_plan(plan: Plan) -> tuple[TimeSpan, ...]:
    """Return the phases of a plan by name."""
    return tuple(TimeSpan(str(phase.name), phase.start_s, phase.end_s) for phase in plan.phases)


def changes_of(plan: Plan) -> tuple[TimeSpan, ...]:
    """Return the changes of shape: when each is flown."""
    marks = {True: " (auto)", False: ""}
    return tuple(TimeSpan(f"{move.name}{marks[move.trigger == AUTO]}", move.start_s, move.end_s) for move in plan.moves)


def limits_of(scenario: Scenario) -> dict[str, float]:
    """Return what a flight must keep: the least clearance, which no height above ground may go below, and separation.

    The vehicles take off from the ground and land on it: the limits hold from one hover to the other.
    """
    return {"above_ground_m": scenario.limits.clearance_min_m, "separation_m": judged_separation_m(scenario)}


def ground_of(scenario: Scenario, places_ned_m: Array) -> GroundGrid:
    """Return the ground around places (..., 3), with its ripple where the grid is fine enough for it."""
    area = area_of(scenario, places_ned_m)
    north, east, height_m = ground_grid(scenario, area, _CELLS)
    if scenario.terrain.ripple is not None and float(np.max(area[1] - area[0])) / (_CELLS - 1) <= _RIPPLE_M:
        height_m = ground_height_m(scenario.terrain, north, east)
    if np.ptp(height_m) <= _LEVEL_M:
        north, east, height_m = (grid[:: _CELLS - 1, :: _CELLS - 1] for grid in (north, east, height_m))
    return GroundGrid(north[:, 0], east[0], height_m, _mercator(scenario, north[:, 0], east[0]))


def _mercator(scenario: Scenario, north_m: Array, east_m: Array) -> tuple[tuple[float, float], ...]:
    """South-west, south-east, north-west and north-east corner on the square map that tiles of the web divide."""
    corners = [(north, east, 0.0) for north in north_m[[0, -1]] for east in east_m[[0, -1]]]
    lat_deg, lon_deg, _ = ned_to_geodetic(np.array(corners), local_origin(scenario))
    y = 0.5 - np.arcsinh(np.tan(np.radians(lat_deg))) / (2.0 * np.pi)
    return tuple(zip((0.5 + unwrapped_deg(lon_deg) / 360.0).tolist(), y.tolist(), strict=True))


def zones_of(scenario: Scenario) -> tuple[SceneZone, ...]:
    """Return no-fly zones and keep-in areas, with their ways."""
    named = zip(zone_names(scenario), zones(scenario), strict=True)
    return tuple(_zone(str(name), zone) for name, zone in named)


def fence_of(plan: Plan) -> SceneZone:
    """Return the fence that every vehicle gets: the edge within which all of the plan lies, with its margin."""
    area = inclusion_area(planned_places_m(plan), plan.scenario.keep_in)
    return SceneZone("fence", True, np.array(area.exterior.coords), np.zeros(1), np.zeros((1, 2)))


def _zone(name: str, zone: Zone) -> SceneZone:
    area = zone.area if isinstance(zone, KeepIn) else outline(zone)
    corners = np.array(shapely.simplify(area, _EDGE_M).exterior.coords)
    moves = np.array(zone.moves if zone.moves else [(0.0, 0.0, 0.0)])
    return SceneZone(name, isinstance(zone, KeepIn), corners, moves[:, 0], moves[:, 1:])
