"""The envelope of a relief as a CasADi function.

Knows: B-splines in CasADi, and that they are symbols of another kind (MX) than formulas (SX). Does not know: how the
envelope was made (`gcs.scenario.environment.heightmap`), who is over it.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from gcs.scenario.environment.heightmap import Envelope

_DEGREE = 3


def spline(envelope: Envelope) -> ca.Function:
    """Places (2, K), north and east in m -> heights (1, K) in m; beyond its table the envelope goes on level."""
    count = envelope.coefficients_m.shape
    # In units of the step coefficient i stands at i, and its basis function reaches from i - 2 to i + 2.
    knots = [(np.arange(n + _DEGREE + 1) - 2.0).tolist() for n in count]
    coefficients = envelope.coefficients_m.ravel(order="F").tolist()
    surface = ca.Function.bspline("surface", knots, coefficients, [_DEGREE, _DEGREE], 1)
    place = ca.MX.sym("place", 2)
    index = (place - ca.DM(envelope.first_m)) / envelope.step_m
    inside = ca.fmax(1.0, ca.fmin(index, ca.DM(np.array(count) - 2.0)))
    return ca.Function("ground", [place], [surface(inside)])
