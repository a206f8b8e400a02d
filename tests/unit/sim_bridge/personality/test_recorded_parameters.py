"""Recorded parameters that appear twice: in the emulated vehicle's table, and in the navigator that predicts it."""

from __future__ import annotations

import pytest

from gcs.autopilots.traits import Autopilot
from sim_bridge.personality import by_name

# parameter, field of the navigator, unit of the parameter in SI
SAME = [
    ("ardupilot", "WPNAV_ACCEL", "acceleration_mps2", 0.01),
    ("ardupilot", "WPNAV_ACCEL_Z", "vertical_mps2", 0.01),
    ("ardupilot", "WPNAV_JERK", "jerk_mps3", 1.0),
    ("ardupilot", "WPNAV_RADIUS", "radius_m", 0.01),
    ("ardupilot", "WPNAV_SPEED_UP", "climb_mps", 0.01),
    ("ardupilot", "WPNAV_SPEED_DN", "sink_mps", 0.01),
    ("px4", "MPC_ACC_HOR", "acceleration_mps2", 1.0),
    ("px4", "MPC_ACC_UP_MAX", "up_mps2", 1.0),
    ("px4", "MPC_ACC_DOWN_MAX", "down_mps2", 1.0),
    ("px4", "MPC_JERK_AUTO", "jerk_mps3", 1.0),
    ("px4", "MPC_XY_TRAJ_P", "turn_share", 1.0),
    ("px4", "MPC_XY_VEL_MAX", "fastest_mps", 1.0),
    ("px4", "MPC_Z_V_AUTO_UP", "climb_mps", 1.0),
    ("px4", "MPC_Z_V_AUTO_DN", "sink_mps", 1.0),
    ("px4", "NAV_ACC_RAD", "radius_m", 1.0),
    ("px4", "NAV_MC_ALT_RAD", "height_radius_m", 1.0),
]


@pytest.mark.parametrize(("autopilot", "name", "field", "unit"), SAME)
def test_the_navigator_has_the_recorded_parameter(autopilot: str, name: str, field: str, unit: float) -> None:
    values = {param.name: param.value for param in by_name(autopilot).params}
    assert getattr(Autopilot.named(autopilot).navigator, field) == pytest.approx(values[name] * unit)
