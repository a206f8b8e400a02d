"""The points that the leader passes between start and end: the joints between the legs of a flight, in SI and NED."""

from dataclasses import dataclass

import numpy as np

from gcs.physics.quadrotor import hover_trim
from gcs.plan.trajectory.constraint_id import PointName
from gcs.scenario.schema.scenario import RoutePoint, Scenario
from gcs.scenario.values.si import NED_FROM_UP, quadrotor, route_points
from gcs.types import Array


@dataclass(frozen=True)
class PassPoint:
    """A point at the end of a leg, and what is required of the leader there."""

    name: PointName
    place_ned_m: Array  # (3,)
    radius_m: float  # 0: exactly through
    earliest_s: float  # may be -inf
    latest_s: float  # may be inf
    speed_mps: float | None
    yaw_ned_rad: float | None
    hold_s: float  # 0: without a stop
    hover_state: Array | None  # (12,) with a hold: at rest, trimmed against the wind


def pass_points(scenario: Scenario) -> tuple[PassPoint, ...]:
    """The points of the route, round after round."""
    return tuple(_pass_point(scenario, number, point) for number, point in enumerate(route_points(scenario), start=1))


def _pass_point(scenario: Scenario, number: int, point: RoutePoint) -> PassPoint:
    place = np.array(point.position_m) * NED_FROM_UP
    # One turn: the limit of yaw is at most half a turn either way.
    yaw_rad = None if point.heading_deg is None else float(np.angle(np.exp(1j * np.radians(point.heading_deg))))
    hover = None
    if point.hold_s:
        if yaw_rad is None and not quadrotor(scenario).wind.is_still:
            yaw_rad = float(np.radians(scenario.end.roll_pitch_yaw_deg[2]))  # the trim against wind depends on yaw
        hover = np.zeros(12)
        hover[:3] = place
        hover[8] = yaw_rad or 0.0
        _, hover[6], hover[7] = hover_trim(-float(place[2]), float(hover[8]), quadrotor(scenario))
    return PassPoint(
        name=PointName(number, point.name or ""),
        place_ned_m=place,
        radius_m=point.radius_m or 0.0,
        earliest_s=_first(point.at_s, point.after_s, -np.inf),
        latest_s=_first(point.at_s, point.by_s, np.inf),
        speed_mps=point.speed_mps,
        yaw_ned_rad=yaw_rad,
        hold_s=point.hold_s or 0.0,
        hover_state=hover,
    )


def _first(*values: float | None) -> float:
    return next(float(value) for value in values if value is not None)
