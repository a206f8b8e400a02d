"""Rules about the physics of a vehicle: it can hover, and its rotors reach the torque limits (Eq. 2).

They check scenarios and vehicle files alike.
"""

import numpy as np

from gcs.physics.quadrotor import Quadrotor, control_from_rotors, hover_trim, rotors_from_control
from gcs.scenario.schema.mistake import Mistake
from gcs.scenario.schema.scenario import ROLL_PITCH_KEYS, Scenario
from gcs.scenario.schema.toml_lines import Key
from gcs.scenario.validation.rule_set import Mistakes, Rules
from gcs.scenario.values.si import quadrotor, torque_limits

_REACHED = 1.0 - 1e-6
SPEED_OF_SOUND_MPS = 340.0
BEST_CELLS_WHPKG = 300.0
_YAW = 2  # row of U_4 among U_2..U_4
_TORQUES = ("U2, rolling", "U3, pitching", "U4, yawing")

RULES = Rules()


def hover_share(model: Quadrotor) -> float:
    """The share of the rotors' full thrust that carries the weight."""
    return model.weight_N / (4 * model.thrust_coeff_Ns2 * model.rotor_max_radps**2)


@RULES.needs("vehicle", "limits")
def _vehicle_hovers(scenario: Scenario) -> Mistakes:
    model = quadrotor(scenario)
    low, high = scenario.limits.thrust_N
    if not low < model.weight_N < high:
        weight = f"the weight is {model.weight_N:.2f} N (vehicle.mass_kg = {model.mass_kg:g})"
        text = f"cannot hover: {weight}, and it must lie between the two thrusts"
        yield Mistake(("limits", "thrust_N"), text, (low, high))
    from_rotors = 4 * model.thrust_coeff_Ns2 * model.rotor_max_radps**2
    if from_rotors < high:
        needed = f"{np.sqrt(high / (4 * model.thrust_coeff_Ns2)):.0f} rad/s"
        text = f"too slow: four rotors lift {from_rotors:.2f} N; limits.thrust_N has {high:g} N and needs {needed}"
        yield Mistake(("vehicle", "rotor_max_radps"), text, model.rotor_max_radps)


@RULES.needs("vehicle", "limits", "wind")
def _wind_is_weaker_than_the_vehicle(scenario: Scenario) -> Mistakes:
    model, limits = quadrotor(scenario), scenario.limits
    if model.wind.is_still or scenario.wind is None:
        return
    highest_m = limits.height_m[1]
    thrust, roll, pitch = hover_trim(highest_m, 0.0, model)
    tilt_deg = float(np.degrees(np.arccos(np.cos(roll) * np.cos(pitch))))
    most_deg = min(limits.roll_pitch_yaw_deg[:2])
    most_N = model.weight_N + (1.0 - limits.control_margin) * (limits.thrust_N[1] - model.weight_N)
    if tilt_deg > most_deg or thrust > most_N:
        needs = f"to hover at {highest_m:g} m the vehicle tilts by {tilt_deg:.1f} degrees and needs {thrust:.2f} N"
        text = f"too strong: {needs}; limits allow {most_deg:g} degrees and the plan {most_N:.2f} N"
        yield Mistake(("wind", "speed_mps"), text, scenario.wind.speed_mps)


@RULES.needs("vehicle", "limits")
def _rotors_give_the_torques(scenario: Scenario) -> Mistakes:
    model = quadrotor(scenario)
    if hover_share(model) >= 1.0:
        return  # another rule reports it
    for axis, most in enumerate(torque_limits(scenario.limits, model.arm_m)):
        wanted = np.array([model.weight_N, 0.0, 0.0, 0.0])
        wanted[axis + 1] = most
        got = float(control_from_rotors(rotors_from_control(wanted, model), model)[axis + 1])
        if got < _REACHED * most:
            limits = scenario.limits
            name = next(key for key in ROLL_PITCH_KEYS if getattr(limits, key) is not None)
            key: Key = (name, axis)
            if axis == _YAW and limits.yaw_moment_Nm is not None:
                key, value = ("yaw_moment_Nm",), limits.yaw_moment_Nm
            else:
                value = getattr(limits, name)[axis]
            text = (
                f"more than the rotors give: while they carry the weight, {_TORQUES[axis]}, reaches "
                f"{got * value / most:.3g} (Eq. 2, rotor_max_radps = {model.rotor_max_radps:g})"
            )
            yield Mistake(("limits", *key), text, value)


@RULES.needs("vehicle")
def _battery_and_propellers_can_be(scenario: Scenario) -> Mistakes:
    power, model = scenario.vehicle.power, quadrotor(scenario)
    if power is None:
        return
    place = ("vehicle", "power")
    apart_m = np.sqrt(2.0) * model.arm_m  # of neighbours' hubs
    if 2.0 * power.rotor_radius_m > apart_m:
        text = f"propellers touch: neighbouring hubs are {apart_m:.3f} m apart (vehicle.arm_m = {model.arm_m:g})"
        yield Mistake((*place, "rotor_radius_m"), text, power.rotor_radius_m)
    tip_mps = power.rotor_radius_m * model.rotor_max_radps
    if tip_mps > SPEED_OF_SOUND_MPS:
        text = f"blade tips faster than sound: {tip_mps:.0f} m/s (vehicle.rotor_max_radps = {model.rotor_max_radps:g})"
        yield Mistake((*place, "rotor_radius_m"), text, power.rotor_radius_m)
    battery_kg = power.battery_Wh / BEST_CELLS_WHPKG
    if battery_kg > model.mass_kg:
        text = f"heavier than the vehicle: good cells weigh {battery_kg:.2f} kg (vehicle.mass_kg = {model.mass_kg:g})"
        yield Mistake((*place, "battery_Wh"), text, power.battery_Wh)
