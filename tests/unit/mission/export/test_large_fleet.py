"""The export of two dozen vehicles in an upright figure that changes: no missions, and all the rest."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import NotWritten
from gcs.mission.export.export import ExportOptions, export, prepared
from gcs.mission.export.separations import GroundReturns, Separation, least
from gcs.mission.formats.registry import DEFAULT
from gcs.plan.formation.shape import Shape
from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Check, Report
from gcs.scenario.schema.scenario import Scenario
from tests.unit.mission.returns.test_separated_or_none import upright

VEHICLES = 24
APART_M = 3.0


@pytest.fixture(scope="module")
def figure(simulation1: Scenario) -> Plan:
    """A figure that grows by a tenth, so that every vehicle needs legs of its own."""
    plan = upright(simulation1, 6, VEHICLES)
    small = plan.shape.basis_ned_m[0]
    return replace(plan, shape=Shape(plan.shape.functions, np.stack([small, 1.1 * small])))


@pytest.fixture(scope="module")
def report(figure: Plan) -> Report:
    """Only what is known of its separation: the figure has no take-off that could be verified."""
    margin_m = APART_M - figure.scenario.limits.separation_min_m
    check = Check(ConstraintId(Kind.SEPARATION), "mission", "m", margin_m, 0.01, None, 1.0, proved=margin_m)
    return Report((check,), 20.0, APART_M, 0.0, 0.0)


@pytest.mark.parametrize("firmware", [Autopilot.ARDUPILOT, pytest.param(Autopilot.PX4, marks=pytest.mark.slow)])
def test_what_cannot_be_missions_is_written_as_setpoints(
    figure: Plan, report: Report, tmp_path: Path, firmware: Autopilot
) -> None:
    index = export(figure, tmp_path / "out", firmware=firmware, setpoint_rate_hz=1.0, report=report)
    assert index.refused.startswith("24 vehicles need legs of their own; speeds are corrected for at most 20")
    assert {f"uav{sysid}.setpoints" for sysid in figure.sysids} == set(index.sha256)
    assert [(row.what, type(row)) for row in index.separations] == [
        ("plan", Separation),
        ("RTL of all at once", Separation),
        ("returns by the ground station", GroundReturns),
    ]
    for row in index.separations:
        assert row.sysids[0] < row.sysids[1]
        assert row.distance_m >= 0.0
        assert row.figure[0] != "-"
    nearest = least(index.separations)
    assert nearest is not None
    assert nearest.distance_m == min(row.distance_m for row in index.separations if row.given)


def test_missions_alone_are_refused_before_anything_is_written(figure: Plan, report: Report, tmp_path: Path) -> None:
    with pytest.raises(NotWritten, match="24 vehicles need legs of their own"):
        export(figure, tmp_path / "out", formats=["plan"], report=report)
    assert not (tmp_path / "out").exists()
    ready = prepared(figure, ExportOptions([row.name for row in DEFAULT], setpoint_rate_hz=1.0), report)
    assert not (tmp_path / "out").exists()
    assert ready.separations
    assert ready.write(tmp_path / "out").refused


def test_what_is_left_out_is_not_the_nearest_of_all() -> None:
    """Nor does rounding make a proved distance larger than it is, or negative."""
    rows = [
        Separation("plan", 2.5779, True, 2.0, (1, 2), 3.0),
        Separation("missions", 0.0199, False, 2.0, (1, 3), 70.0, given=False),
        Separation("returns", 0.0, True, 2.0, (2, 3), 70.0, given=False),
    ]
    nearest = least(rows)
    assert nearest is not None
    assert nearest.what == "plan"
    assert [row.figure for row in rows] == ["2.577 m", "0.02 m", "0.000 m"]
    assert [row.kept for row in rows] == [True, False, False]
