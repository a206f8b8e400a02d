"""Vehicle presets: body, limits, propellers and battery of known types, for what a scenario leaves out."""

from dataclasses import dataclass
from types import MappingProxyType

from gcs.physics.quadrotor import Quadrotor
from sim_bridge.dynamics.battery import PowerTrain
from sim_bridge.dynamics.lqr_gains import ControlLimits


@dataclass(frozen=True, slots=True)
class VehiclePreset:
    """One type: its body (Eq. 1, Eq. 2), the control limits, and the power train."""

    name: str
    quadrotor: Quadrotor
    limits: ControlLimits
    power: PowerTrain


# Table 1 and Eq. 51. Propellers and battery are not in the paper: 3 inch and 3S 2200 mAh, as such frames have.
F150 = VehiclePreset(
    "f150",
    Quadrotor(
        mass_kg=0.5,
        arm_m=0.075,
        inertia_kgm2=(0.0219, 0.0219, 0.0366),
        thrust_coeff_Ns2=1.105e-5,
        moment_coeff_Nms2=1.779e-7,
        drag_Nspm=(0.073, 0.073, 0.073),
        drag_moment_Nms=(0.0055, 0.0055, 0.0055),
        rotor_max_radps=400.0,
    ),
    ControlLimits(5.2, (0.0501, 0.0501, 0.0209)),
    PowerTrain(0.038, 0.5, 2.0, cells=3, capacity_Ah=2.2, resistance_ohm=0.03),
)

# A 500 mm frame with 10 inch propellers that lifts twice its weight; 4S 5200 mAh.
FIELD = VehiclePreset(
    "field",
    Quadrotor(
        mass_kg=2.0,
        arm_m=0.25,
        inertia_kgm2=(0.0217, 0.0217, 0.040),
        thrust_coeff_Ns2=8.55e-6,
        moment_coeff_Nms2=1.37e-7,
        drag_Nspm=(0.3, 0.3, 0.3),
        drag_moment_Nms=(0.02, 0.02, 0.02),
        rotor_max_radps=1070.0,
    ),
    ControlLimits(38.0, (0.4, 0.4, 0.08)),
    PowerTrain(0.127, 0.55, 4.0, cells=4, capacity_Ah=5.2, resistance_ohm=0.02),
)

PRESETS = MappingProxyType({preset.name: preset for preset in (F150, FIELD)})


def power_train_of(q: Quadrotor) -> PowerTrain:
    """Return the power train of the preset with this body, else one typical for its size."""
    return next((p.power for p in PRESETS.values() if p.quadrotor == q), None) or PowerTrain.typical(q)
