"""Heights above the ground in a file: of one point or of all, in metres or degrees, and against what stands there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs.errors import ScenarioError
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario, with_keys
from tests.hill import hill_scenario


def heights_m(scenario: Scenario) -> np.ndarray:
    """Heights above the ground of start, points and end."""
    places = np.array([p.position_m for p in (scenario.start, *scenario.route, scenario.end)])
    return np.asarray(places[:, 2] - ground_height_m(scenario.terrain, places[:, 0], places[:, 1]))


def test_one_key_is_the_height_of_every_place_without_one(tmp_path: Path) -> None:
    scenario = load_scenario(hill_scenario(tmp_path))
    np.testing.assert_allclose(heights_m(scenario), 30.0, atol=1e-6)
    assert np.ptp([p.position_m[2] for p in (scenario.start, *scenario.route)]) > 5.0


def test_a_place_may_have_its_own_height_of_any_kind(tmp_path: Path) -> None:
    scenario = load_scenario(
        hill_scenario(
            tmp_path,
            ("{ position_m = [80.0, 30.0] }", "{ position_m = [80.0, 30.0], height_above_ground_m = 22.5 }"),
            ("{ position_m = [180.0, -20.0] }", "{ position_m = [180.0, -20.0, 44.0] }"),
        )
    )
    _, second = scenario.route
    assert heights_m(scenario)[1] == pytest.approx(22.5, abs=1e-6)
    assert second.position_m[2] == 44.0 and second.height_above_ground_m is None


def test_a_place_in_degrees_may_count_from_the_ground(tmp_path: Path) -> None:
    degrees = "{ position_deg = [-35.36254, 149.16557], height_above_ground_m = 22.5 }"
    scenario = load_scenario(hill_scenario(tmp_path, ("{ position_m = [80.0, 30.0] }", degrees)))
    np.testing.assert_allclose(scenario.route[0].position_m[:2], [80.0, 30.0], atol=0.5)
    assert heights_m(scenario)[1] == pytest.approx(22.5, abs=1e-6)
    both = degrees.replace("height_above", "height_m = 3.0, height_above")
    with pytest.raises(ScenarioError, match=r"height_m = 3\.0: stands beside height_above_ground_m") as refused:
        load_scenario(hill_scenario(tmp_path, ("{ position_m = [80.0, 30.0] }", both)))
    assert "mistakes" not in str(refused.value)  # nothing about the heights of other places, which are sound


def test_two_heights_of_one_place_are_refused(tmp_path: Path) -> None:
    both = "{ position_m = [80.0, 30.0, 50.0], height_above_ground_m = 30.0 }"
    said = r"route\[0\].height_above_ground_m = 30.0: stands beside a height of 50 m in position_m, and means 41\.\d+ m"
    with pytest.raises(ScenarioError, match=said):
        load_scenario(hill_scenario(tmp_path, ("{ position_m = [80.0, 30.0] }", both)))


def test_a_place_without_any_height_is_still_a_mistake(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="position_m"):
        load_scenario(hill_scenario(tmp_path, ("legs = { height_above_ground_m = 30.0 }", "")))


def test_a_mistake_about_the_height_names_the_key_of_the_file(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"route\[0\]\.height_above_ground_m = 3.0: ") as refused:
        load_scenario(
            hill_scenario(
                tmp_path,
                ("{ position_m = [80.0, 30.0] }", "{ position_m = [80.0, 30.0], height_above_ground_m = 3.0 }"),
            )
        )
    assert "position_m[2]" not in str(refused.value)


def test_a_changed_height_moves_the_places_and_a_written_scenario_stays_as_it_is(tmp_path: Path) -> None:
    scenario = load_scenario(hill_scenario(tmp_path))
    assert with_keys(scenario) == scenario
    lower = with_keys(scenario, start={"height_above_ground_m": 25.0})
    assert heights_m(lower)[0] == pytest.approx(25.0, abs=1e-6)
    file = tmp_path / "again.json"
    file.write_text(scenario.model_dump_json(), encoding="utf-8")
    assert load_scenario(file) == scenario
