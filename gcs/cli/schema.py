"""`gcs schema`: the JSON Schema of scenario files."""

from __future__ import annotations

import json

from gcs.cli.options import DebugOption


def schema(debug: DebugOption = False) -> None:
    """Print the JSON Schema of scenario.toml, for editors and for the curious."""
    from gcs.scenario.model import Scenario
    from gcs.scenario.vehicle_file import KEY, presets

    tables = Scenario.model_json_schema()
    # A vehicle type brings [vehicle] and half of [limits]: which of them are missing, only loading can tell.
    kinds = f"type of vehicle: {', '.join(presets())}, or the path of a vehicle file"
    tables["properties"][KEY] = {"type": "string", "description": kinds}
    tables["required"].remove("vehicle")
    for name in ("Vehicle", "Limits"):
        tables["$defs"][name].pop("required")
    print(json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema", **tables}, indent=2))
