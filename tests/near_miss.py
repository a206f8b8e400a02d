"""A recorded near miss: six ArduCopters flew `circuit` by missions on board, and vehicle 4 slowed down as it was told.

`tests/recorded/near_miss/flight.npz` has whole centimetres at 5 Hz from T0 on, as steps from one instant to the next:
what was reported (positions and velocities), where the vehicles truly were, and what was predicted of the missions
before the flight. The prediction has vehicle 4 slow down no more than the others did.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.plan.plan_file import read_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.navigation_error import navigation_error
from gcs.types import Array

FOLDER = Path(__file__).resolve().parent / "recorded" / "near_miss"
STEP_S = 0.2
NEAREST_S, CLIMBED_S = 212.8, 212.0  # the closest approach, and the first order, which was too late
LATE = 4


@cache
def plan() -> Plan:
    """The plan that was flown."""
    return read_plan(FOLDER / "plan.skein")[0]


@cache
def _metres(name: str) -> Array:
    with np.load(FOLDER / "flight.npz") as stored:
        return np.asarray(np.cumsum(stored[f"{name}_steps_cm"].astype(np.float64), axis=1) / 100.0)


def true_m() -> Array:
    """True positions (6, N, 3)."""
    return _metres("true")


def reported(row: int, t_s: float) -> Array:
    """Reported position and velocity (6,) of a vehicle at a plan time."""
    values = _metres("reported")[row]
    at = min(int(t_s / STEP_S), len(values) - 2)
    return np.asarray(values[at] + (t_s / STEP_S - at) * (values[at + 1] - values[at]))


def tracks() -> PredictedTracks:
    """What was predicted."""
    places = _metres("predicted")
    at_s, t_s = STEP_S * np.arange(places.shape[1]), np.arange(0.0, STEP_S * places.shape[1], STEP_S / 2)
    finer = [np.stack([np.interp(t_s, at_s, each[:, n]) for n in range(3)], axis=-1) for each in places]
    return PredictedTracks(plan().sysids, 0.0, np.array(finer), navigation_error(plan().scenario).vertical_m)
