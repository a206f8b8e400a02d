"""The formation error of Definition 1 and Eq. 4: how far the shape is off, wherever the formation flies."""

from __future__ import annotations

import numpy as np

from gcs.physics.quadrotor import Array


def formation_errors_m(positions_ned_m: Array, offsets_ned_m: Array) -> Array:
    """Errors |xi_i - h_i - c| of each vehicle (V, N), m, from positions xi and offsets h, both (V, N, 3).

    c is the formation's own centre, the mean of xi - h: a formation that flies elsewhere as a whole has no error.
    """
    seen = positions_ned_m - offsets_ned_m
    return np.asarray(np.linalg.norm(seen - seen.mean(axis=0), axis=-1))


def formation_error_m(positions_ned_m: Array, offsets_ned_m: Array) -> Array:
    """The formation error (N,), m: the largest error of all vehicles; zero where Eq. 4 holds."""
    return np.asarray(formation_errors_m(positions_ned_m, offsets_ned_m).max(axis=0))
