"""Zones at the start, at points of the route and at the end: each place is put wrongly alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from gcs.errors import ScenarioError
from gcs.scenario.schema.mistake import dotted
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.validation.cross_table import check
from tests.unit.scenario.validation.orchard import orchard

YARD = [[-30.0, -30.0], [130.0, -30.0], [130.0, 110.0], [60.0, 110.0], [-30.0, 60.0]]


def told(**tables: Any) -> list[str]:
    mistakes = check(Scenario.model_validate(orchard(**tables)))
    return [f"{dotted(mistake.key)}: {mistake.text}; {mistake.remedy}" for mistake in mistakes]


def route(*places: list[float], **keys: Any) -> list[dict[str, Any]]:
    return [{"position_m": place} | keys for place in places]


@pytest.mark.parametrize(
    ("tables", "found"),
    [
        ({"keep_in": [{"polygon_m": YARD}]}, None),
        ({"keep_in": [{"polygon_m": [[n, e + 35.0] for n, e in YARD]}]}, "leaves out vehicle 3 at its start, 13.00 m"),
        ({"route": route([100.0, 108.0, 15.0])}, "leaves out vehicle 4 at route[0], 14.00 m outside"),
        ({"route": route([100.0, 108.0, 15.0], radius_m=13.9)}, "leaves out vehicle 4 at route[0], 0.10 m outside"),
        ({"route": route([100.0, 108.0, 15.0], radius_m=14.1)}, None),
        ({"end": {"position_m": [0.0, 65.0, 15.0]}}, "leaves out vehicle 4 at its end"),
        ({"limits": {"zone_margin_m": 25.0}}, "is 22 m from the edge of keep-in area 1 at its start"),
        ({"no_fly": [{"north_m": 101.0, "east_m": 70.0, "radius_m": 3.0}]}, "contains vehicle 1 at route[1], 2.00 m"),
    ],
)
def test_a_place_in_a_zone_is_told_with_zone_place_and_depth(tables: dict[str, Any], found: str | None) -> None:
    mistakes = told(**tables)
    assert (mistakes == []) == (found is None), mistakes
    assert found is None or any(found in mistake for mistake in mistakes), mistakes


def test_a_zone_that_moves_may_be_gone_when_the_leader_comes() -> None:
    zone = {"north_m": 101.0, "east_m": 70.0, "radius_m": 3.0}
    assert told(no_fly=[zone | {"moves": [[0.0, 0.0, 0.0], [10.0, 500.0, 0.0]]}]) == []


def test_a_formation_that_changes_is_looked_at_by_its_leader_alone() -> None:
    points = route([100.0, 108.0, 15.0])
    assert told(route=points)
    assert told(route=[points[0] | {"shape": "line"}]) == []


def test_corners_in_degrees_are_an_area_and_degrees_in_metres_are_asked_about(tmp_path: Path) -> None:
    file = tmp_path / "scenario.toml"
    text = "keep_in = [{{ {} = [[47.3997, 8.5496], [47.4015, 8.5496], [47.4015, 8.5516], [47.3997, 8.5516]] }}]\n"
    rest = (
        'schema_version = 1\nname = "a"\nvehicle_type = "quad500"\n'
        "origin = { lat_deg = 47.4, lon_deg = 8.55, alt_amsl_m = 488.0 }\ntime = { flight_s = 60.0 }\n"
        'start = { position_m = [0.0, 0.0, 15.0] }\nend = "start"\nroute = [{ position_m = [50.0, 0.0, 15.0] }]\n'
        "formation = { vehicle = [{ sysid = 1, position_m = [0.0, 0.0, 15.0] }] }\n"
        "[limits]\nnorth_m = [-40.0, 140.0]\neast_m = [-40.0, 120.0]\nheight_m = [0.0, 40.0]\n"
        "clearance_min_m = 5.0\nseparation_min_m = 5.0\n"
    )
    file.write_text(text.format("polygon_deg") + rest)
    (area,) = load_scenario(file).keep_in
    assert area.area.bounds == pytest.approx((-33.4, -30.2, 166.8, 120.7), abs=0.3)
    file.write_text(text.format("polygon_m") + rest)
    with pytest.raises(ScenarioError, match=r"keep_in\[0\].polygon_m.*these look like degrees") as raised:
        load_scenario(file)
    assert "write polygon_deg = [[47.3997, 8.5496]" in raised.value.hint
