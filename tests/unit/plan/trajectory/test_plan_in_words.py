"""`print(plan)` and `print(report)` are three lines; a plan knows its distances to vehicles, zones and ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gcs
from gcs.physics.states import POSITION
from gcs.plan.trajectory.distances import separations_m, zone_distances_m
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import NoFlyZone


def test_a_plan_is_three_lines(simulation1_plan: Plan) -> None:
    plan, lines = simulation1_plan, str(simulation1_plan).splitlines()
    assert len(lines) == 3 and max(map(len, lines)) <= 130
    assert lines[0] == f"plan simulation1: 6 vehicles, {plan.flight_s:.1f} s of flight, cost {plan.objective:.4f}"
    assert lines[1].startswith("  leader 1 from (") and lines[1].endswith("m north, east, up")
    assert all(phase.name in lines[2] for phase in plan.phases)
    assert repr(plan) == str(plan)  # what a notebook shows


def test_a_report_is_three_lines(simulation1_plan: Plan) -> None:
    report = gcs.verify(simulation1_plan)
    lines = str(report).splitlines()
    assert lines[0] == f"verification: all {len(report.checks)} checks passed"
    assert f"{report.clearance_min_m:.3f} m from the ground" in lines[1]
    assert f"{report.separation_min_m:.3f} m apart" in lines[1]
    assert len(lines) == 3


def test_a_report_that_failed_says_what_and_by_how_much(simulation1_plan: Plan) -> None:
    report = gcs.verify(simulation1_plan)
    first, second, *others = report.checks
    bad = (replace(first, worst=-1.5), replace(second, worst=-0.5), *others)
    lines = str(replace(report, checks=bad, separation_min_m=None)).splitlines()
    assert lines[0] == f"verification: FAILED, 2 of {len(bad)} checks did not pass"
    assert "apart" not in lines[1]
    assert f"{first.name}, {first.phase}: violated by 1.5" in lines[2] and lines[2].endswith("; and 1 more")
    assert len(lines) == 3


def test_distances_of_a_plan_and_of_what_was_flown(simulation1_plan: Plan) -> None:
    plan, t_s = simulation1_plan, np.linspace(0.0, simulation1_plan.flight_s, 60)
    report = gcs.verify(plan)
    assert report.separation_min_m is not None
    assert plan.separations_m(t_s).min() >= report.separation_min_m - 1e-9
    assert plan.ground_distances_m(t_s).min() >= report.clearance_min_m - 1e-6
    assert plan.zone_distances_m(t_s).min() >= -1e-3
    flown = plan.states(t_s)[..., POSITION] - [0.0, 0.0, 2.0]
    assert np.all(plan.ground_distances_m(t_s, flown) >= plan.ground_distances_m(t_s) - 1e-9)
    assert plan.separations_m(t_s, flown) == pytest.approx(plan.separations_m(t_s))
    assert np.isinf(separations_m(flown[:1])).all()


def test_a_zone_that_moves_is_where_it_is_at_each_time(simulation1_plan: Plan) -> None:
    zone = NoFlyZone(north_m=0.0, east_m=0.0, radius_m=10.0, moves=((0.0, 0.0, 0.0), (10.0, 100.0, 0.0)))
    scenario = simulation1_plan.scenario.model_copy(update={"no_fly": (zone,)})
    still = np.zeros((2, 3, 3))
    still[1, :, 0] = 50.0
    found = zone_distances_m(scenario, np.array([0.0, 5.0, 10.0]), still)
    assert found == pytest.approx(np.array([[-10.0, 40.0, 90.0], [40.0, -10.0, 40.0]]))
