"""Piecewise polynomials as Taylor models over intervals that lie within one piece."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from gcs.plan.verification.proof.taylor import Taylor
from gcs.types import Array


def enclosed(polynomial: PPoly, start_s: Array, end_s: Array, order: int, derivative: int = 0) -> Taylor:
    """A polynomial of time, or a derivative, over intervals (N,): Taylor models of shape (n, N), one of n components.

    No interval may reach over a joint.
    """
    begin_s, finish_s, which = distinct(start_s, end_s)
    scaled = scaled_coefficients(polynomial, begin_s, finish_s, derivative)
    return modelled(np.moveaxis(scaled, 2, 1), order)[:, which]


def distinct(start_s: Array, end_s: Array) -> tuple[Array, Array, NDArray[np.intp]]:
    """The starts and ends of the intervals (N,) without repetitions, and which of them each interval is (N,).

    Groups of vehicles are looked at over the same intervals, so what depends on time alone needs few of them.
    """
    spans_s, which = np.unique(start_s + 1j * end_s, return_inverse=True)
    return spans_s.real, spans_s.imag, which


def modelled(scaled: Array, order: int) -> Taylor:
    """Taylor models (...) of polynomials with coefficients (D+1, ...), the lowest power of scaled time first."""
    if len(scaled) <= order + 1:
        c = np.concatenate([scaled, np.zeros((order + 1 - len(scaled), *scaled.shape[1:]))])
        return Taylor(c, np.zeros(scaled.shape[1:]))
    return Taylor(scaled[: order + 1], np.abs(scaled[order + 1 :]).sum(axis=0))


def scaled_coefficients(polynomial: PPoly, start_s: Array, end_s: Array, derivative: int = 0) -> Array:
    """Coefficients (D+1, N, n), the lowest power first, of time counted from the middle in half lengths."""
    middle_s, half_s = 0.5 * (start_s + end_s), 0.5 * (end_s - start_s)
    piece = np.clip(np.searchsorted(polynomial.x, middle_s, side="right") - 1, 0, len(polynomial.x) - 2)
    shifted = shifted_coefficients(polynomial, piece, middle_s, derivative)
    return np.asarray(shifted * (half_s[None, :] ** np.arange(len(shifted))[:, None])[..., None])


def combined(functions: Taylor, tables: Array) -> list[Taylor]:
    """Functions (K, N) times tables (K, V, A), summed over the functions: A components (V, N)."""
    c = np.einsum("okn,kva->oavn", functions.c, tables)
    remainder = np.einsum("kn,kva->avn", functions.remainder, np.abs(tables))
    return [Taylor(c[:, axis], remainder[axis]) for axis in range(tables.shape[2])]


def shifted_coefficients(polynomial: PPoly, piece: NDArray[np.intp], at_s: Array, derivative: int = 0) -> Array:
    """Coefficients (D+1, N, n) of the pieces (N,) in powers of t - at_s, the lowest first."""
    c = polynomial.c[::-1][:, piece, :]  # (D+1, N, n), lowest power first
    for _ in range(derivative):
        c = c[1:] * np.arange(1.0, len(c))[:, None, None] if len(c) > 1 else np.zeros_like(c[:1])
    return shifted(c, (at_s - polynomial.x[piece])[:, None])


def shifted(c: Array, by: Array | float) -> Array:
    """Coefficients (D+1, ...) of polynomials, the lowest power first, with their origin `by` later (Horner's shift)."""
    c = np.array(c)
    for low in range(len(c) - 1):
        for k in range(len(c) - 2, low - 1, -1):
            c[k] += by * c[k + 1]
    return c
