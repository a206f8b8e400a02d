"""Warnings about what is passed nearer than the navigation error, at their limits."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.navigation_margins import navigation_in_words, thin_margins
from gcs.plan.verification.proof.verdict import Check, NearestZone, Report
from gcs.scenario.values.navigation_error import navigation_error
from tests.unit.plan.problems import changed


def graded(plan: Plan, grade: str) -> Plan:
    return replace(plan, scenario=changed(plan.scenario, sensors={"grade": grade}))


def report(clearance_m: float, zone_m: float | None = None) -> Report:
    ground = [
        Check(ConstraintId(Kind.CLEARANCE), phase, "m", worst, 1e-3, sysid, t_s, worst)
        for phase, worst, sysid, t_s in (("hover", 3.0, 1, 2.0), ("mission", 1.0, 3, 12.4), ("landing", 2.0, 2, 30.0))
    ]
    other = Check(ConstraintId(Kind.HEIGHT), "mission", "m", -5.0, 1e-3, 2, 1.0, -5.0)
    zone = None if zone_m is None else NearestZone(2, 2, 7.6, zone_m)
    return Report((*ground, other), clearance_m, None, 0.0, 0.0, zone)


@pytest.mark.parametrize("grade", ["gnss", "rtk"])
def test_the_error_of_one_vehicle_is_told_with_its_sensors(meadow_plan: Plan, grade: str) -> None:
    plan = graded(meadow_plan, grade)
    error = navigation_error(plan.scenario)
    words = navigation_in_words(plan.scenario)
    assert words == (
        f"up to {error.horizontal_m:g} m horizontally, {error.vertical_m:g} m in height ({grade} sensors, 3 sigma)"
    )


@pytest.mark.parametrize("grade", ["gnss", "rtk"])
def test_ground_and_zone_are_named_where_they_are_nearer_than_the_error(meadow_plan: Plan, grade: str) -> None:
    plan = graded(meadow_plan, grade)
    error = navigation_error(plan.scenario)
    fine = report(error.vertical_m - 0.009, error.horizontal_m - 0.009)  # thinner by a centimetre is what was asked for
    assert thin_margins(plan, fine) == ()
    (ground,) = thin_margins(plan, report(error.vertical_m - 0.0149))
    below_m = int(100.0 * (error.vertical_m - 0.0149)) / 100.0
    assert ground.startswith(f"vehicle 3 passes the ground at {below_m:.2f} m (t = 12 s)")
    assert f"limits.clearance_min_m = {error.vertical_m:g}" in ground
    assert ("sensors.grade" in ground) == (grade == "gnss")
    (zone,) = thin_margins(plan, report(error.vertical_m, error.horizontal_m - 0.0149))
    assert zone.startswith("vehicle 2 passes no-fly zone 2 at ")
    assert "(t = 8 s)" in zone
    assert f"limits.zone_margin_m = {error.horizontal_m:g}" in zone
    assert ("sensors.grade" in zone) == (grade == "gnss")
    assert len(thin_margins(plan, report(0.0, 0.0))) == 2


@pytest.mark.parametrize(
    ("distance_m", "said"), [(0.129, "0.12"), (0.0, "0.00"), (-0.004, "0.00"), (-0.006, "-0.01"), (-1.5, "-1.50")]
)
def test_a_distance_is_rounded_down_and_has_no_sign_of_rounding_alone(
    meadow_plan: Plan, distance_m: float, said: str
) -> None:
    (zone,) = thin_margins(graded(meadow_plan, "gnss"), report(99.0, distance_m))
    assert f" at {said} m (" in zone


def test_a_figure_without_its_check_is_no_warning(meadow_plan: Plan) -> None:
    keys: dict[str, Any] = {"clearance_min_m": 99.0}
    assert thin_margins(meadow_plan, replace(report(0.0), **keys)) == ()
