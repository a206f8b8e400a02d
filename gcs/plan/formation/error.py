"""How far a formation is from its shape (Definition 1), wherever it flies.

Knows: Eq. 4's difference at given instants. Does not know: what makes it converge.
"""

from __future__ import annotations

import numpy as np

from gcs.physics.quadrotor import Array


def formation_errors_m(positions_ned_m: Array, offsets_ned_m: Array) -> Array:
    """|xi_i - h_i - c| of each vehicle (V, N), in m, from positions xi and places h, both (V, N, 3).

    c is the formation's own centre, the mean of xi - h: a formation that flies elsewhere as a whole has no error.
    """
    seen = positions_ned_m - offsets_ned_m
    return np.asarray(np.linalg.norm(seen - seen.mean(axis=0), axis=-1))


def formation_error_m(positions_ned_m: Array, offsets_ned_m: Array) -> Array:
    """The largest of all vehicles' errors (N,), in m; it goes to zero where Eq. 4 holds."""
    return np.asarray(formation_errors_m(positions_ned_m, offsets_ned_m).max(axis=0))
