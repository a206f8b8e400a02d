"""The contents of a map: the track of every vehicle in time and space, the route points, and the fence.

Altitudes are AMSL. Times are plan times; formats that need a date show T0 as `T0_SHOWN`.
"""

from dataclasses import dataclass

import numpy as np

from gcs.frames import ned_to_geodetic
from gcs.mission.geofence import NO_FENCE, Geofence
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.si import local_origin
from gcs.types import Array

T0_SHOWN = "2000-01-01T00:00:00Z"  # plans have no date
PERIOD_S = 1.0
DEGREE_DECIMALS, _METRE_DECIMALS = 7, 3
_MS = 1000


@dataclass(frozen=True, eq=False)
class Track:
    """The track of one vehicle: times (N,) in whole milliseconds, positions (N,)."""

    sysid: int
    t_s: Array
    lat_deg: Array
    lon_deg: Array
    alt_amsl_m: Array


@dataclass(frozen=True)
class MapPoint:
    """A route point: its number, its name (empty without one), when the leader is there, and the point itself."""

    number: int
    name: str
    t_s: float
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float

    @property
    def title(self) -> str:
        """Its number and name, as maps show them."""
        return f"{self.number} {self.name}".strip()


@dataclass(frozen=True)
class MapFile:
    """Contents of one map."""

    title: str
    plan_hash: str
    tracks: tuple[Track, ...]
    geofence: Geofence = NO_FENCE
    points: tuple[MapPoint, ...] = ()


def build_map(plan: Plan, geofence: Geofence = NO_FENCE, period_s: float = PERIOD_S) -> MapFile:
    """The map of a plan: tracks from take-off to landing, with a point every `period_s` and at both ends."""
    steps = int(np.ceil((plan.t_end_s - plan.t_start_s) / period_s))
    t_s = np.unique(np.rint(np.linspace(plan.t_start_s, plan.t_end_s, steps + 1) * _MS) / _MS)
    inside = plan.clamped(t_s)
    position = plan.leader_trajectory.state(inside)[:, POSITION] + plan.offsets(inside)
    lat, lon, alt = ned_to_geodetic(position, local_origin(plan.scenario))
    rounded = np.round(lat, DEGREE_DECIMALS), np.round(lon, DEGREE_DECIMALS), np.round(alt, _METRE_DECIMALS)
    tracks = tuple(Track(sysid, t_s, *(part[row] for part in rounded)) for row, sysid in enumerate(plan.sysids))
    return MapFile(plan.scenario.title or plan.scenario.name, plan.hash, tracks, geofence, _points(plan))


def _points(plan: Plan) -> tuple[MapPoint, ...]:
    """The route points of the plan, rounded as the tracks are."""
    found = []
    for passage in plan.passages:
        lat, lon, alt = ned_to_geodetic(passage.position_ned_m[None], local_origin(plan.scenario))
        place = (round(float(lat[0]), DEGREE_DECIMALS), round(float(lon[0]), DEGREE_DECIMALS))
        t_s, alt_m = round(passage.arrives_s, _METRE_DECIMALS), round(float(alt[0]), _METRE_DECIMALS)
        found.append(MapPoint(passage.number, passage.point.name or "", t_s, *place, alt_m))
    return tuple(found)
