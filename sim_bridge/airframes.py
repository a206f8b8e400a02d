"""A fleet of bodies: motors, plant, sensors, estimators and controllers of V vehicles, stepped as one batch.

Knows: the order of things within one control period. Does not know: modes, missions, messages, where
references come from. Truth flows to the sensors and to whoever judges a flight, never to the controller.
"""

from __future__ import annotations

import numpy as np

from gcs.quadrotor import Array, Quadrotor, control_from_rotors, rotors_from_control
from sim_bridge.battery import Battery, PowerTrain
from sim_bridge.breakdowns import Breakdowns
from sim_bridge.control import Controller
from sim_bridge.estimator import Accuracy, Estimator, Ratios
from sim_bridge.gains import ControlLimits, motor_limits
from sim_bridge.plant import Ground, Mask, Plant
from sim_bridge.presets import power_train_of
from sim_bridge.reference import Reference
from sim_bridge.sensors import GNSS_PERIOD_S, INERTIAL_PERIOD_S, SensorGrade, Sensors

CONTROL_PERIOD_S = 0.01
_STEPS_PER_INERTIAL = round(INERTIAL_PERIOD_S / CONTROL_PERIOD_S)
_STEPS_PER_GNSS = round(GNSS_PERIOD_S / CONTROL_PERIOD_S)


class Airframes:
    """V vehicles of one type. The same seed and the same inputs give the same flight, bit for bit.

    Attributes: `control` (V, 4) and `rotors_radps` (V, 4) as last applied; `wind_ned_mps` (V, 3), which may be
    replaced between steps; `faults`, one schedule of breakdowns per vehicle (`sim_bridge.breakdowns`); `battery`, what
    every vehicle draws and has left; `sensors` and `estimator`, for those who study them.
    """

    def __init__(
        self,
        quadrotor: Quadrotor,
        ground_height_m: Ground,
        pads_ned_m: Array,
        yaw_ned_rad: Array,
        grade: SensorGrade,
        *,
        seed: int,
        limits: ControlLimits | None = None,
        power: PowerTrain | None = None,
    ) -> None:
        """Stand the vehicles on the ground, motors off, below or above pads (V, 3), with yaw (V,).

        ground_height_m maps north and east (V,) to height (V,). `limits` are the controls the autopilots
        allow themselves (Eq. 51); without them, all that the motors can do. `power` is by default what presets
        or the size say. Raise ValueError if shapes disagree or the thrust cannot lift the vehicle.
        """
        vehicles = len(pads_ned_m)
        if pads_ned_m.shape != (vehicles, 3) or yaw_ned_rad.shape != (vehicles,):
            raise ValueError(f"pads {pads_ned_m.shape} and yaw {yaw_ned_rad.shape} must be (V, 3) and (V,)")
        limits = limits or motor_limits(quadrotor)
        self._quadrotor = quadrotor
        self._plant = Plant(quadrotor, ground_height_m, pads_ned_m, yaw_ned_rad)
        self.sensors = Sensors(grade, vehicles, seed)
        self.estimator = Estimator(quadrotor, limits, grade, vehicles)
        self._controller = Controller(quadrotor, limits)
        self.faults = Breakdowns(vehicles)
        self._effects = self.faults.effects(0.0)
        self.battery = Battery(power or power_train_of(quadrotor), quadrotor, vehicles)
        self._steps = 0
        self.control = np.zeros((vehicles, 4))
        self.rotors_radps = np.zeros((vehicles, 4))
        self.wind_ned_mps = np.zeros((vehicles, 3))

    @property
    def t_s(self) -> float:
        """Time since construction, counted in control periods."""
        return self._steps * CONTROL_PERIOD_S

    @property
    def truth(self) -> Array:
        """True states (V, 12), for judges and sensors only."""
        return self._plant.state

    @property
    def estimate(self) -> Array:
        """Estimated states (V, 12): all that an autopilot knows."""
        return self.estimator.state

    @property
    def landed(self) -> Mask:
        """Vehicles (V,) in contact with the ground."""
        return self._plant.landed

    @property
    def innovation(self) -> Ratios:
        """Innovation test ratios of the filters; above 1 a measurement was refused."""
        return self.estimator.ratios

    @property
    def accuracy(self) -> Accuracy:
        """Standard deviations of position and velocity, as the filters see them."""
        return self.estimator.accuracy

    @property
    def gnss_fix(self) -> Mask:
        """Vehicles (V,) whose receiver has a fix now."""
        return ~self._effects.gnss_lost

    @property
    def healthy(self) -> Mask:
        """Vehicles (V,) whose filter has converged and agrees with its sensors."""
        return self.estimator.healthy

    def step(self, reference: Reference, motors_on: Mask) -> None:
        """Advance by CONTROL_PERIOD_S: command from the estimate, move, measure, estimate.

        Motors do not turn where motors_on (V,) is False, nor before the filters are aligned (two seconds).
        """
        landed = self._plant.landed
        spin = motors_on & self.estimator.aligned
        wanted = self._controller.command(reference, self.estimator.state, landed)
        self.rotors_radps = rotors_from_control(wanted, self._quadrotor) * spin[:, None]
        self.control = control_from_rotors(self.rotors_radps, self._quadrotor)
        self.battery.draw(self.rotors_radps, CONTROL_PERIOD_S)
        self._plant.step(self.control, self.wind_ned_mps, CONTROL_PERIOD_S)
        self.estimator.propagate(self.control, self._plant.landed, CONTROL_PERIOD_S)
        self._steps += 1
        if self._steps % _STEPS_PER_INERTIAL == 0:
            truth = self._plant.state
            inertial = self.sensors.read_inertial(truth)
            gnss = self.sensors.read_gnss(truth) if self._steps % _STEPS_PER_GNSS == 0 else None
            self.estimator.measure(inertial, gnss, self._plant.landed)
