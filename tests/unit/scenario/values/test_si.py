"""Shapes in NED relative to the leader: the place of each vehicle, computed by hand."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.scenario.schema.scenario import START_SHAPE, Scenario
from gcs.scenario.values.si import (
    autopilots,
    hover_start_ned_m,
    names_autopilots,
    offsets_ned_m,
    pads_ned_m,
    shape_offsets_ned_m,
    sysids,
)
from tests.unit.scenario.variants import Data, counted_scenario, with_changes

COLUMN = {"name": "column", "generator": "column", "spacing_m": 2.0}
STAIRS = {"name": "stairs", "offsets_m": [[9.0, 0.0, 1.0], [8.0, 1.0, 3.0], [7.0, 2.0, 6.0]]}


@pytest.fixture
def data(repo_root: Path) -> Data:
    return tomllib.loads((repo_root / "missions" / "simulation1" / "scenario.toml").read_text(encoding="utf-8"))


def test_the_leader_takes_the_first_place_of_a_generator_and_the_others_follow_in_order(data: Data) -> None:
    scenario = counted_scenario(data, 4, COLUMN, leader=3)
    assert sysids(scenario) == (1, 2, 3, 4)
    expected = [[-2.0, 0.0, 0.0], [-4.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-6.0, 0.0, 0.0]]
    assert np.array_equal(offsets_ned_m(scenario), expected)
    assert np.array_equal(shape_offsets_ned_m(scenario, START_SHAPE), expected)


def test_a_table_is_seen_from_its_leader_with_down_positive(data: Data) -> None:
    scenario = counted_scenario(data, 3, STAIRS, leader=2)
    assert np.array_equal(offsets_ned_m(scenario), [[1.0, -1.0, 2.0], [0.0, 0.0, 0.0], [-1.0, 1.0, -3.0]])


def test_the_start_shape_of_listed_vehicles_is_where_they_are(data: Data) -> None:
    scenario = Scenario.model_validate(with_changes(data, shape=[COLUMN]))
    expected = [[0, 0, 0], [-2, -1, 0], [-2, 1, 0], [-1, -0.5, 0], [-2, -0.5, 0], [-1, 0.5, 0]]
    assert np.array_equal(shape_offsets_ned_m(scenario, START_SHAPE), expected)
    assert np.array_equal(shape_offsets_ned_m(scenario, "column")[:, 0], -2.0 * np.arange(6))


def test_a_counted_fleet_takes_off_around_the_leaders_start(data: Data) -> None:
    scenario = counted_scenario(data, 3, STAIRS, leader=2)
    leader = hover_start_ned_m(scenario)[1]
    assert np.allclose(leader, [2.0 - 25.0 / np.sqrt(2.0), 1.0 - 25.0 / np.sqrt(2.0), -3.0])
    assert np.allclose(pads_ned_m(scenario), [[leader[0] + n, leader[1] - n, 0.0] for n in (1.0, 0.0, -1.0)])


def test_each_vehicle_has_its_own_autopilot_or_that_of_the_mission(data: Data) -> None:
    for row in (1, 3):
        data["formation"]["vehicle"][row]["autopilot"] = "px4"
    scenario = Scenario.model_validate(data)
    assert [known.key for known in autopilots(scenario)] == ["ardupilot", "px4"] * 2 + ["ardupilot"] * 2
    assert names_autopilots(scenario)
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario


def test_a_fleet_of_one_autopilot_is_written_as_before(data: Data) -> None:
    data["mission"]["autopilot"] = "px4"
    scenario = Scenario.model_validate(data)
    assert set(autopilots(scenario)) == {Autopilot.PX4}
    assert not names_autopilots(scenario)
    assert all(set(row) == {"sysid", "position_m"} for row in scenario.model_dump()["formation"]["vehicle"])
