"""Speeds and times of a new flight by the limits of its vehicle type, with the room that a planner needs."""

import math

from gcs.autopilots.traits import Autopilot
from gcs.scenario.schema.scenario import MissionOptions, Performance
from gcs.scenario.sources.load import vehicle_type
from gcs.scenario.values.own_landing import landing_duration_s
from gcs.scenario.values.si import WIND_PEAKS

VEHICLE_TYPE = "quad500"  # of the template
SPEED_SHARE = 0.85  # of the limits: the most that a flight has in the mean
_CLIMB_ROOM = 1.1  # times the least time in wind, which a scenario may get later
GNSS_APART_M = 5.0  # nearer vehicles need better sensors
BETTER_SENSORS = 'sensors = { grade = "rtk" }   # vehicles stand too near for ordinary GNSS'
HOVERS_S = 10.0  # both hovers of [ground_phases]
_LEAST_TAKEOFF_S = 20.0


def type_limits(vehicle: str = VEHICLE_TYPE) -> Performance:
    """The limits of a vehicle type, a preset or a vehicle file. Raises ScenarioError for a file with mistakes."""
    return vehicle_type(vehicle).limits


def fastest_mps(limits: Performance) -> float:
    """The highest mean speed of a new flight in any direction."""
    return SPEED_SHARE * min(limits.speed_ned_mps[:2])


def ground_phases_s(limits: Performance, climb_m: float, descent_m: float | None = None) -> tuple[float, float]:
    """The times of take-off, in calm air and in wind, and of the autopilot's landing, for the highest vehicle."""
    down_m = climb_m if descent_m is None else descent_m
    vertical_mps = limits.speed_ned_mps[2]
    takeoff_s = max(_LEAST_TAKEOFF_S, math.ceil(_CLIMB_ROOM * WIND_PEAKS[0] / vertical_mps * climb_m))
    return float(takeoff_s), landing_duration_s(Autopilot.named(MissionOptions().autopilot), down_m, vertical_mps)
