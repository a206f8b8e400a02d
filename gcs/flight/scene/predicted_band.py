"""The band of missions on board in a scene, and which vehicles were in it."""

import numpy as np

from gcs.flight.monitoring.predicted_tracks import PredictedTracks, TrackWatch
from gcs.flight.monitoring.progress import PredictedPlaces
from gcs.flight.scene.scene_model import PlannedBand, Rows
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array


def band_of(tracks: PredictedPlaces, plan: Plan, t_s: Array) -> PlannedBand:
    """Return the band of a plan's missions at plan times (N,); it is watched between T0 and the arrival."""
    rows = [tracks.sysids.index(sysid) for sysid in plan.sysids]
    places = tracks.places(rows, np.broadcast_to(t_s, (len(rows), len(t_s))))
    return PlannedBand(np.where(_watched(plan, t_s)[:, None], places, np.nan), tracks.band_s[rows], tracks.band_m)


def in_band(tracks: PredictedTracks, plan: Plan, t_s: Array, places_ned_m: Array) -> Rows:
    """Return for places (V, N, 3) at plan times (N,) 1 inside, 0 outside, and -1 where it is not known."""
    rows = [tracks.sysids.index(sysid) for sysid in plan.sysids]
    watch, found = TrackWatch(tracks, plan.flight_s), np.full(places_ned_m.shape[:2], -1, dtype=np.int64)
    for at in np.flatnonzero(_watched(plan, t_s)):
        known = np.flatnonzero(np.isfinite(places_ned_m[:, at, 0]))
        if len(known):
            watch.follow([rows[row] for row in known], places_ned_m[known, at], np.full(len(known), t_s[at]))
            found[known, at] = [watch.inside(plan.sysids[row]) for row in known]
    return found


def _watched(plan: Plan, t_s: Array) -> Array:
    return np.asarray((t_s >= 0.0) & (t_s <= plan.flight_s))
