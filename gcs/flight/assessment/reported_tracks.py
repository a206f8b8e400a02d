"""The tracks of a flight from what its vehicles reported, with what the reports leave open.

Between two reports a vehicle may have moved off the interpolated track as far as its acceleration allows. After a
vehicle's last report in the air nothing is known of it.
"""

from __future__ import annotations

import numpy as np
import pyarrow as pa
from scipy.interpolate import CubicHermiteSpline

from gcs.flight.assessment.judge import GRID_S, Tracks, Verdict, judge_tracks
from gcs.flight.monitoring.plan_time import PlanTime
from gcs.plan.trajectory.plan import Plan

_ACCELERATION_MPS2 = 5.0  # of a vehicle that leans by 27 degrees
_ENDS_S = 3.0  # a vehicle whose reports end with those of all others was not lost
_AXES = ("north", "east", "down")
_FORMS = ("{}_m", "v_{}_mps")


def judge_reports(plan: Plan, tracks: Tracks) -> Verdict | None:
    """Return the verdict on a flight from `reported_tracks`. It counts what `judge` counts, in plan time.

    None where nothing was reported between T0 and the planned arrival.
    """
    if not ((tracks.t_s >= 0.0) & (tracks.t_s <= plan.flight_s)).any() or np.isnan(tracks.ned_m).any():
        return None
    landing_s = plan.phase("landing").start_s
    return judge_tracks(plan, tracks, tracks.during((tracks.t_s >= plan.airborne_s) & (tracks.t_s <= landing_s)))


def reported_tracks(plan: Plan, record: pa.Table, plan_time: PlanTime) -> Tracks | None:
    """Return the tracks of a flight's record from its first armed report to its last one; None without any."""
    columns = {name: record.column(name).to_numpy() for name in record.column_names}
    armed_s = columns["unix_s"][columns["armed"]]
    if not len(armed_s):
        return None
    unix_s = np.arange(armed_s.min(), armed_s.max(), GRID_S)
    places = np.full((len(plan.sysids), len(unix_s), 3), np.nan)
    horizontal_m, vertical_m = np.full((2, len(plan.sysids), len(unix_s)), np.inf)
    for row, sysid in enumerate(plan.sysids):
        mine = np.flatnonzero(columns["sysid"] == sysid)
        mine = mine[np.unique(columns["unix_s"][mine], return_index=True)[1]]
        if len(mine) < 2:
            continue
        told_s = columns["unix_s"][mine]
        at = {form: np.stack([columns[form.format(axis)][mine] for axis in _AXES], axis=1) for form in _FORMS}
        places[row] = CubicHermiteSpline(told_s, *at.values())(np.clip(unix_s, told_s[0], told_s[-1]))
        after = np.clip(np.searchsorted(told_s, unix_s), 1, len(mine) - 1)
        strayed_m = _ACCELERATION_MPS2 * (told_s[after] - told_s[after - 1]) ** 2 / 8.0
        lost = (unix_s > told_s[-1] + _ENDS_S) & bool(columns["armed"][mine[-1]])
        for name, within in (("horizontal_within_m", horizontal_m), ("vertical_within_m", vertical_m)):
            told_m = columns[name][mine]
            within[row] = np.maximum(told_m[after - 1], told_m[after]) + strayed_m
            within[row, lost] = np.inf
    return Tracks(plan_time.t_s(unix_s), places, horizontal_m, vertical_m)
