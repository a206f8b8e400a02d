"""The reference trajectories of ordered vehicles: where each one starts, where a return ends, when it has arrived."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gcs.flight.contingency.energy_choice import EnergyChoice
from gcs.flight.contingency.manoeuvres import (
    MotionReference,
    hold_reference,
    predicted_start,
    return_reference,
    spread_reference,
)
from gcs.flight.contingency.policy import SPREAD_M, Action, Order
from gcs.flight.monitoring.monitor import VehicleView
from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.mission.returns.rtl_altitudes import ReturnPlan
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

HOVER_M = 1.0  # over the pad, before the landing
NEAR_M, STILL_MPS = 0.5, 0.3  # a vehicle has arrived: horizontally, and in every direction
ARRIVES_S = 8.0  # at most after the end of a return's reference
# A vehicle that a failsafe or a gust stopped does not follow the reference of its return. It gets a new one then, from
# where it is. Ways keep 3 m from zones.
LEFT_M, RENEWS_S, RENEWALS_MAX = 2.0, 2.0, 3


class OrderedTracks:
    """Makes and judges the references of orders. `routes` are the ways back, `chosen` the last choices of energy."""

    def __init__(self, plan: Plan, returns: ReturnPlan, chosen: Mapping[int, EnergyChoice]) -> None:
        self.routes = ReturnRoutes(plan)
        self._plan = plan
        self._returns = returns
        self._chosen = chosen

    def reference(
        self, order: Order, view: VehicleView, row: int, t0_unix_s: float, begin_s: float
    ) -> MotionReference | None:
        """The reference of an order, from the vehicle's predicted position at plan time `begin_s`.

        None: a return without a way.
        """
        start = predicted_start(self._plan, view, t0_unix_s, begin_s)
        if order.action is Action.HOLD:
            return hold_reference(start, self.routes)
        if order.action is Action.SPREAD:
            return spread_reference(start, self.routes, SPREAD_M)
        home, end, speeds = self._plan.pads_ned_m[row], self.end_ned_m(order, row), self._returns.speeds
        top_down_m = float(home[2]) - self._returns.altitudes_m[row]
        return return_reference(start, self.routes, end, top_down_m, speeds, HOVER_M)

    def end_ned_m(self, order: Order, row: int) -> Array:
        """Where an order to return or to divert ends (3,)."""
        choice = self._chosen.get(order.sysid)
        target = None if choice is None or order.action is not Action.DIVERT else choice.chosen.target_ned_m
        return self._plan.pads_ned_m[row] if target is None else np.array(target)


@dataclass(frozen=True)
class WayBack:
    """A vehicle on its way back. `renewals`: how often it got a new reference, because it did not follow the last."""

    order: Order
    track: MotionReference
    renewals: int = 0

    def has_arrived(self, view: VehicleView, t_s: float) -> bool:
        """Whether the return has ended: the vehicle rests above its end, or had time enough to come there."""
        if t_s <= self.track.end_s:
            return False
        off_m = float(np.linalg.norm((view.position_ned_m - self.track.end_ned_m)[:2]))
        still = float(np.linalg.norm(view.velocity_ned_mps)) < STILL_MPS
        return (off_m < NEAR_M and still) or t_s > self.track.end_s + ARRIVES_S

    def is_left(self, view: VehicleView, t0_unix_s: float, t_s: float) -> bool:
        """Whether a vehicle is so far from its reference that it would cut corners of the way."""
        if self.renewals >= RENEWALS_MAX or t_s < self.track.begin_s + RENEWS_S:
            return False
        position, _ = view.predicted(t0_unix_s + t_s)
        return float(np.linalg.norm(position - np.array(self.track.at(0, t_s)[:3]))) > LEFT_M
