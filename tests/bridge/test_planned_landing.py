"""Emulated vehicles touch down when the plan says, as their autopilots' landings take."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.plan.planner import make_plan
from gcs.scenario.schema.scenario import Scenario
from tests.bridge.flying import fly, step_aside


@pytest.mark.long
@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_the_last_vehicle_touches_down_at_the_end_of_the_plan(field: Scenario, autopilot: str) -> None:
    data = step_aside(field).model_dump(mode="json")
    data["mission"]["autopilot"] = autopilot
    data["ground_phases"].update(takeoff_s=50.0, landing_s=None)
    for place in (data["start"], data["end"], *data["formation"]["vehicle"]):
        place["position_m"][2] = 25.0
    data["limits"]["height_m"] = [0.0, 60.0]
    plan = make_plan(Scenario.model_validate(data))
    flown = fly(plan, safety=True)
    assert flown.error is None
    height_m = -flown.places[..., 2] + plan.pads_ned_m[:, 2, None]
    down_s = [flown.t_s[np.flatnonzero(above > 0.15)[-1]] for above in height_m]
    assert max(down_s) == pytest.approx(plan.t_end_s, abs=3.0)
