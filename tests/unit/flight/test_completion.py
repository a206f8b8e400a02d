"""How long the vehicles flew, by their own boot clocks, and where they came down."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.flight.completion import Completion
from gcs.flight.monitor import VehicleView
from gcs.plan.trajectory.plan import Plan

EARLY_S = 20.0


def flown(plan: Plan, *, missing_s: float = 0.0, reboot: bool = False, disarmed_after_s: float = 1e9) -> Completion:
    """All vehicles report ten times a second from T0 to the landing; the last one as told."""
    found = Completion(plan)
    found.begins(0.0)
    landing_s = plan.phase("landing").start_s
    for sysid in plan.sysids:
        last = sysid == plan.sysids[-1]
        for tick in range(int(10.0 * (landing_s - (missing_s if last else 0.0)))):
            boot_s = 50.0 + tick / 10.0
            if reboot and last and boot_s > 60.0:
                boot_s -= 55.0
            found.receive(sysid, int(1e3 * boot_s), armed=not last or tick / 10.0 < disarmed_after_s)
    found.lands(plan.sysids)
    return found


def test_a_plan_that_was_flown_misses_nothing(simulation1_plan: Plan) -> None:
    assert flown(simulation1_plan).missing({}) == []


def test_a_reboot_is_no_flight_that_ended_early(simulation1_plan: Plan) -> None:
    assert flown(simulation1_plan, reboot=True).missing({}) == []


@pytest.mark.parametrize("how", [{"missing_s": EARLY_S}, {"disarmed_after_s": 16.0}])
def test_a_vehicle_that_flew_too_short_is_named(simulation1_plan: Plan, how: dict[str, float]) -> None:
    (words,) = flown(simulation1_plan, **how).missing({})  # type: ignore[arg-type]
    landing_s = simulation1_plan.phase("landing").start_s
    flown_s = how.get("disarmed_after_s", landing_s - EARLY_S)
    assert words.startswith(f"vehicle {simulation1_plan.sysids[-1]} flew {flown_s:.0f} s of {landing_s:.0f} s")


def test_a_boot_clock_that_jumps_is_not_flown_time(simulation1_plan: Plan) -> None:
    found = Completion(simulation1_plan)
    found.begins(0.0)
    for boot_ms in (1000, 1100, 3_601_100):
        found.receive(1, boot_ms, armed=True)
    found.lands([1])
    assert "vehicle 1 flew 0 s" in found.missing({})[0]


def test_a_vehicle_that_came_down_elsewhere_is_named(simulation1_plan: Plan) -> None:
    found = flown(simulation1_plan)
    place = simulation1_plan.landing_points_ned_m[0]
    near = {1: VehicleView(1, place + np.array([1.0, 0.0, 0.0]))}
    far = {1: VehicleView(1, place + np.array([0.0, 41.0, 0.0]))}
    assert found.missing(near) == []
    assert found.missing(far) == ["vehicle 1 came down 41.0 m from its landing point (limit 5 m)"]


def test_a_flight_that_all_vehicles_broke_off_is_not_flown(simulation1_plan: Plan) -> None:
    found = flown(simulation1_plan)
    found.broke_off = True
    assert found.missing({}) == ["no vehicle flew it to its landing"]
