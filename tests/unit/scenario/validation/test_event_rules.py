"""Events and their orders as typed into a scenario: each mistake is told at its key."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from gcs.scenario.schema.event_table import EventTable
from gcs.scenario.schema.mistake import dotted
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.cross_table import check
from tests.unit.scenario.validation.orchard import orchard


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ({"order": "home"}, "has no event"),
        ({"at_s": 5.0, "event": "storm", "order": "home"}, "stands beside at_s"),
        ({"at_s": 5.0, "order": "scale"}, 'missing; order = "scale" needs it'),
        ({"at_s": 5.0, "order": "home", "factor": 2.0}, 'has no effect with order = "home"'),
        ({"at_s": 5.0, "order": "land", "otherwise": "hold"}, "which needs no plan"),
        ({"silent_for_s": 3.0, "order": "home"}, "one that is not heard gets no new plan"),
        ({"battery_below_percent": 0.0, "order": "land"}, "greater than 0"),
        ({"event": "Big Storm", "order": "land"}, "pattern"),
        ({"at_s": 5.0, "order": "slower"}, 'missing; order = "slower" needs it'),
        ({"at_s": 5.0, "order": "slower", "factor": 1.2}, "not from 0.1 to 0.99"),
        ({"at_s": 5.0, "order": "go"}, 'missing; order = "go" needs it'),
        ({"at_s": 5.0, "order": "hold", "position_m": [1.0, 2.0, 3.0]}, 'or give order = "go"'),
        ({"silent_for_s": 3.0, "order": "resume"}, "one that is not heard gets no new plan"),
    ],
)
def test_a_row_that_cannot_mean_anything_is_refused(row: dict[str, Any], told: str) -> None:
    with pytest.raises(ValidationError, match=told):
        EventTable.model_validate(row)


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ([{"at_s": 5.0, "order": "shape", "shape": "vee"}], "on[0].shape: is no shape of the formation; it has start"),
        ([{"at_s": 5.0, "order": "shape", "shape": "start"}], ""),
        ([{"at_s": 9000.0 / 3, "order": "hold"}], "on[0].at_s: after the flight"),
        (
            [{"at_s": 5.0, "order": "go", "position_m": [1.0, 2.0, 9e3]}],
            "on[0].position_m[2]: outside of limits.height_m",
        ),
        ([{"at_s": 5.0, "order": "slower", "factor": 0.5}, {"event": "on", "order": "resume"}], ""),
        ([{"event": "storm", "order": "hold"}, {"event": "storm", "order": "land"}], "on[1].event: the event of row 1"),
    ],
)
def test_rows_are_compared_with_the_flight_and_each_other(rows: list[dict[str, Any]], told: str) -> None:
    mistakes = check(Scenario.model_validate(orchard(on=rows)))
    said = "".join(f"{dotted(one.key)}: {one.text}" for one in mistakes)
    assert said.startswith(told)
    assert bool(said) == bool(told)


def test_a_shape_that_turns_with_the_course_takes_no_orders() -> None:
    turning = orchard(on=[{"at_s": 5.0, "order": "scale", "factor": 0.9}])
    turning["formation"]["frame"] = "course"
    assert any("changes by itself" in one.text for one in check(Scenario.model_validate(turning)))


def test_a_scenario_without_events_is_written_without_them() -> None:
    assert "on" not in Scenario.model_validate(orchard()).model_dump(mode="json")
