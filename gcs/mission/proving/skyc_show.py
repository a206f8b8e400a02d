"""Reads shows of Skybrush (.skyc): an archive with `show.json` and a chain of Bézier curves for each vehicle.

A point of a trajectory is [t, [x, y, z], [control points of the curve that ends here]]; times count from the start of
the show in seconds, places are metres along the show's axis, to its left, and up. Light programs, yaw and cues are left
out. The layout was read from programs that write such files: their publisher has no document of it.
"""

from __future__ import annotations

import io
import math
import sys
from collections.abc import Sequence
from urllib.parse import unquote

import numpy as np
from scipy.interpolate import PPoly

from gcs.errors import FileFormatError
from gcs.mission.proving.csv_rows import ROWS_MAX, TrackFile, in_ned
from gcs.mission.proving.track import PolynomialTrack
from gcs.types import Array
from gcs.util.archives import BadArchive, read_members
from gcs.util.bounded_file import MIB, read_json

SHOW = "show.json"
_AXES = "nwu"
_MEMBERS_MAX = 20_000
_MEMBER_BYTES, _ALL_BYTES = 64 * MIB, 512 * MIB
_DEGREE_MAX = 15
_LARGEST = sys.float_info.max
_HINT = "export the show again, with its trajectories"


def is_show(file: TrackFile) -> bool:
    """Whether a file is an archive."""
    return file.data.startswith(b"PK")


def read_show(file: TrackFile) -> tuple[list[PolynomialTrack], list[str]]:
    """The tracks of a show, and what was left out. Raises `FileFormatError` with the vehicle and the point."""

    def wanted(name: str) -> bool:
        return name.endswith(".json") and not name.endswith(("lights.json", "cues.json"))

    try:
        members = read_members(
            io.BytesIO(file.data), wanted, largest_bytes=_MEMBER_BYTES, all_bytes=_ALL_BYTES, most=_MEMBERS_MAX
        )
    except BadArchive as problem:
        raise FileFormatError(f"{file.source}: {problem}.", hint=_HINT) from problem
    if SHOW not in members:
        raise FileFormatError(
            f"{file.source}: the archive holds no {SHOW}.",
            hint="give a .skyc file of Skybrush; a plan is proved by `gcs verify`",
        )
    drones = _at(_json(members[SHOW], f"{file.source}, {SHOW}"), ("swarm", "drones"))
    if not isinstance(drones, list) or not drones:
        raise FileFormatError(f"{file.source}, {SHOW}: it has no list swarm.drones.", hint=_HINT)
    tracks, late_s = [], set()
    left_out = {"lights", "cues"}
    names = _names(drones)
    for name, drone in zip(names, drones, strict=True):
        where = f"{file.source}, {name}"
        path = _at(drone, ("settings", "trajectory"))
        if isinstance(path, dict) and isinstance(path.get("$ref"), str):
            member = unquote(path["$ref"]).partition("#")[0].removeprefix("./")
            if member not in members:
                raise FileFormatError(f"{where}: the archive has no {member[:80]}.", hint=_HINT)
            path = _json(members[member], f"{file.source}, {member}")
        points = _at(path, ("points",))
        if not isinstance(points, list) or len(points) < 2:
            raise FileFormatError(f"{where}: its trajectory has no two points.", hint=_HINT)
        late_s.add(_numbers([_at(path, ("takeoffTime",)) or 0.0], 1, f"{where}, takeoffTime")[0])
        t_s, curves, turns = _curves(points, where)
        left_out |= {"yaw"} if turns else set()
        tracks.append(PolynomialTrack(name, _polynomials(t_s, curves, file.frame or _AXES)))
    if len(late_s) > 1:
        # Programs disagree whether a point's time counts from the show's start or from the vehicle's take-off.
        what = "its vehicles have different takeoffTime: times of points may count from the take-off of each"
        raise FileFormatError(f"{file.source}: {what}.", hint="export the show with one start of time for all")
    return tracks, sorted(left_out)


def _names(drones: Sequence[object]) -> list[str]:
    """The name of each vehicle, or its number where names are missing or doubled."""
    names = [str(_at(drone, ("settings", "name")) or "")[:60] for drone in drones]
    return names if all(names) and len(set(names)) == len(names) else [f"drone {n + 1}" for n in range(len(names))]


def _json(data: bytes, where: str) -> object:
    try:
        return read_json(data)
    except ValueError as problem:
        raise FileFormatError(f"{where}: {problem}.", hint=_HINT) from problem


def _at(value: object, keys: tuple[str, ...]) -> object:
    """A value inside nested objects; None where one lacks it."""
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value


def _curves(points: Sequence[object], where: str) -> tuple[Array, list[Array], bool]:
    """The times (N,) of points, the control points (D + 1, 3) of each curve with both ends, and whether yaw turns."""
    if len(points) > ROWS_MAX:
        raise FileFormatError(f"{where}: more than {ROWS_MAX:,} points.", hint="give fewer")
    times: list[float] = []
    curves: list[Array] = []
    turns = False
    last: Array | None = None
    for number, point in enumerate(points, start=1):
        at = f"{where}, point {number}"
        if not isinstance(point, list) or len(point) not in (2, 3):
            raise FileFormatError(f"{at}: it is not [time, place, control points].", hint=_HINT)
        time, place = _numbers([point[0]], 1, at)[0], _numbers(point[1], 3, at)
        turns |= len(place) > 3 and place[3] != 0.0
        inner = point[2] if len(point) == 3 else []
        if not isinstance(inner, list) or len(inner) >= _DEGREE_MAX:
            raise FileFormatError(f"{at}: its control points are no list of up to {_DEGREE_MAX - 1}.", hint=_HINT)
        if times and time <= times[-1]:
            raise FileFormatError(f"{at}: the time goes from {times[-1]:g} s to {time:g} s.", hint="sort by time")
        end = np.array(place[:3])
        if last is not None:
            between = [np.array(_numbers(each, 3, at)[:3]) for each in inner]
            curves.append(np.array([last, *between, end]))
        times.append(time)
        last = end
    return np.array(times), curves, turns


def _numbers(values: object, least: int, where: str) -> list[float]:
    """Finite numbers, `least` of them or more."""
    if isinstance(values, list) and least <= len(values) <= 4:
        given = [value for value in values if isinstance(value, int | float) and not isinstance(value, bool)]
        if len(given) == len(values) and all(abs(value) <= _LARGEST for value in given):
            return [float(value) for value in given]
    raise FileFormatError(f"{where}: a time or a place is not of finite numbers.", hint=_HINT)


def _polynomials(t_s: Array, curves: Sequence[Array], frame: str) -> PPoly:
    """The curves in powers of the time since their start: a_j = C(n, j) (the j-th difference of the points)."""
    top = max(len(curve) for curve in curves)
    c = np.zeros((top, len(curves), 3))
    for degree in sorted({len(curve) - 1 for curve in curves}):
        rows = [row for row, curve in enumerate(curves) if len(curve) == degree + 1]
        points = in_ned(np.array([curves[row] for row in rows]), frame)
        length_s = np.diff(t_s)[rows, None]
        for power in range(degree + 1):
            difference = np.diff(points, n=power, axis=1)[:, 0]
            c[top - 1 - power, rows] = math.comb(degree, power) * difference / length_s**power
    return PPoly(c, t_s)
