"""Power consumption of the rotors, and the state of the battery.

A rotor's power (`gcs.physics.quadrotor`) follows momentum theory of hover. At constant air density it is a constant
times the cube of its speed, because Eq. 2 has T = K_T Ω². The air density is that at sea level.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from gcs.physics.quadrotor import Quadrotor, induced_power_W
from gcs.scenario.schema.scenario import Power
from gcs.types import Array
from sim_bridge.dynamics.failures import ROTORS
from sim_bridge.dynamics.plant import Mask

SETTLE_PERIOD_S = 0.2  # between two updates of voltage and current
_TYPICAL_HOVER_H = 0.25
_NOMINAL_CELL_V = 3.7

# Open-circuit voltage of one lithium-polymer cell over the remaining share of its charge.
_CHARGE = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
_CELL_V = np.array([3.27, 3.61, 3.69, 3.73, 3.77, 3.79, 3.82, 3.87, 3.92, 4.0, 4.08, 4.2])


@dataclass(frozen=True, slots=True)
class PowerTrain:
    """Propellers, motors and battery of one type of vehicle."""

    propeller_radius_m: float
    efficiency: float  # ideal power of momentum theory over power drawn
    avionics_W: float
    cells: int
    capacity_Ah: float
    resistance_ohm: float

    @classmethod
    def typical(cls, q: Quadrotor) -> PowerTrain:
        """Return the power train of an undescribed vehicle: propeller radius 0.508 times the arm, 15 min of hover."""
        cells = 3 if q.mass_kg < 1.0 else 4 if q.mass_kg < 3.0 else 6
        unit = cls(
            propeller_radius_m=0.508 * q.arm_m,
            efficiency=0.55,
            avionics_W=3.0,
            cells=cells,
            capacity_Ah=1.0,
            resistance_ohm=0.0,
        )
        current_A = unit.hover_power_W(q) / (3.8 * cells)
        capacity_Ah = _TYPICAL_HOVER_H * current_A
        return replace(unit, capacity_Ah=capacity_Ah, resistance_ohm=0.02 * cells / capacity_Ah)

    def described(self, power: Power | None) -> PowerTrain:
        """Return the same with the battery and propellers of a scenario."""
        if power is None:
            return self
        return replace(
            self,
            propeller_radius_m=power.rotor_radius_m,
            efficiency=power.figure_of_merit,
            capacity_Ah=power.battery_Wh / (power.battery_V or _NOMINAL_CELL_V * self.cells),
        )

    def cube_coefficient(self, q: Quadrotor) -> float:
        """Return the electrical power of one rotor per cubed speed, W s³."""
        return float(induced_power_W(q.thrust_coeff_Ns2, self.propeller_radius_m)) / self.efficiency

    def hover_power_W(self, q: Quadrotor) -> float:
        """Return the power in hover, W."""
        rotor_radps = math.sqrt(q.weight_N / (ROTORS * q.thrust_coeff_Ns2))
        return ROTORS * self.cube_coefficient(q) * rotor_radps**3 + self.avionics_W


class Battery:
    """The batteries of V vehicles of one type.

    `voltage_V` and `current_A` at the terminals, `power_W` of the rotors, `used_J` of chemical energy, losses included,
    `used_Ah` and `remaining` (share of the charge), each (V,), as of the last update, every SETTLE_PERIOD_S.
    """

    def __init__(self, train: PowerTrain, q: Quadrotor, vehicles: int) -> None:
        """Start with full batteries and motors off."""
        self.train = train
        self._per_cube = train.cube_coefficient(q)
        self._cubes = np.zeros(vehicles)  # ∫ Σ Ω³ dt since the last update
        self._since_s = 0.0
        self.used_J = np.zeros(vehicles)
        self.used_Ah = np.zeros(vehicles)
        self.power_W = np.zeros(vehicles)
        self.current_A = np.zeros(vehicles)
        self.voltage_V = np.zeros(vehicles)
        self.remaining = np.ones(vehicles)
        self._solve()

    @property
    def empty(self) -> Mask:
        """Vehicles (V,) whose charge is used up; their motors stop."""
        return self.used_Ah >= self.train.capacity_Ah

    @property
    def open_circuit_V(self) -> Array:
        """Open-circuit voltage (V,)."""
        return np.asarray(self.train.cells * np.interp(self.remaining, _CHARGE, _CELL_V))

    def draw(self, rotors_radps: Array, squared: Array, step_s: float) -> None:
        """Draw the energy of rotors that turned for `step_s` at speeds (4, V) with these squares."""
        self._cubes += step_s * np.add.reduce(squared * rotors_radps)
        self._since_s += step_s
        if self._since_s >= SETTLE_PERIOD_S - 1e-9:
            self.power_W = self._per_cube * self._cubes / self._since_s
            self._solve()
            self.used_J = self.used_J + self.open_circuit_V * self.current_A * self._since_s
            self._take(self.used_Ah + self.current_A * (self._since_s / 3600.0))
            self._cubes = np.zeros_like(self._cubes)
            self._since_s = 0.0

    def drain(self, remaining: Array) -> None:
        """Limit the remaining charge to these shares (V,)."""
        drained_Ah = (1.0 - remaining) * self.train.capacity_Ah
        if (drained_Ah > self.used_Ah).any():
            self._take(np.maximum(self.used_Ah, drained_Ah))
            self._solve()

    def _take(self, used_Ah: Array) -> None:
        self.used_Ah = used_Ah
        self.remaining = np.maximum(1.0 - used_Ah / self.train.capacity_Ah, 0.0)

    def _solve(self) -> None:
        """Solve for the current that gives the power, P = (V₀ - I R) I, at most the maximum power of the cells."""
        rest, ohm = self.open_circuit_V, self.train.resistance_ohm
        power = self.power_W + self.train.avionics_W
        if ohm > 0.0:
            power = np.minimum(power, rest * rest / (4.0 * ohm))
        spread = np.sqrt(np.maximum(rest * rest - 4.0 * ohm * power, 0.0))
        self.current_A = 2.0 * power / (rest + spread)
        self.voltage_V = rest - ohm * self.current_A
