"""Nodes, weights and D: against closed forms, the paper's own formulas, and functions whose derivative is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.polynomial import Legendre, Polynomial

from gcs.plan.nlp.gauss import gauss_rule

ROOT3, ROOT15 = math.sqrt(3), math.sqrt(15)
INNER4, OUTER4 = (math.sqrt(3 / 7 + sign * 2 / 7 * math.sqrt(6 / 5)) for sign in (-1, 1))
INNER5, OUTER5 = (math.sqrt(5 + sign * 2 * math.sqrt(10 / 7)) / 3 for sign in (-1, 1))
CLOSED_FORMS = {
    1: ([0], [2]),
    2: ([-1 / ROOT3, 1 / ROOT3], [1, 1]),
    3: ([-ROOT15 / 5, 0, ROOT15 / 5], [5 / 9, 8 / 9, 5 / 9]),
    4: (
        [-OUTER4, -INNER4, INNER4, OUTER4],
        [(18 - math.sqrt(30)) / 36, (18 + math.sqrt(30)) / 36, (18 + math.sqrt(30)) / 36, (18 - math.sqrt(30)) / 36],
    ),
    5: (
        [-OUTER5, -INNER5, 0, INNER5, OUTER5],
        [
            (322 - 13 * math.sqrt(70)) / 900,
            (322 + 13 * math.sqrt(70)) / 900,
            128 / 225,
            (322 + 13 * math.sqrt(70)) / 900,
            (322 - 13 * math.sqrt(70)) / 900,
        ],
    ),
}
DEGREES = [1, 2, 3, 4, 5, 6, 8, 12, 20, 40]


@pytest.mark.parametrize("degree", CLOSED_FORMS)
def test_nodes_and_weights_have_their_closed_forms(degree: int) -> None:
    rule = gauss_rule(degree)
    nodes, weights = CLOSED_FORMS[degree]
    np.testing.assert_allclose(rule.nodes, nodes, atol=1e-15)
    np.testing.assert_allclose(rule.weights, weights, atol=1e-15)


@pytest.mark.parametrize("degree", DEGREES)
def test_nodes_are_the_roots_of_eq_39_and_symmetric(degree: int) -> None:
    """Rodrigues' formula in whole numbers, whose derivative loses nothing."""
    rule = gauss_rule(degree)
    if degree <= 12:
        rodrigues = (Polynomial([-1, 0, 1]) ** degree).deriv(degree) / (2**degree * math.factorial(degree))
        np.testing.assert_allclose(rodrigues(rule.nodes), 0.0, atol=1e-12)
    np.testing.assert_allclose(rule.nodes, -rule.nodes[::-1], atol=1e-15)
    np.testing.assert_allclose(rule.weights, rule.weights[::-1], atol=1e-15)
    assert rule.weights.min() > 0
    assert rule.weights.sum() == pytest.approx(2.0, abs=1e-14)
    assert rule.support[0] == -1.0
    assert rule.nodes[0] > -1.0
    assert rule.nodes[-1] < 1.0


@pytest.mark.parametrize("degree", DEGREES)
def test_quadrature_is_exact_to_degree_2k_less_1_and_no_further(degree: int) -> None:
    rule = gauss_rule(degree)
    # In Legendre's basis every integral but the first is zero; in powers high degrees would hide behind their size.
    for k in range(2 * degree):
        assert rule.weights @ Legendre.basis(k)(rule.nodes) == pytest.approx(2.0 if k == 0 else 0.0, abs=1e-13)
    # The square of P_K is zero at every node, and its integral is not.
    assert rule.weights @ Legendre.basis(degree)(rule.nodes) ** 2 == pytest.approx(0.0, abs=1e-13)
    finer = gauss_rule(degree + 1)
    assert finer.weights @ Legendre.basis(degree)(finer.nodes) ** 2 == pytest.approx(2.0 / (2 * degree + 1))


@pytest.mark.parametrize("degree", DEGREES)
def test_weights_are_the_integrals_eq_46_says_they_are(degree: int) -> None:
    """Lambda_k = integral of L_k over the K nodes, by a rule that integrates it exactly."""
    rule, finer = gauss_rule(degree), gauss_rule(degree + 1)
    for k in range(degree):
        others = np.delete(rule.nodes, k)
        lagrange = np.prod((finer.nodes[:, None] - others) / (rule.nodes[k] - others), axis=1)
        assert finer.weights @ lagrange == pytest.approx(rule.weights[k], rel=1e-9)


@pytest.mark.parametrize("degree", DEGREES)
def test_d_is_eq_43_with_its_misprint_mended(degree: int) -> None:
    """The paper's diagonal begins with P_K' where the second derivative of (1 + tau) P_K has P_K''."""
    rule = gauss_rule(degree)
    p = Legendre.basis(degree)
    first, second = p.deriv(), p.deriv(2)

    def slope(tau: float) -> float:
        return float((1 + tau) * first(tau) + p(tau))

    printed = np.empty((degree, degree + 1))
    for k, tau_k in enumerate(rule.nodes):
        for i, tau_i in enumerate(rule.support):
            if i == k + 1:
                printed[k, i] = ((1 + tau_i) * second(tau_i) + 2 * first(tau_i)) / (2 * slope(tau_i))
            else:
                printed[k, i] = slope(tau_k) / ((tau_k - tau_i) * slope(tau_i))
    np.testing.assert_allclose(rule.differentiation, printed, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("degree", DEGREES)
def test_interpolation_is_eq_38_and_meets_its_points(degree: int) -> None:
    rule = gauss_rule(degree)
    np.testing.assert_array_equal(rule.interpolation(rule.support), np.eye(degree + 1))
    tau = np.array([-0.987, -0.3, 0.1234, 1.0])
    product = np.array(
        [
            [np.prod([(t - other) / (own - other) for other in rule.support if other != own]) for own in rule.support]
            for t in tau
        ]
    )
    np.testing.assert_allclose(rule.interpolation(tau), product, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("function", "slope"),
    [(np.exp, np.exp), (lambda t: np.sin(2 * t), lambda t: 2 * np.cos(2 * t))],
    ids=["exp", "sin"],
)
def test_errors_fall_faster_than_any_power(function, slope) -> None:  # type: ignore[no-untyped-def]
    """Spectral: on a log-log plot the line of the error gets steeper with every degree, down to rounding."""
    degrees = np.array([3, 5, 7, 9, 11, 13])
    tau = np.linspace(-1, 1, 201)
    errors = np.empty((3, len(degrees)))
    for n, degree in enumerate(degrees):
        rule = gauss_rule(int(degree))
        values = function(rule.support)
        errors[0, n] = np.abs(rule.interpolation(tau) @ values - function(tau)).max()
        errors[1, n] = np.abs(rule.differentiation @ values - slope(rule.nodes)).max()
        errors[2, n] = abs(rule.weights @ slope(rule.nodes) - (function(1.0) - function(-1.0)))
    for error in errors:
        seen = error > 1e-13  # what is left is rounding
        order = -np.diff(np.log(error[seen])) / np.diff(np.log(degrees[seen]))
        assert len(order) >= 1
        assert (np.diff(order) > 0).all(), f"orders {order} do not grow"
        assert order[-1] > 8
        assert error[-1] < 1e-9


def test_values_become_powers_and_back() -> None:
    for degree in range(1, 9):
        rule = gauss_rule(degree)
        coefficients = np.random.default_rng(degree).normal(size=degree + 1)
        values = np.polyval(coefficients, 0.5 * (rule.support + 1.0))
        np.testing.assert_allclose(rule.power_basis() @ values, coefficients, atol=1e-9)


def test_a_rule_without_nodes_is_a_constant() -> None:
    rule = gauss_rule(0)
    np.testing.assert_array_equal(rule.interpolation(np.array([-1.0, 0.3, 1.0])), np.ones((3, 1)))
    assert rule.weights.size == 0
    with pytest.raises(ValueError, match="0 nodes or more"):
        gauss_rule(-1)
