"""The RMS differences between planned, estimated and true positions of a flight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from gcs.flight.assessment.judge import Truth
from gcs.flight.lateness import lateness_s
from gcs.physics.quadrotor import POSITION, Array
from gcs.plan.trajectory.plan import Plan


@dataclass(frozen=True)
class Comparison:
    """The differences of one vehicle, RMS between T0 and the planned arrival; NaN without data."""

    sysid: int
    plan_estimate_m: float
    estimate_truth_m: float
    plan_truth_m: float
    late_s: float  # mean delay behind the plan, with that of its start


def compare(plan: Plan, record: pa.Table, t0_unix_s: float, truth: Truth | None) -> tuple[Comparison, ...]:
    """Return them for every vehicle of the plan. True states are interpolated to the times of the estimates."""
    found = []
    for sysid in plan.sysids:
        columns = {name: record.column(name).to_numpy() for name in record.column_names}
        t_s = columns["t_s"]
        mine = (columns["sysid"] == sysid) & (t_s >= 0.0) & (t_s <= plan.flight_s)
        if not mine.any():
            found.append(Comparison(sysid, np.nan, np.nan, np.nan, np.nan))
            continue
        estimated, planned, rate = (
            _vectors(columns, mine, form) for form in ("{}_m", "planned_{}_m", "planned_v_{}_mps")
        )
        true = np.full_like(estimated, np.nan)
        if truth is not None and sysid in truth.sysids:
            places = truth.states[truth.sysids.index(sysid)][:, POSITION]
            at = truth.unix_s - t0_unix_s
            true = np.stack([np.interp(t_s[mine], at, places[:, n]) for n in range(3)], axis=1)
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


def _vectors(columns: dict[str, Array], rows: Array, form: str) -> Array:
    return np.stack([columns[form.format(axis)][rows] for axis in ("north", "east", "down")], axis=1)


def _rms(off: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(off * off, axis=1))))
