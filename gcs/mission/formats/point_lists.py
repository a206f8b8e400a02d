"""MAVProxy's own lists of points: a fence as lines of latitude and longitude, and rally points as RALLY lines.

The first line of a fence is the return point. The others are the vertices of one inclusion polygon, and the last line
repeats the first vertex. A RALLY line holds latitude, longitude, altitude above home, break altitude, landing direction
and flags.
"""

import math
import re
from collections.abc import Iterator

from gcs.errors import FileFormatError
from gcs.mission.formats.vendor_quirks import Quirk, QuirkKind, QuirkList, decoded, significant_lines
from gcs.mission.geofence import LEAST_VERTICES, FencePolygon, Geofence, GeoPoint, RallyPoint

_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_FENCE = re.compile(rf"\s*{_NUMBER}\s+{_NUMBER}\s*")
_RALLY = re.compile(r"\s*RALLY\s.*", re.IGNORECASE)
_RALLY_COLUMNS = 7
_FRAME_GIVEN, _FRAME_SHIFT, _ABOVE_HOME = 4, 3, 1  # in RALLY_FLAGS: bits 3 and 4 are an altitude frame


def begins_fence(line: str) -> bool:
    """Whether a file with this first line is a list of fence points."""
    return _FENCE.fullmatch(line) is not None


def begins_rally(line: str) -> bool:
    """Whether a file with this first line is a list of rally points."""
    return _RALLY.fullmatch(line) is not None


def numbered_points(text: str | bytes, source: str) -> list[tuple[int, GeoPoint]]:
    """The points of a list with their lines. Raises `FileFormatError` with file, line and reason."""
    return [(number, _point(cells, source, number)) for number, cells in _rows(text, source, QuirkList(source), 2)]


def read_fence_list(text: str | bytes, source: str) -> tuple[Geofence, tuple[Quirk, ...]]:
    """The fence in a list of points. Raises `FileFormatError` with file, line and reason."""
    quirks = QuirkList(source)
    points = [(number, _point(cells, source, number)) for number, cells in _rows(text, source, quirks, 2)]
    if len(points) < LEAST_VERTICES + 2:
        raise FileFormatError(
            f"{source}: {len(points)} points; a fence has a return point, {LEAST_VERTICES} vertices or more, and the "
            "first vertex again."
        )
    (first, back), (_, start), *_, (last, end) = points
    if end != start:
        message = f"{source}, line {last}: the last point does not repeat the first vertex, line {points[1][0]}."
        raise FileFormatError(message, hint="repeat it: MAVProxy drops the last point")
    quirks.add(QuirkKind.RETURN, "the return point has no altitude: read as 0 m above home", first)
    polygon = FencePolygon(tuple(point for _, point in points[1:-1]), inclusion=True)
    return Geofence((polygon,), (), RallyPoint(back, 0.0)), quirks.found()


def read_rally_list(text: str | bytes, source: str) -> tuple[tuple[RallyPoint, ...], tuple[Quirk, ...]]:
    """The rally points in a list. Raises `FileFormatError` with file, line and reason."""
    quirks = QuirkList(source)
    points = []
    for number, cells in _rows(text, source, quirks, _RALLY_COLUMNS):
        if cells[0].upper() != "RALLY":
            raise FileFormatError(f"{source}, line {number}: expected RALLY, got '{cells[0][:40]}'.")
        place = _point(cells[1:3], source, number)
        alt_m, break_alt_m, direction_deg, flags = (_number(cell, source, number) for cell in cells[3:])
        if not (flags.is_integer() and 0 <= flags <= 0xFF):
            raise FileFormatError(f"{source}, line {number}: flags must be an integer from 0 to 255, got {flags:g}.")
        frame = round(flags) >> _FRAME_SHIFT & 3
        if round(flags) & _FRAME_GIVEN and frame != _ABOVE_HOME:
            raise FileFormatError(
                f"{source}, line {number}: flags {flags:.0f} give an altitude in frame {frame}, not above home (1).",
                hint="write the altitude above home",
            )
        if break_alt_m or direction_deg or flags:
            text_of = f"{break_alt_m:g} m, {direction_deg:g} degrees, {flags:.0f}"
            quirks.add(QuirkKind.RALLY, f"break altitude, landing direction and flags are ignored: {text_of}", number)
        points.append(RallyPoint(place, alt_m))
    if not points:
        raise FileFormatError(f"{source}: no RALLY line.")
    return tuple(points), quirks.found()


def _rows(text: str | bytes, source: str, quirks: QuirkList, count: int) -> Iterator[tuple[int, list[str]]]:
    for number, body in significant_lines(decoded(text, source), quirks):
        cells = body.split()
        if len(cells) != count:
            raise FileFormatError(f"{source}, line {number}: {len(cells)} columns instead of {count}.")
        yield number, cells


def _point(cells: list[str], source: str, number: int) -> GeoPoint:
    lat_deg, lon_deg = (_number(cell, source, number) for cell in cells)
    if abs(lat_deg) > 90 or abs(lon_deg) > 180:
        raise FileFormatError(f"{source}, line {number}: latitude {lat_deg}, longitude {lon_deg} is not on Earth.")
    return GeoPoint.at(lat_deg, lon_deg)


def _number(cell: str, source: str, number: int) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FileFormatError(f"{source}, line {number}: expected a number, got '{cell[:40]}'.")
    return value
