"""The picture of a survey: its title and legend, what is left out, and a plan without a survey."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib import pyplot as plt

from gcs.errors import UsageError
from gcs.flight.plots.coverage_plot import draw_coverage, save_coverage
from gcs.flight.plots.overview_plot import draw_scenario
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.coverage import coverage
from gcs.scenario.schema.scenario import SurveyTable
from gcs.scenario.sources.load import load_scenario

SQUARE = ((-100.0, -100.0), (-100.0, 100.0), (100.0, 100.0), (100.0, -100.0))


def surveyed(plan: Plan) -> Plan:
    """The plan with a square round its start as its survey, most of which it does not see."""
    survey = SurveyTable(swath_m=4.0, polygon_m=SQUARE)
    return replace(plan, scenario=plan.scenario.model_copy(update={"survey": survey}))


def test_the_picture_says_what_is_seen_and_what_is_left(simulation1_plan: Plan, tmp_path: Path) -> None:
    plan = surveyed(simulation1_plan)
    found = coverage(plan)
    assert found is not None and not found.is_complete
    figure = draw_coverage(plan, found)
    axes = figure.axes[0]
    assert f"{int(1e3 * found.share) / 10.0:g} % of 4.00 ha covered" in axes.get_title()
    entries = {text.get_text() for text in axes.get_legend().get_texts()}
    assert {"vehicle 1", "survey area", "seen, swath 4 m", "not covered"} <= entries
    assert any(text.get_text().endswith(" m²") for text in axes.texts)
    plt.close(figure)
    save_coverage(plan, tmp_path / "coverage.png")
    assert (tmp_path / "coverage.png").read_bytes().startswith(b"\x89PNG")


def test_a_plan_without_a_survey_has_no_picture_of_it(simulation1_plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no \\[survey\\]"):
        save_coverage(simulation1_plan, tmp_path / "coverage.png")


def test_every_map_of_a_survey_shows_its_area_and_holes_and_no_entry_for_wind_where_there_is_none(
    repo_root: Path,
) -> None:
    scenario = load_scenario(repo_root / "missions" / "survey")
    assert scenario.survey is not None and scenario.wind is None
    figure = draw_scenario(scenario)
    (axes,) = figure.axes
    drawn = {str(patch.get_label()): patch for patch in axes.patches}
    corners = drawn["survey area"].get_path().vertices
    assert {tuple(place) for place in scenario.survey.polygon_m} <= {(north, east) for east, north in corners}
    assert len(drawn["left out of the survey"].get_path().vertices) == len(scenario.survey.hole[0].polygon_m) + 1
    entries = [text.get_text() for text in axes.get_legend().get_texts()]
    assert entries[-2:] == ["survey area", "left out of the survey"]
    plt.close(figure)


def test_a_map_of_a_survey_names_each_pass_once(repo_root: Path) -> None:
    """Where each of its four points was named, names covered points and each other."""
    scenario = load_scenario(repo_root / "missions" / "survey")
    passes = {name[:6] for point in scenario.route if (name := point.name or "").startswith("pass ")}
    assert len(passes) > 1
    figure = draw_scenario(scenario)
    told = [text.get_text() for text in figure.axes[0].texts]
    assert sorted(text.split(" ", 1)[1] for text in told if "pass" in text) == sorted(passes)
    plt.close(figure)
