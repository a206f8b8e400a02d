"""Plans leave room beside no-fly zones for the navigation error, where there is room; a given margin is proved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs.errors import PlanningError, ScenarioError
from gcs.flight.assessment.judge import Truth, Verdict, judge
from gcs.flight.monitoring.progress import FlightTimes
from gcs.mission.returns.fence_rally import build_fence
from gcs.plan.planner import make_plan
from gcs.plan.replanning.replanner import Replanner
from gcs.plan.trajectory.distances import zone_distances_m
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.zone_margin import first_with_margin
from gcs.plan.verification.navigation_margins import thin_margins
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import NoFlyZone, Scenario
from gcs.scenario.validation.cross_table import check
from gcs.scenario.values.navigation_error import navigation_error
from gcs.types import Array
from tests.unit.plan.problems import alone, changed, meadow

# Its corner is in the straight way from (2, 1) to (40, 14).
CORNER: dict[str, Any] = {"polygon_m": [[21.0, 7.0], [26.0, -15.0], [16.0, -15.0]]}
T0_UNIX_S = 1.7e9


@pytest.fixture(scope="module")
def beside(simulation1: Scenario) -> Callable[..., Plan]:
    made: dict[str, Plan] = {}

    def plan(*zones: dict[str, Any], grade: str = "gnss", **limits: Any) -> Plan:
        key = repr((zones, grade, limits))
        if key not in made:
            wide = {"north_m": [-20.0, 80.0], "east_m": [-60.0, 60.0], "separation_min_m": 0.4} | limits
            scenario = meadow(alone(simulation1), limits=wide, no_fly=list(zones), sensors={"grade": grade})
            made[key] = make_plan(scenario)
        return made[key]

    return plan


def nearest_m(plan: Plan) -> float:
    t_s = np.arange(plan.t_start_s, plan.t_end_s, 0.01)
    return float(zone_distances_m(plan.scenario, t_s, plan.states(t_s)[..., :3]).min())


def test_by_default_a_plan_keeps_the_navigation_error_at_a_polygons_corner(beside: Callable[..., Plan]) -> None:
    plan = beside(CORNER)
    report, error_m = verify(plan), navigation_error(plan.scenario).horizontal_m
    assert report.ok, report.failures
    assert report.nearest_zone is not None
    assert error_m - 1e-3 <= report.nearest_zone.distance_m <= nearest_m(plan) <= 1.35 * error_m + 0.3
    assert not any("no-fly zone" in sentence for sentence in thin_margins(plan, report))


def test_without_a_margin_the_plan_passes_near_and_says_so(beside: Callable[..., Plan]) -> None:
    plan = beside(CORNER, zone_margin_m=0.0)
    report = verify(plan)
    assert report.ok
    assert -1e-3 < nearest_m(plan) < 0.6
    (sentence,) = (s for s in thin_margins(plan, report) if "no-fly" in s)
    error_m = navigation_error(plan.scenario).horizontal_m
    assert sentence.startswith(f"vehicle {plan.sysids[0]} passes no-fly zone 1 at 0.")
    assert f"the navigation error of gnss sensors is up to {error_m:g} m (3 sigma)" in sentence
    assert sentence.endswith(f'Set limits.zone_margin_m = {error_m:g}, or sensors.grade = "rtk"')


def test_a_given_margin_is_a_limit_that_the_verifier_proves(beside: Callable[..., Plan]) -> None:
    plan = beside(CORNER, zone_margin_m=4.0)
    report = verify(plan)
    assert report.ok and report.nearest_zone is not None
    assert report.nearest_zone.distance_m >= 4.0 - 1e-3
    thinner = beside(CORNER)
    wanted = replace(thinner, scenario=changed(thinner.scenario, limits={"zone_margin_m": 4.0}))
    assert {check.name for check in verify(wanted).failures} == {"no-fly zone 1"}


def test_rtk_needs_less_room(beside: Callable[..., Plan]) -> None:
    plan = beside(CORNER, grade="rtk")
    assert navigation_error(plan.scenario).horizontal_m - 1e-3 <= nearest_m(plan) < 1.2
    assert verify(plan).ok


def test_where_there_is_no_room_the_plan_is_made_with_less_and_says_so(beside: Callable[..., Plan]) -> None:
    gap = [
        {"polygon_m": [[20.0, 9.0], [22.0, 9.0], [22.0, 60.0], [20.0, 60.0]]},
        {"polygon_m": [[20.0, 6.0], [22.0, 6.0], [22.0, -60.0], [20.0, -60.0]]},
    ]
    plan = beside(*gap, north_m=[-20.0, 80.0], east_m=[-59.0, 59.0])
    report = verify(plan)
    assert report.ok, report.failures
    assert 0.0 <= nearest_m(plan) <= 1.5 + 1e-3
    assert any("no-fly zone" in sentence for sentence in thin_margins(plan, report))
    start = {"north_m": 2.0, "east_m": -4.0, "radius_m": 4.0}
    assert verify(beside(start)).ok  # 1 m from the pad: the take-off cannot keep more


@pytest.mark.parametrize(("kept", "told"), [("none", [False, True]), ("bare", [False, True, False]), ("all", [False])])
def test_only_the_failure_that_is_read_is_explained(simulation1: Scenario, kept: str, told: list[bool]) -> None:
    """With the whole margin there may be no plan, and with none; then the second failure is the answer."""
    scenario = meadow(alone(simulation1), no_fly=[CORNER], sensors={"grade": "gnss"})
    asked: list[bool] = []

    def found_in(inflated: Scenario, explained: bool) -> str:
        asked.append(explained)
        is_bare = inflated.no_fly == scenario.no_fly
        if kept == "all" or (kept == "bare" and is_bare):
            return kept
        raise PlanningError("bare" if is_bare else "inflated")

    if kept == "none":
        with pytest.raises(PlanningError, match="bare"):
            first_with_margin(scenario, found_in)
    else:
        assert first_with_margin(scenario, found_in) == kept
    assert asked == told


def test_a_margin_that_the_start_does_not_have_is_a_mistake(beside: Callable[..., Plan]) -> None:
    scenario = changed(
        beside(CORNER).scenario,
        no_fly=[{"north_m": 2.0, "east_m": -4.0, "radius_m": 4.0}],
        limits={"zone_margin_m": 3.0},
    )
    (mistake,) = check(scenario)
    assert mistake.key == ("limits", "zone_margin_m")
    assert "is 1 m from no-fly zone 1 at its start" in str(mistake)
    with pytest.raises(ScenarioError):
        raise ScenarioError(str(mistake))


def test_a_re_plan_keeps_room_beside_old_and_new_zones(beside: Callable[..., Plan]) -> None:
    plan = beside(CORNER)
    error_m = navigation_error(plan.scenario).horizontal_m
    new = NoFlyZone(north_m=33.0, east_m=10.0, radius_m=2.0)
    again = Replanner(plan).replan(plan.states(np.array([2.0]))[plan.leader, 0], 2.0, [new])
    report = verify(again)
    assert report.ok, report.failures
    assert again.scenario.no_fly == (*plan.scenario.no_fly, new)
    assert nearest_m(again) >= error_m - 0.02


def judged(plan: Plan, change: Callable[[Array, Array], None]) -> Verdict:
    t_s = np.arange(plan.t_start_s, plan.t_end_s, 0.1)
    states = np.array(plan.states(t_s))
    change(t_s, states)
    times = FlightTimes(T0_UNIX_S + plan.airborne_s, T0_UNIX_S, T0_UNIX_S + plan.phase("landing").start_s)
    return judge(plan, Truth(plan.sysids, T0_UNIX_S + t_s, states), times)


def test_a_vehicle_that_is_truly_in_a_zone_fails_the_flight(beside: Callable[..., Plan]) -> None:
    plan = beside(CORNER)

    def into_the_zone(t_s: Array, states: Array) -> None:
        states[0, np.abs(t_s - 8.0) < 0.25, :6] = [21.0, -14.9, -4.0, 0.0, 0.0, 0.0]

    (as_planned,) = (c for c in judged(plan, lambda t_s, states: None).criteria if c.name == "outside no-fly zones")
    assert as_planned.ok and as_planned.value == pytest.approx(nearest_m(plan), abs=0.05)
    verdict = judged(plan, into_the_zone)
    (criterion,) = (c for c in verdict.criteria if c.name == "outside no-fly zones")
    assert criterion.value == pytest.approx(-0.1, abs=1e-6)
    assert not criterion.ok and not verdict.ok
    assert (criterion.sysid, criterion.t_s) == (plan.sysids[0], pytest.approx(8.0, abs=0.3))


def test_a_vehicle_outside_the_fence_or_above_the_ceiling_fails_the_flight(beside: Callable[..., Plan]) -> None:
    plan = beside(CORNER)
    ceiling_m = plan.scenario.limits.height_m[1]
    most_m = ceiling_m + navigation_error(plan.scenario).vertical_m

    def away(t_s: Array, states: Array) -> None:
        states[0, np.abs(t_s - 8.0) < 0.25, :3] = [21.0, 59.0, -(most_m + 1.0)]

    found = {c.name: c for c in judged(plan, away).criteria}
    assert not found["inside the fence"].ok and found["inside the fence"].value < -10.0
    assert found["height"].limit == pytest.approx(most_m, abs=1e-3) and found["height"].planned == ceiling_m
    assert not found["height"].ok
    planned = {c.name: c for c in judged(plan, lambda t_s, states: None).criteria}
    assert planned["inside the fence"].value >= 10.0 - 1e-6 and planned["height"].ok


@pytest.mark.slow
def test_a_plan_stays_in_a_keep_in_area_and_leaves_room_to_its_edge(simulation1: Scenario) -> None:
    """The straight way from (2, 1) to (40, 14) cuts the inner corner of an L; the fence does not."""
    corners = [[-10.0, -10.0], [50.0, -10.0], [50.0, 30.0], [30.0, 30.0], [30.0, 4.0], [-10.0, 4.0]]
    wide = {"north_m": [-20.0, 80.0], "east_m": [-60.0, 60.0]}
    rtk = {"grade": "rtk"}
    scenario = meadow(alone(simulation1), limits=wide, keep_in=[{"polygon_m": corners}], sensors=rtk)
    plan = make_plan(scenario)
    report, error_m = verify(plan), navigation_error(scenario).horizontal_m
    assert report.ok, report.failures
    assert report.nearest_zone is not None and report.nearest_zone.keep_in
    assert error_m - 1e-3 <= report.nearest_zone.distance_m <= nearest_m(plan)
    straight = replace(make_plan(scenario.model_copy(update={"keep_in": ()})), scenario=scenario)
    assert {check.name for check in verify(straight).failures} == {"keep-in area 1"}
    assert any("the edge of keep-in area 1" in told for told in thin_margins(straight, verify(straight)))
    (around,) = build_fence(plan).geofence.polygons
    assert around.inclusion and len(around.points) > 4
