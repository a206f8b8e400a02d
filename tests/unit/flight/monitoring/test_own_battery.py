"""The factor of a measured hover: recorded currents of a real autopilot, and sensors that are not believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.flight.monitoring.own_battery import ChargeRule, OwnBattery, measured_draw
from gcs.link.wire.message import Message
from gcs.plan.trajectory.energy import BatteryModel, battery_model
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Power

POWER = Power(battery_Wh=76.96, rotor_radius_m=0.127, figure_of_merit=0.55)
MODEL = BatteryModel(np.array([0.0, 1.0]), np.zeros((1, 2)), 0.001, 14.7, np.full(3, 0.3), 76.96 * 3600.0, 0.55)
SIMULATED = OwnBattery(3300.0, 11.1)


@pytest.mark.parametrize(
    ("battery", "power", "current_A", "scale"),
    [
        (SIMULATED, POWER, 28.2, 28.2 / (3.6 * 3300.0) / 0.001),  # recorded of ArduCopter 4.5.6
        (SIMULATED, None, 28.2, 28.2 / (3.6 * 3300.0) / 0.001),
        (OwnBattery(), POWER, 28.2, 28.2 * 12.6 / (3600.0 * 76.96) / 0.001),
        (OwnBattery(), None, 28.2, None),
        (SIMULATED, POWER, -1.0, None),  # recorded of PX4: no sensor
        (SIMULATED, POWER, 0.0, None),
        (SIMULATED, POWER, 2.0, None),  # a sensor that is not set up
    ],
)
def test_the_hover_scales_the_need(
    battery: OwnBattery, power: Power | None, current_A: float, scale: float | None
) -> None:
    found = battery.measured_scale(power, MODEL, current_A, 12.6)
    assert found == (None if scale is None else pytest.approx(scale))


def test_a_voltage_that_is_not_told_measures_nothing_without_a_capacity() -> None:
    """65535 mV stand for "not known": as a voltage they would make the need five times as large."""
    told = [
        Message("SYS_STATUS", {"battery_remaining": 90, "current_battery": 2820, "voltage_battery": volt}, 1, 1)
        for volt in (0xFFFF, 0, 0xFFFF)
    ]
    current_A, volt = measured_draw(told)
    assert OwnBattery().measured_scale(POWER, MODEL, current_A, volt) is None
    assert SIMULATED.measured_scale(POWER, MODEL, current_A, volt) == pytest.approx(28.2 / (3.6 * 3300.0) / 0.001)
    told.append(Message("SYS_STATUS", told[0].fields | {"voltage_battery": 12_600}, 1, 1))
    assert measured_draw(told) == (28.2, 12.6)


def test_what_is_left_is_the_charge_less_the_measured_need_of_the_rest_of_the_plan(simulation1_plan: Plan) -> None:
    plan, model = simulation1_plan, battery_model(simulation1_plan)
    need = float(
        np.interp(plan.t_end_s, model.t_s, model.used[1]) - np.interp(plan.airborne_s, model.t_s, model.used[1])
    )
    rule = ChargeRule(0.25, 1.15, {})
    sysid = plan.sysids[1]
    assert 0.0 < need < model.used[1, -1]
    assert rule.left_at_end(plan, model, sysid, 0.9, 2.0) == pytest.approx(0.9 - 2.0 * need)
    hover = replace(model, full_J=None)  # of hover alone: climbs and wind come on top
    assert rule.left_at_end(plan, hover, sysid, 0.9, 2.0) == pytest.approx(0.9 - 1.15 * 2.0 * need)
