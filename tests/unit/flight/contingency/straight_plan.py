"""A plan whose flight is known in closed form: all fly north at a constant speed, one behind the other."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from gcs.flight.monitoring.monitor import VehicleView
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

NORTH_MPS, SPREAD_MPS, HOVER_DOWN_M, BEHIND_M = 2.0, 0.1, -8.0, 5.0


def yaw_rad(t_s: Any) -> Any:
    return 0.4 + 0.01 * t_s


class _Leader:
    @staticmethod
    def state(t_s: Array) -> Array:
        """The leader's state (N, 12): north 2 t, 8 m above the ground; 1 m lower from -10 s to 0 s."""
        state = np.zeros((len(t_s), 12))
        state[:, 0], state[:, 3] = NORTH_MPS * t_s, NORTH_MPS
        state[:, 2] = np.where(t_s < -9.0, HOVER_DOWN_M, HOVER_DOWN_M + 1.0)
        state[:, 8] = yaw_rad(t_s)
        return state


class StraightPlan:
    """Vehicles 3, 1, 2 in the rows 0, 1, 2. Row n flies 5 m behind row n - 1, and n times 0.1 m/s further east."""

    sysids = (3, 1, 2)
    airborne_s, t_start_s, t_end_s = -10.0, -20.0, 60.0
    pads_ned_m = np.array([[0.0, 0.0, 0.0], [-5.0, 0.0, 0.0], [-10.0, 0.0, 0.0]])
    leader_trajectory = _Leader()

    @property
    def shape(self) -> StraightPlan:
        return self

    @staticmethod
    def offsets(t_s: Array, order: int = 0) -> Array:
        """Offsets from the leader (V, N, 3), or their rates."""
        rows = np.arange(3.0)[:, None] * np.ones(len(t_s))
        if order:
            return np.stack([0 * rows, SPREAD_MPS * rows, 0 * rows], axis=-1)
        return np.stack([-BEHIND_M * rows, SPREAD_MPS * rows * t_s, 0 * rows], axis=-1)

    def states(self, t_s: Array) -> Array:
        """States of all vehicles (V, N, 12)."""
        states = np.repeat(self.leader_trajectory.state(t_s)[None], 3, axis=0)
        states[..., :3] += self.offsets(t_s)
        states[..., 3:6] += self.offsets(t_s, 1)
        return states


def straight_plan() -> Plan:
    return cast(Plan, StraightPlan())


def reported(t_s: float, t0_unix_s: float, ages_s: dict[int, float] | float = 0.0) -> dict[int, VehicleView]:
    """What vehicles that fly the plan reported: each at `t_s` less the age of its report."""
    views = {}
    for row, sysid in enumerate(StraightPlan.sysids):
        at_s = t_s - (ages_s if isinstance(ages_s, float) else ages_s.get(sysid, 0.0))
        state = StraightPlan().states(np.array([at_s]))[row, 0]
        views[sysid] = VehicleView(sysid, state[:3], state[3:6], t0_unix_s + at_s)
    return views
