"""What holds for every polynomial and every mesh."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.polynomial import Legendre

from gcs.plan.nlp.gauss import gauss_rule
from gcs.plan.nlp.mesh import Mesh, end_refined
from gcs.types import Array

degrees = st.integers(1, 12)
coefficients = st.floats(-10, 10)


@st.composite
def polynomials(draw: st.DrawFn) -> tuple[int, Legendre]:
    """A degree K, and a polynomial of at most that degree."""
    degree = draw(degrees)
    return degree, Legendre(draw(st.lists(coefficients, min_size=1, max_size=degree + 1)))


@given(polynomials())
def test_d_differentiates_and_l_interpolates_every_polynomial_of_its_degree(case: tuple[int, Legendre]) -> None:
    degree, polynomial = case
    rule = gauss_rule(degree)
    values = polynomial(rule.support)
    tau = np.linspace(-1, 1, 17)
    np.testing.assert_allclose(rule.differentiation @ values, polynomial.deriv()(rule.nodes), atol=1e-9)
    np.testing.assert_allclose(rule.interpolation(tau) @ values, polynomial(tau), atol=1e-10)
    # Eq. 46: from -1 to 1 by the derivative at the nodes alone.
    step = rule.weights @ polynomial.deriv()(rule.nodes)
    assert polynomial(-1.0) + step == pytest.approx(polynomial(1.0), abs=1e-9)


@given(degrees)
def test_d_does_not_know_polynomials_of_a_higher_degree(degree: int) -> None:
    rule, beyond = gauss_rule(degree), Legendre.basis(degree + 1)
    missed = rule.differentiation @ beyond(rule.support) - beyond.deriv()(rule.nodes)
    assert np.abs(missed).max() > 0.1


@given(
    st.floats(-100, 100),
    st.floats(0.5, 500),
    st.floats(0.1, 30),
    st.floats(0.05, 5),
)
def test_end_refined_covers_the_flight_and_is_symmetric(
    start: float, length: float, longest: float, first: float
) -> None:
    shortest = min(first, longest)
    mesh = end_refined(start, start + length, longest, shortest, 5)
    assert mesh.joints_s[0] == start
    assert mesh.joints_s[-1] == start + length
    steps = np.diff(mesh.joints_s)
    np.testing.assert_allclose(steps, steps[::-1], rtol=1e-6, atol=1e-9)
    half = steps[: len(steps) // 2]
    assert len(steps) % 2 == 0
    assert steps[0] <= 1.5 * shortest + 1e-9  # a short flight may lend its first step the remainder
    assert steps.max() <= 1.5 * longest + 1e-9
    assert (half[1:-1] <= 1.5 * half[:-2] + 1e-9).all()
    assert (half[1:-1] >= half[:-2] - 1e-9).all()
    assert set(mesh.degrees) == {5}


@st.composite
def meshes(draw: st.DrawFn) -> Mesh:
    steps = draw(st.lists(st.floats(0.1, 20), min_size=1, max_size=8))
    orders = draw(st.lists(st.integers(1, 7), min_size=len(steps), max_size=len(steps)))
    return Mesh(draw(st.floats(-50, 50)) + np.concatenate([[0.0], np.cumsum(steps)]), tuple(orders))


@given(meshes(), st.data())
def test_split_halves_the_named_intervals_and_nothing_else(mesh: Mesh, data: st.DataObject) -> None:
    chosen = data.draw(st.sets(st.integers(0, mesh.intervals - 1)))
    finer = mesh.split(chosen)
    assert finer.intervals == mesh.intervals + len(chosen)
    assert set(mesh.joints_s) <= set(finer.joints_s)
    middles = {0.5 * (mesh.joints_s[i] + mesh.joints_s[i + 1]) for i in chosen}
    assert set(finer.joints_s) - set(mesh.joints_s) == middles
    assert sum(finer.degrees) == sum(mesh.degrees) + sum(mesh.degrees[i] for i in chosen)


@given(meshes(), st.lists(st.floats(-50, 50), max_size=5), st.lists(st.floats(-50, 50), max_size=5))
def test_watching_adds_instants_in_order_and_only_once(mesh: Mesh, first: list[float], second: list[float]) -> None:
    watched = mesh.enforcing_at(np.array(first)).enforcing_at(np.array(second)).enforcing_at(np.array(first))
    assert list(watched.extra_s) == sorted({*first, *second})
    assert watched.split({0}).extra_s is watched.extra_s


@pytest.mark.parametrize(
    ("joints", "orders"), [([0.0, 1.0], (3, 3)), ([0.0, 1.0, 1.0], (3, 3)), ([1.0, 0.0], (3,))], ids=str
)
def test_a_mesh_that_is_none_is_refused(joints: list[float], orders: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="increasing joints and one degree per interval"):
        Mesh(np.array(joints), orders)


@given(st.lists(st.floats(-1, 1), min_size=1, max_size=20).map(np.array), degrees)
@example(np.array([2.2e-313]), 1)  # as near to a node as numbers come
def test_interpolation_keeps_constants(tau: Array, degree: int) -> None:
    np.testing.assert_allclose(gauss_rule(degree).interpolation(tau).sum(axis=1), 1.0, atol=1e-12)
