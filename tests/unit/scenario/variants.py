"""Scenarios with formations that change, made from Simulation 1: as data and as the text of a file."""

from __future__ import annotations

import copy
from typing import Any

from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.rule_set import Rules

Data = dict[str, Any]

# Simulation 1 over flat ground, with room for a thousand vehicles around its start and its end.
ROOM = {"north_m": [-600.0, 1500.0], "east_m": [-600.0, 1600.0], "height_m": [0.0, 200.0]}


def changed(data: Data, *path_and_value: Any) -> Data:
    """A copy with the value at a path replaced: changed(data, "limits", "north_m", [0.0, 1.0])."""
    *path, last, value = path_and_value
    copied = copy.deepcopy(data)
    node: Any = copied
    for part in path:
        node = node[part]
    node[last] = value
    return copied


def with_changes(data: Data, *changes: Data, **formation: Any) -> Data:
    """Simulation 1's six vehicles and these changes of shape."""
    copied = copy.deepcopy(data)
    copied["formation"] |= {"change": list(changes), **formation}
    return copied


def counted(data: Data, count: int, shape: Data, **formation: Any) -> Data:
    """So many vehicles in one shape, over flat ground and in a wide box."""
    copied = copy.deepcopy(data)
    copied["limits"] |= ROOM
    copied["terrain"] = {}
    formation = {"count": count, "start_shape": shape["name"], "shape": [shape], **formation}
    copied["formation"] = {"leader": 1, **formation}
    return copied


def counted_scenario(data: Data, count: int, shape: Data, **formation: Any) -> Scenario:
    """The same, as a scenario."""
    return Scenario.model_validate(counted(data, count, shape, **formation))


def formation_text(text: str, formation: str) -> str:
    """The text of a scenario file with another [formation], which keeps the line it begins on."""
    begin, end = text.index("[formation]"), text.index("[ground_phases]")
    return f"{text[:begin]}{formation.strip()}\n\n{text[end:]}"


def with_tables(data: Data, **tables: Any) -> Data:
    """A copy with keys of some tables replaced, tables added, and what is no table replaced as a whole."""
    copied = copy.deepcopy(data)
    for name, value in tables.items():
        copied[name] = {**copied.get(name, {}), **value} if isinstance(value, dict) else value
    return copied


def violated(rules: Rules, data: Data) -> list[str]:
    """The mistakes that these rules alone find, as people read them."""
    return [str(mistake) for mistake in rules.violated(Scenario.model_validate(data), tuple(Scenario.model_fields))]
