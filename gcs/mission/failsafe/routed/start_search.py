"""The nearest two vehicles of returns that the ground station flies, searched over the instants at which they begin.

Intervals between instants are halved, down to 1 ms, where a way jumps to another corner or another brake, and where the
distance may fall below the least one if it changes as fast as vehicles fly. That is a search, not a proof: a way that
jumps twice between two of the first instants is not seen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs.mission.failsafe.return_routes import ReturnRoutes
from gcs.mission.failsafe.routed.routed_returns import RoutedReturns, nearest_pairs, routed_returns
from gcs.mission.failsafe.rtl_motion import ReturnSpeeds
from gcs.mission.machine_independent import first_least
from gcs.physics.quadrotor import Array

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

RESOLUTION_S = 1e-3
_JUMP = 0.05  # corners jump by metres; the strengths of brakes, m/s^2, are at least 0.09 apart
_NEARER_M = 0.05  # less is not looked for
_AT_ONCE = 32  # instants
_NEAR_MAX, _SOLVED_MAX = 150, 500  # instants, after which none is added near the least distance; and none at all
_PAIRS_MAX = 66  # of vehicles; a fleet that has more is looked at once more only


@dataclass(frozen=True)
class NearestReturn:
    """A return from `t_s` in which two vehicles (rows) come within `distance_m`."""

    distance_m: float
    t_s: float
    pair: tuple[int, int]
    name: str


def nearest_return(
    plan: Plan,
    routes: ReturnRoutes,
    first: list[RoutedReturns],
    top_down_m: Array,
    speeds: ReturnSpeeds,
) -> NearestReturn:
    """The nearest two vehicles; `first` are the returns to begin with, at least two vehicles of them."""
    apart_m = plan.scenario.limits.separation_min_m
    rate_mps = float(np.hypot(*plan.scenario.limits.speed_ned_mps[:2]))
    found: list[NearestReturn] = []
    known = {case.name: _Instants.of(case, nearest_pairs(case, top_down_m, speeds, apart_m), found) for case in first}
    solved, most = 0, _SOLVED_MAX if len(top_down_m) * (len(top_down_m) - 1) // 2 <= _PAIRS_MAX else 1
    while solved < most:
        best_m = min(one.distance_m for one in found)
        wanted = [instants.wanted(best_m, rate_mps) for instants in known.values()]
        middle_s, low_m, jumps = (np.concatenate(column) for column in zip(*wanted, strict=True))
        order = np.argsort(low_m, kind="stable")
        near = order[~jumps[order]][: _AT_ONCE if solved < _NEAR_MAX else 0]
        at_s = np.unique(middle_s[np.concatenate([order[jumps[order]][:_AT_ONCE], near])])
        if not len(at_s):
            break
        solved += len(at_s)
        more = {
            case.name: _Instants.of(case, nearest_pairs(case, top_down_m, speeds, apart_m), found)
            for case in routed_returns(plan, routes, at_s)
        }
        # Where all return home, there is no other case.
        known = {name: instants.joined(more.get(name, more["home"])) for name, instants in known.items()}
    return found[first_least(np.array([one.distance_m for one in found]))]


@dataclass(frozen=True)
class _Instants:
    """Instants (N,), in order, the least distances of their returns, and what jumps where ways do (N, V, 6)."""

    t_s: Array
    least_m: Array
    kinds: Array

    @classmethod
    def of(cls, case: RoutedReturns, nearest: tuple[Array, NDArray[np.intp]], found: list[NearestReturn]) -> _Instants:
        """Those of a case; its nearest two vehicles are added to what was found."""
        least_m, pairs = nearest
        at = first_least(least_m)
        pair = int(pairs[at, 0]), int(pairs[at, 1])
        found.append(NearestReturn(float(least_m[at]), float(case.t_s[at]), pair, case.name))
        return cls(case.t_s, least_m, case.kinds())

    def wanted(self, best_m: float, rate_mps: float) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Middles (M,) of intervals to halve, how near (M,) vehicles may be in them, and whether a way jumps."""
        width_s = np.diff(self.t_s)
        low_m = np.minimum(self.least_m[:-1], self.least_m[1:]) - 0.5 * rate_mps * width_s
        jumps: NDArray[np.bool_] = np.any(np.abs(np.diff(self.kinds, axis=0)) > _JUMP, axis=(1, 2))
        left = (width_s > RESOLUTION_S) & (jumps | (low_m < best_m - _NEARER_M))
        return (0.5 * (self.t_s[:-1] + self.t_s[1:]))[left], low_m[left], jumps[left]

    def joined(self, other: _Instants) -> _Instants:
        """Both, in order; what both have counts once."""
        t_s, order = np.unique(np.concatenate([self.t_s, other.t_s]), return_index=True)
        least_m = np.concatenate([self.least_m, other.least_m])[order]
        return _Instants(t_s, least_m, np.concatenate([self.kinds, other.kinds])[order])
