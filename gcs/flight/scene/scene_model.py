"""The values that a scene is made of: ground, zones, tracks, phases, curves, events, and one picture of now."""

import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from gcs.types import Array

Rows = NDArray[np.int64]


class SceneKind(StrEnum):
    """Where a scene comes from."""

    PLAN = "plan"
    REPLAY = "replay"
    FLIGHT = "flight"  # under way: pictures follow


@dataclass(frozen=True)
class GroundGrid:
    """Heights of the ground over a grid of places."""

    north_m: Array  # (G,)
    east_m: Array  # (H,)
    height_m: Array  # (G, H)
    mercator: tuple[tuple[float, float], ...] = ()  # of its corners: x and y of the web's square map, 0 to 1


@dataclass(frozen=True)
class SceneZone:
    """The edge of a no-fly zone or of a keep-in area, and how it moves."""

    name: str
    keep_in: bool
    corners_m: Array  # (C, 2) north and east, closed, before it moves
    t_s: Array  # (M,) plan times; linear between them, still outside
    moved_m: Array  # (M, 2) north and east


@dataclass(frozen=True)
class Motion:
    """All vehicles over the times of a scene; NaN where nothing is known."""

    places_ned_m: Array  # (V, N, 3)
    heading_rad: Array  # (V, N) clockwise from north: of the nose as planned, of the course as flown
    speed_mps: Array  # (V, N)
    above_ground_m: Array  # (V, N) vertically
    neighbour_m: Array  # (V, N) to the nearest other vehicle
    neighbour: Rows  # (V, N) its row; -1 without one


@dataclass(frozen=True)
class PlannedBand:
    """Where missions on board may have their vehicles, by the model of the autopilot."""

    places_ned_m: Array  # (V, N, 3) predicted, at the times of the scene; NaN where nothing is predicted
    late_s: Array  # (V,) so early or late
    off_m: float  # so far beside the track


@dataclass(frozen=True)
class SceneSurvey:
    """The area of a survey, and how wide a vehicle sees."""

    rings_m: tuple[Array, ...]  # (C, 2) each, north and east, closed: the edge, then the holes
    swath_m: float
    seen_from_m: float | None  # above the ground; from half of it half of the width is seen. None: from every height
    until_s: float  # plan time; what is seen counts from T0 until then


@dataclass(frozen=True)
class NamedPlace:
    """A point of the drawn route."""

    name: str
    place_ned_m: Array  # (3,)


@dataclass(frozen=True)
class ReportedState:
    """What vehicles reported of themselves over the times of a scene, from their last report."""

    words: tuple[str, ...]  # modes by name
    mode: Rows  # (V, N) its place in `words`; -1 before the first report
    armed: Rows  # (V, N) 0 or 1
    battery_pct: Rows  # (V, N) -1: not reported
    age_s: Array  # (V, N) since the last report; NaN before the first
    error_m: Array  # (V, N) distance to the planned position at the same time
    in_band: Rows  # (V, N) 1 in the band of its predicted track, 0 outside, -1 where none is predicted


@dataclass(frozen=True)
class TimeSpan:
    """A named part of a scene's time."""

    name: str
    begin_s: float
    end_s: float


@dataclass(frozen=True)
class Curve:
    """One figure over the times of a scene, with its limit, and the vehicles that it comes from."""

    name: str
    unit: str
    flown: Array | None  # (N,)
    planned: Array | None  # (N,)
    vehicles: Rows  # (N, 2) system ids behind the true value, else the flown, else the planned one; 0 for none
    limit: float | None = None
    at_least: bool = True  # a value below the limit violates it; else one above
    on_demand: bool = False  # shown when asked for
    true: Array | None = None  # (N,) of emulated vehicles, whose true states are known; `flown` is what they reported


@dataclass(frozen=True)
class Happening:
    """One event in words."""

    t_s: float  # NaN before T0
    sysid: int  # 0: all vehicles, -1: this program
    text: str
    is_bad: bool  # an incident or an order; else a mode, an arming or a text


@dataclass(frozen=True)
class Scene:
    """A plan or a flight over time. Times count from T0, without a plan from the first report."""

    name: str
    kind: SceneKind
    sysids: tuple[int, ...]
    leader: int  # system id; 0 without a plan
    t_s: Array  # (N,), increasing
    ground: GroundGrid | None
    zones: tuple[SceneZone, ...] = ()
    planned: Motion | None = None
    flown: Motion | None = None
    reported: ReportedState | None = None
    phases: tuple[TimeSpan, ...] = ()
    changes: tuple[TimeSpan, ...] = ()
    curves: tuple[Curve, ...] = ()
    events: tuple[Happening, ...] = ()
    limits: dict[str, float] = field(default_factory=dict)  # least `above_ground_m` and `separation_m`
    notes: tuple[str, ...] = ()
    rally_ned_m: Array | None = None  # (V, R, 3) rally points of each vehicle, on the ground, its landing point first
    needed_pct: Array | None = None  # (V, N) of a full battery, from then to the end of the plan
    band: PlannedBand | None = None
    survey: SceneSurvey | None = None
    points: tuple[NamedPlace, ...] = ()
    shapes: tuple[str, ...] = ()  # names of those that the formation may be told to take
    lands_s: float = math.inf  # from then on all vehicles land, by the plan or as ordered before its end


@dataclass(frozen=True)
class VehiclePicture:
    """One vehicle now, as it reports itself; NaN for what it has not reported."""

    sysid: int
    place_ned_m: tuple[float, float, float]
    heading_rad: float
    speed_mps: float
    mode: str
    armed: bool
    battery_pct: float
    link_age_s: float
    loss: float
    error_m: float
    above_ground_m: float
    neighbour: int  # system id; 0 without one
    neighbour_m: float
    in_band: bool | None = None


@dataclass(frozen=True)
class FlightPicture:
    """A flight under way at one moment."""

    t_s: float  # plan time; NaN before T0 is known
    step: str
    vehicles: tuple[VehiclePicture, ...]
    separation_m: float
    nearest: tuple[int, int]  # system ids; zeros where nothing is known
    formation_error_m: float
