"""The landing of a plan takes as long as that of its autopilots, emulated or real, and keeps all limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.plan.trajectory.ground_phases import landing_step
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.own_landing import landing_s, own_landing


def lands_from(scenario: Scenario, up_m: float, autopilot: str, **limits: Any) -> Scenario:
    data = scenario.model_dump(mode="json")
    data["terrain"] = {}
    data["ground_phases"]["landing_s"] = None
    data["mission"]["autopilot"] = autopilot
    data["end"]["position_m"][2] = up_m
    data["limits"].update({"speed_ned_mps": [5.0, 5.0, 1.5], "thrust_N": [0.1, 10.0], **limits})
    return Scenario.model_validate(data)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("up_m", [0.2, 3.0, 7.0, 11.0, 13.0, 25.0, 60.0])
def test_it_ends_as_the_autopilot_touches_down(simulation1: Scenario, up_m: float, autopilot: str) -> None:
    scenario = lands_from(simulation1, up_m, autopilot)
    traits = Autopilot.named(autopilot).traits
    sink = {"ardupilot": {"WPNAV_SPEED_DN": 150.0}, "px4": {"MPC_Z_V_AUTO_DN": 1.5}}[autopilot]
    profile = traits.landing.profile(sink)
    assert -0.1 < landing_s(scenario) - profile.duration_s(up_m, 0.0) < 3.0
    if up_m < 1.0:
        return
    at_s = np.linspace(0.0, landing_s(scenario), 2000)
    planned = landing_step(0.0, at_s[-1], -up_m, 0.0, scenario)
    assert abs(-planned(at_s) - profile.height_m(up_m, 0.0, at_s)).max() < 1.6
    for order in (1, 2, 3, 4):
        assert np.abs(planned([0.0, at_s[-1]], nu=order)).max() < 1e-6
        jump = planned(planned.x[1:-1], nu=order) - planned(planned.x[1:-1] - 1e-9, nu=order)
        assert np.abs(jump).max() < 1e-4


def test_changes_of_speed_keep_the_jerk_limit(simulation1: Scenario) -> None:
    scenario = lands_from(simulation1, 30.0, "ardupilot", jerk_max_mps3=0.4)
    step = landing_step(0.0, landing_s(scenario), -30.0, 0.0, scenario)
    assert np.abs(step(np.linspace(0.0, step.x[-1], 5000), nu=3)).max() <= 0.4


def test_what_a_file_says_is_kept(simulation1: Scenario) -> None:
    assert (landing_s(simulation1), own_landing(simulation1)) == (12.0, ())
