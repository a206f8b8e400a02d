"""The errors of a flight: between planned, estimated and true positions (RMS), and of its landings by telemetry."""

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gcs.flight.assessment.judge import Truth
from gcs.flight.monitoring.lateness import lateness_s
from gcs.flight.monitoring.progress import PlanTime
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

_RESTS_MPS, _LOW_M = 0.25, 1.0  # slower than any descent
_OVER_M = 10.0  # horizontally: over its landing point


@dataclass(frozen=True)
class Comparison:
    """The differences of one vehicle, RMS between T0 and the planned arrival; NaN without data."""

    sysid: int
    plan_estimate_m: float
    estimate_truth_m: float
    plan_truth_m: float
    late_s: float  # mean delay behind the plan, with that of its start


def compare(plan: Plan, record: pa.Table, truth: Truth | None, plan_time: PlanTime) -> tuple[Comparison, ...]:
    """Return them for every vehicle of the plan. True states are interpolated to the times of the estimates.

    While a standstill led the vehicles off the plan nothing counts.
    """
    found = []
    for sysid in plan.sysids:
        columns = {name: record.column(name).to_numpy() for name in record.column_names}
        t_s = columns["t_s"]
        mine = (columns["sysid"] == sysid) & (t_s >= 0.0) & (t_s <= plan.flight_s)
        mine &= ~plan_time.off_plan(columns["unix_s"])
        if not mine.any():
            found.append(Comparison(sysid, np.nan, np.nan, np.nan, np.nan))
            continue
        estimated, planned, rate = (
            np.stack([columns[form.format(axis)][mine] for axis in ("north", "east", "down")], axis=1)
            for form in ("{}_m", "planned_{}_m", "planned_v_{}_mps")
        )
        true = np.full_like(estimated, np.nan)
        if truth is not None and sysid in truth.sysids:
            places = truth.states[truth.sysids.index(sysid)][:, POSITION]
            at_s = columns["unix_s"][mine]
            true = np.stack([np.interp(at_s, truth.unix_s, places[:, n]) for n in range(3)], axis=1)
        found.append(
            Comparison(
                sysid,
                _rms(estimated - planned),
                _rms(estimated - true),
                _rms(true - planned),
                lateness_s(estimated, planned, rate),
            )
        )
    return tuple(found)


def _rms(off: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(off * off, axis=1))))


@dataclass(frozen=True)
class LandingError:
    """One vehicle's landing; NaN where the record does not tell."""

    sysid: int
    touchdown_s: float  # plan time of the last report before it was disarmed, or of the last one, at rest
    horizontal_m: float  # from the landing point, then
    vertical_max_m: float  # the largest deviation from the expected descent; NaN if it landed elsewhere

    def within(self, limit_m: float) -> bool | None:
        """Return whether it landed within this horizontal distance; None if its landing is not in the record."""
        return None if np.isnan(self.horizontal_m) else bool(self.horizontal_m <= limit_m)


def landing_errors(plan: Plan, record: pa.Table) -> tuple[LandingError, ...]:
    """Return them for every vehicle of the plan, from its flight record (`record_table`).

    The descent is compared while the vehicle is over its landing point, and above it: where the ground is lower than
    the scenario's, the rest is not an error of the descent.
    """
    names = ("sysid", "t_s", "armed", "north_m", "east_m", "down_m", "v_down_mps", "planned_down_m")
    columns = {name: record.column(name).to_numpy() for name in names}
    landing_s = plan.landing_s
    found = []
    for sysid, point in zip(plan.sysids, plan.landing_points_ned_m, strict=True):
        mine = columns["sysid"] == sysid
        t_s, armed, north_m, east_m, down_m, rate_mps, planned_m = (columns[name][mine] for name in names[1:])
        beside_m = np.hypot(north_m - point[0], east_m - point[1])
        last = _touchdown(armed, np.abs(rate_mps) < _RESTS_MPS, down_m > point[2] - _LOW_M)
        if last is None:
            found.append(LandingError(sysid, np.nan, np.nan, np.nan))
            continue
        above = (t_s >= landing_s) & armed & (beside_m <= _OVER_M) & ~np.isnan(planned_m)
        off_m = np.abs(np.minimum(down_m, point[2]) - planned_m)[above]
        known = len(off_m) > 0 and beside_m[last] <= _OVER_M
        vertical_m = float(off_m.max()) if known else np.nan
        found.append(LandingError(sysid, float(t_s[last]), float(beside_m[last]), vertical_m))
    return tuple(found)


def _touchdown(armed: NDArray[np.bool_], rests: NDArray[np.bool_], low: NDArray[np.bool_]) -> int | None:
    """The last armed report before a vehicle was disarmed for good; the last one where the record ends with it."""
    if not len(armed) or not armed.any():
        return None
    last = int(np.flatnonzero(armed)[-1])
    ends_at_rest = bool(rests[last] and low[last])  # a flight ends as soon as its last vehicle is disarmed
    return last if last + 1 < len(armed) or ends_at_rest else None
