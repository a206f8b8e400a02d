"""A scenario with other keys: what is not named stays, and it is checked as a file is."""

import pytest

from gcs.errors import ScenarioError
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import with_keys


def test_one_key_of_a_table_is_changed_and_all_others_stay(simulation1: Scenario) -> None:
    faster = with_keys(simulation1, time={"flight_s": 300.0}, title="slower")
    assert (faster.time.flight_s, faster.title) == (300.0, "slower")
    assert faster.model_copy(update={"time": simulation1.time, "title": simulation1.title}) == simulation1
    deep = with_keys(simulation1, vehicle={"power": {"battery_Wh": 30.0}})
    assert deep.vehicle.power is not None and simulation1.vehicle.power is not None
    assert deep.vehicle.power == simulation1.vehicle.power.model_copy(update={"battery_Wh": 30.0})
    assert deep.vehicle.mass_kg == simulation1.vehicle.mass_kg
    assert with_keys(simulation1) == simulation1


def test_all_mistakes_are_told_at_once(simulation1: Scenario) -> None:
    with pytest.raises(ScenarioError, match="scenario simulation1, changed") as caught:
        with_keys(simulation1, time={"flight_s": 20.0}, judge={"separation_min_m": 900.0})
    for told in ("2 mistakes", "time.flight_s", "judge.separation_min_m"):
        assert told in caught.value.message
    with pytest.raises(ScenarioError, match=r"speed_limit.*unknown key"):
        with_keys(simulation1, limits={"speed_limit": 3.0})
