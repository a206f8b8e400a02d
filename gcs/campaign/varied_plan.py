"""Scenarios with values of the design in place of their own: a campaign about the plan itself plans for every flight.

A factor whose name has a dot is a key of the scenario: `vehicle.mass_kg`, or `formation.vehicle.0.sysid` of a list.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gcs.campaign.design import Value
from gcs.campaign.records import Row
from gcs.errors import UsageError
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Report, refusal, verify
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario


def varied_keys(row: Row) -> dict[str, Value]:
    """Return the values of a row of the design that belong into the scenario, by key."""
    return {name: value for name, value in row.items() if "." in name}


def refuse_unknown_keys(scenario: Scenario, keys: Iterable[str]) -> None:
    """Raise UsageError for a key that the scenario does not have."""
    data = scenario.model_dump(mode="json")
    for key in keys:
        _place(data, key)


def varied_scenario(scenario: Scenario, values: Mapping[str, Value]) -> Scenario:
    """Return the scenario with these values, checked as one from a file. Raises ScenarioError and UsageError."""
    data = scenario.model_dump(mode="json")
    for key, value in values.items():
        table, last = _place(data, key)
        table[last] = value
    with TemporaryDirectory() as folder:
        file = Path(folder) / "scenario.json"
        file.write_text(json.dumps(data))
        return load_scenario(file)


def planned_anew(scenario: Scenario, values: Mapping[str, Value]) -> tuple[Plan, Report]:
    """Return the plan of the scenario with these values. Raises as planning, and VerificationError for a wrong plan."""
    plan = make_plan(varied_scenario(scenario, values))
    report = verify(plan)
    if not report.ok:
        raise refusal(report)
    return plan, report


def _place(data: object, key: str) -> tuple[Any, Any]:
    """The table or list that has the last part of a key, and that part."""
    *path, last = key.split(".")
    known = data
    for part in path:
        known = known.get(part) if isinstance(known, dict) else _item(known, part)
    if isinstance(known, dict) and last in known:
        return known, last
    if _item(known, last) is not None:
        return known, int(last)
    raise UsageError(
        f"--vary {key}: the scenario has no such key"
        + (f"; there are {', '.join(sorted(map(str, known)))}" if isinstance(known, dict) else ""),
        hint="name the key with its tables: --vary vehicle.mass_kg=1.8..2.4",
    )


def _item(known: object, part: str) -> object:
    return known[int(part)] if isinstance(known, list) and part.isdecimal() and int(part) < len(known) else None
