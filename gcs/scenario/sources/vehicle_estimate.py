"""A vehicle file from what its owner knows: mass, size, propellers, hover throttle and battery.

Everything else is estimated, and its line in the file says from what and how far off it may be. A log of one flight is
better than any of these estimates.
"""

import json
import math
import re
import tempfile
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from gcs.errors import ScenarioError, UsageError
from gcs.physics.quadrotor import AIR_DENSITY_KGPM3, induced_power_W
from gcs.scenario.sources.load import load_vehicle
from gcs.scenario.sources.template import filled_line

INCH_M = 0.0254
GRAVITY_MPS2 = 9.8
CELL_V = 3.7  # nominal, as in the presets
HOVER_THROTTLE = 0.5  # where it is not known: thrust twice the weight, as that of the presets
MERIT_SPREAD = 0.25  # of the published flights in tests/unit/scenario/sources/test_vehicle_estimate.py
_SIZE_PER_PROPELLER = 1.75  # frames sold for 5 to 15 inches: 1.7 to 2.0 diameters from motor to motor
_THRUST_SHARE = 0.95  # of full throttle, so that four rotors reach it
_LEAST_THRUST = 0.2  # of the weight: faster descents fall into their own wake
_C_T, _MOMENT_ARM = 0.10, 0.065  # T = C_T rho n^2 D^4; moment over thrust, in diameters
_INERTIA = 0.21, 0.42  # about x and y, and about z, in m l^2
_DRAG_PER_S = 0.2  # of the mass
_ROLL_RADPS2, _YAW_RADPS2 = 4.6, 2.0  # what quad500 plans with
_BATTERY = re.compile(r"(\d+)\s*s\D{0,3}?\s*(\d+(?:[.,]\d+)?)\s*(mah|ah)?(?:\s*\d+\s*c)?", re.IGNORECASE)
_ENERGY = re.compile(r"(\d+(?:[.,]\d+)?)\s*wh", re.IGNORECASE)
_AH_MOST = 100.0  # a capacity without a unit is in mAh from here on


@dataclass(frozen=True)
class BatteryPack:
    """Energy and nominal voltage of a full battery. `battery_V` is None where only the energy is known."""

    battery_Wh: float
    battery_V: float | None = None


def parse_battery(text: str) -> BatteryPack:
    """The battery in a text such as `4S 3300 mAh`, `6S 10 Ah` or `48.8 Wh`. Raises `UsageError` for any other."""
    words = text.strip()
    if found := _ENERGY.fullmatch(words):
        return BatteryPack(_number(found[1]))
    if (found := _BATTERY.fullmatch(words)) and int(found[1]):
        cells, capacity, unit = int(found[1]), _number(found[2]), (found[3] or "").lower()
        amp_hours = capacity / 1000.0 if unit == "mah" or (not unit and capacity >= _AH_MOST) else capacity
        return BatteryPack(round(cells * CELL_V * amp_hours, 3), round(cells * CELL_V, 3))
    raise UsageError(f"--battery {text[:40]}: not a battery", hint='write for example --battery "4S 3300mAh"')


def _number(text: str) -> float:
    return float(text.replace(",", "."))


@dataclass(frozen=True)
class KnownVehicle:
    """What the owner of a quadrotor knows. `arm_m` None: a usual frame for the propellers. `hover_W` was measured."""

    mass_kg: float
    rotor_radius_m: float
    battery: BatteryPack
    arm_m: float | None = None
    hover_throttle: float | None = None
    hover_W: float | None = None
    autopilot: str | None = None

    @property
    def weight_N(self) -> float:
        """The weight of the whole vehicle, with its battery."""
        return self.mass_kg * GRAVITY_MPS2

    @property
    def ideal_W(self) -> float:
        """The power of four ideal rotors in hover at sea level."""
        return 4.0 * float(induced_power_W(self.weight_N / 4.0, self.rotor_radius_m))

    @property
    def figure_of_merit(self) -> float:
        """Ideal power over the battery's in hover: measured, or else what is usual for propellers of this size."""
        if self.hover_W is not None:
            return self.ideal_W / self.hover_W
        return min(0.21 + 0.014 * 2.0 * self.rotor_radius_m / INCH_M, 0.5)

    @property
    def hover_s(self) -> tuple[float, float]:
        """The least and the greatest time that a full battery hovers, to the last drop."""
        spread = MERIT_SPREAD if self.hover_W is None else 0.0
        full_J = 3600.0 * self.battery.battery_Wh * self.figure_of_merit
        return full_J * (1.0 - spread) / self.ideal_W, full_J * (1.0 + spread) / self.ideal_W


def vehicle_text(name: str, known: KnownVehicle) -> str:
    """The text of a vehicle file. Raises `UsageError` for a vehicle that the rules of physics refuse."""
    text = _text(name, known)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "vehicle.toml"
        file.write_text(text, encoding="utf-8")
        try:
            load_vehicle(file)
        except ScenarioError as mistakes:
            step = "look at --mass, --propeller, --size and --hover-throttle"
            raise UsageError(f"such a vehicle is not possible: {mistakes.reason}", hint=step) from None
    return text


def _text(name: str, known: KnownVehicle) -> str:
    diameter_m = 2.0 * known.rotor_radius_m
    arm_m = known.arm_m or 0.5 * _SIZE_PER_PROPELLER * diameter_m
    throttle = known.hover_throttle or HOVER_THROTTLE
    most_N = known.weight_N / throttle
    thrust_coeff = _C_T * AIR_DENSITY_KGPM3 * diameter_m**4 / (2.0 * math.pi) ** 2
    level, upright = (share * known.mass_kg * arm_m**2 for share in _INERTIA)
    battery_V = known.battery.battery_V
    low_min, high_min = (f"{hover_s / 60.0:.0f}" for hover_s in known.hover_s)
    if known.hover_W is not None:
        merit_is = f"measured: {known.hover_W:g} W in hover"
    else:
        times = f"{1.0 - MERIT_SPREAD:g} to {1.0 + MERIT_SPREAD:g} times"
        merit_is = f"{times}: usual for this diameter, with motors, ESCs and electronics"
    numbers = {
        "ARM": arm_m,
        "LEVEL": level,
        "UPRIGHT": upright,
        "THRUST_COEFF": thrust_coeff,
        "MOMENT_COEFF": _MOMENT_ARM * diameter_m * thrust_coeff,
        "DRAG": _DRAG_PER_S * known.mass_kg,
        "ROTOR_MAX": math.sqrt(most_N / 4.0 / thrust_coeff),
        "MERIT": known.figure_of_merit,
        "LEAST": _LEAST_THRUST * known.weight_N,
        "MOST": _THRUST_SHARE * most_N,
        "ROLL": _ROLL_RADPS2 * level / arm_m,
        "YAW": _YAW_RADPS2 * upright,
    }
    keys = {
        **{key: repr(float(f"{value:.3g}")) for key, value in numbers.items()},
        "NAME": json.dumps(name, ensure_ascii=False)[1:-1],
        "AUTOPILOT": f'autopilot = "{known.autopilot}"' if known.autopilot else "# autopilot = the scenario's",
        "MASS": repr(float(known.mass_kg)),
        "INCHES": f"{diameter_m / INCH_M:.3g}",
        "RADIUS": repr(round(known.rotor_radius_m, 5)),
        "ENERGY": repr(known.battery.battery_Wh),
        "VOLTS": f"battery_V = {battery_V!r}" if battery_V else "# battery_V =",
        "GRAVITY": repr(GRAVITY_MPS2),
        "HOVER_MIN": low_min if low_min == high_min else f"{low_min} to {high_min}",
        "ARM_IS": "" if known.arm_m else f"; not given: {_SIZE_PER_PROPELLER:g} propeller diameters are usual",
        "C_T": f"{_C_T:g}",
        "MOMENT_ARM": f"{_MOMENT_ARM:g}",
        "DRAG_SHARE": f"{_DRAG_PER_S:g}",
        "TILT": f"{math.degrees(math.atan(_DRAG_PER_S * 5.0 / GRAVITY_MPS2)):.0f}",
        "LIFT": f"{1.0 / throttle:.3g}",
        "THROTTLE": f"{100.0 * throttle:.3g}",
        "THROTTLE_IS": "" if known.hover_throttle else ", not given",
        "MERIT_IS": merit_is,
    }
    text = (files("gcs.scenario.sources") / "template_vehicle.toml").read_text(encoding="utf-8")
    return "\n".join(filled_line(line, keys) for line in text.split("\n"))
