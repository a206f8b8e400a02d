"""The JSON Schema of scenario files, as people may write them.

Knows: that a vehicle type brings [vehicle] and half of [limits], and what programs add by themselves. Does not know:
printing.
"""

from __future__ import annotations

from typing import Any

from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.vehicle_types import KEY, presets

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def scenario_schema() -> dict[str, Any]:
    """Every table and key, with unit, range, default. Which keys a vehicle type leaves open, only loading can tell."""
    tables = Scenario.model_json_schema()
    kinds = f"type of vehicle: {', '.join(presets())}, or the path of a vehicle file"
    tables["properties"][KEY] = {"type": "string", "description": kinds}
    tables["required"].remove("vehicle")
    for name in ("VehicleTable", "LimitsTable"):
        tables["$defs"][name].pop("required")
    return {"$schema": DIALECT, **tables}
