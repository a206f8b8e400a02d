"""The times at which a formation passes its waypoints, and the commanded speeds of its vehicles."""

from dataclasses import dataclass

import numpy as np

from gcs.mission.waypoints.placement import Deviation
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

_SAME_S = 1e-6


@dataclass(frozen=True)
class Gate:
    """A waypoint where all vehicles stop and wait until plan time `leaves_s`; they are due `slack_s` before that."""

    waypoint: int
    leaves_s: float
    slack_s: float


@dataclass(frozen=True)
class TimedLegs:
    """Times (W,) at which all vehicles pass their waypoints, from the start of the run-up to the arrival.

    Speeds (1 or V, W - 1), NaN where a vehicle rests, are corrected for an autopilot; without them each leg is flown at
    its length over its time. With them come the delays `waits_s` (1 or V, W - 1) after each leg. All vehicles leave the
    hover at plan time `leaves_s`, by default the first time. Waypoints are `raised_m` (W,) above the plan where long
    legs would violate the clearance.
    """

    t_s: Array
    error: Deviation
    speeds_mps: Array | None = None
    leaves_s: float | None = None
    gates: tuple[Gate, ...] = ()
    raised_m: Array | None = None
    waits_s: Array | None = None

    @property
    def left_s(self) -> float:
        """The plan time at which vehicles leave the hover."""
        return float(self.t_s[0]) if self.leaves_s is None else self.leaves_s


def rows_with_own_legs(plan: Plan) -> slice:
    """The vehicles with legs of their own: all of them, or only the leader if the shape stays rigid.

    In a rigid formation the others fly the leader's legs, translated.
    """
    begin_s = next(p for p in plan.phases if p.name in (PhaseKind.RUN_UP, PhaseKind.MISSION)).start_s
    moving = any(start < plan.flight_s and end > begin_s for start, end in plan.shape.moving_s)
    return slice(None) if moving else slice(plan.leader, plan.leader + 1)


def with_drawn_points(t_s: Array, plan: Plan) -> tuple[Array, tuple[int, ...]]:
    """Sample times (N,) with those of route points among them, and the indices of these; both ends of a hold.

    A sample gives way to a route point less than half a step away, so that no step is too short for a speed. The first
    and the last sample stay.
    """
    instants = np.array([instant for passage in plan.passages for instant in passage.times_s])
    instants = instants[(instants > t_s[0] + _SAME_S) & (instants < t_s[-1] - _SAME_S)]
    if not len(instants):
        return t_s, ()
    near_s = 0.5 * float(t_s[1] - t_s[0])
    away_s = np.abs(t_s[:, None] - instants).min(axis=1)
    away_s[[0, -1]] = np.inf
    every = np.union1d(t_s[away_s >= near_s], instants)
    return every, tuple(np.searchsorted(every, instants).tolist())
