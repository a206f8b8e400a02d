"""What is said of a survey's coverage: cut, not rounded, with the places that are left out."""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from typing import Any

import pytest
import shapely

from gcs.cli.planning.plan_tables import say_coverage
from gcs.cli.shared.console import Screen
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification import coverage as room
from gcs.plan.verification.coverage import coverage
from gcs.scenario.schema.scenario import SurveyTable

SQUARE = ((-100.0, -100.0), (-100.0, 100.0), (100.0, 100.0), (100.0, -100.0))


def surveyed(plan: Plan) -> Plan:
    survey = SurveyTable(swath_m=4.0, polygon_m=SQUARE)
    return replace(plan, scenario=plan.scenario.model_copy(update={"survey": survey}))


def test_places_that_are_left_out_are_named(simulation1_plan: Plan, capsys: pytest.CaptureFixture[str]) -> None:
    found = say_coverage(Screen(), surveyed(simulation1_plan))["coverage"]
    told = capsys.readouterr()
    assert "% of 4.00 ha proved" in told.out and "ha per battery" in told.out
    assert "(4 m from every height; [survey] height_above_ground_m" in told.out  # over uneven ground
    assert "m² of the survey are not covered" in told.out + told.err
    assert 0.0 < found["share"] < 1.0
    assert sum(gap["area_m2"] for gap in found["uncovered"]) == pytest.approx((1.0 - found["share"]) * 4e4)


def test_nearly_everything_is_not_everything(
    simulation1_plan: Plan, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = surveyed(simulation1_plan)
    whole = coverage(plan)
    assert whole is not None

    def told(left: Any) -> str:
        monkeypatch.setattr(room, "coverage", lambda _: dataclasses.replace(whole, uncovered=left))
        say_coverage(Screen(), plan)
        return capsys.readouterr().out

    assert ": 99.9 % of 4.00 ha" in told(shapely.MultiPolygon([shapely.box(0, 0, 1, 4)]))
    assert ": 100 % of 4.00 ha" in told(shapely.MultiPolygon())


def test_nothing_is_said_without_a_survey(simulation1_plan: Plan, capsys: pytest.CaptureFixture[str]) -> None:
    assert say_coverage(Screen(), simulation1_plan) == {}
    assert capsys.readouterr().out == ""
