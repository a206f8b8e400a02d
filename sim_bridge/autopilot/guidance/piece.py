"""Polynomial pieces: the reference that every guidance law gives to the controller.

A piece gives position and yaw over time, so jerk and snap are exact. A path is a sequence of pieces with marks.
`PieceBatch` evaluates the present pieces of the whole fleet with one matrix product per step of 20 ms.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gcs.types import Array

TERMS = 8  # degree 7: position, velocity, acceleration and jerk given at both ends
DERIVATIVES = 5  # position to snap

_k = np.arange(TERMS)
_FACTORS = np.array([[float(math.perm(k, j)) for k in _k] for j in range(DERIVATIVES)])  # 0 where k < j
_EXPONENTS = np.maximum(_k - np.arange(DERIVATIVES)[:, None], 0)


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Σ c_k (t - start_s)^k until `end_s`, for north, east, down (m, common local NED) and yaw (rad)."""

    start_s: float
    end_s: float
    coefficients: Array  # (TERMS, 4)

    def at(self, t_s: float) -> Array:
        """Return position and yaw with their derivatives up to snap, (DERIVATIVES, 4)."""
        return np.asarray(_basis(np.float64(t_s - self.start_s)) @ self.coefficients)


def _basis(tau_s: Array | np.float64) -> Array:
    """Return monomials and their derivatives, tau (...) -> (..., DERIVATIVES, TERMS)."""
    powers = np.power.outer(tau_s, _k)
    return np.asarray(_FACTORS * powers[..., _EXPONENTS])


def hold(start_s: float, flat: Array) -> Piece:
    """Return the piece that holds at `flat` (DERIVATIVES, 4) or (4,), without end."""
    c = np.zeros((TERMS, 4))
    c[0] = flat if flat.ndim == 1 else flat[0]
    return Piece(start_s, math.inf, c)


class PieceBatch:
    """The present piece of every vehicle, evaluated together."""

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self._start_s = np.array([p.start_s for p in pieces])
        self._coefficients = np.stack([p.coefficients for p in pieces])  # (V, TERMS, 4)
        self._current = list(pieces)

    def put(self, row: int, piece: Piece) -> None:
        """Set the piece of one vehicle; costs nothing if it has not changed."""
        if self._current[row] is not piece:
            self._current[row] = piece
            self._start_s[row] = piece.start_s
            self._coefficients[row] = piece.coefficients

    def reference(self, t_s: float) -> Array:
        """Return the reference of all vehicles at `t_s`, (V, DERIVATIVES, 4)."""
        return np.asarray(_basis(t_s - self._start_s) @ self._coefficients)


@dataclass(frozen=True)
class Mark:
    """At `t_s` mission item `reached` was completed and `current` begins; either may be None."""

    t_s: float
    reached: int | None = None
    current: int | None = None


@dataclass(frozen=True)
class PiecePath:
    """Pieces in sequence, followed by the paths of `continuation`; after the last piece the vehicle holds position.

    A continuation generates its paths while they are flown. Each path states its own climb and landing times.
    """

    pieces: tuple[Piece, ...]
    marks: tuple[Mark, ...] = ()
    climbing_until_s: float = -math.inf  # a take-off from the ground
    landing_from_s: float = math.inf
    continuation: Iterator[PiecePath] | None = None
