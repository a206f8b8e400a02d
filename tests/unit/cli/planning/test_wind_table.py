"""The winds of a plan for an operator: never more than is proved, and the same in `--json`, table and picture."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs.cli.planning.wind_table import say_winds
from gcs.cli.shared.console import Screen
from gcs.flight.plots.wind_plot import save_winds
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.wind_envelope import wind_envelope


def test_winds_are_said_and_given_as_plain_values(simulation1_plan: Plan, capsys: pytest.CaptureFixture[str]) -> None:
    found = say_winds(Screen(), simulation1_plan, 0.25, whole=True)
    told = capsys.readouterr().out
    data = json.loads(json.dumps(found, allow_nan=False))["wind_envelope"]
    assert len(data["borders"]) == 24 and data["gust_share"] == 0.25
    assert data["wind_ok_mps"] == wind_envelope(simulation1_plan, 0.25).wind_ok_mps
    said = float(told.split("wind: up to ")[1].split(" m/s")[0])
    assert data["wind_ok_mps"] - 0.1 < said <= data["wind_ok_mps"]
    assert "gusts of 25% of it" in told and "345°" in told


@pytest.mark.parametrize("gust_share", [0.0, 0.5])
def test_the_picture_is_drawn(simulation1_plan: Plan, tmp_path: Path, gust_share: float) -> None:
    save_winds(simulation1_plan, tmp_path / "winds.svg", gust_share)
    assert (tmp_path / "winds.svg").stat().st_size > 10_000
