"""Energy: momentum theory's closed forms, Ohm's law, and a balance that closes."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.physics.quadrotor import AIR_DENSITY_KGPM3
from sim_bridge.dynamics import presets
from sim_bridge.dynamics.battery import SETTLE_PERIOD_S, Battery, PowerTrain
from sim_bridge.dynamics.sensors import RTK
from tests.unit.sim_bridge.flights import FIELD, FIELD_LIMITS, course, fly, stand

PRESETS = list(presets.PRESETS.values())
STEP_S = 0.02


def hover_speeds(q, vehicles=1):
    return np.full((4, vehicles), np.sqrt(q.weight_N / (4.0 * q.thrust_coeff_Ns2)))


def run(battery, rotors, seconds):
    for _ in range(round(seconds / STEP_S)):
        battery.draw(rotors, rotors * rotors, STEP_S)


@pytest.mark.parametrize("preset", PRESETS, ids=lambda p: p.name)
def test_hover_power_is_momentum_theory_over_efficiency(preset):
    """T v_i with the induced velocity v_i = √(T / 2ρA), for each of four rotors."""
    q, train = preset.quadrotor, preset.power
    thrust = q.weight_N / 4.0
    induced = np.sqrt(thrust / (2.0 * AIR_DENSITY_KGPM3 * np.pi * train.propeller_radius_m**2))
    expected = 4.0 * thrust * induced / train.efficiency + train.avionics_W
    np.testing.assert_allclose(train.hover_power_W(q), expected, rtol=1e-12)
    battery = Battery(train, q, 1)
    run(battery, hover_speeds(q), 1.0)
    np.testing.assert_allclose(battery.voltage_V * battery.current_A, expected, rtol=1e-9)
    # Such vehicles hover for a quarter to half an hour.
    assert 0.2 < train.capacity_Ah / battery.current_A[0] < 0.5


@pytest.mark.parametrize("preset", PRESETS, ids=lambda p: p.name)
def test_chemical_energy_is_what_was_used_and_what_heated_the_cells(preset):
    q, train = preset.quadrotor, preset.power
    battery = Battery(train, q, 2)
    rng = np.random.default_rng(3)
    delivered = heat = 0.0
    for _ in range(200):
        rotors = hover_speeds(q, 2) * rng.uniform(0.5, 1.15, size=(4, 2))
        run(battery, rotors, SETTLE_PERIOD_S)
        expected = train.cube_coefficient(q) * (rotors**3).sum(axis=0) + train.avionics_W
        np.testing.assert_allclose(battery.voltage_V * battery.current_A, expected, rtol=1e-9)
        delivered = delivered + expected * SETTLE_PERIOD_S
        heat = heat + train.resistance_ohm * battery.current_A**2 * SETTLE_PERIOD_S
    np.testing.assert_allclose(battery.used_J, delivered + heat, rtol=1e-9)


def test_a_battery_that_hovers_long_enough_is_empty_and_its_voltage_has_fallen():
    preset = presets.FIELD
    battery = Battery(preset.power, preset.quadrotor, 1)
    full_V = battery.voltage_V[0]
    rotors = hover_speeds(preset.quadrotor)
    left, volts = [], []
    while not battery.empty[0]:
        run(battery, rotors, 30.0)
        left.append(battery.remaining[0])
        volts.append(battery.voltage_V[0])
    assert (np.diff(left) < 0.0).all() and (np.diff(volts) < 0.0).all()
    assert left[-1] == 0.0 and battery.used_Ah[0] >= preset.power.capacity_Ah
    assert volts[-1] < 0.8 * full_V
    assert 10.0 < 0.5 * len(volts) < 30.0  # minutes


def test_nothing_draws_more_than_the_cells_can_give():
    preset = presets.F150
    battery = Battery(preset.power, preset.quadrotor, 1)
    run(battery, np.full((4, 1), 5000.0), 1.0)
    np.testing.assert_allclose(battery.voltage_V, battery.open_circuit_V / 2.0, rtol=0.01)


def test_draining_leaves_what_it_says_and_never_fills():
    battery = Battery(presets.F150.power, presets.F150.quadrotor, 3)
    battery.drain(np.array([1.0, 0.2, 1.0]))
    np.testing.assert_allclose(battery.remaining, [1.0, 0.2, 1.0])
    battery.drain(np.array([1.0, 0.9, 1.0]))
    np.testing.assert_allclose(battery.remaining, [1.0, 0.2, 1.0])
    assert battery.voltage_V[1] < battery.voltage_V[0]


@pytest.mark.parametrize("preset", PRESETS, ids=lambda p: p.name)
def test_a_preset_is_known_by_its_body_and_others_by_their_size(preset):
    assert presets.power_train_of(preset.quadrotor) is preset.power
    typical = PowerTrain.typical(preset.quadrotor)
    np.testing.assert_allclose(
        typical.hover_power_W(preset.quadrotor), preset.power.hover_power_W(preset.quadrotor), rtol=0.3
    )


def test_a_flight_draws_from_its_own_battery_only_while_it_flies():
    pads = 5.0 * np.arange(2)[:, None] * np.array([[1.0, 0.0, 0.0]])
    airframes = stand(FIELD, FIELD_LIMITS, RTK, pads, seed=1)
    idle_W = airframes.battery.voltage_V * airframes.battery.current_A
    np.testing.assert_allclose(idle_W, airframes.battery.train.avionics_W, rtol=1e-9)
    fly(airframes, course(yaw_swing_rad=0.0).part(0.0, 12.0), pads)
    power_W = airframes.battery.voltage_V * airframes.battery.current_A
    np.testing.assert_allclose(power_W, airframes.battery.train.hover_power_W(FIELD), rtol=0.05)
    assert (airframes.battery.remaining < 0.995).all()
