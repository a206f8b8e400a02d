"""The motion of one vehicle as piecewise polynomials, and of a fleet on intervals that no joint divides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import PPoly

from gcs.errors import FileFormatError, UsageError
from gcs.plan.verification.proof.polynomials import modelled, scaled_coefficients, shifted
from gcs.plan.verification.proof.subdivision import Rows
from gcs.plan.verification.proof.taylor import Taylor
from gcs.types import Array

ORDER = 2
_NUMBERS_MAX = 40_000_000  # coefficients of all vehicles on all intervals


@dataclass(frozen=True, eq=False)
class PolynomialTrack:
    """The motion of one vehicle: place in metres NED over time in seconds.

    Before its first instant the vehicle stands at its first place, after its last one at its last place.
    Raises `FileFormatError` for a polynomial that is not of three finite components.
    """

    name: str
    position_ned_m: PPoly  # c (degree + 1, pieces, 3), x (pieces + 1,) in s
    off_m: float = 0.0  # how far the vehicle may be from it at the same instant

    def __post_init__(self) -> None:
        c, x = self.position_ned_m.c, self.position_ned_m.x
        if c.ndim != 3 or c.shape[2] != 3:
            raise FileFormatError(
                f"track {self.name}: coefficients have the shape {c.shape}.",
                hint="give an array of (degree + 1, pieces, 3)",
            )
        if not (np.isfinite(c).all() and np.isfinite(x).all() and (np.diff(x) > 0.0).all()):
            raise FileFormatError(
                f"track {self.name}: a coefficient or a time is not finite, or times do not increase.",
                hint="give finite numbers, and times that increase",
            )

    @property
    def accelerates(self) -> bool:
        """Whether it says how the vehicle accelerates: straight lines between samples do not."""
        return len(self.position_ned_m.c) > 2

    def jumps(self, derivative: int = 0) -> Array:
        """Sizes (pieces - 1,) of the steps at the inner joints, of the place (m) or of a derivative of it."""
        x = self.position_ned_m.x
        starts, ends = both_ends(scaled_coefficients(self.position_ned_m, x[:-1], x[1:], derivative))
        return np.asarray(np.linalg.norm(starts[1:] - ends[:-1], axis=-1))


def both_ends(scaled: Array) -> tuple[Array, Array]:
    """Values (...) at the start and at the end of intervals, of coefficients (D+1, ...), the lowest power first."""
    return np.tensordot((-1.0) ** np.arange(len(scaled)), scaled, axes=1), np.asarray(scaled.sum(axis=0))


@dataclass(frozen=True, eq=False)
class FleetMotion:
    """The motion of V vehicles on N intervals: no polynomial has a joint within one."""

    edges_s: Array  # (N + 1,)
    c: Array  # (D+1, V, N, 3) in NED metres, the lowest power first, of time from the middle in half lengths
    moves: Array  # (V, N), 1 where the vehicle has a polynomial, 0 where it stands before or after it
    off_m: Array  # (V,), how far each vehicle may be from its polynomials

    @classmethod
    def of(cls, tracks: Sequence[PolynomialTrack], more_s: Array) -> FleetMotion:
        """The motion of several tracks, divided at `more_s` too. Raises `UsageError` where that is too much."""
        inner_s = [each.position_ned_m.x for each in tracks]
        edges_s = np.unique(np.concatenate(inner_s))
        more_s = more_s[(more_s > edges_s[0]) & (more_s < edges_s[-1])]
        edges_s = np.unique(np.concatenate([edges_s, more_s]))
        width = max(len(each.position_ned_m.c) for each in tracks)
        count = len(edges_s) - 1
        if width * len(tracks) * count * 3 > _NUMBERS_MAX:
            raise UsageError(
                f"{len(tracks)} tracks have {count + 1} different times together: too many.",
                hint="give all vehicles samples at the same times, or prove parts of the time one by one",
            )
        c = np.zeros((width, len(tracks), count, 3))
        moves = np.zeros((len(tracks), count))
        for row, each in enumerate(tracks):
            x = each.position_ned_m.x
            first, last = np.searchsorted(edges_s, [x[0], x[-1]])
            scaled = scaled_coefficients(each.position_ned_m, edges_s[first:last], edges_s[first + 1 : last + 1])
            c[: len(scaled), row, first:last] = scaled
            starts, ends = both_ends(scaled)
            c[0, row, :first], c[0, row, last:] = starts[0], ends[-1]
            moves[row, first:last] = 1.0
        return cls(edges_s, c, moves, np.array([each.off_m for each in tracks]))

    @cached_property
    def relative(self) -> FleetMotion:
        """The motion beside the mean of all vehicles: of a formation it is small, and differences are the same."""
        return replace(self, c=self.c - self.c.mean(axis=1, keepdims=True))

    @cached_property
    def half_s(self) -> Array:
        """Half the length (N,) of each interval."""
        return 0.5 * np.diff(self.edges_s)

    @cached_property
    def middle_s(self) -> Array:
        """The instants (N,) in the middle of the intervals."""
        return self.edges_s[:-1] + self.half_s

    def interval(self, t_s: Array) -> Rows:
        """The number of the interval (M,) at instants (M,)."""
        return np.clip(np.searchsorted(self.edges_s, t_s, side="right") - 1, 0, len(self.half_s) - 1)

    def enclosed(self, row: Rows, start_s: Array, end_s: Array, derivative: int = 0) -> Taylor:
        """Places (3, M) of vehicles (M,), or a derivative, over spans (M,) that lie within one interval each."""
        middle_s = 0.5 * (start_s + end_s)
        number = self.interval(middle_s)
        half = self.half_s[number]
        c = self.c[:, row, number]
        for _ in range(derivative):
            c = c[1:] * np.arange(1.0, len(c))[:, None, None] if len(c) > 1 else np.zeros_like(c[:1])
        c = shifted(c, ((middle_s - self.middle_s[number]) / half)[:, None])
        share = 0.5 * (end_s - start_s) / half
        c *= (share ** np.arange(len(c))[:, None] / half**derivative)[..., None]
        found = modelled(np.moveaxis(c, 2, 1), ORDER)
        return found if derivative else Taylor(found.c, found.remainder + self.off_m[row])

    def places(self, row: Rows, t_s: Array) -> Array:
        """Places (M, 3) of vehicles (M,) at instants (M,)."""
        number = self.interval(t_s)
        s = ((t_s - self.middle_s[number]) / self.half_s[number])[:, None]
        found = np.zeros((len(row), 3))
        for power in self.c[::-1]:
            found = found * s + power[row, number]
        return found

    @cached_property
    def jumps_m(self) -> Array:
        """Steps (V, N + 1) at the edges, added up from the first edge on: rounding, or a broken polynomial."""
        starts, ends = both_ends(self.c)
        steps = np.linalg.norm(starts[:, 1:] - ends[:, :-1], axis=2)
        return np.cumsum(np.pad(steps, ((0, 0), (1, 1))), axis=1)

    @cached_property
    def windows(self) -> tuple[tuple[Array, Array, Array, Array], ...]:
        """Boxes on windows of 1, 2, 4, ... intervals, each (V, windows, 3): place low, high, velocity low, high."""
        vehicles, count = self.c.shape[1:3]
        row, number = np.repeat(np.arange(vehicles), count), np.tile(np.arange(count), vehicles)
        found = []
        for derivative in (0, 1):
            low, high = self.enclosed(row, self.edges_s[number], self.edges_s[number + 1], derivative).range()
            found += [low.T.reshape(vehicles, count, 3), high.T.reshape(vehicles, count, 3)]
        levels = [(found[0], found[1], found[2], found[3])]
        while levels[-1][0].shape[1] > 1:
            low, high, slow, fast = levels[-1]
            wider = _paired(low, np.minimum), _paired(high, np.maximum)
            levels.append((*wider, _paired(slow, np.minimum), _paired(fast, np.maximum)))
        return tuple(levels)


def _paired(values: Array, of: np.ufunc) -> Array:
    """The least or largest (V, ceil(n / 2), 3) of each two neighbours of (V, n, 3)."""
    return np.asarray(of.reduceat(values, np.arange(0, values.shape[1], 2), axis=1))
