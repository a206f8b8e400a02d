"""The pieces of one line: segments of a track, parts of a multi-geometry.

Pieces that touch are one line, also where a GIS stored them in another order or direction. A receiver's pauses are
bridged up to a length. Nothing is bridged without a sentence.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.frames import Origin, geodetic_to_ned
from gcs.mission.drawings.drawing import DrawnPoint
from gcs.mission.drawings.labels import Label, LeftOut
from gcs.types import Array

_TOUCH_M, _PAUSE_M = 5.0, 100.0  # the widest gap of a drawn and of a recorded line
_SAME_M = 0.3


@dataclass(frozen=True)
class LinePiece:
    """Points in order, at least one. `label` names them in sentences."""

    label: Label
    points: tuple[DrawnPoint, ...]


@dataclass
class _Chain:
    """A line that grows at both ends: its points, and where it begins and ends, m."""

    points: list[DrawnPoint]
    ends_m: list[Array]
    labels: list[Label]  # of the pieces at its two ends


def joined(pieces: Sequence[LinePiece], *, recorded: bool = False) -> tuple[LinePiece, list[LeftOut]]:
    """The first piece with all that touch it, and sentences about gaps, turned pieces and those that lie apart.

    Pieces of a recorded line are joined in their own order only: it is that of time.
    """
    origin = Origin(*pieces[0].points[0].place, 0.0)
    lat, lon = np.array([[piece.points[end].place for end in (0, -1)] for piece in pieces]).transpose(2, 0, 1)
    ends_m = geodetic_to_ned(lat, lon, 0.0, origin)  # (pieces, 2, 3)
    chain = _Chain(list(pieces[0].points), [*ends_m[0]], [pieces[0].label] * 2)
    waiting, said = list(range(1, len(pieces))), []
    widest_m = _PAUSE_M if recorded else _TOUCH_M
    while waiting:
        at, row, turned, gap_m = _next(chain, ends_m[waiting], widest_m, in_order=recorded)
        if gap_m > widest_m:
            break
        number = waiting.pop(row)
        said += _joined(chain, pieces[number], at, turned, gap_m, out_of_order=bool(row) or at == 0)
        chain.ends_m[at] = ends_m[number, 0 if turned == (at == 1) else 1]
    for number in waiting:
        away_m = float(np.linalg.norm(ends_m[number, 0] - chain.ends_m[1]))
        text = (
            f"not flown: it begins {away_m:.0f} m from the end of {chain.labels[1]}; a file per route carries it over"
        )
        said.append(LeftOut(pieces[number].label, text))
    return LinePiece(pieces[0].label, tuple(chain.points)), said


def _next(chain: _Chain, ends_m: Array, widest_m: float, *, in_order: bool) -> tuple[int, int, bool, float]:
    """The end of the chain that grows (1: its end), the row of the next piece, whether it is turned, and the gap."""
    gaps_m = [np.linalg.norm(ends_m - end_m, axis=2) for end_m in chain.ends_m]
    if in_order or gaps_m[1][0, 0] <= widest_m:
        return 1, 0, False, float(gaps_m[1][0, 0])
    found = []
    for at in (1, 0):
        row, side = (int(one) for one in np.unravel_index(int(gaps_m[at].argmin()), gaps_m[at].shape))
        found.append((at, row, side == at, float(gaps_m[at][row, side])))
    return found[0] if found[0][3] <= widest_m else found[1]


def _joined(
    chain: _Chain, piece: LinePiece, at: int, turned: bool, gap_m: float, *, out_of_order: bool
) -> list[LeftOut]:
    """Add a piece at an end of the chain; return what is to be said about it."""
    beside = chain.labels[at]
    points = list(piece.points[::-1] if turned else piece.points)
    text = []
    if turned:
        text.append("flown backwards")
    if out_of_order:
        text.append(f"flown {'after' if at else 'before'} {beside}")
    if gap_m > _SAME_M:
        text.append(f"joined to {beside} over a gap of {gap_m:.1f} m that nobody drew")
    near, other = (points[0], chain.points[-1]) if at else (points[-1], chain.points[0])
    climb_m = abs(near.height_m - other.height_m) if near.datum is other.datum else 0.0
    if climb_m > _SAME_M:
        text.append(f"joined to {beside} over {climb_m:.1f} m of height that nobody drew")
    if gap_m <= _SAME_M and (near.datum, near.height_m) == (other.datum, other.height_m) and len(points) > 1:
        points = points[1:] if at else points[:-1]
    chain.points[:] = [*chain.points, *points] if at else [*points, *chain.points]
    chain.labels[at] = piece.label
    return [LeftOut(piece.label, ", ".join(text))] if text else []
