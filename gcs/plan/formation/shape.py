"""The shape over time: offsets of all vehicles from the leader as a few functions times fixed tables.

A thousand vehicles that shrink and rotate together need three functions; a path for each would need thousands.
"""

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from gcs.physics.wind import SteadyWind
from gcs.types import Array

Rows = NDArray[np.intp]
EVERYONE = slice(None)
_LEVEL_M = 1e-9  # rounding, not a difference in height


@dataclass(frozen=True)
class Shape:
    """Offsets from the leader: sum over k of functions[k](t) * basis_ned_m[k]."""

    functions: PPoly  # coefficients (C+1, P, K)
    basis_ned_m: Array  # (K, V, 3)

    def __post_init__(self) -> None:
        if self.basis_ned_m.ndim != 3 or self.basis_ned_m.shape[2] != 3:
            raise ValueError(f"basis needs (K, V, 3), not {self.basis_ned_m.shape}")
        if self.functions.c.shape[2:] != (len(self.basis_ned_m),):
            raise ValueError(f"{len(self.basis_ned_m)} tables need functions (C+1, P, K), not {self.functions.c.shape}")

    @property
    def joints_s(self) -> Array:
        """Instants (P+1,) where polynomials join."""
        return np.asarray(self.functions.x)

    @property
    def start_s(self) -> float:
        """First instant."""
        return float(self.functions.x[0])

    @property
    def end_s(self) -> float:
        """Last instant."""
        return float(self.functions.x[-1])

    def offsets(self, t_s: Array, order: int = 0, rows: slice | Rows = EVERYONE) -> Array:
        """Offsets (V, N, 3) of `rows` from the leader, or their `order`-th time derivative in m/s^order."""
        tables, factors = self.basis_ned_m[:, rows], np.ascontiguousarray(self.functions(t_s, nu=order).T)
        offsets = np.zeros((*tables.shape[1:], factors.shape[1]))  # (V, 3, N)
        # Summed one by one: a matrix product sums in an order that depends on the processor.
        for table, factor in zip(tables, factors, strict=True):
            if factor.any():
                offsets += table[..., None] * factor
        return np.ascontiguousarray(offsets.swapaxes(1, 2))

    def is_moving(self, t_s: Array) -> NDArray[np.bool_]:
        """Whether the shape changes at these instants (N,)."""
        return np.asarray(self._moves[self._piece(t_s)])

    def moves_apart(self, t_s: Array, wind: SteadyWind) -> NDArray[np.bool_]:
        """Whether some vehicle's velocity, attitude or control differs from the leader's, at these instants (N,).

        They differ where the shape changes, and where vehicles fly at different heights in a wind that grows with
        height. Elsewhere the leader stands for all.
        """
        return np.asarray(self._differs(wind)[self._piece(t_s)])

    def apart_s(self, wind: SteadyWind) -> tuple[tuple[float, float], ...]:
        """Spans (start, end) in which vehicles move apart, as `moves_apart` has it."""
        return self._spans(self._differs(wind))

    def at(self, t_s: float, order: int = 0) -> Array:
        """Offsets (V, 3) at one instant, or their `order`-th derivative."""
        return np.asarray(self.offsets(np.array([t_s]), order)[:, 0])

    @cached_property
    def moving_s(self) -> tuple[tuple[float, float], ...]:
        """Spans (start, end) over which the offsets change; outside them the formation is rigid."""
        return self._spans(self._moves)

    def _piece(self, t_s: Array) -> Rows:
        """The polynomial (N,) that each instant belongs to."""
        return np.clip(np.searchsorted(self.joints_s, t_s, side="right") - 1, 0, len(self._moves) - 1)

    def _spans(self, pieces: NDArray[np.bool_]) -> tuple[tuple[float, float], ...]:
        """Spans (start, end) of consecutive pieces that are marked."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], pieces, [False]]).astype(int)))
        return tuple(
            (float(self.joints_s[a]), float(self.joints_s[b])) for a, b in zip(edges[::2], edges[1::2], strict=True)
        )

    def _differs(self, wind: SteadyWind) -> NDArray[np.bool_]:
        return self._moves | self._uneven if wind.has_shear else self._moves

    @cached_property
    def _moves(self) -> NDArray[np.bool_]:
        return np.asarray(np.any(np.abs(self.functions.c[:-1]) > 0.0, axis=(0, 2)))

    @cached_property
    def _uneven(self) -> NDArray[np.bool_]:
        """Whether some vehicle is higher or lower than the leader in each polynomial."""
        return np.asarray(np.any(np.abs(self.functions.c @ self.basis_ned_m[..., 2]) > _LEVEL_M, axis=(0, 2)))


def rigid(offsets_ned_m: Array, start_s: float, end_s: float) -> Shape:
    """A rigid shape: offsets (V, 3) from start to end."""
    return Shape(PPoly(np.ones((1, 1, 1)), np.array([start_s, end_s])), np.asarray(offsets_ned_m, dtype=float)[None])


def stretched(shape: Shape, start_s: float, end_s: float) -> Shape:
    """The same shape over another span of time."""
    return Shape(stretched_polynomials(shape.functions, start_s, end_s), shape.basis_ned_m)


def stretched_polynomials(polynomials: PPoly, start_s: float, end_s: float) -> PPoly:
    """The same polynomials over another span of time."""
    first, last = float(polynomials.x[0]), float(polynomials.x[-1])
    factor = (end_s - start_s) / (last - first)
    joints = start_s + (polynomials.x - first) * factor
    joints[-1] = end_s
    powers = np.arange(len(polynomials.c) - 1.0, -1.0, -1.0)
    return PPoly(polynomials.c / factor ** powers[:, None, None], joints)


def joined(parts: list[Shape]) -> Shape:
    """One shape from several that follow each other without a gap; raises ValueError where there is one."""
    for before, after in itertools.pairwise(parts):
        if before.end_s != after.start_s:
            raise ValueError(f"one shape ends at {before.end_s} s, the next starts at {after.start_s} s")
    top = max(p.functions.c.shape[0] for p in parts)
    tables = [len(p.basis_ned_m) for p in parts]
    columns = np.concatenate([[0], np.cumsum(tables)])
    blocks = []
    for part, first, last in zip(parts, columns[:-1], columns[1:], strict=True):
        own = part.functions.c
        block = np.zeros((top, own.shape[1], columns[-1]))
        block[top - own.shape[0] :, :, first:last] = own
        blocks.append(block)
    joints = np.concatenate([parts[0].joints_s[:1], *(p.joints_s[1:] for p in parts)])
    return Shape(PPoly(np.concatenate(blocks, axis=1), joints), np.concatenate([p.basis_ned_m for p in parts]))
