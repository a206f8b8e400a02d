"""The picture of a survey: its title and legend, what is left out, and a plan without a survey."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib import pyplot as plt

from gcs.errors import UsageError
from gcs.flight.plots.coverage_plot import draw_coverage, save_coverage
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.coverage import coverage
from gcs.scenario.schema.scenario import SurveyTable

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
    assert {"vehicle 1", "area", "seen, swath 4 m", "not covered"} <= entries
    assert any(text.get_text().endswith(" m²") for text in axes.texts)
    plt.close(figure)
    save_coverage(plan, tmp_path / "coverage.png")
    assert (tmp_path / "coverage.png").read_bytes().startswith(b"\x89PNG")


def test_a_plan_without_a_survey_has_no_picture_of_it(simulation1_plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no \\[survey\\]"):
        save_coverage(simulation1_plan, tmp_path / "coverage.png")
