"""Ground height of Eqs. 52, 53 or an elevation model: exact for the verifier, a smooth envelope for the optimiser.

`xp` supplies the functions of the formulas (NumPy or CasADi). The envelope of an elevation model is a spline;
`gcs.plan.ocp.stage_functions` makes its symbols.
"""

from typing import Any

import numpy as np

from gcs.scenario.schema.scenario import Mountains, Ripple, Terrain
from gcs.types import Array, Scalar

# Half width of the rounded corner where the envelope passes from ripple to mountain.
ENVELOPE_ROUNDING_M = 0.25


def ground_height_m(terrain: Terrain, north_m: Array, east_m: Array) -> Array:
    """Exact height (...) of the ground above height 0: the relief, or max(Eq. 52, Eq. 53)."""
    if terrain.relief is not None:
        return terrain.relief.height_m(north_m, east_m)
    mountains = mountain_height_m(terrain.mountains, north_m, east_m)
    if terrain.ripple is None:
        return np.asarray(mountains + np.zeros_like(north_m))
    return np.asarray(np.maximum(ripple_height_m(terrain.ripple, north_m, east_m), mountains))


def ripple_height_m(ripple: Ripple, north_m: Array, east_m: Array) -> Array:
    """Eq. 52."""
    return np.asarray(np.abs(ripple_wave_m(ripple, north_m, east_m)))


def ripple_wave_m(ripple: Ripple, north_m: Array, east_m: Array) -> Array:
    """Eq. 52 without its absolute value."""
    r = np.hypot(north_m, east_m)
    waves = np.sin(east_m + ripple.a) + ripple.b * np.sin(north_m) + ripple.c * np.cos(ripple.d * r)
    return np.asarray(waves + ripple.e * np.cos(east_m) + ripple.f * np.sin(ripple.g * r))


def ripple_peak_m(ripple: Ripple) -> float:
    """A height Eq. 52 never exceeds: the amplitude of its east terms plus those of the others."""
    east = np.hypot(np.cos(ripple.a), np.sin(ripple.a) + ripple.e)
    return float(east + abs(ripple.b) + abs(ripple.c) + abs(ripple.f))


def mountain_height_m(mountains: Mountains, north_m: Scalar, east_m: Scalar, xp: Any = np) -> Scalar:
    """Eq. 53, on arrays or on symbols."""
    total: Scalar = 0.0 * north_m  # of the caller's shape, mountains or none
    for height, north, east, spread_n, spread_e in mountains.rows:
        total = total + height * xp.exp(-(((north_m - north) / spread_n) ** 2) - ((east_m - east) / spread_e) ** 2)
    return total


def ground_envelope_m(terrain: Terrain, north_m: Scalar, east_m: Scalar, xp: Any = np) -> Scalar:
    """A twice differentiable height that is nowhere below the ground.

    Nodes stand metres apart and cannot see a ripple of 6 m wavelength, so the ripple counts with its peak
    everywhere; the corner between peak and mountain is rounded upwards. A relief has its own envelope, for arrays only.
    """
    if terrain.relief is not None:
        return terrain.relief.envelope.height_m(north_m, east_m)
    mountains = mountain_height_m(terrain.mountains, north_m, east_m, xp)
    if terrain.ripple is None:
        return mountains
    rise = mountains - ripple_peak_m(terrain.ripple)
    return ripple_peak_m(terrain.ripple) + 0.5 * (rise + xp.sqrt(rise * rise + ENVELOPE_ROUNDING_M**2))
