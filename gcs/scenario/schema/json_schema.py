"""The JSON Schema of scenario files; with a vehicle type, [vehicle] and half of [limits] may be left out."""

from __future__ import annotations

from typing import Any

from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.schema.vehicle_types import KEY, presets

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def scenario_schema() -> dict[str, Any]:
    """The schema of every table and key. It does not require the keys that a vehicle type may give; loading does."""
    tables = Scenario.model_json_schema()
    kinds = f"type of vehicle: {', '.join(presets())}, or the path of a vehicle file"
    tables["properties"][KEY] = {"type": "string", "description": kinds}
    tables["required"].remove("vehicle")
    for name in ("VehicleTable", "LimitsTable"):
        tables["$defs"][name].pop("required")
    return {"$schema": DIALECT, **tables}
