"""The smooth envelope of a height map as a CasADi function: a B-spline, which takes MX symbols only.

`gcs.scenario.environment.heightmap` makes the envelope.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from gcs.scenario.environment.heightmap import Envelope

_DEGREE = 3


def spline(envelope: Envelope) -> ca.Function:
    """The function places (2, K), north and east in m -> heights (1, K) in m; constant beyond the edge of its table."""
    count = envelope.coefficients_m.shape
    # In units of the step, coefficient i is at i, and its basis function reaches from i - 2 to i + 2.
    knots = [(np.arange(n + _DEGREE + 1) - 2.0).tolist() for n in count]
    coefficients = envelope.coefficients_m.ravel(order="F").tolist()
    surface = ca.Function.bspline("surface", knots, coefficients, [_DEGREE, _DEGREE], 1)
    place = ca.MX.sym("place", 2)
    index = (place - ca.DM(envelope.first_m)) / envelope.step_m
    inside = ca.fmax(1.0, ca.fmin(index, ca.DM(np.array(count) - 2.0)))
    return ca.Function("ground", [place], [surface(inside)])
