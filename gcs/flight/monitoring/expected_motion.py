"""The motion that is expected of every vehicle: the plan, and in its last phase the landing of its own autopilot.

The landing is ordered at the beginning of the plan's landing phase. From then on a vehicle stays above its landing
point, and descends at the speeds of its autopilot, not at those of the plan.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gcs.autopilots.columns import LandingProfile
from gcs.autopilots.traits import traits_of
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

_MOTION = VELOCITY.stop  # a state begins with position and velocity
_DOWN, _DOWN_RATE = POSITION.start + 2, VELOCITY.start + 2


def landing_profiles(
    autopilots: Mapping[int, int], parameters: Mapping[int, Mapping[str, float]] | None = None
) -> dict[int, LandingProfile]:
    """Return the profile of each vehicle from MAV_AUTOPILOT and the parameters that are known, both by system id.

    Vehicles with an autopilot that is not in the table have none.
    """
    rows = {sysid: traits_of(autopilot) for sysid, autopilot in autopilots.items()}
    known = parameters or {}
    return {sysid: row.landing.profile(known.get(sysid)) for sysid, row in rows.items() if row is not None}


class ExpectedMotion:
    """The positions and velocities, NED, that are expected of a plan's vehicles.

    Without a profile a vehicle is expected to descend as planned.
    """

    def __init__(self, plan: Plan, profiles: Mapping[int, LandingProfile] | None = None) -> None:
        self.plan = plan
        self.profiles = dict(profiles or {})
        self._landing_s = plan.landing_s
        self._from = plan.states(np.array([self._landing_s]))[:, 0, :_MOTION]
        self._ground_ned_m = plan.landing_points_ned_m

    def covers(self, row: int, t_s: Array) -> NDArray[np.bool_]:
        """Return whether a motion is expected at plan times (N,): in the plan, and after it on the landing point.

        Without a profile nothing is expected after the plan.
        """
        ends_s = np.inf if self.plan.sysids[row] in self.profiles else self.plan.t_end_s
        return (t_s >= self.plan.t_start_s) & (t_s <= ends_s)

    def states(self, t_s: Array) -> Array:
        """Return positions and velocities (V, N, 6) at plan times (N,), around the plan its first and last ones."""
        return np.stack([self.of_vehicle(row, t_s) for row in range(len(self.plan.sysids))])

    def of_vehicle(self, row: int, t_s: Array) -> Array:
        """Return those (N, 6) of the vehicle in this row of the plan: cheap, for every report in flight."""
        plan = self.plan
        inside_s = np.clip(t_s, plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf))
        beside = [plan.shape.offsets(inside_s, order, slice(row, row + 1))[0] for order in (0, 1)]
        states = plan.leader_trajectory.state(inside_s)[:, :_MOTION] + np.hstack(beside)
        profile = self.profiles.get(plan.sysids[row])
        landing = t_s >= self._landing_s
        if profile is not None and landing.any():
            states[landing] = self._descent(row, profile, t_s[landing] - self._landing_s)
        return np.asarray(states)

    def _descent(self, row: int, profile: LandingProfile, since_s: Array) -> Array:
        pad_m = -float(self.plan.pads_ned_m[row, 2])  # home, from which the autopilot counts
        ground_m = -float(self._ground_ned_m[row, 2]) - pad_m
        height_m = profile.height_m(-float(self._from[row, _DOWN]) - pad_m, ground_m, since_s)
        states = np.repeat(self._from[row][None], len(since_s), axis=0)
        states[:, _DOWN] = -(height_m + pad_m)
        states[:, VELOCITY] = 0.0
        moves = (since_s > profile.delay_s) & (height_m > ground_m)
        states[:, _DOWN_RATE] = np.where(moves, profile.speed_mps(height_m), 0.0)
        return np.asarray(states)
