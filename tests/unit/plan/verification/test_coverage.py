"""Coverage against closed forms: stadiums, strips, gaps, and a proof that stays below the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy.interpolate import PPoly

from gcs.plan.formation.shape import rigid
from gcs.plan.trajectory.energy import battery_model
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.coverage import Coverage, coverage
from gcs.scenario.schema.scenario import Mountains, Power, Scenario, Terrain
from gcs.scenario.sources.survey_flight import SurveyOrder
from gcs.scenario.values.si import offsets_ned_m
from tests.unit.plan.surveyed import FIELD, SWATH_M, corners_of, flown, scenario_of


def proved(plan: Plan) -> Coverage:
    found = coverage(plan)
    assert found is not None
    return found


@pytest.fixture
def scenario(tmp_path: Path) -> Scenario:
    return scenario_of(SurveyOrder(FIELD, SWATH_M), tmp_path)


def test_a_laid_survey_that_is_flown_covers_its_area(scenario: Scenario) -> None:
    found = proved(flown(scenario, corners_of(scenario)))
    assert found.is_complete and found.share == 1.0 and not found.gaps()
    assert found.overlap > 0.2  # that of the passes, and the legs between them
    assert found.covered_ha == pytest.approx(FIELD.area / 1e4)
    seen_m2 = SWATH_M * sum(shapely.intersection(track, found.area).length for track in found.tracks.geoms)
    assert found.overlap == pytest.approx(seen_m2 / FIELD.area - 1.0)


def test_a_pass_that_is_left_out_is_found_where_it_is(scenario: Scenario) -> None:
    corners = corners_of(scenario)
    found = proved(flown(scenario, np.delete(corners, [3, 4, 5, 6], axis=0)))
    missed = shapely.LineString(corners[4:6, :2])
    assert not found.is_complete
    largest = found.gaps()[0]
    assert largest.area_m2 > 0.4 * missed.length * SWATH_M
    assert missed.distance(shapely.Point(largest.north_m, largest.east_m)) < 5.0 * SWATH_M
    assert sum(gap.area_m2 for gap in found.gaps()) == pytest.approx((1.0 - found.share) * FIELD.area)


def test_one_leg_covers_a_stadium_a_little_less_in_the_proof(scenario: Scenario) -> None:
    ends = corners_of(scenario)[:2]
    found = proved(flown(scenario, ends))
    truth = shapely.union_all(
        [
            shapely.LineString(ends[:, :2] + offset[:2]).buffer(SWATH_M / 2.0, quad_segs=512)
            for offset in offsets_ned_m(scenario)
        ]
    )
    assert found.slack_m < 0.02
    assert found.covered.difference(truth).area < 1e-9
    assert truth.difference(found.covered).area < 0.03 * truth.length


def test_the_true_track_is_within_the_slack_of_the_chords_of_the_proof(scenario: Scenario) -> None:
    """A circle of 20 m in 30 s bends everywhere."""
    scenario = scenario.model_copy(update={"time": scenario.time.model_copy(update={"flight_s": 24.0})})
    t_s = np.linspace(0.0, scenario.time.flight_s, 60)
    angle = 2.0 * np.pi * t_s / 30.0
    plan = flown(scenario, corners_of(scenario))
    bent = np.column_stack([20.0 * np.cos(angle), 20.0 * np.sin(angle), -15.0 + 0.0 * angle])
    rates = np.column_stack([-np.sin(angle), np.cos(angle), 0.0 * angle]) * 20.0 * 2.0 * np.pi / 30.0
    span_s = t_s[1]
    c = np.zeros((4, len(t_s) - 1, 12))
    step = np.diff(bent, axis=0)
    c[3, :, :3], c[2, :, :3] = bent[:-1], rates[:-1]
    c[1, :, :3] = 3.0 * step / span_s**2 - (2.0 * rates[:-1] + rates[1:]) / span_s
    c[0, :, :3] = -2.0 * step / span_s**3 + (rates[:-1] + rates[1:]) / span_s**2
    leader = Trajectory(PPoly(c, t_s), PPoly(np.zeros((1, len(t_s) - 1, 4)), t_s))
    round_plan = Plan(scenario, leader, rigid(offsets_ned_m(scenario), 0.0, t_s[-1]), plan.phases[1:2], 0.0)
    found = _tracks_of(round_plan)
    fine = round_plan.states(np.linspace(0.0, np.nextafter(24.0, 0.0), 1500))[:2, :, :2]
    for track, places in zip(list(found.tracks.geoms)[:2], fine, strict=True):
        assert float(shapely.distance(track, shapely.points(places)).max()) <= found.slack_m
        chords = shapely.points(shapely.segmentize(track, 0.05).coords)
        assert (
            float(shapely.distance(shapely.LineString(places), chords).max()) <= found.slack_m + 1e-3
        )  # chords of `fine`
    assert 0.005 < found.slack_m < 0.01


def _tracks_of(plan: Plan) -> Coverage:
    """The coverage of a plan without ground phases."""
    return coverage.__wrapped__(plan)  # type: ignore[attr-defined,no-any-return]


def test_a_plan_without_a_survey_has_no_coverage(scenario: Scenario) -> None:
    plain = scenario.model_copy(update={"survey": None})
    assert coverage(flown(plain, corners_of(plain))) is None


def test_area_per_battery_leaves_the_reserve(scenario: Scenario) -> None:
    found = proved(flown(scenario, corners_of(scenario)))
    kept = 1.0 - scenario.preflight.reserve
    assert found.ha_per_battery * float(found.used.sum()) == pytest.approx(found.covered_ha * kept)


def test_the_battery_of_a_survey_is_that_of_the_whole_flight(scenario: Scenario) -> None:
    """It hovers by its controls: so much each second, at 15 m in air that is 0.15 % thinner."""
    power = Power(battery_Wh=80.0, rotor_radius_m=0.1, figure_of_merit=0.6)
    scenario = scenario.model_copy(update={"vehicle": scenario.vehicle.model_copy(update={"power": power})})
    plan = flown(scenario, corners_of(scenario)[:3])
    hovers = battery_model(plan).hover_per_s * (plan.t_end_s - plan.t_start_s)
    assert proved(plan).used == pytest.approx([hovers] * len(plan.sysids), rel=5e-3)


def test_the_swath_is_that_of_the_height_flown(scenario: Scenario) -> None:
    """From 60 % of the height at which the swath counts, 60 % of it is seen; a bump below takes some of that, too."""
    survey = scenario.survey
    assert survey is not None
    flown_m = scenario.start.position_m[2]
    lower = survey.model_copy(update={"height_above_ground_m": flown_m / 0.6})
    same = survey.model_copy(update={"swath_m": 0.6 * SWATH_M})
    plan = flown(scenario, corners_of(scenario))
    by_height, by_width = (
        proved(replace(plan, scenario=scenario.model_copy(update={"survey": table}))) for table in (lower, same)
    )
    assert by_height.share == pytest.approx(by_width.share, abs=1e-5)
    assert by_width.share < 0.9
    hill = Terrain(
        mountains=Mountains(
            north_m=(50.0,), east_m=(60.0,), height_m=(6.0,), spread_north_m=(20.0,), spread_east_m=(20.0,)
        )
    )
    over_hill = proved(replace(plan, scenario=scenario.model_copy(update={"survey": lower, "terrain": hill})))
    worst = shapely.Point(50.0, 60.0).buffer(25.0)
    missed = [found.uncovered.intersection(worst).area for found in (over_hill, by_height)]
    assert missed[0] > 1.5 * missed[1]
