"""Legendre-Gauss collocation on [-1, 1]: nodes, weights, differentiation and interpolation (Eqs. 37-46)."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from gcs.types import Array


@dataclass(frozen=True)
class GaussRule:
    """Constants of a collocated interval of degree K."""

    degree: int
    nodes: Array  # (K,) roots of the Legendre polynomial P_K (Eq. 39)
    weights: Array  # (K,) quadrature weights (Eq. 46)
    support: Array  # (K+1,) interpolation points of the state: -1, then the nodes (Eq. 37)
    differentiation: Array  # (K, K+1) D of Eq. 42: derivative at the nodes from values at the support
    barycentric: Array  # (K+1,) barycentric weights of the support

    def interpolation(self, tau: Array) -> Array:
        """Matrix (T, K+1) of Lagrange polynomials L_i(tau) (Eq. 38): values at the support -> values at tau."""
        return lagrange_matrix(self.support, self.barycentric, tau)

    def power_basis(self) -> Array:
        """Matrix (K+1, K+1): values at the support -> coefficients of ((tau + 1) / 2)**k, highest power first."""
        return np.asarray(np.linalg.inv(np.vander(0.5 * (self.support + 1.0))))


@cache
def gauss_rule(degree: int) -> GaussRule:
    """The Legendre-Gauss rule with `degree` nodes; exact for polynomials up to degree 2 K - 1. 0: a constant."""
    if degree < 0:
        raise ValueError(f"a Gauss rule has 0 nodes or more; got {degree}")
    if degree == 0:  # the state is constant
        return GaussRule(0, np.zeros(0), np.zeros(0), np.array([-1.0]), np.zeros((0, 1)), np.ones(1))
    nodes, weights = np.polynomial.legendre.leggauss(degree)
    support = np.concatenate([[-1.0], nodes])
    barycentric = barycentric_weights(support)
    gaps = support[:, None] - support[None, :]
    np.fill_diagonal(gaps, 1.0)
    # The diagonal of the differentiation follows from rows summing to zero, which keeps it accurate.
    matrix = barycentric[None, :] / barycentric[:, None] / gaps
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return GaussRule(degree, nodes, weights, support, matrix[1:], barycentric)


def barycentric_weights(support: Array) -> Array:
    """1 / prod_{j != i} (s_i - s_j), scaled to maximum 1 (the scale cancels everywhere)."""
    gaps = support[:, None] - support[None, :]
    np.fill_diagonal(gaps, 1.0)
    weights = 1.0 / np.prod(gaps, axis=1)
    return np.asarray(weights / np.max(np.abs(weights)))


def lagrange_matrix(support: Array, barycentric: Array, points: Array) -> Array:
    """Lagrange basis at `points`: (T, S), by the second barycentric formula."""
    gaps = np.atleast_1d(points)[:, None] - support[None, :]
    hit = np.abs(gaps) < 1e-300  # the reciprocal of a smaller gap is not finite
    gaps[hit] = 1.0
    terms = barycentric / gaps
    on_node = hit.any(axis=1)
    terms[on_node] = hit[on_node]
    return np.asarray(terms / terms.sum(axis=1, keepdims=True))
