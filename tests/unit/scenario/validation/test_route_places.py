"""Points of a route against the box, the ground, the speed limits and the yaw limit; each is broken alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from gcs.cli.main import run
from gcs.scenario.schema.mistake import dotted
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.validation.cross_table import check
from tests.unit.scenario.validation.orchard import orchard, orchard_text


def broken(point: dict[str, Any], **tables: Any) -> list[tuple[str, str]]:
    """Key and text of the mistakes of a route of this point alone, without a keep-in area."""
    mistakes = check(Scenario.model_validate(orchard(route=[point], keep_in=[], **tables)))
    return [(dotted(mistake.key), f"{mistake.text}; {mistake.remedy}") for mistake in mistakes]


@pytest.mark.parametrize(
    ("point", "key", "found"),
    [
        ({"position_m": [141.0, 0.0, 15.0]}, "route[0].position_m[0]", "vehicle 1 would be at 141"),
        ({"position_m": [80.0, 105.0, 15.0]}, "route[0].position_m[1]", "vehicle 4 would be at 121"),
        ({"position_m": [80.0, 0.0, 40.5]}, "route[0].position_m[2]", "outside the box, height 0 to 40 m"),
        ({"position_m": [80.0, 0.0, 4.0]}, "route[0].position_m[2]", "vehicle 1 would be 1.00 m too low"),
        ({"position_m": [80.0, 0.0, 15.0], "speed_mps": 7.3}, "route[0].speed_mps", "allows 7.23 m/s"),
    ],
)
def test_one_rule_broken(point: dict[str, Any], key: str, found: str) -> None:
    ((where, text),) = broken(point)
    assert where == key
    assert found in text


def test_every_vehicle_counts_where_the_formation_keeps_its_shape_and_else_the_leader() -> None:
    point = {"position_m": [80.0, 105.0, 15.0]}
    assert broken(point)
    assert broken(point | {"shape": "line"}) == []


def test_a_radius_is_room() -> None:
    """141 m is 1 m outside: with a radius of 0.9 m the leader cannot be inside, with 1.1 m it can."""
    point = {"position_m": [141.0, 0.0, 15.0]}
    assert broken(point | {"radius_m": 0.9})
    assert broken(point | {"radius_m": 1.1}) == []


@pytest.mark.parametrize(
    ("heading_deg", "ok"),
    [(60.0, True), (-59.0, True), (301.0, True), (720.0, True), (61.0, False), (299.0, False), (-180.0, False)],
)
def test_a_heading_is_taken_the_short_way_round(heading_deg: float, ok: bool) -> None:
    limits = {"roll_pitch_yaw_deg": [30.0, 30.0, 60.0]}
    found = broken({"position_m": [80.0, 0.0, 15.0], "heading_deg": heading_deg}, limits=limits)
    assert [key for key, _ in found] == ([] if ok else ["route[0].heading_deg"])


def test_the_example_of_the_documents_is_a_scenario(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "scenario.toml").write_text(orchard_text(), encoding="utf-8")
    scenario = load_scenario(tmp_path)
    assert [point.name for point in scenario.route] == ["gate", "well", None]
    assert scenario.end.position_m == scenario.start.position_m and len(scenario.keep_in) == 1
    assert run(["show", str(tmp_path)]) == 0
    assert "5 corners, 2.02 ha" in capsys.readouterr().out
