"""When a formation passes its waypoints, and at what speeds its vehicles are asked to fly there.

Knows: plain numbers that missions are built from, whose legs are alike. Does not know: items, autopilots.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs.mission.waypoints.placement import Deviation
from gcs.physics.quadrotor import Array

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan


@dataclass(frozen=True)
class Gate:
    """A waypoint where everybody stops and waits until plan time `leaves_s`; due `slack_s` before that."""

    waypoint: int
    leaves_s: float
    slack_s: float


@dataclass(frozen=True)
class TimedLegs:
    """Instants (W,) all vehicles are to pass their waypoints at, from the start of the run-up to the arrival.

    Speeds (1 or V, W - 1), NaN where a vehicle rests, are corrected for an autopilot; without them each leg is flown at
    its length over its time. Everybody leaves the hover at plan time `leaves_s`, the first instant unless given, and
    waypoints are `lift_m` (W,) above the plan, where long legs would come too near to the ground.
    """

    t_s: Array
    error: Deviation
    speeds_mps: Array | None = None
    leaves_s: float | None = None
    gates: tuple[Gate, ...] = ()
    lift_m: Array | None = None

    @property
    def left_s(self) -> float:
        """When the hover is left."""
        return float(self.t_s[0]) if self.leaves_s is None else self.leaves_s


def rows_with_own_legs(plan: Plan) -> slice:
    """Vehicles whose legs are to be made: everybody, or the leader for all where the shape rests on the way.

    A rigid formation flies its leader's legs, moved.
    """
    begin_s = next(p for p in plan.phases if p.name in ("run-up", "mission")).start_s
    moving = any(start < plan.flight_s and end > begin_s for start, end in plan.shape.moving_s)
    return slice(None) if moving else slice(plan.leader, plan.leader + 1)
