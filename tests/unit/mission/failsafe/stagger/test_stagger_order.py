"""The order of return altitudes does not depend on the last bits of a plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gcs.mission.failsafe.rtl_cases import return_cases
from gcs.mission.failsafe.rtl_motion import ReturnSpeeds
from gcs.mission.failsafe.stagger.stagger_order import SEARCHED_MAX, stagger_order
from gcs.plan.trajectory.plan import Plan


@pytest.mark.parametrize("vehicles", [2, 6, 9, SEARCHED_MAX])
def test_equally_good_orders_keep_the_vehicles_own(plan_of: Callable[[str], Plan], vehicles: int) -> None:
    """Twins far apart: every order has the same least distance but for round-off, which each seed changes."""
    plan = plan_of("simulation1/scenario.toml")
    case = return_cases(plan, plan.autopilots, ReturnSpeeds(2.0, 4.0, 2.0, 5.0), 60.0)[0]
    lines_m = 30.0 * np.arange(vehicles)[:, None, None] * np.array([0.6, 0.8, 0.0])
    for seed in range(5):
        noise = 1.0 + 1e-12 * np.random.default_rng(seed).uniform(-1.0, 1.0, (vehicles, 1, 1))
        twins = replace(
            case,
            from_ned_m=(case.from_ned_m[:1] + lines_m) * noise,
            to_ned_m=(case.to_ned_m[:1] + lines_m) * noise,
            datum_m=np.repeat(case.datum_m[:1], vehicles, axis=0),
            waits_s=None,
        )
        levels_m = np.repeat(20.0 + 2.0 * np.arange(vehicles)[:, None], vehicles, axis=1)
        assert stagger_order([twins], levels_m, 0.4).tolist() == list(range(vehicles))
