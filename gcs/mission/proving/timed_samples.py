"""CSV of timed samples: lines between them, or cubics where the velocities are there.

The names of columns say the frame and the unit. x, y and z have the frame that the caller states.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from gcs.errors import FileFormatError
from gcs.mission.formats.vehicle_curve import cubic, quintic
from gcs.mission.proving.csv_rows import TrackFile, in_ned
from gcs.mission.proving.track import PolynomialTrack
from gcs.types import Array

_VEHICLE = re.compile(
    r"(?:id|name|(?:vehicle|system|sys|drone|uav|robot|agent|crazyflie|cf|quad|quadrotor|quadcopter|aircraft|member)s?"
    r"[ _.-]*(?:id|name|no|nr|number|num|index|idx)?)"
)
_WAYS = {  # the axis in NED and the sign; x, y, z are of the stated frame
    **dict.fromkeys(("north", "n"), (0, 1.0)),
    **dict.fromkeys(("east", "e"), (1, 1.0)),
    **dict.fromkeys(("down", "d"), (2, 1.0)),
    **dict.fromkeys(("up", "u", "height"), (2, -1.0)),
}
_UNITS = {
    "time": {"": 1.0, "s": 1.0, "sec": 1.0, "ms": 1e-3, "msec": 1e-3},
    "place": {"": 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "velocity": {"": 1.0, "m/s": 1.0, "mps": 1.0},
}
_HEAD = re.compile(r"(.*?)\s*(?:_(s|sec|ms|msec|m|cm|mm|mps)|[\[(]\s*(.*?)\s*[\])])?")
_NEXT = "name columns t, x, y, z with --frame, or t, north, east, down (or up), and vehicle where there are several"


class _Column(NamedTuple):
    quantity: str
    axis: int
    factor: float
    lettered: bool  # x, y or z


@dataclass
class _Samples:
    """The samples of one vehicle so far."""

    lines: list[int] = field(default_factory=list)
    values: list[list[float]] = field(default_factory=list)


def are_samples(file: TrackFile) -> bool:
    """Whether the first row names the columns of samples: any table that no other format claims."""
    return True


def read_samples(file: TrackFile) -> tuple[list[PolynomialTrack], list[str]]:
    """The tracks of a file, and what was left out. Raises `FileFormatError` with file and line."""
    rows = file.rows()
    line, names = next(rows, (1, [""]))
    columns = [_column(file, line, name) for name in names]
    wanted = _wanted(file, line, columns)
    vehicle = next((index for index, name in enumerate(names) if _VEHICLE.fullmatch(name.lower())), None)
    fleet: dict[str, _Samples] = {}
    for number, cells in rows:
        if len(cells) != len(names):
            raise file.mistake(number, f"{len(cells)} columns, not {len(names)}", f"see line {line} for their names")
        samples = fleet.setdefault(file.stem if vehicle is None else cells[vehicle], _Samples())
        samples.lines.append(number)
        samples.values.append([file.number(cells[index], names[index], number) for index in wanted])
    if not fleet:
        raise FileFormatError(f"{file.source}: no samples.", hint=_NEXT)
    chosen = [column for index in wanted if (column := columns[index])]
    tracks = [PolynomialTrack(name, _interpolated(file, name, samples, chosen)) for name, samples in fleet.items()]
    left_out = [name for index, name in enumerate(names) if index not in wanted and index != vehicle and name]
    return tracks, left_out


def _column(file: TrackFile, line: int, name: str) -> _Column | None:
    """What a column holds; None of one that is left out."""
    found = _HEAD.fullmatch(name.lower())
    assert found
    base, unit = found[1], found[2] or found[3] or ""
    if base in ("t", "time"):
        quantity, axis, sign = "time", 0, 1.0
    else:
        speed = re.fullmatch(r"v(?:el(?:ocity)?)?_?([a-z]+)|([a-z]+)_?v(?:el(?:ocity)?)?", base)
        way = (speed[1] or speed[2]) if speed else base
        quantity = "velocity" if speed and (way in _WAYS or way in ("x", "y", "z")) else "place"
        if way in ("x", "y", "z"):
            axis, sign = "xyz".index(way), 1.0
        elif way in _WAYS:
            axis, sign = _WAYS[way]
        else:
            return None
    if unit not in _UNITS[quantity]:
        known = ", ".join(filter(None, _UNITS[quantity]))
        raise file.mistake(line, f"the column '{name[:40]}' is in '{unit[:20]}'", f"give one of {known}")
    return _Column(quantity, axis, sign * _UNITS[quantity][unit], base[-1:] in "xyz" and quantity != "time")


def _wanted(file: TrackFile, line: int, columns: list[_Column | None]) -> list[int]:
    """Where time, the places of three axes and, if they are there, the velocities stand."""
    found: dict[tuple[str, int], int] = {}
    for index, column in enumerate(columns):
        if column is None:
            continue
        key = (column.quantity, column.axis)
        if key in found:
            raise file.mistake(line, f"two columns hold the {column.quantity} of one axis", "remove one of them")
        found[key] = index
    needed = [("time", 0), *(("place", axis) for axis in range(3))]
    if missing := [key for key in needed if key not in found]:
        what = "the time" if missing[0][0] == "time" else "a place in three axes"
        raise file.mistake(line, f"the columns do not hold {what}", _NEXT)
    speeds = [("velocity", axis) for axis in range(3)]
    has = [key in found for key in speeds]
    if any(has) and not all(has):
        raise file.mistake(line, "the velocity is not given in all three axes", "add the others, or remove it")
    wanted = [found[key] for key in [*needed, *(speeds if all(has) else [])]]
    lettered = {column.lettered for index in wanted if (column := columns[index]) and column.quantity != "time"}
    if len(lettered) > 1:
        raise file.mistake(line, "x, y, z stand beside north, east, down", "name all columns one way")
    if True in lettered and file.frame is None:
        raise file.mistake(line, "x, y and z do not say their frame", "give --frame enu (z up) or --frame ned (z down)")
    return wanted


def _interpolated(file: TrackFile, name: str, samples: _Samples, columns: list[_Column]) -> PPoly:
    """Lines through the samples of one vehicle, or cubics through places and velocities."""
    values = np.array(samples.values) * [column.factor for column in columns]
    t_s, vectors = values[:, 0], values[:, 1:].reshape(len(values), -1, 3)
    if (back := np.flatnonzero(np.diff(t_s) <= 0.0)).size:
        line, late = samples.lines[back[0] + 1], t_s[back[0] + 1]
        raise file.mistake(line, f"the time of {name} goes from {t_s[back[0]]:g} s to {late:g} s", "sort by time")
    if len(t_s) < 2:
        raise file.mistake(samples.lines[0], f"{name} has one sample only", "give two or more")
    if columns[1].lettered:
        vectors = in_ned(vectors, file.frame or "ned")
    return through(t_s, *(vectors[:, order] for order in range(vectors.shape[1])))


def through(t_s: Array, place: Array, velocity: Array | None = None, acceleration: Array | None = None) -> PPoly:
    """The polynomials of degree 1, 3 or 5 through places (N, 3) at times (N,), and velocities and accelerations."""
    length_s = np.diff(t_s)
    if velocity is None:
        c = np.stack([place[:-1], np.diff(place, axis=0) / length_s[:, None]])
    elif acceleration is None:
        c = cubic(length_s, place, velocity)
    else:
        c = quintic(length_s, place, velocity, acceleration)
    return PPoly(c[::-1].copy(), t_s)
