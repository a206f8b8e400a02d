"""The motion of one vehicle as piecewise polynomials, and of a fleet in pieces that no joint divides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PPoly

from gcs.errors import FileFormatError, UsageError
from gcs.plan.verification.proof.polynomials import modelled, scaled_coefficients, shifted
from gcs.plan.verification.proof.subdivision import Mask, Rows
from gcs.plan.verification.proof.taylor import Taylor
from gcs.types import Array

ORDER = 2
_NUMBERS_MAX = 40_000_000  # coefficients of all pieces of all vehicles
_ROUNDINGS = 4  # for each power: of the shift to a piece, and of that to an interval


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
        if not 0.0 <= self.off_m < np.inf:
            raise FileFormatError(f"track {self.name}: off_m is {self.off_m}.", hint="give a length, or leave it out")

    @property
    def rounding_m(self) -> float:
        """How far rounding may move a place: where large terms cancel, much of them is lost."""
        c, x = np.abs(self.position_ned_m.c[::-1]), self.position_ned_m.x
        with np.errstate(over="ignore", invalid="ignore"):
            terms_m = (c * (np.diff(x) ** np.arange(len(c))[:, None])[..., None]).sum(axis=0)
            return float(_ROUNDINGS * len(c) * np.finfo(np.float64).eps * np.nan_to_num(terms_m, nan=np.inf).max())

    @property
    def accelerates(self) -> bool:
        """Whether it says how the vehicle accelerates: straight lines between samples do not."""
        return len(self.position_ned_m.c) > 2


def both_ends(scaled: Array) -> tuple[Array, Array]:
    """Values (...) at the start and at the end of intervals, of coefficients (D+1, ...), the lowest power first."""
    return np.tensordot((-1.0) ** np.arange(len(scaled)), scaled, axes=1), np.asarray(scaled.sum(axis=0))


def derived(c: Array) -> Array:
    """Coefficients (D, P, 3) of the derivative, the lowest power first."""
    return c[1:] * np.arange(1.0, len(c))[:, None, None] if len(c) > 1 else np.zeros_like(c[:1])


@dataclass(frozen=True, eq=False)
class FleetMotion:
    """The motion of V vehicles as P pieces that no joint divides, in N windows of time that all vehicles share.

    Pieces stand vehicle by vehicle, in the order of time; each lies within one window.
    """

    edges_s: Array  # (N + 1,) of the windows
    starts_s: Array  # (P,)
    ends_s: Array  # (P,)
    c: Array  # (D+1, P, 3) in NED metres, the lowest power first, of time from the middle in half lengths
    moves: Mask  # (P,), whether the vehicle has a polynomial, or stands before or after it
    begins: Rows  # (V, N + 1), the number of the first piece in each window, and of that after the last
    off_m: Array  # (V,), how far each vehicle may be from its polynomials

    @classmethod
    def of(cls, tracks: Sequence[PolynomialTrack], more_s: Array) -> FleetMotion:
        """The motion of several tracks, divided at `more_s` too. Raises `UsageError` where that is too much."""
        edges_s = _windows_s([each.position_ned_m.x for each in tracks], more_s)
        width = max(len(each.position_ned_m.c) for each in tracks)
        own = [np.union1d(edges_s, each.position_ned_m.x) for each in tracks]
        counts = np.array([len(each) - 1 for each in own])
        firsts = np.cumsum(counts) - counts
        pieces = int(counts.sum())
        if width * pieces * 3 > _NUMBERS_MAX:
            raise UsageError(
                f"{len(tracks)} tracks have {pieces:,} pieces together: too many.",
                hint="prove parts of the time, or fewer vehicles, one by one",
            )
        c = np.zeros((width, pieces, 3))
        moves = np.zeros(pieces, dtype=bool)
        begins = np.zeros((len(tracks), len(edges_s)), dtype=np.intp)
        for row, (each, own_s) in enumerate(zip(tracks, own, strict=True)):
            x, here = each.position_ned_m.x, slice(firsts[row], firsts[row] + counts[row])
            first, last = np.searchsorted(own_s, [x[0], x[-1]])
            scaled = scaled_coefficients(each.position_ned_m, own_s[first:last], own_s[first + 1 : last + 1])
            places, moving = c[:, here], moves[here]
            places[: len(scaled), first:last] = scaled
            starts, ends = both_ends(scaled)
            places[0, :first], places[0, last:] = starts[0], ends[-1]
            moving[first:last] = True
            begins[row] = firsts[row] + np.searchsorted(own_s, edges_s)
        starts_s = np.concatenate([each[:-1] for each in own])
        ends_s = np.concatenate([each[1:] for each in own])
        return cls(edges_s, starts_s, ends_s, c, moves, begins, np.array([each.off_m for each in tracks]))

    @cached_property
    def relative(self) -> FleetMotion:
        """The motion beside the mean of all vehicles: of a formation it is small, and differences are the same.

        The mean is exact in windows without a joint of any vehicle. In others it is a cubic, which goes on in place and
        velocity from one window to the next.
        """
        vehicles, windows = np.arange(len(self.begins)), len(self.edges_s) - 1
        plain = (np.diff(self.begins, axis=1) == 1).all(axis=0)
        c = np.zeros((max(len(self.c), 4), *self.c.shape[1:]))
        c[: len(self.c)] = self.c
        if plain.any():
            mean = np.zeros((len(self.c), windows, 3))
            for firsts in self.begins[:, :-1]:
                mean[:, plain] += self.c[:, firsts[plain]] / len(vehicles)
            c[: len(self.c)] -= mean[:, self.window]
        if not plain.all():
            place, velocity = np.zeros((windows + 1, 3)), np.zeros((windows + 1, 3))
            beside = ~np.append(plain, True) | ~np.append(True, plain)
            for number in np.flatnonzero(beside).tolist():
                at_s = np.full(len(vehicles), self.edges_s[number])
                place[number] = self.places(vehicles, at_s).mean(axis=0)
                velocity[number] = self.enclosed(vehicles, at_s, at_s, 1).middle.mean(axis=1)
            pieces = np.flatnonzero(~plain[self.window])
            cubic = CubicHermiteSpline(self.edges_s, place, velocity)
            c[:4, pieces] -= scaled_coefficients(cubic, self.starts_s[pieces], self.ends_s[pieces])
        return replace(self, c=c)

    @cached_property
    def row(self) -> Rows:
        """The vehicle (P,) of each piece."""
        return np.repeat(np.arange(len(self.begins)), self.begins[:, -1] - self.begins[:, 0])

    @cached_property
    def window(self) -> Rows:
        """The window (P,) of each piece."""
        return np.tile(np.arange(len(self.edges_s) - 1), len(self.begins)).repeat(np.diff(self.begins, axis=1).ravel())

    def piece(self, row: Rows, t_s: Array) -> Rows:
        """The number of the piece (M,) of vehicles (M,) at instants (M,)."""
        window = np.clip(np.searchsorted(self.edges_s, t_s, side="right") - 1, 0, len(self.edges_s) - 2)
        found, last = self.begins[row, window], self.begins[row, window + 1] - 1
        while (later := (found < last) & (self.ends_s[found] <= t_s)).any():
            found = found + later
        return found

    def enclosed(self, row: Rows, start_s: Array, end_s: Array, derivative: int = 0) -> Taylor:
        """Places (3, M) of vehicles (M,), or a derivative, over spans (M,) that lie within one piece each."""
        middle_s = 0.5 * (start_s + end_s)
        piece = self.piece(row, middle_s)
        half = 0.5 * (self.ends_s[piece] - self.starts_s[piece])
        c = self.c[:, piece]
        for _ in range(derivative):
            c = derived(c)
        c = shifted(c, ((middle_s - self.starts_s[piece] - half) / half)[:, None])
        share = 0.5 * (end_s - start_s) / half
        c *= (share ** np.arange(len(c))[:, None] / half**derivative)[..., None]
        found = modelled(np.moveaxis(c, 2, 1), ORDER)
        return found if derivative else Taylor(found.c, found.remainder + self.off_m[row])

    def places(self, row: Rows, t_s: Array) -> Array:
        """Places (M, 3) of vehicles (M,) at instants (M,)."""
        piece = self.piece(row, t_s)
        half = 0.5 * (self.ends_s[piece] - self.starts_s[piece])
        s = ((t_s - self.starts_s[piece] - half) / half)[:, None]
        found = np.zeros((len(row), 3))
        for power in self.c[::-1]:
            found = found * s + power[piece]
        return found

    def steps(self, derivative: int = 0) -> Array:
        """Sizes (P,) of the steps of the place (m), or of a derivative, where pieces begin; infinite if one overflows.

        A vehicle that begins to move, or stops, has no step of a derivative there.
        """
        c, half_s = self.c, 0.5 * (self.ends_s - self.starts_s)
        for _ in range(derivative):
            c = derived(c) / half_s[:, None]
        starts, ends = both_ends(c)
        goes_on = (self.row[1:] == self.row[:-1]) & ((derivative == 0) | (self.moves[1:] & self.moves[:-1]))
        sizes = np.nan_to_num(np.linalg.norm(starts[1:] - ends[:-1], axis=1), nan=np.inf)
        return np.append(0.0, np.where(goes_on, sizes, 0.0))

    @cached_property
    def jumps_m(self) -> Array:
        """Steps (P,) of the place before each piece, added up, for the difference of two pieces of one vehicle."""
        return np.cumsum(self.steps())

    def single(self, row: Rows, window: Rows) -> Mask:
        """Whether vehicles (M,) have one piece only in windows (M,)."""
        return np.asarray(self.begins[row, window + 1] - self.begins[row, window] == 1)

    @cached_property
    def windows(self) -> tuple[tuple[Array, Array, Array, Array], ...]:
        """Boxes on 1, 2, 4, ... windows, each (V, windows, 3): place low, high, velocity low, high."""
        found = []
        for derivative in (0, 1):
            for bound, least in zip(
                self.enclosed(self.row, self.starts_s, self.ends_s, derivative).range(),
                (np.minimum, np.maximum),
                strict=True,
            ):
                found.append(least.reduceat(bound.T, self.begins[:, :-1].ravel()).reshape(len(self.begins), -1, 3))
        levels = [(found[0], found[1], found[2], found[3])]
        while levels[-1][0].shape[1] > 1:
            low, high, slow, fast = levels[-1]
            wider = _paired(low, np.minimum), _paired(high, np.maximum)
            levels.append((*wider, _paired(slow, np.minimum), _paired(fast, np.maximum)))
        return tuple(levels)


def _windows_s(times_s: list[Array], more_s: Array) -> Array:
    """Instants at which the time of all vehicles is divided: those of all, or where they differ as many as one has."""
    every_s = np.unique(np.concatenate(times_s))
    most = max(map(len, times_s))
    if len(every_s) > 2 * most:
        every_s = every_s[np.unique(np.linspace(0, len(every_s) - 1, most).astype(np.intp))]
    more_s = more_s[(more_s > every_s[0]) & (more_s < every_s[-1])]
    return np.union1d(every_s, more_s)


def _paired(values: Array, of: np.ufunc) -> Array:
    """The least or largest (V, ceil(n / 2), 3) of each two neighbours of (V, n, 3)."""
    return np.asarray(of.reduceat(values, np.arange(0, values.shape[1], 2), axis=1))
