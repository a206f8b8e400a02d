"""Raising of waypoints above the plan where long legs would violate the clearance over ground."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.autopilots.navigation.navigator import Navigator
from gcs.autopilots.navigation.predict import Prediction, predict
from gcs.mission.check.flight_limits import limits_of
from gcs.mission.waypoints.clear_legs import short_of_m
from gcs.mission.waypoints.leg_profile import LegProfile
from gcs.mission.waypoints.speed_correction import Corrected
from gcs.physics.quadrotor import Array
from gcs.scenario.environment.no_fly import outside_m, zones

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

_OVER_M = 0.02  # above the required clearance, for rounding
_RAISE_GRID_M = 2.0**-6
_ROUNDS = 4
_EVERY = 4  # steps of a flight between samples: about half a metre


class TerrainRaise:
    """The heights by which waypoints are raised so that the legs between them keep the clearance.

    All vehicles are raised alike, so the formation keeps its shape. The first and the last waypoint are not raised.
    """

    def __init__(self, plan: Plan, t_s: Array) -> None:
        """For waypoints due at t_s (W,)."""
        self._plan, self._t_s = plan, t_s
        self._clearance_m = limits_of(plan.scenario).clearance_m + _OVER_M
        self.by_waypoint_m = np.zeros(len(t_s))
        self._rests: set[int] = set()  # legs on which a vehicle rests: both ends are one waypoint

    def raise_over_ground(
        self, navigator: Navigator, profile: LegProfile, legs: list[int], found: Corrected, row: int | None
    ) -> float:
        """Raise waypoints (W,) for one vehicle (row), or for all that fly the leader's legs (None).

        Return how much nearer to a no-fly zone than they may any of them would be, m.
        """
        flown = found.flown
        self._rests |= set(range(len(self.by_waypoint_m) - 1)) - set(legs)
        for _ in range(_ROUNDS):
            low = self._short_m(flown, row)
            number = np.minimum(np.searchsorted(flown.completed_s, flown.t_s), len(legs) - 1)
            if not np.any(low > 0.0):
                break
            more_m = np.zeros(len(self.by_waypoint_m))
            for leg, which in enumerate(legs):
                ends = slice(which, which + 2)
                more_m[ends] = np.maximum(more_m[ends], low[number == leg].max(initial=0.0))
            more_m[[0, -1]] = 0.0
            self.by_waypoint_m += np.ceil(more_m / _RAISE_GRID_M) * _RAISE_GRID_M
            for leg in sorted(self._rests):
                self.by_waypoint_m[leg : leg + 2] = self.by_waypoint_m[leg : leg + 2].max()
            raised = profile.points_ned_m.copy()
            raised[1:, 2] -= self.by_waypoint_m[np.array(legs) + 1]
            flown = predict(navigator, replace(profile, points_ned_m=raised).orders(found.speeds_mps))
        return max(self._too_near_m(flown, row), 0.0)

    def _too_near_m(self, flown: Prediction, row: int | None) -> float:
        places, scenario = self._places(flown, row), self._plan.scenario
        t_s = np.broadcast_to(float(self._t_s[0]) + flown.t_s[::_EVERY], places.shape[:2])
        away_m = [float(outside_m(zone, t_s, places[..., 0], places[..., 1]).min()) for zone in zones(scenario)]
        required_m = (scenario.limits.zone_margin_m or 0.0) - scenario.mission.tolerance_m
        return required_m - min(away_m, default=math.inf)

    def _short_m(self, flown: Prediction, row: int | None) -> Array:
        """The largest shortfall of the clearance of any vehicle at each step (M,)."""
        places = self._places(flown, row)
        short_m = short_of_m(self._plan.scenario.terrain, places, self._clearance_m).max(axis=0)
        return np.asarray(np.repeat(short_m, _EVERY)[: len(flown.t_s)])

    def _places(self, flown: Prediction, row: int | None) -> Array:
        """Positions of the vehicles (V, M / _EVERY, 3)."""
        plan = self._plan
        t_s = np.clip(float(self._t_s[0]) + flown.t_s[::_EVERY], None, plan.flight_s)
        offsets = plan.offsets(t_s)
        offsets = np.zeros((1, 1, 3)) if row is not None else offsets - offsets[plan.leader]
        return np.asarray(flown.position_ned_m[None, ::_EVERY] + offsets)
