"""The energy that a plan takes from each vehicle's battery, by momentum theory from the planned controls.

Planned controls include climbs, the planned wind and every turn. Gusts, waiting in the air and slower landings are not
in a plan: the reserve covers them.
"""

from __future__ import annotations

import numpy as np

from gcs.physics.quadrotor import POSITION, Array
from gcs.physics.rotor_power import air_density_kgpm3, drawn_power_W
from gcs.plan.trajectory.plan import Plan

_STEP_S = 0.1
_J_PER_WH = 3600.0


def energy_Wh(plan: Plan) -> Array | None:
    """Energy of each vehicle (V,) from take-off to landing, Wh; None where the scenario does not describe rotors."""
    power = plan.scenario.vehicle.power
    if power is None:
        return None
    t_s = np.linspace(plan.t_start_s, plan.t_end_s, max(2, round((plan.t_end_s - plan.t_start_s) / _STEP_S) + 1))
    inside = np.clip(t_s, plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf))
    density = air_density_kgpm3(plan.scenario.origin.alt_amsl_m - plan.states(inside)[..., POSITION][..., 2])
    drawn_W = drawn_power_W(
        plan.controls(inside), plan.quadrotor, power.rotor_radius_m, power.figure_of_merit, density
    )  # (V, N)
    return np.asarray(np.trapezoid(drawn_W, t_s, axis=-1) / _J_PER_WH)
