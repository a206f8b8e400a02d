"""A recorded flight: the reports of every vehicle over time, and its events, in one frame."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from gcs.autopilots.columns import LandingProfile
from gcs.flight.assessment.judge import Tracks
from gcs.flight.monitoring.expected_motion import ExpectedMotion
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.flight.monitoring.progress import Event
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

SILENCE_S = 3.0  # after a longer silence the position of a vehicle is unknown


@dataclass(frozen=True)
class VehicleTrack:
    """The reports of one vehicle, in order of time."""

    sysid: int
    autopilot: int  # MAV_AUTOPILOT
    t_s: Array  # (N,)
    position_ned_m: Array  # (N, 3)
    velocity_ned_mps: Array  # (N, 3)
    armed: NDArray[np.bool_]  # (N,)
    mode: NDArray[np.int64]  # (N,) HEARTBEAT.custom_mode
    battery_pct: NDArray[np.int64]  # (N,) -1: not reported

    def last(self, t_s: float) -> int | None:
        """Return the index of the last report until then; None before the first."""
        at = int(np.searchsorted(self.t_s, t_s, side="right")) - 1
        return at if at >= 0 else None

    def at(self, t_s: Array) -> tuple[Array, Array]:
        """Return positions and velocities (M, 3) at times (M,), interpolated; NaN where the vehicle was silent."""
        if not len(self.t_s):
            return np.full((len(t_s), 3), np.nan), np.full((len(t_s), 3), np.nan)
        after = np.clip(np.searchsorted(self.t_s, t_s), 1, max(len(self.t_s) - 1, 1))
        silent = (t_s < self.t_s[0]) | (t_s > self.t_s[-1])
        if len(self.t_s) > 1:
            silent |= self.t_s[after] - self.t_s[after - 1] > SILENCE_S
        found = []
        for values in (self.position_ned_m, self.velocity_ned_mps):
            between = np.stack([np.interp(t_s, self.t_s, values[:, n]) for n in range(3)], axis=1)
            found.append(np.where(silent[:, None], np.nan, between))
        return found[0], found[1]


@dataclass(frozen=True)
class Recording:
    """All vehicles. Times count from T0 where there is a plan, else from the log's first frame."""

    name: str
    tracks: tuple[VehicleTrack, ...]
    events: tuple[Event, ...]  # incidents and orders
    remarks: tuple[Event, ...]  # modes, arming, texts
    plan: Plan | None
    notes: tuple[str, ...] = ()  # what was not read, in sentences
    landings: Mapping[int, LandingProfile] = field(default_factory=dict)  # by system id
    predicted: PredictedTracks | None = None  # of missions on board
    truth: Tracks | None = None  # of emulated vehicles

    @property
    def sysids(self) -> tuple[int, ...]:
        """Vehicles in order."""
        return tuple(track.sysid for track in self.tracks)

    @property
    def span_s(self) -> tuple[float, float]:
        """From the first report to the last."""
        reported = [track.t_s for track in self.tracks if len(track.t_s)]
        return min(float(t[0]) for t in reported), max(float(t[-1]) for t in reported)

    def at(self, t_s: Array) -> tuple[Array, Array]:
        """Return positions and velocities (V, M, 3) of all vehicles at times (M,); NaN where they were silent."""
        found = [track.at(t_s) for track in self.tracks]
        return np.stack([places for places, _ in found]), np.stack([rates for _, rates in found])

    def planned(self, t_s: Array) -> tuple[Array, Array] | None:
        """Return the planned ones, NaN before and after the plan; None without a plan.

        In the landing they are those of the autopilots' own descents, to the ground.
        """
        plan = self.plan
        if plan is None:
            return None
        expected = ExpectedMotion(plan, self.landings)
        covered = np.stack([expected.covers(row, t_s) for row in range(len(plan.sysids))])
        states = np.where(covered[..., None], expected.states(t_s), np.nan)
        return states[..., POSITION], states[..., VELOCITY]


def nearest_m(places_ned_m: Array) -> Array:
    """Return the least distance (M,) between two of (V, M, 3); NaN where fewer than two are known."""
    found = np.full(places_ned_m.shape[1], np.nan)
    for instant in range(len(found)):
        known = places_ned_m[:, instant][~np.isnan(places_ned_m[:, instant, 0])]
        if len(known) > 1:
            found[instant] = pdist(known).min()
    return found
