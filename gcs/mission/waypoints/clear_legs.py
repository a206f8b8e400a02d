"""The test whether a straight leg keeps the clearance over the ground."""

from __future__ import annotations

import numpy as np

from gcs.mission.check.flight_limits import limits_of
from gcs.mission.waypoints.placement import Allowed
from gcs.physics.quadrotor import Array
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario

_OVER_M, _OVER_SHARE = 0.02, 0.25  # above the required clearance, for rounding; and of the tolerance, at most


def clear_legs(scenario: Scenario, t_s: Array, position_ned_m: Array) -> Allowed:
    """Return the test of legs between samples at `t_s` (N,), flown by all vehicles at positions (V, N, 3)."""
    least_m = limits_of(scenario).clearance_m + min(_OVER_M, _OVER_SHARE * scenario.mission.tolerance_m)

    def allowed(first: int, last: int) -> bool:
        share = ((t_s[first : last + 1] - t_s[first]) / (t_s[last] - t_s[first]))[:, None]
        begin, end = position_ned_m[:, None, first], position_ned_m[:, None, last]
        places = begin + share * (end - begin)  # (V, M, 3)
        ground_m = ground_height_m(scenario.terrain, places[..., 0], places[..., 1])
        return bool(np.all(-places[..., 2] - ground_m >= least_m))

    return allowed
