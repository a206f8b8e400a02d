"""State and control of one vehicle over a whole plan, as CSV: for plots and comparisons, not for flying."""

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from gcs.mission.formats.tables.csv_table import with_units, write_csv
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

COLUMNS = with_units(
    "t_s north_m east_m down_m v_north_mps v_east_mps v_down_mps roll_rad pitch_rad yaw_rad "
    "roll_rate_radps pitch_rate_radps yaw_rate_radps U1_N U2_N U3_N U4_Nm"
)
_TITLE = "Skein state and control history: common local NED frame, t_s = 0 is T0"
_MS = 1000
_STATE_DECIMALS, _CONTROL_DECIMALS = 6, 7  # micrometres and microradians: what all machines agree on
ALL_VEHICLES = slice(None)


@dataclass(frozen=True)
class History:
    """One vehicle's states (N, 12) and controls (N, 4) of Eq. 1 at times (N,)."""

    sysid: int
    plan_hash: str
    t_s: Array
    states: Array
    controls: Array


def build_histories(plan: Plan, rate_hz: float, rows: slice = ALL_VEHICLES) -> list[History]:
    """The histories of the vehicles in `rows`, from take-off to landing: at t = k / rate_hz and at both ends."""
    ticks = np.arange(np.ceil(plan.t_start_s * rate_hz), np.floor(plan.t_end_s * rate_hz) + 1)
    inside = np.rint(ticks * _MS / rate_hz) / _MS
    t_s = np.unique(plan.clamped(np.concatenate([[plan.t_start_s], inside, [plan.t_end_s]])))
    states, controls = plan.motion(t_s, rows)
    states, controls = np.round(states, _STATE_DECIMALS) + 0.0, np.round(controls, _CONTROL_DECIMALS) + 0.0
    return [History(sysid, plan.hash, t_s, states[row], controls[row]) for row, sysid in enumerate(plan.sysids[rows])]


def write_history(history: History) -> bytes:
    """The bytes of a file."""
    columns = np.column_stack([history.t_s, history.states, history.controls])
    table = pa.table({name: columns[:, index] for index, name in enumerate(COLUMNS)})
    return write_csv(_TITLE, {"plan": history.plan_hash, "vehicle": str(history.sysid)}, COLUMNS, table)
