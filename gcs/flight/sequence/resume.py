"""The instant of a plan that airborne vehicles are nearest to, from which a flight can be resumed."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gcs.physics.quadrotor import POSITION, Array
from gcs.plan.trajectory.plan import Plan

NEAR_M = 3.0
FADE_S = 10.0
_STEP_S = 0.1


class Resume(StrEnum):
    """What is done with a flight that lost its ground station."""

    SHOW = "show"
    LAND = "land"
    RETURN = "return"
    RESUME = "resume"


@dataclass(frozen=True)
class Where:
    """The plan time whose positions are nearest, and the largest deviation of a vehicle from them."""

    t_s: float
    off_m: float


def where_in_plan(plan: Plan, positions_ned_m: Array) -> Where:
    """Return it for positions (V, 3), between the end of the take-off and the start of the landing."""
    t_s = np.arange(plan.airborne_s, plan.phase("landing").start_s, _STEP_S)
    places = plan.leader_trajectory.state(t_s)[:, POSITION] + plan.offsets(t_s)  # (V, N, 3)
    off = np.linalg.norm(places - positions_ned_m[:, None], axis=-1).max(axis=0)
    best = int(np.argmin(off))
    return Where(float(t_s[best]), float(off[best]))
