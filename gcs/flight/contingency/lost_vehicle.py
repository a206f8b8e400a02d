"""Where a vehicle that left the formation may be from now on, as no-fly zones for those that fly on.

All zones reach over all heights: a vehicle that is not heard may climb, hold, sink or fall.
"""

import numpy as np
import shapely

from gcs.flight.contingency.manoeuvres import MotionReference
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import NoFlyZone
from gcs.scenario.values.navigation_error import navigation_error
from gcs.types import Array

_BRAKE_MPS2 = 1.5  # at least, of a vehicle that stops by itself
_EVERY_S, _MOVES_MAX = 0.5, 400
_LEAST_M = 0.1


def kept_m(plan: Plan) -> float:
    """The distance to keep from where a vehicle is thought to be: its separation, and what it may be off."""
    return plan.scenario.limits.separation_min_m + navigation_error(plan.scenario).horizontal_m


def where_it_stopped(plan: Plan, place_ned_m: Array, velocity_ned_mps: Array) -> NoFlyZone:
    """Around where a vehicle that was last heard here has braked, or has come down."""
    speed_mps = float(np.linalg.norm(velocity_ned_mps[:2]))
    on_m = speed_mps / (2.0 * _BRAKE_MPS2) * velocity_ned_mps[:2] / 2.0
    north_m, east_m = (place_ned_m[:2] + on_m).tolist()
    radius_m = kept_m(plan) + float(np.linalg.norm(on_m))
    return NoFlyZone(north_m=round(north_m, 3), east_m=round(east_m, 3), radius_m=round(radius_m, 3))


def way_home(
    plan: Plan, row: int, place_ned_m: Array, rtl_up_m: float, now_s: float, rest: tuple[int, ...]
) -> tuple[NoFlyZone, ...]:
    """The way on which a vehicle that is not heard may return by itself, where it is as high as those that fly on.

    `rtl_up_m`: its return altitude over its pad. When it begins is not known: the zone is the whole way.
    """
    t_s = np.arange(now_s, plan.landing_s, _EVERY_S)
    if not len(t_s):
        return ()
    rows = [plan.sysids.index(sysid) for sysid in rest]
    pad = plan.pads_ned_m[row]
    off_m = plan.states(t_s)[rows][..., 2] - min(float(pad[2]) - rtl_up_m, float(place_ned_m[2]))
    apart_m = plan.scenario.limits.separation_min_m + navigation_error(plan.scenario).vertical_m
    way = shapely.LineString([place_ned_m[:2], pad[:2]])
    if np.abs(off_m).min() >= apart_m or way.length < _LEAST_M:
        return ()
    corners = way.buffer(kept_m(plan), quad_segs=2).exterior.coords[:-1]
    return (NoFlyZone(polygon_m=tuple((round(north, 3), round(east, 3)) for north, east in corners)),)


def on_its_way(plan: Plan, reference: MotionReference, now_s: float) -> NoFlyZone:
    """Around a vehicle that flies an ordered track, and with it, to its end."""
    end_s = max(reference.end_s, now_s + _EVERY_S)
    t_s = np.linspace(now_s, end_s, min(int((end_s - now_s) / _EVERY_S) + 2, _MOVES_MAX))
    places_m = np.array([reference.at(0, at_s)[:2] for at_s in t_s.tolist()])
    moves = np.column_stack([t_s, places_m - places_m[0]])
    north_m, east_m = places_m[0].tolist()
    return NoFlyZone(north_m=north_m, east_m=east_m, radius_m=kept_m(plan), moves=tuple(map(tuple, moves.tolist())))
