"""The track and time that is predicted for every vehicle which flies its own mission, and how far it is from them.

The prediction is that of the mission as it is on board, by the model of its autopilot. In a recorded flight five
ArduCopters were within 0.7 m of a place where they were predicted within 0.5 s (`tests/recorded/near_miss`). A vehicle
outside three times that time, and twice that distance or the navigation error of the scenario, does something else
than predicted.
"""

import io
import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from gcs.errors import FileFormatError
from gcs.flight.monitoring.monitor import VehicleView
from gcs.mission.check.fleet_check import FleetReport
from gcs.mission.model import VehicleMission
from gcs.mission.predicted.timing import knots_in_plan_time_s
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.navigation_error import navigation_error
from gcs.types import Array
from gcs.util.archives import ArrayKind, read_arrays
from gcs.util.atomic_write import atomic_write
from gcs.util.bounded_file import TRACKS_FILE, open_regular, refuse_size

BAND_S, BAND_M = 1.5, 1.5
_LATE_M = 1.0  # a vehicle on its track is late, or early, if it is so much farther from where it may be in time
CONFIRMED_S = 0.5  # of reports outside the band: an estimate may jump
_STEP_S = 0.1
_REACH_S = 20.0  # a vehicle is sought on its track so far before and after the present time
_PULL_MPS = 0.5  # nobody is late on a slower track; where one comes back, the place nearest in time counts
_MOVES_MPS = 0.5  # of a slower track no relative speed is known
_FASTEST = 2.0  # relative speed
_ARRAYS = {
    "sysid": ArrayKind("i8", 1, TRACKS_FILE.largest_bytes),
    "begin_s": ArrayKind("f8", 1, TRACKS_FILE.largest_bytes),
    "band_m": ArrayKind("f8", 1, TRACKS_FILE.largest_bytes),
    "band_s": ArrayKind("f8", 1, TRACKS_FILE.largest_bytes),
    "ned_m": ArrayKind("f8", 3, TRACKS_FILE.largest_bytes),
}


class PredictedTracks:
    """Predicted positions of vehicles on one grid of plan time, in the common frame; before and after it, at rest."""

    def __init__(
        self,
        sysids: tuple[int, ...],
        begin_s: float,
        ned_m: Array,
        band_m: float = BAND_M,
        spread_s: Array | None = None,
    ) -> None:
        """`ned_m` (V, N, 3) every 0.1 s. `spread_s` (V,): by so much a vehicle may be early or late besides."""
        self.sysids = sysids
        self.band_m = band_m
        self.band_s = BAND_S + (np.zeros(len(sysids)) if spread_s is None else spread_s)  # (V,)
        self._begin_s = begin_s
        self._ned_m = ned_m

    @classmethod
    def of_plan(cls, plan: Plan) -> Self:
        """Of vehicles that keep the plan's own times."""
        t_s = np.arange(0.0, plan.t_end_s, _STEP_S)
        return cls(plan.sysids, 0.0, plan.motion(t_s)[0][..., POSITION], _band_m(plan))

    @classmethod
    def of_missions(cls, plan: Plan, missions: Sequence[VehicleMission], report: FleetReport) -> Self:
        """Of vehicles that fly these missions as the report predicts."""
        knots_s = [knots_in_plan_time_s(*each) for each in zip(missions, report.flights, strict=True)]
        t_s = np.arange(min(each.leaves_s for each in missions), max(each[-1] for each in knots_s), _STEP_S)
        ned_m = [
            np.stack([np.interp(t_s, at_s, flight.ned_m[:, axis]) for axis in range(3)], axis=-1)
            for at_s, flight in zip(knots_s, report.flights, strict=True)
        ]
        spread_s = np.array([each.widest_s for each in report.spreads]) if report.spreads else None
        sysids = tuple(each.sysid for each in missions)
        return cls(sysids, float(t_s[0]), np.array(ned_m), _band_m(plan), spread_s)

    def save(self, path: Path) -> None:
        """Write the tracks as a NumPy archive, for `gcs attach`. Raises OSError."""
        data = io.BytesIO()
        sysid = np.array(self.sysids, dtype=np.int64)
        begin_s, band_m = np.array([self._begin_s]), np.array([self.band_m])
        np.savez(data, sysid=sysid, begin_s=begin_s, band_m=band_m, band_s=self.band_s, ned_m=self._ned_m)
        atomic_write(path, data.getvalue())

    @classmethod
    def load(cls, path: Path) -> Self:
        """Return the tracks that `save` wrote. Raises FileFormatError."""
        hint = "attach with --land or --return"
        try:
            with os.fdopen(open_regular(path, hint=hint), "rb") as file:
                refuse_size(path, os.fstat(file.fileno()).st_size, TRACKS_FILE)
                found = read_arrays(file, _ARRAYS, stored=True)
            sysids, ned_m, band_s = tuple(found["sysid"].tolist()), found["ned_m"], found["band_s"]
            if not all(np.isfinite(values).all() for values in found.values()):
                raise ValueError("a value is not a finite number")
            if ned_m.shape[::2] != (len(sysids), 3) or ned_m.shape[1] < 2 or band_s.shape != (len(sysids),):
                raise ValueError("its arrays are not of one fleet")
            (begin_s,), (band_m,) = found["begin_s"].tolist(), found["band_m"].tolist()
        except (OSError, ValueError) as problem:
            raise FileFormatError(f"{path} has no predicted tracks of a flight: {problem}.", hint=hint) from problem
        return cls(sysids, begin_s, ned_m, band_m, band_s - BAND_S)

    def places(self, rows: list[int], t_s: Array) -> Array:
        """Predicted positions (R, T, 3) of the vehicles in these rows, each at its own times (R, T)."""
        at = np.clip((t_s - self._begin_s) / _STEP_S, 0.0, self._ned_m.shape[1] - 1.0)
        low = np.minimum(at.astype(np.int64), self._ned_m.shape[1] - 2)
        which = np.array(rows)[:, None]
        share = (at - low)[..., None]
        return np.asarray(self._ned_m[which, low] * (1.0 - share) + self._ned_m[which, low + 1] * share)

    def nearest(self, rows: list[int], ned_m: Array, t_s: Array) -> tuple[Array, Array, Array]:
        """Find vehicles at `ned_m` (R, 3) and times (R,) on their tracks.

        Returns the time (R,) for which the track has the position, the distance from there (R,), and the distance (R,)
        from the part of the track within the vehicle's band.
        """
        around_s = np.arange(-_REACH_S, _REACH_S + _STEP_S / 2, _STEP_S)
        places = self.places(rows, t_s[:, None] + around_s)
        away_m = np.linalg.norm(places - ned_m[:, None], axis=-1)
        best = np.argmin(away_m**2 + (_PULL_MPS * around_s) ** 2, axis=1)
        inside = np.abs(around_s) <= self.band_s[rows][:, None] + _STEP_S / 2
        each = np.arange(len(rows))
        return t_s + around_s[best], away_m[each, best], np.min(away_m, axis=1, where=inside, initial=np.inf)

    def ahead(self, views: Sequence[VehicleView], t0_unix_s: float, unix_s: float, ahead_s: Array) -> Array:
        """Positions (R, T, 3), after `unix_s`, of vehicles that go on along their own tracks at their own speeds.

        They keep their distance to the side. Along a track that hardly moves no speed is known: time passes there.
        """
        rows, ned_m, t_s = self.reports(views, t0_unix_s)
        mps = np.array([view.velocity_ned_mps for view in views])
        at_s, _, _ = self.nearest(rows, ned_m, t_s)
        around = self.places(rows, at_s[:, None] + np.array([-0.5, 0.0, 0.5]))
        rates = around[:, 2] - around[:, 0]
        squared = np.sum(rates * rates, axis=-1)
        along = np.sum(rates * mps, axis=-1) / np.maximum(squared, _MOVES_MPS**2)
        relative = np.where(squared > _MOVES_MPS**2, np.clip(along, 0.0, _FASTEST), 1.0)
        off_m = ned_m - around[:, 1]
        later_s = np.maximum(unix_s - t0_unix_s - t_s, 0.0)[:, None] + ahead_s
        return np.asarray(self.places(rows, at_s[:, None] + relative[:, None] * later_s) + off_m[:, None])

    def reports(self, views: Sequence[VehicleView], t0_unix_s: float) -> tuple[list[int], Array, Array]:
        """Rows, positions (R, 3) and plan times (R,) of the last reports."""
        rows = [self.sysids.index(view.sysid) for view in views]
        return rows, np.array([v.position_ned_m for v in views]), np.array([v.unix_s for v in views]) - t0_unix_s


def _band_m(plan: Plan) -> float:
    return max(BAND_M, navigation_error(plan.scenario).vertical_m)


@dataclass(frozen=True)
class OffTrack:
    """A vehicle outside its band: how late it is on its track, early if negative, and how far from it."""

    sysid: int
    late_s: float
    off_m: float
    band_s: float
    band_m: float

    def __str__(self) -> str:
        when = f"{abs(self.late_s):.1f} s {'late' if self.late_s >= 0.0 else 'early'}"
        limits = f"limits {self.band_s:.1f} s, {self.band_m:.1f} m"
        return f"{when} on its predicted track and {self.off_m:.1f} m off it; {limits}"


class TrackWatch:
    """Tells each vehicle that leaves its band, once until it is back.

    A vehicle hovers where its receiver has its pad, beside the track. Until it is on the track for the first time its
    band is wider by the distance at which it was first seen.
    """

    def __init__(self, tracks: PredictedTracks, until_s: float) -> None:
        """`until_s`: the plan time at which the watch ends."""
        self._tracks = tracks
        self._until_s = until_s
        self._since_s: dict[int, float] = {}
        self._reported: set[int] = set()
        self._began_m: dict[int, float] = {}

    def look(self, views: Mapping[int, VehicleView], t0_unix_s: float, on_plan: Collection[int]) -> list[OffTrack]:
        """Return the vehicles `on_plan` that their last reports show outside their bands for `CONFIRMED_S`."""
        flying = [views[i] for i in on_plan if 0.0 <= views[i].unix_s - t0_unix_s <= self._until_s]
        if not flying:
            return []
        rows, ned_m, t_s = self._tracks.reports(flying, t0_unix_s)
        at_s, off_m = self.follow(rows, ned_m, t_s)
        found = []
        for n, (sysid, now_s) in enumerate(zip([view.sysid for view in flying], t_s.tolist(), strict=True)):
            if now_s - self._since_s.get(sysid, np.inf) >= CONFIRMED_S and sysid not in self._reported:
                self._reported.add(sysid)
                band_s = float(self._tracks.band_s[rows[n]])
                found.append(OffTrack(sysid, now_s - float(at_s[n]), float(off_m[n]), band_s, self._tracks.band_m))
        return found

    def follow(self, rows: list[int], ned_m: Array, t_s: Array) -> tuple[Array, Array]:
        """Take in vehicles at `ned_m` (R, 3) and plan times (R,); `inside` then tells of each.

        Returns the time (R,) for which its track has the position, and the distance from there (R,).
        """
        at_s, off_m, outside_m = self._tracks.nearest(rows, ned_m, t_s)
        beyond_m = np.maximum(outside_m - self._tracks.band_m, outside_m - off_m - _LATE_M)
        for n, row in enumerate(rows):
            sysid = self._tracks.sysids[row]
            began_m = self._began_m.setdefault(sysid, float(outside_m[n]))
            if beyond_m[n] <= 0.0:
                self._began_m[sysid] = 0.0
            if beyond_m[n] <= began_m:
                self._since_s.pop(sysid, None)
                self._reported.discard(sysid)
            else:
                self._since_s.setdefault(sysid, float(t_s[n]))
        return at_s, off_m

    def inside(self, sysid: int) -> bool:
        """Whether the last look found the vehicle inside its band."""
        return sysid not in self._since_s
