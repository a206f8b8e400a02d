"""Surveys as scenarios: they load, their points lie on the passes, and what cannot be a scenario is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from gcs.errors import UsageError
from gcs.frames import Origin
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.sources.survey_flight import SurveyOrder, survey_flight
from gcs.scenario.sources.template import scenario_text
from gcs.scenario.values.si import offsets_ned_m

POND = [(40.0, 90.0), (60.0, 90.0), (60.0, 120.0), (40.0, 120.0)]
FIELD = shapely.Polygon([(0, 0), (100, 20), (110, 230), (-10, 200)], [POND])


def loaded(order: SurveyOrder, folder: Path) -> Scenario:
    folder.mkdir(exist_ok=True)
    (folder / "scenario.toml").write_text(
        scenario_text(folder, Origin(47.0, 8.0, 400.0), flight=survey_flight(order)), encoding="utf-8"
    )
    return load_scenario(folder)


@pytest.mark.parametrize("counts", [(3,), (4,), (5,), (6,)])
def test_the_line_flown_from_the_points_is_the_one_that_was_laid(tmp_path: Path, counts: tuple[int, ...]) -> None:
    order = SurveyOrder(FIELD, 12.0, counts=counts)
    scenario = loaded(order, tmp_path / "field")
    laid = survey_flight(order).mowing
    offsets = offsets_ned_m(scenario)[:, :2]
    passes = [point.position_m[:2] for point in scenario.route if point.name and point.name.startswith("pass")]
    leader = [scenario.start.position_m[:2], *passes]
    flown = [offset + leg for leg in np.array(leader).reshape(-1, 2, 2) for offset in offsets[:, None]]
    assert shapely.hausdorff_distance(shapely.MultiLineString(flown), laid.lines) < 0.03  # written to a centimetre
    assert [point.name for point in scenario.route][:3] == ["pass 1 ends", "after pass 1", "before pass 2"]
    assert {point.name for point in scenario.route if isinstance(point.corridor_m, float)} == {
        f"pass {number} ends" for number in range(1, len(laid.passes) + 1)
    }
    assert scenario.end.position_m == scenario.start.position_m
    assert {point.heading_deg for point in scenario.route} == {scenario.start.roll_pitch_yaw_deg[2]}


def test_the_area_is_kept_with_its_holes(tmp_path: Path) -> None:
    survey = loaded(SurveyOrder(FIELD, 12.0), tmp_path / "field").survey
    assert survey is not None
    assert survey.area.equals(FIELD)
    assert survey.swath_m == 12.0


def test_a_hole_is_crossed_and_a_no_fly_zone_is_not(tmp_path: Path) -> None:
    pond = shapely.Polygon(POND)
    assert survey_flight(SurveyOrder(FIELD, 12.0)).mowing.lines.intersects(pond)
    zones = "[[no_fly]]\npolygon_m = [[40.0, 90.0], [60.0, 90.0], [60.0, 120.0], [40.0, 120.0]]\n"
    avoiding = SurveyOrder(FIELD, 12.0, avoided=(pond,), zones=zones)
    (zone,) = loaded(avoiding, tmp_path / "avoided").no_fly
    assert zone.polygon_m is not None and shapely.Polygon(zone.polygon_m).equals(pond)
    assert survey_flight(avoiding).mowing.lines.distance(pond) > 4.9
    assert survey_flight(avoiding).seen < 0.999


def test_seeing_the_area_beside_zones_comes_before_time() -> None:
    """Passes that are cut short are quick; the best way sees nearly as much as any single direction does."""
    zones = (shapely.box(40, 90, 60, 110), shapely.box(70, 170, 80, 180))
    chosen = survey_flight(SurveyOrder(FIELD, 12.0, avoided=zones))
    others = [
        survey_flight(SurveyOrder(FIELD, 12.0, course_deg=angle, avoided=zones)).seen for angle in (0.0, 45.0, 90.0)
    ]
    assert chosen.seen > max(others) - 0.05


def test_a_flight_from_the_origin_comes_back_to_it(tmp_path: Path) -> None:
    scenario = loaded(SurveyOrder(FIELD, 12.0, starts_at_origin=True), tmp_path / "field")
    assert scenario.start.position_m == (0.0, 0.0, 15.0)
    assert [point.name for point in scenario.route][:2] == ["before pass 1", "pass 1 begins"]


def test_the_overlap_is_at_least_the_one_asked_for() -> None:
    for overlap in (0.1, 0.2, 0.5):
        assert survey_flight(SurveyOrder(FIELD, 12.0, overlap)).mowing.spacing_m <= 12.0 * (1.0 - overlap) + 1e-6


@pytest.mark.parametrize("side_m", [3000.0, 20_000.0])
def test_an_area_that_is_too_large_for_a_flight_is_refused(side_m: float) -> None:
    with pytest.raises(UsageError, match=r"at most (100 points|7,200 s)"):
        survey_flight(SurveyOrder(shapely.box(0, 0, side_m, side_m), 12.0 if side_m > 5000.0 else 60.0))
