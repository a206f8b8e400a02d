"""A fleet of bodies: motors, plant, wind, sensors, estimators and controllers of V vehicles, stepped as one batch.

The true state goes to the sensors and to the assessment of a flight, never to the controller. Inside, arrays have
components first, (12, V), so that a component is one contiguous row; outside, vehicles come first.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.physics.quadrotor import Quadrotor
from gcs.types import Array
from sim_bridge.dynamics.battery import Battery, PowerTrain
from sim_bridge.dynamics.controller import Controller
from sim_bridge.dynamics.estimator import Estimator
from sim_bridge.dynamics.failures import Effects, Failure
from sim_bridge.dynamics.lqr_gains import ControlLimits, motor_limits
from sim_bridge.dynamics.plant import Ground, Mask, Motors, Plant
from sim_bridge.dynamics.presets import power_train_of
from sim_bridge.dynamics.sensors import BARO_PERIOD_S, GNSS_PERIOD_S, INERTIAL_PERIOD_S, SensorGrade, Sensors
from sim_bridge.dynamics.wind_field import CALM, GUST_PERIOD_S, Wind, WindField

CONTROL_PERIOD_S = INERTIAL_PERIOD_S
_STEPS_PER_S = round(1.0 / CONTROL_PERIOD_S)
_STEPS_PER_UPDATE = round(BARO_PERIOD_S / CONTROL_PERIOD_S)
_STEPS_PER_GNSS = round(GNSS_PERIOD_S / CONTROL_PERIOD_S)
_STEPS_PER_GUST = round(GUST_PERIOD_S / CONTROL_PERIOD_S)


@dataclass(frozen=True)
class Craft:
    """What all vehicles of one type are: the body, the controls that their autopilots use (Eq. 51), and the battery."""

    quadrotor: Quadrotor
    limits: ControlLimits | None = None  # None: all that the motors can do
    power: PowerTrain | None = None  # None: that of the preset, or typical for the size


class Airframes:
    """V vehicles of one type. The same seed and the same inputs give the same flight, bit for bit.

    `battery`: consumption and charge of every vehicle. `sensors` of one `grade`, `estimator` and `controller` are open
    to inspection.
    """

    def __init__(
        self,
        craft: Craft,
        ground_height_m: Ground,
        pads_ned_m: Array,
        yaw_ned_rad: Array,
        grade: SensorGrade,
        *,
        seed: int,
        wind: Wind = CALM,
    ) -> None:
        """Stand the vehicles on the ground, motors off, below or above pads (V, 3), with yaw (V,).

        `ground_height_m` maps north and east (V,) to height (V,). Raises ValueError if shapes disagree or the thrust
        cannot lift the vehicle.
        """
        vehicles = len(pads_ned_m)
        if pads_ned_m.shape != (vehicles, 3) or yaw_ned_rad.shape != (vehicles,):
            raise ValueError(f"pads {pads_ned_m.shape} and yaw {yaw_ned_rad.shape} must be (V, 3) and (V,)")
        quadrotor = craft.quadrotor
        self._plant = Plant(quadrotor, ground_height_m, pads_ned_m, yaw_ned_rad, CONTROL_PERIOD_S)
        self._motors = Motors(quadrotor)
        self._wind_field = WindField(wind, pads_ned_m, seed)
        self.grade = grade
        self.rotor_max_radps = quadrotor.rotor_max_radps
        self.sensors = Sensors(grade, vehicles, seed)
        self.estimator = Estimator(grade, vehicles, quadrotor.gravity_mps2)
        self.controller = Controller(quadrotor, craft.limits or motor_limits(quadrotor), vehicles, CONTROL_PERIOD_S)
        self.battery = Battery(craft.power or power_train_of(quadrotor), quadrotor, vehicles)
        self._failures: list[Sequence[Failure]] = [()] * vehicles
        self._failures_changed = False
        self._strength: Array | None = None  # (4, V) of the motors; None if all have full thrust
        self._steps = 0
        self._still = np.zeros((4, vehicles))
        self._rotors = self._commanded = self._applied = self._still
        self._fault_wind: Array | None = None  # (3, V) added to the field by faults
        self._wind = self._draw_wind()
        self._gnss = np.full((6, vehicles), np.nan)

    @property
    def t_s(self) -> float:
        """The time since construction, counted in control periods."""
        return self._steps / _STEPS_PER_S

    @property
    def truth(self) -> Array:
        """True states (V, 12), for assessment and sensors only."""
        return self._plant.state.T

    @property
    def control(self) -> Array:
        """Controls (V, 4) that the rotors produced in the last step."""
        return self._applied.T

    @property
    def rotors_radps(self) -> Array:
        """Rotor speeds (V, 4) in the last step."""
        return self._rotors.T

    @property
    def wind_ned_mps(self) -> Array:
        """True wind (V, 3)."""
        return self._wind.T

    @property
    def estimate(self) -> Array:
        """Estimated states (V, 12): all that an autopilot knows."""
        return self.estimator.state.T

    @property
    def landed(self) -> Mask:
        """Vehicles (V,) in contact with the ground."""
        return self._plant.landed

    @property
    def gnss_ned(self) -> Array:
        """The last GNSS measurements (V, 6): position (m) and velocity (m/s), NaN without a fix."""
        return self._gnss.T

    @property
    def gnss_fix(self) -> Mask:
        """Vehicles (V,) whose receiver has a fix now."""
        return ~self.sensors.effects.gnss_lost

    @property
    def healthy(self) -> Mask:
        """Vehicles (V,) whose filter has converged, agrees with its sensors and is sure of its position."""
        return self.estimator.healthy

    def fail(self, row: int, failures: Sequence[Failure]) -> None:
        """Let these failures of one vehicle act from the next step on, in place of those before."""
        if failures != self._failures[row]:
            self._failures[row] = failures
            self._failures_changed = True

    def step(self, reference: Array, motors_on: Mask) -> None:
        """Advance by CONTROL_PERIOD_S along a reference (V, 5, 4): command from the estimate, move, measure, estimate.

        Motors do not turn where `motors_on` (V,) is False, nor before the filter is aligned (2 s).
        """
        if self._failures_changed:
            self._apply_failures()
        if self._steps % _STEPS_PER_GUST == 0:
            self._wind = self._draw_wind()
        plant, estimator = self._plant, self.estimator
        self._step_rotors(reference, motors_on & estimator.aligned)
        plant.step(self._applied, self._wind)
        inertial = self.sensors.read_inertial(plant.state, plant.specific_force_mps2)
        estimator.propagate(inertial, plant.landed, any_landed=plant.any_landed)
        self._steps += 1
        if self._steps % _STEPS_PER_UPDATE == 0:
            sensors, truth, landed = self.sensors, plant.state, plant.landed
            if self._steps % _STEPS_PER_GNSS == 0:
                self._gnss = sensors.read_gnss(truth)
                estimator.update(landed, sensors.read_baro(truth), gnss=self._gnss)
            else:
                estimator.update(landed, sensors.read_baro(truth), compass=sensors.read_compass(truth))
            if self.battery.empty.any():
                self._update_motor_strength()

    def _step_rotors(self, reference: Array, spin: Mask) -> None:
        """Compute the rotor speeds of this step, and draw their energy."""
        turning = spin.all()
        if not turning and not spin.any():
            self._rotors = self._commanded = self._applied = squared = self._still
        else:
            plant = self._plant
            wanted = self.controller.command(
                reference, self.estimator.state, self._commanded, plant.landed, any_landed=plant.any_landed
            )
            squared, self._rotors, free = self._motors.speeds(wanted)
            if not turning:
                squared, self._rotors = squared * spin, self._rotors * spin
            self._commanded = wanted if free and turning else self._motors.control(squared)
            weak = self._strength
            self._applied = self._commanded if weak is None else self._motors.control(squared * weak)
        self.battery.draw(self._rotors, squared, CONTROL_PERIOD_S)

    def _apply_failures(self) -> None:
        self._failures_changed = False
        effects = Effects.of(self._failures)
        self.battery.drain(effects.remaining)
        self.sensors.suffer(effects)
        self.controller.slow_down(effects.speed_max_mps)
        self._plant.push(effects.push_ned_mps2.T.copy() if effects.push_ned_mps2.any() else None)
        self._fault_wind = effects.wind_ned_mps.T if effects.wind_ned_mps.any() else None
        self._update_motor_strength()

    def _draw_wind(self) -> Array:
        drawn = self._wind_field.draw(-self._plant.state[2])
        return drawn if self._fault_wind is None else drawn + self._fault_wind

    def _update_motor_strength(self) -> None:
        strength = self.sensors.effects.motor_strength.T * ~self.battery.empty
        self._strength = None if strength.min() == 1.0 else strength
