"""Reads CSV of polynomial pieces, as uav_trajectories writes and Crazyswarm flies them.

A row holds a duration, then 8 coefficients for each of x, y, z and yaw, the lowest power first. Their frame is x east,
y north, z up, unless the caller states another.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly

from gcs.errors import FileFormatError
from gcs.mission.proving.csv_rows import TrackFile, in_ned, is_number
from gcs.mission.proving.track import PolynomialTrack

_COEFFICIENTS = 8
_COLUMNS = 1 + 4 * _COEFFICIENTS


def are_pieces(file: TrackFile) -> bool:
    """Whether the first row names a duration, or holds as many numbers as a piece."""
    _, cells = next(file.rows(), (0, [""]))
    return cells[0].lower().startswith("duration") or (len(cells) == _COLUMNS and all(map(is_number, cells)))


def read_pieces(file: TrackFile) -> tuple[list[PolynomialTrack], list[str]]:
    """The one track of a file, and what was left out. Raises `FileFormatError` with file and line."""
    rows = []
    for order, (line, cells) in enumerate(file.rows()):
        if order == 0 and not is_number(cells[0]):
            continue
        if len(cells) != _COLUMNS:
            text = f"{len(cells)} columns, not {_COLUMNS}"
            raise file.mistake(line, text, "give the duration, then 8 coefficients each of x, y, z and yaw")
        values = [file.number(cell, f"column {column}", line) for column, cell in enumerate(cells, start=1)]
        if values[0] <= 0.0:
            raise file.mistake(line, f"the duration is {values[0]:g} s", "give a time above 0, or leave out the piece")
        rows.append(values)
    if not rows:
        raise FileFormatError(f"{file.source}: no pieces.", hint="give a row for each piece")
    table = np.array(rows)
    x = np.concatenate([[0.0], np.cumsum(table[:, 0])])
    places = table[:, 1 : 1 + 3 * _COEFFICIENTS].reshape(-1, 3, _COEFFICIENTS)
    c = in_ned(np.moveaxis(places, 1, 2), file.frame or "enu")
    used = max(int(np.flatnonzero(c.any(axis=(0, 2))).max(initial=0)) + 1, 3)
    track = PolynomialTrack(file.stem, PPoly(np.moveaxis(c[:, :used], 1, 0)[::-1].copy(), x))
    return [track], ["yaw"] if table[:, 1 + 3 * _COEFFICIENTS :].any() else []
