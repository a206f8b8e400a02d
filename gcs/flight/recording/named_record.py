"""`record.parquet` by name: what each vehicle of a flight reported, beside what was planned."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gcs.errors import FileFormatError
from gcs.flight.recording.record_table import NAME
from gcs.physics.quadrotor import Array
from gcs.reading.bounded_file import RECORD_FILE, read_file
from gcs.reading.bounded_parquet import open_parquet

_AXES = ("north", "east", "down")
_NEEDED = {form.format(axis) for form in ("{}_m", "v_{}_mps") for axis in _AXES} | {
    *("t_s", "sysid", "armed", "mode", "battery_pct")
}


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
