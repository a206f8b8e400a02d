"""The flight record: reported beside planned states at the same times, as one table (Parquet).

It is made from the `.tlog`, so that an interrupted flight has a record too. `FlightReports` has its columns as arrays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from gcs.autopilots.columns import LandingProfile
from gcs.autopilots.local_frame import local_frame
from gcs.autopilots.parameter_names import in_units_of, spellings
from gcs.autopilots.traits import traits_of
from gcs.errors import FileFormatError
from gcs.flight.monitoring.expected_motion import ExpectedMotion, landing_profiles
from gcs.flight.monitoring.progress import PlanTime
from gcs.flight.recording.tlog import LoggedFrame, scan
from gcs.link.protocols.clock import VehicleClock
from gcs.link.wire.message import Message, is_autopilots_beat, local_motion
from gcs.mavlink import ModeFlag
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.navigation_error import NavigationError, navigation_error
from gcs.scenario.values.si import local_origin
from gcs.types import Array
from gcs.util.bounded_file import MIB, RECORD_FILE, read_file
from gcs.util.bounded_parquet import open_parquet

_SIGMAS = 3.0
_FIX_3D = 3
_RATIOS = {
    "EKF_STATUS_REPORT": ("pos_horiz_variance", "pos_vert_variance"),
    "ESTIMATOR_STATUS": ("pos_horiz_ratio", "pos_vert_ratio"),
}


class ReportedAccuracy:
    """The accuracy of one vehicle's reports, as last reported; that of `unknown` where the receiver reports none."""

    def __init__(self, unknown: NavigationError) -> None:
        self._unknown = (unknown.horizontal_m, unknown.vertical_m)
        self._has_fix = True
        self._receiver_m = (0.0, 0.0)  # 1 sigma, horizontal and vertical; 0: not told
        self._estimator_m = (0.0, 0.0)
        self._ratios = (0.0, 0.0)

    def receive(self, message: Message) -> None:
        """Take in a message of the vehicle."""
        fields = message.fields
        if message.name == "GPS_RAW_INT":
            self._has_fix = fields["fix_type"] >= _FIX_3D
            self._receiver_m = fields.get("h_acc", 0) / 1e3, fields.get("v_acc", 0) / 1e3
        if message.name == "ESTIMATOR_STATUS":
            self._estimator_m = _finite(fields["pos_horiz_accuracy"]), _finite(fields["pos_vert_accuracy"])
        if message.name in _RATIOS:
            self._ratios = _finite(fields[_RATIOS[message.name][0]]), _finite(fields[_RATIOS[message.name][1]])

    @property
    def within_m(self) -> tuple[float, float]:
        """The horizontal and the vertical distance; infinite without a fix, or with a receiver that is ignored."""
        if not self._has_fix and not self._estimator_m[0]:
            return math.inf, math.inf
        horizontal_m, vertical_m = (
            math.inf
            if ratio >= 1.0
            else (1.0 + ratio) * (_SIGMAS * max(reported_m, estimated_m) if reported_m or estimated_m else unknown_m)
            for reported_m, estimated_m, unknown_m, ratio in zip(
                self._receiver_m, self._estimator_m, self._unknown, self._ratios, strict=True
            )
        )
        return horizontal_m, vertical_m


def _finite(value: float) -> float:
    return float(value) if math.isfinite(value) else 0.0


NAME = "record.parquet"
_LONG_BYTES = 2 * MIB
Row = tuple[float, int, float, float, float, float, float, float, bool, int, int, int, float, float]
WITHIN = ("horizontal_within_m", "vertical_within_m")
_STEP_S = 0.1
_CLOCK_S = 0.02  # a vehicle's clock is corrected in such steps
_BAROMETER_SHARE = 0.05  # of the height: what air 15 K warmer or colder than a barometer assumes makes of it
_AXES = ("north", "east", "down")
_NEEDED = {form.format(axis) for form in ("{}_m", "v_{}_mps") for axis in _AXES} | {
    *("t_s", "sysid", "armed", "mode", "battery_pct")
}


def reported_profiles(messages: Iterable[Message], vehicle_of: Mapping[int, int]) -> dict[int, LandingProfile]:
    """Return the landing profiles of vehicles, `vehicle_of` by MAVLink system id.

    Parameters count until a vehicle is in its landing mode: after the flight they may be restored.
    """
    autopilots: dict[int, int] = {}
    values: dict[int, dict[str, float]] = {}
    landing: set[int] = set()
    for message in messages:
        sysid = vehicle_of.get(message.sysid)
        if sysid is None:
            continue
        fields = message.fields
        if is_autopilots_beat(message):
            autopilots[sysid] = int(fields["autopilot"])
            row = traits_of(autopilots[sysid])
            if row is not None and int(fields["custom_mode"]) == row.flight.land:
                landing.add(sysid)
        elif message.name == "PARAM_VALUE" and sysid not in landing:
            values.setdefault(sysid, {})[str(fields["param_id"])] = float(fields["param_value"])
    known = {sysid: _by_old_names(autopilot, values.get(sysid, {})) for sysid, autopilot in autopilots.items()}
    return landing_profiles(autopilots, known)


def _by_old_names(autopilot: int, values: Mapping[str, float]) -> dict[str, float]:
    row = traits_of(autopilot)
    found = {}
    for wanted in row.landing.parameters if row is not None else ():
        for name in spellings(autopilot, wanted):
            if name in values:
                found[wanted] = float(in_units_of(autopilot, wanted, name, values[name]))
    return found


def build_record(
    plan: Plan, plan_time: PlanTime, messages: Iterable[Message], systems: Mapping[int, int] | None = None
) -> pa.Table:
    """Return one row for every position that a vehicle reported once its time was known.

    Columns: t_s (plan time), unix_s (the vehicles' common time), sysid, north/east/down_m, v_..._mps, planned_..._m,
    planned_v_..._mps, error_m, armed, mode, battery_pct (-1: not reported), autopilot, formation_error_m (Definition 1
    at that time, of all vehicles; NaN after the last report of one of them), horizontal_within_m and vertical_within_m
    (how far the true position may be, 3 sigma, by what the vehicle told of its receiver, estimator and clock; in height
    also 5 % of the reported height, which barometers get wrong in air that is warm or cold). Common local NED frame.
    In the landing the planned columns are the descent that the vehicle's autopilot flies by itself, to the ground.
    `systems` are the MAVLink systems of vehicles with another system id than in the plan.
    """
    kept: list[Message] = []  # of all others only a row is kept: a log may have millions
    vehicle_of = {(systems or {}).get(sysid, sysid): sysid for sysid in plan.sysids}
    clocks = {sysid: VehicleClock() for sysid in plan.sysids}
    modes = dict.fromkeys(plan.sysids, (False, 0))
    autopilots = dict.fromkeys(plan.sysids, 0)
    battery = dict.fromkeys(plan.sysids, -1)
    components: dict[int, int] = {}  # that of each autopilot: a camera's clock, or its place, is not the vehicle's
    accuracies = {sysid: ReportedAccuracy(navigation_error(plan.scenario)) for sysid in plan.sysids}
    rows: list[Row] = []
    for n, message in enumerate(messages):
        sysid = vehicle_of.get(message.sysid)
        if sysid is None:
            continue
        beats = is_autopilots_beat(message)
        if message.compid != (components.setdefault(sysid, message.compid) if beats else components.get(sysid, 1)):
            continue
        if message.name in ("HEARTBEAT", "PARAM_VALUE"):
            kept.append(message)
        clocks[sysid].receive(message, float(n))
        accuracies[sysid].receive(message)
        fields = message.fields
        if beats:
            autopilots[sysid] = int(fields["autopilot"])
            modes[sysid] = bool(fields["base_mode"] & ModeFlag.ARMED), int(fields["custom_mode"])
            if modes[sysid][0]:
                clocks[sysid].hold()  # as in flight: a jump of GNSS time is not followed
        elif message.name == "SYS_STATUS":
            battery[sysid] = int(fields["battery_remaining"])
        elif message.name == "LOCAL_POSITION_NED":
            unix_s, motion = clocks[sysid].unix_s(fields["time_boot_ms"]), local_motion(message)
            if unix_s is not None and motion is not None:
                off_s = abs(clocks[sysid].gnss_off_s) + _CLOCK_S
                beside_m, above_m = accuracies[sysid].within_m
                above_m += _BAROMETER_SHARE * abs(motion[2])
                within_m = beside_m + off_s * math.hypot(*motion[3:5]), above_m + off_s * abs(motion[5])
                rows.append((unix_s, sysid, *motion, *modes[sysid], battery[sysid], autopilots[sysid], *within_m))
    return _table(ExpectedMotion(plan, reported_profiles(kept, vehicle_of)), plan_time, rows)


def telemetry_logs(folder: Path) -> list[Path]:
    """Return the logs of a flight's folder, oldest first by the vehicles' time: its own, and one of every `attach`."""
    logs = sorted(folder.glob("telemetry*.tlog"), key=lambda path: (len(path.name), path.name))
    frames = {log: (one for one in scan(log) if isinstance(one, LoggedFrame)) for log in logs}
    return sorted(logs, key=lambda log: next((one.stamp_us for one in frames[log] if one.stamp_us), 0))


def write_record(
    folder: Path,
    plan: Plan,
    plan_time: PlanTime,
    systems: Mapping[int, int] | None = None,
    say: Callable[[str], None] | None = None,
) -> pa.Table:
    """Make the record of a flight's folder from its telemetry, write it there and return it.

    Damaged parts of the telemetry are left out. `say` is told of telemetry that takes seconds to read.
    """
    logs = telemetry_logs(folder)
    if say is not None and (size := sum(log.stat().st_size for log in logs)) > _LONG_BYTES:
        say(f"reading {size / MIB:.0f} MiB of telemetry")
    frames = (one for path in logs for one in scan(path) if isinstance(one, LoggedFrame))
    messages = (frame.message for frame in frames if frame.message is not None)
    table = build_record(plan, plan_time, messages, systems)
    pq.write_table(table, folder / NAME, compression="zstd")
    return table


def _formation_error_m(plan: Plan, t_s: Array, sysids: NDArray[np.int64], places_ned_m: Array) -> Array:
    """Definition 1 (N,) at the times and positions (N,), (N, 3) of rows; computed every 0.1 s and interpolated."""
    if len(t_s) == 0 or len(set(plan.sysids) - set(sysids.tolist())):
        return np.full(len(t_s), np.nan)
    begin_s, end_s = max(float(t_s.min()), plan.t_start_s), min(float(t_s.max()), plan.t_end_s)
    grid_s = np.arange(begin_s, end_s, _STEP_S)
    if len(grid_s) == 0:
        return np.full(len(t_s), np.nan)
    places = np.empty((len(plan.sysids), len(grid_s), 3))
    for row, sysid in enumerate(plan.sysids):
        mine = np.flatnonzero(sysids == sysid)
        mine = mine[np.argsort(t_s[mine], kind="stable")]
        for n in range(3):
            places[row, :, n] = np.interp(grid_s, t_s[mine], places_ned_m[mine, n], left=np.nan, right=np.nan)
    error = plan.formation_error_m(grid_s, places)
    return np.asarray(np.interp(t_s, grid_s, error, left=np.nan, right=np.nan))


def _table(expected: ExpectedMotion, plan_time: PlanTime, rows: list[Row]) -> pa.Table:
    plan = expected.plan
    columns = list(zip(*rows, strict=True)) or [()] * 14
    unix_s, sysids = np.array(columns[0], dtype=np.float64), np.array(columns[1], dtype=np.int64)
    autopilots, origin = np.array(columns[11], dtype=np.int64), local_origin(plan.scenario)
    t_s = plan_time.t_s(unix_s)
    reported = np.array(columns[2:8], dtype=np.float64).reshape(6, -1).T
    planned = np.full((len(t_s), 6), np.nan)
    for row, sysid in enumerate(plan.sysids):
        mine = sysids == sysid
        if mine.any():
            frame = local_frame(int(autopilots[mine][-1]), origin, plan.pads_ned_m[row])
            reported[mine] = np.hstack([frame.common_ned_m(reported[mine, :3]), reported[mine, 3:] / frame.counts])
            motion = expected.of_vehicle(row, t_s[mine])
            planned[mine] = np.where(expected.covers(row, t_s[mine])[:, None], motion, np.nan)
    data: dict[str, object] = {"t_s": t_s, "unix_s": unix_s, "sysid": sysids}
    for name, values in (("", reported), ("planned_", planned)):
        data |= {f"{name}{axis}_m": values[:, n] for n, axis in enumerate(_AXES)}
        data |= {f"{name}v_{axis}_mps": values[:, 3 + n] for n, axis in enumerate(_AXES)}
    data["error_m"] = np.linalg.norm(reported[:, :3] - planned[:, :3], axis=1)
    data["formation_error_m"] = _formation_error_m(plan, t_s, sysids, reported[:, :3])
    data["armed"] = np.array(columns[8], dtype=bool)
    for n, name in enumerate(("mode", "battery_pct", "autopilot"), start=9):
        data[name] = np.array(columns[n], dtype=np.int64)
    data |= {name: np.array(columns[n], dtype=np.float64) for n, name in enumerate(WITHIN, start=12)}
    return pa.table(data)


@dataclass(frozen=True)
class FlightReports:
    """Every position that vehicles reported, in order of arrival; (N,) rows. `of(sysid)` has one vehicle's alone."""

    table: pa.Table  # all columns, by the names of docs/formats.md

    @cached_property
    def sysids(self) -> tuple[int, ...]:
        """The vehicles with a row."""
        return tuple(sorted(set(self.sysid.tolist())))

    @property
    def sysid(self) -> NDArray[np.int64]:
        """The vehicle of each row (N,)."""
        return np.asarray(self.column("sysid"), dtype=np.int64)

    @property
    def t_s(self) -> Array:
        """Plan times (N,)."""
        return self.column("t_s")

    @property
    def position_ned_m(self) -> Array:
        """Reported positions (N, 3) in the formation's common frame."""
        return self._axes("{}_m")

    @property
    def velocity_ned_mps(self) -> Array:
        """Reported velocities (N, 3)."""
        return self._axes("v_{}_mps")

    @property
    def planned_position_ned_m(self) -> Array:
        """Planned positions (N, 3); NaN before and after the plan."""
        return self._axes("planned_{}_m")

    @property
    def planned_velocity_ned_mps(self) -> Array:
        """Planned velocities (N, 3); NaN before and after the plan."""
        return self._axes("planned_v_{}_mps")

    @property
    def error_m(self) -> Array:
        """Distances (N,) between reported and planned positions."""
        return self.column("error_m")

    @property
    def formation_error_m(self) -> Array:
        """The formation error (N,), Definition 1."""
        return self.column("formation_error_m")

    def of(self, sysid: int) -> FlightReports:
        """Return the rows of one vehicle. Raises KeyError for one without any."""
        if sysid not in self.sysids:
            raise KeyError(f"vehicle {sysid} has no row; those with one are {', '.join(map(str, self.sysids))}")
        return FlightReports(self.table.filter(pa.array(self.sysid == sysid)))

    def column(self, name: str) -> Array:
        """Return a column (N,) by its name. Raises KeyError."""
        if name not in self.table.column_names:
            raise KeyError(f"{name!r} is no column; there are {', '.join(self.table.column_names)}")
        return np.asarray(self.table[name].to_numpy())

    def _axes(self, form: str) -> Array:
        return np.column_stack([self.column(form.format(axis)) for axis in _AXES])


def load_record(flight: Path | str) -> FlightReports:
    """Return the record of a flight: of its folder, or a `record.parquet`. Raises FileFormatError."""
    path = Path(flight)
    return FlightReports(read_record(path / NAME if path.is_dir() else path, "write it with `gcs report FOLDER`"))


def read_record(path: Path, hint: str) -> pa.Table:
    """Return the columns of a `record.parquet`. Raises FileFormatError with the hint."""
    try:
        table = open_parquet(read_file(path, RECORD_FILE, hint=hint)).read()
        if lacking := sorted(_NEEDED - set(table.column_names)):
            raise ValueError(f"no column {lacking[0]}")
        if wrong := [name for name in sorted(_NEEDED) if not _is_number(table.schema.field(name).type)]:
            raise ValueError(f"column {wrong[0]} holds no numbers")
    except (OSError, ValueError, pa.ArrowException) as problem:
        reason = str(problem).splitlines()[0][:200] if str(problem) else type(problem).__name__
        raise FileFormatError(f"{path} cannot be read: {reason}.", hint=hint) from None
    return table


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind))
