"""Times along a route against the least times of its legs, worked by hand: speed limits are 5, 5 and 1.5 m/s."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.scenario.schema.mistake import dotted
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.cross_table import check
from tests.unit.scenario.validation.orchard import orchard

# 100 m north take 20 s, 60 m east 12 s, and 15 m down 10 s: back at the start after 42 s and more.
CORNERS = [[100.0, 0.0, 15.0], [100.0, 60.0, 15.0], [100.0, 60.0, 30.0]]


def told(*keys: dict[str, Any], flight_s: float = 300.0, **tables: Any) -> list[tuple[str, str]]:
    """Key and text of the mistakes of a route along CORNERS, whose points have these keys too."""
    route = [{"position_m": place} | more for place, more in zip(CORNERS, (*keys, {}, {}, {}), strict=False)]
    data = orchard(**({"route": route, "keep_in": [], "time": {"flight_s": flight_s}} | tables))
    mistakes = check(Scenario.model_validate(data))
    return [(dotted(mistake.key), f"{mistake.text}; {mistake.remedy}") for mistake in mistakes]


@pytest.mark.parametrize(
    ("keys", "key", "found"),
    [
        (({"at_s": 19.9},), "route[0].at_s", "leg 1, to route[0], takes at least 20.0 s"),
        (({"by_s": 19.9},), "route[0].by_s", "at limits.speed_ned_mps[0] = 5 m/s; by_s leaves 19.9 s from the start"),
        (({"at_s": 50.0}, {"at_s": 61.0}), "route[1].at_s", "leg 2, to route[1], takes at least 12.0 s"),
        (
            ({"after_s": 50.0}, {"by_s": 61.0}),
            "route[1].by_s",
            "by_s leaves 11 s from route[0]; set route[1].by_s to 65 or more",
        ),
        (({"after_s": 5.0}, {"by_s": 31.0}), "route[1].by_s", "2 legs take 32.0 s; by_s leaves 31 s from the start"),
        (({"hold_s": 5.0}, {}, {"by_s": 46.0}), "route[2].by_s", "leg 1, to route[0], takes at least 20.0 s"),
        (({"at_s": 60.0}, {"at_s": 60.0}), "route[1].at_s", "must be later than route[0] at 60 s"),
        (({"at_s": 300.0},), "route[0].at_s", "is after the flight, which ends at time.flight_s = 300"),
    ],
)
def test_a_leg_that_has_too_little_time_is_named(keys: tuple[dict[str, Any], ...], key: str, found: str) -> None:
    ((where, text),) = told(*keys)
    assert where == key
    assert found in text


def test_a_time_that_is_too_early_is_where_the_next_leg_begins() -> None:
    first, second = told({"at_s": 19.0}, {"at_s": 30.5})
    assert [first[0], second[0]] == ["route[0].at_s", "route[1].at_s"]
    assert "at_s leaves 11.5 s from route[0]; set route[1].at_s to 34 or more" in second[1]


def test_legs_and_holds_add_up_to_the_least_flight() -> None:
    """20 + 12 + 10 s, and 20 s back; 5 s of hold."""
    assert told({"hold_s": 5.0}, flight_s=67.1) == []
    ((key, text),) = told({"hold_s": 5.0}, flight_s=66.9)
    assert key == "time.flight_s"
    assert "leg 1, to route[0], takes at least 20.0 s" in text
    assert "4 legs and holds take 67.0 s; flight_s leaves 66.9 s from the start" in text
    assert told({"hold_s": 5.0}, flight_s=66.9, time={"free": True, "latest_s": 67.1, "flight_s": 66.9}) == []
    assert told({"hold_s": 5.0}, time={"free": True, "latest_s": 66.9})[0][0] == "time.latest_s"


def test_a_radius_shortens_both_legs() -> None:
    """10 m around the first point: 18 s and 10 s instead of 20 and 12."""
    assert told({"radius_m": 10.0, "by_s": 18.1}, {"by_s": 28.1}) == []
    assert [key for key, _ in told({"radius_m": 10.0, "by_s": 17.9}, {"by_s": 28.1})] == ["route[0].by_s"]
    assert [key for key, _ in told({"radius_m": 10.0}, {"by_s": 27.9})] == ["route[1].by_s"]


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(0.0, 30.0), min_size=3, max_size=3), st.floats(0.5, 20.0))
def test_times_that_leave_each_leg_its_least_time_are_no_mistake(more_s: list[float], first_s: float) -> None:
    least_s, at_s, keys = (20.0, 12.0, 10.0), 0.0, []
    for least, more in zip(least_s, more_s, strict=True):
        at_s += least + more + 1e-6
        keys.append({"at_s": at_s})
    assert told(*keys) == []
    keys[1]["at_s"] = max(keys[0]["at_s"] + 12.0 - first_s, 0.0)
    assert told(*keys)[0][0] == "route[1].at_s"


def test_rounds_and_their_times() -> None:
    assert told(loops=3, flight_s=600.0) == []
    assert [key for key, _ in told({"at_s": 30.0, "hold_s": 1.0}, loops=2)] == ["route[0].at_s"]
    ((key, text),) = told(loops=34, flight_s=7000.0)
    assert key == "loops"
    assert "makes 102 points of 3" in text and "set loops to 33" in text
    assert [key for key, _ in told(route=[], loops=2)] == ["loops"]
    ((key, text),) = told(loops=2, flight_s=95.0)  # 20 + 12 + 10, 12 back to the first point, 12 + 10 + 20
    assert key == "time.flight_s" and "7 legs" in text


@pytest.mark.parametrize(
    ("places", "keys"),
    [
        ([[0.0, 0.05, 15.0]], ["route[0].position_m"]),
        ([[50.0, 0.0, 15.0], [50.0, 0.0, 15.09], [50.0, 0.0, 16.0]], ["route[1].position_m"]),
        ([[50.0, 0.0, 15.0], [50.0, 0.0, 15.11]], []),
        ([[50.0, 0.0, 15.0], [0.0, 0.0, 15.0]], ["route[1].position_m"]),
    ],
)
def test_a_leg_has_a_length(places: list[list[float]], keys: list[str]) -> None:
    assert [key for key, _ in told(route=[{"position_m": place} for place in places])] == keys
    if keys == ["route[0].position_m"]:
        assert keys[0] in [key for key, _ in told(route=[{"position_m": place} for place in places], loops=2)]
