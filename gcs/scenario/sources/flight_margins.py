"""Speeds and times of a new flight by the limits of its vehicle type, with the room that a planner needs."""

import math
from functools import cache
from pathlib import Path

from gcs.scenario.schema.scenario import Performance
from gcs.scenario.schema.vehicle_types import preset_file, presets
from gcs.scenario.sources.load import load_vehicle
from gcs.scenario.values.si import WIND_PEAKS

VEHICLE_TYPE = "quad500"  # of the template
SPEED_SHARE = 0.85  # of the limits: the most that a flight has in the mean
_CLIMB_ROOM = 1.1  # times the least time in wind, which a scenario may get later
_LANDING_SPM = 2.0  # slower than the climb, as autopilots land
HOVERS_S = 10.0  # both hovers of [ground_phases]
_LEAST_TAKEOFF_S, _LEAST_LANDING_S = 20.0, 30.0


def type_limits(vehicle: str = VEHICLE_TYPE) -> Performance:
    """The limits of a vehicle type, a preset or a vehicle file. Raises ScenarioError for a file with mistakes."""
    return _preset_limits(vehicle) if vehicle in presets() else load_vehicle(Path(vehicle)).limits


@cache
def _preset_limits(name: str) -> Performance:
    return load_vehicle(preset_file(name)).limits


def fastest_mps(limits: Performance) -> float:
    """The highest mean speed of a new flight in any direction."""
    return SPEED_SHARE * min(limits.speed_ned_mps[:2])


def ground_phases_s(limits: Performance, climb_m: float, descent_m: float | None = None) -> tuple[float, float]:
    """The times of take-off and landing for the highest vehicle, in calm air and in wind."""
    down_m = climb_m if descent_m is None else descent_m
    least_spm = _CLIMB_ROOM * WIND_PEAKS[0] / limits.speed_ned_mps[2]
    takeoff_s = max(_LEAST_TAKEOFF_S, math.ceil(least_spm * climb_m))
    landing_s = max(_LEAST_LANDING_S, math.ceil(max(_LANDING_SPM, least_spm) * down_m))
    return float(takeoff_s), float(landing_s)
