"""Electrical power of the rotors: the ideal power of momentum theory divided by a figure of merit.

A rotor with thrust T and disk area A in air of density ρ induces v = sqrt(T / (2 ρ A)) and takes T v = T^(3/2) /
sqrt(2 ρ A). Propeller, motor and speed controller together take that divided by their figure of merit. Inflow from
climb and forward flight is neglected: below 6 m/s it changes less than the uncertainty of the figure of merit.
"""

from __future__ import annotations

import numpy as np

from gcs.physics.quadrotor import Array, Quadrotor, rotors_from_control

AIR_DENSITY_KGPM3 = 1.225  # at sea level, 15 degrees C
_LAPSE_PM, _EXPONENT = 2.25577e-5, 4.25588


def air_density_kgpm3(alt_amsl_m: Array | float) -> Array:
    """The air density (...) at altitudes AMSL (...), kg/m^3: standard atmosphere (ISO 2533) up to 11 km."""
    return np.asarray(AIR_DENSITY_KGPM3 * (1.0 - _LAPSE_PM * np.asarray(alt_amsl_m)) ** _EXPONENT)


def induced_power_W(
    thrust_N: Array | float, radius_m: float, density_kgpm3: Array | float = AIR_DENSITY_KGPM3
) -> Array:
    """The ideal power (...) of one rotor with thrust (...) N, W."""
    return np.asarray(np.asarray(thrust_N) ** 1.5 / np.sqrt(2.0 * np.asarray(density_kgpm3) * np.pi * radius_m**2))


def drawn_power_W(
    control: Array,
    q: Quadrotor,
    radius_m: float,
    figure_of_merit: float,
    density_kgpm3: Array | float = AIR_DENSITY_KGPM3,
) -> Array:
    """The power (...) that the four rotors of Eq. 2 draw together at controls (..., 4), W."""
    thrust_N = q.thrust_coeff_Ns2 * np.square(rotors_from_control(control, q))  # (..., 4)
    density = np.broadcast_to(density_kgpm3, thrust_N.shape[:-1])[..., None]
    return np.asarray(np.sum(induced_power_W(thrust_N, radius_m, density), axis=-1) / figure_of_merit)
