"""Shapes along a route: names that there are, points that there are, and one place for all changes."""

from __future__ import annotations

from typing import Any

import pytest

from gcs.scenario.schema.mistake import dotted
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.cross_table import check
from tests.unit.scenario.validation.orchard import orchard

POINTS = [[80.0, 0.0, 15.0], [40.0, 50.0, 15.0]]


def told(shapes: tuple[str | None, str | None], *changes: dict[str, Any], loops: int = 1) -> list[tuple[str, str]]:
    route = [{"position_m": place, "shape": shape} for place, shape in zip(POINTS, shapes, strict=True)]
    formation = {"change": [{"kind": "reshape", "to": "start"} | change for change in changes]}
    data = orchard(route=route, loops=loops, keep_in=[], formation=formation, time={"flight_s": 300.0})
    mistakes = check(Scenario.model_validate(data))
    return [(dotted(mistake.key), f"{mistake.text}; {mistake.remedy}") for mistake in mistakes]


def test_a_shape_is_the_start_or_one_of_the_table() -> None:
    assert told(("line", "start")) == []
    ((key, text),) = told(("lines", None))
    assert key == "route[0].shape"
    assert 'there are "start", "line"' in text


@pytest.mark.parametrize(("loops", "at_point", "ok"), [(1, 2, True), (1, 3, False), (2, 4, True), (2, 5, False)])
def test_a_change_begins_at_a_point_of_a_round(loops: int, at_point: int, ok: bool) -> None:
    found = told((None, None), {"at_point": at_point}, loops=loops)
    assert [key for key, _ in found] == ([] if ok else ["formation.change[0].at_point"])
    assert ok or f"[[route]] has {2 * loops} points" in found[0][1]


@pytest.mark.parametrize("change", [{"at_s": 3.0}, {"at_point": 1}, {"gate_m": [[20.0, -9.0], [20.0, 9.0]]}])
def test_changes_of_both_kinds_are_refused(change: dict[str, Any]) -> None:
    assert told((None, None), change) == []
    ((key, text),) = told((None, "line"), change)
    assert key == "route[1].shape"
    assert "at_point = 2" in text


def test_a_free_time_allows_changes_at_points() -> None:
    free = {"free": True, "latest_s": 400.0}
    for change, count in (({"at_point": 1}, 0), ({"at_s": 3.0}, 1)):
        formation = {"change": [{"kind": "reshape", "to": "start"} | change]}
        data = orchard(time=free, formation=formation)
        assert len(check(Scenario.model_validate(data))) == count
