"""Where in a plan vehicles are that were left alone in the air, and how it goes on from there.

Knows: places, the plan. Does not know: links, who asks.
"""

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
    """What is to become of the flight."""

    SHOW = "show"
    LAND = "land"
    RETURN = "return"
    RESUME = "resume"


@dataclass(frozen=True)
class Where:
    """The instant of the plan whose places are nearest, and how far the furthest is from its own."""

    t_s: float
    off_m: float


def where_in_plan(plan: Plan, positions_ned_m: Array) -> Where:
    """For positions (V, 3), between the end of the take-off and the beginning of the landing."""
    t_s = np.arange(plan.airborne_s, plan.phase("landing").start_s, _STEP_S)
    places = plan.leader_trajectory.state(t_s)[:, POSITION] + plan.offsets(t_s)  # (V, N, 3)
    off = np.linalg.norm(places - positions_ned_m[:, None], axis=-1).max(axis=0)
    best = int(np.argmin(off))
    return Where(float(t_s[best]), float(off[best]))
