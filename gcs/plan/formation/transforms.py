"""The paper's changes of shape (§2.2.1-2.2.3) on [0, 1]: rotate, shrink, straight to new places; Eqs. 5-14.

Offsets are from the leader, which stays at their origin. Every centre of rotation or shrinking gives the same offsets,
so there is none here.
"""

import math

import numpy as np
from scipy.interpolate import PPoly

from gcs.plan.formation.shape import Shape
from gcs.plan.formation.time_scaling import smooth_step
from gcs.types import Array

# Derivatives, the value included, in which neighbouring polynomials agree at a joint.
_MEET = 6
# So many pieces, and one more per such angle, have errors below 1e-12 (the tests compare with the closed form).
_PIECES = 8
_PIECE_RAD = math.pi / 9.0


def straight(offsets_ned_m: Array, targets_ned_m: Array) -> Shape:
    """The shape in which every vehicle flies straight from its offset (V, 3) to its target (V, 3), in step."""
    step = smooth_step()
    back = -step.c
    back[-1] += 1.0
    functions = PPoly(np.stack([back, step.c], axis=2), step.x)
    return Shape(functions, np.stack([offsets_ned_m, targets_ned_m]).astype(float))


def shrinking(offsets_ned_m: Array, scale: float) -> Shape:
    """The shape that scales offsets (V, 3) from 1 to `scale` (§2.2.2)."""
    step = smooth_step()
    size = (scale - 1.0) * step.c
    size[-1] += 1.0
    return Shape(PPoly(size[:, :, None], step.x), np.asarray(offsets_ned_m, dtype=float)[None])


def rotation(offsets_ned_m: Array, axis_ned: Array, angle_rad: float) -> Shape:
    """The shape that rotates offsets (V, 3) as one rigid body about an axis (3,), right-handed (§2.2.1, Rodrigues)."""
    turned = PPoly(*_cos_sin(angle_rad))
    ones = np.zeros((turned.c.shape[0], turned.c.shape[1], 1))
    ones[-1] = 1.0
    functions = PPoly(np.concatenate([ones, turned.c], axis=2), turned.x)
    return Shape(functions, np.stack(_parts(offsets_ned_m, axis_ned)))


def rotated(offsets_ned_m: Array, axis_ned: Array, angle_rad: float) -> Array:
    """Offsets (V, 3) after the whole rotation."""
    along, across, ahead = _parts(offsets_ned_m, axis_ned)
    return along + math.cos(angle_rad) * across + math.sin(angle_rad) * ahead


def reshape_paths_m(offsets_ned_m: Array, targets_ned_m: Array) -> Array:
    """Length of each vehicle's straight path (V,)."""
    return np.asarray(np.linalg.norm(targets_ned_m - offsets_ned_m, axis=1))


def paper_time_s(paths_m: Array, v_max_mps: float) -> float:
    """Eqs. 8, 12, 14: the time of the longest path at constant greatest speed."""
    return float(paths_m.max() / v_max_mps)


def paper_rotation_time_s(offsets_ned_m: Array, axis_ned: Array, angle_rad: float, v_max_mps: float) -> float:
    """Eqs. 5-8: the paper's least time of a rotation, s; by distances to the axis, printed are those to a point."""
    _, across, _ = _parts(offsets_ned_m, axis_ned)
    return paper_time_s(abs(angle_rad) * np.linalg.norm(across, axis=1), v_max_mps)


def paper_shrink_time_s(offsets_ned_m: Array, scale: float, v_max_mps: float) -> float:
    """Eqs. 9-12: the paper's least time of a shrink, s: (1 - scale) of the distance that the paper counts whole."""
    return paper_time_s(abs(1.0 - scale) * np.linalg.norm(offsets_ned_m, axis=1), v_max_mps)


def paper_reshape_time_s(offsets_ned_m: Array, targets_ned_m: Array, v_max_mps: float) -> float:
    """Eqs. 13, 14: the paper's least time of a reshape, s."""
    return paper_time_s(reshape_paths_m(offsets_ned_m, targets_ned_m), v_max_mps)


def _parts(offsets_ned_m: Array, axis_ned: Array) -> tuple[Array, Array, Array]:
    """Of each offset the part along the axis, that across, and that one turned by 90° about the axis; (V, 3) each."""
    axis = np.asarray(axis_ned, dtype=float)
    axis = axis / np.linalg.norm(axis)
    along = (offsets_ned_m @ axis)[:, None] * axis
    return along, offsets_ned_m - along, np.cross(axis, offsets_ned_m)


def _cos_sin(angle_rad: float) -> tuple[Array, Array]:
    """Coefficients (2 _MEET, P, 2) and joints (P + 1,) of cos and sin of `angle_rad` times the step.

    Neighbours share their first _MEET derivatives at a joint. The lower half of a piece's coefficients is its Taylor
    series at the left joint. The upper half corrects the right joint by a small amount, so rounding stays small too.
    """
    pieces = _PIECES + math.ceil(abs(angle_rad) / _PIECE_RAD)
    joints = np.linspace(0.0, 1.0, pieces + 1)
    width = 1.0 / pieces
    n = np.arange(_MEET)
    taylor = _turn_series(angle_rad, joints) * width**n  # in units of a piece's length
    falling = np.array([[math.perm(power, k) for power in range(2 * _MEET)] for k in range(_MEET)], dtype=float)
    at_right = taylor[1:] * np.array([math.factorial(k) for k in range(_MEET)])
    missing = at_right - taylor[:-1] @ falling[:, :_MEET].T
    upper = np.linalg.solve(falling[:, _MEET:], missing.T).T
    series = np.concatenate([taylor[:-1], upper], axis=1) / width ** np.arange(2 * _MEET)  # (P, 2 _MEET)
    highest_first = series[:, ::-1].T
    return np.stack([highest_first.real, highest_first.imag], axis=2), joints


def _turn_series(angle_rad: float, joints: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.complex128]]:
    """Taylor coefficients (P + 1, _MEET) of exp(i angle s(r)) at the joints: e' = i angle s' e, term by term."""
    step = smooth_step()
    s = np.stack([step(joints, nu=k) / math.factorial(k) for k in range(_MEET)], axis=1)
    s[-1, 1:4] = 0.0  # rest at the end is exact
    turn = np.zeros(s.shape, dtype=complex)
    turn[:, 0] = np.exp(1j * angle_rad * s[:, 0])
    for k in range(1, _MEET):
        terms = sum(m * s[:, m] * turn[:, k - m] for m in range(1, k + 1))
        turn[:, k] = 1j * angle_rad / k * terms
    return turn
