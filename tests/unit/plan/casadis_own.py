"""The derivatives of a program against CasADi's automatic ones, for tests."""

from __future__ import annotations

import casadi as ca
import numpy as np

from gcs.plan.nlp.transcription import Program
from gcs.types import Array


def assert_casadis_own(program: Program, at_y: Array) -> None:
    """Gradient, Jacobian and Hessian against automatic ones of the whole program."""
    y, p = ca.MX.sym("y", len(program.y_low)), ca.MX.sym("p", 0)
    f, g = program.nlp(y, p)
    sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", g.size1())
    automatic = ca.Function(
        "automatic",
        [y, sigma, lam],
        [ca.gradient(f, y), ca.jacobian(g, y), ca.triu(ca.hessian(sigma * f + ca.dot(lam, g), y)[0])],
    )
    weights = np.random.default_rng(2).normal(size=g.size1())
    gradient, jacobian, hessian = (np.array(ca.DM(part)) for part in automatic(at_y, 0.7, weights))
    assert np.abs(hessian).max() > 0.1  # there is something to compare
    got_f, got_gradient = program.derivatives["grad_f"](at_y, [])
    got_g, got_jacobian = program.derivatives["jac_g"](at_y, [])
    np.testing.assert_allclose(np.array(got_gradient), gradient, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(np.array(ca.DM(got_jacobian)), jacobian, rtol=1e-9, atol=1e-11)
    got_hessian = program.derivatives["hess_lag"](at_y, [], 0.7, weights)
    np.testing.assert_allclose(np.array(ca.DM(got_hessian)), hessian, rtol=1e-8, atol=1e-9)
    np.testing.assert_array_equal(np.array(got_f), np.array(program.nlp(at_y, [])[0]))
    np.testing.assert_array_equal(np.array(got_g), np.array(program.nlp(at_y, [])[1]))
