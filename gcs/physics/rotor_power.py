"""What rotors draw: the ideal power of momentum theory over a figure of merit, in air as thin as it is.

Knows: hovering rotors, the standard atmosphere. Does not know: vehicles, batteries, plans.
A rotor that pushes with thrust T through a disk of area A moves air at v = sqrt(T / (2 ρ A)) and takes T v =
T^(3/2) / sqrt(2 ρ A); propeller, motor and speed controller together take that over their figure of merit. Inflow from
climbing and forward flight is left out: below 6 m/s it changes less than nobody knows of the figure of merit.
"""

from __future__ import annotations

import numpy as np

from gcs.physics.quadrotor import Array, Quadrotor, rotors_from_control

AIR_DENSITY_KGPM3 = 1.225  # at the sea, 15 degrees
_LAPSE_PM, _EXPONENT = 2.25577e-5, 4.25588


def air_density_kgpm3(alt_amsl_m: Array | float) -> Array:
    """Standard atmosphere (ISO 2533) up to 11 km: (...) -> (...)."""
    return np.asarray(AIR_DENSITY_KGPM3 * (1.0 - _LAPSE_PM * np.asarray(alt_amsl_m)) ** _EXPONENT)


def induced_power_W(
    thrust_N: Array | float, radius_m: float, density_kgpm3: Array | float = AIR_DENSITY_KGPM3
) -> Array:
    """Ideal power of one rotor that pushes with thrust (...) N, W."""
    return np.asarray(np.asarray(thrust_N) ** 1.5 / np.sqrt(2.0 * np.asarray(density_kgpm3) * np.pi * radius_m**2))


def drawn_power_W(
    control: Array,
    q: Quadrotor,
    radius_m: float,
    figure_of_merit: float,
    density_kgpm3: Array | float = AIR_DENSITY_KGPM3,
) -> Array:
    """What the four rotors of Eq. 2 draw together for controls (..., 4), W (...)."""
    thrust_N = q.thrust_coeff_Ns2 * np.square(rotors_from_control(control, q))  # (..., 4)
    density = np.broadcast_to(density_kgpm3, thrust_N.shape[:-1])[..., None]
    return np.asarray(np.sum(induced_power_W(thrust_N, radius_m, density), axis=-1) / figure_of_merit)
