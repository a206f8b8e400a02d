"""One polynomial of time for position and yaw, and the evaluation of a whole fleet's in one go.

Knows: coefficients and derivatives. Does not know: why a vehicle flies them.
Every guidance law ends as such pieces, so that the step that runs a hundred times a second is one small
matrix product for all vehicles, and jerk and snap are exact.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gcs.physics.quadrotor import Array
from sim_bridge.dynamics.control.reference import Reference

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
        """Position and yaw with their derivatives up to snap, (DERIVATIVES, 4)."""
        return np.asarray(_basis(np.float64(t_s - self.start_s)) @ self.coefficients)


def _basis(tau_s: Array | np.float64) -> Array:
    """Monomials and their derivatives, tau (...) -> (..., DERIVATIVES, TERMS)."""
    powers = np.power.outer(tau_s, _k)
    return np.asarray(_FACTORS * powers[..., _EXPONENTS])


def hold(start_s: float, flat: Array) -> Piece:
    """Stand where `flat` (DERIVATIVES, 4) or (4,) says, for ever."""
    c = np.zeros((TERMS, 4))
    c[0] = flat if flat.ndim == 1 else flat[0]
    return Piece(start_s, math.inf, c)


class PieceBatch:
    """The current piece of every vehicle, evaluated together."""

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self._start_s = np.array([p.start_s for p in pieces])
        self._coefficients = np.stack([p.coefficients for p in pieces])  # (V, TERMS, 4)
        self._current = list(pieces)

    def put(self, row: int, piece: Piece) -> None:
        """Give one vehicle its piece; free when it has not changed."""
        if self._current[row] is not piece:
            self._current[row] = piece
            self._start_s[row] = piece.start_s
            self._coefficients[row] = piece.coefficients

    def reference(self, t_s: float) -> Reference:
        """What all vehicles are asked to do at `t_s`."""
        flat = _basis(t_s - self._start_s) @ self._coefficients  # (V, DERIVATIVES, 4)
        ned = flat[:, :, :3]
        return Reference(ned[:, 0], ned[:, 1], ned[:, 2], ned[:, 3], ned[:, 4], flat[:, 0, 3], flat[:, 1, 3])


@dataclass(frozen=True)
class Mark:
    """At `t_s` mission item `reached` was completed, and `current` begins; either may be absent."""

    t_s: float
    reached: int | None = None
    current: int | None = None


@dataclass(frozen=True)
class PiecePath:
    """Pieces one after the other, then what `rest` has; after the last the vehicle stands where it ended.

    The rest is worked out as it is flown, course by course; each says anew what is climbing and what is landing.
    """

    pieces: tuple[Piece, ...]
    marks: tuple[Mark, ...] = ()
    climbing_until_s: float = -math.inf  # a take-off from the ground
    landing_from_s: float = math.inf
    rest: Iterator[PiecePath] | None = None
