"""`gcs schema`: the JSON Schema of scenario files."""

from __future__ import annotations

import json

from gcs.cli.options import DebugOption


def schema(debug: DebugOption = False) -> None:
    """Print the JSON Schema of scenario.toml, for editors and for the curious."""
    from gcs.scenario.model import Scenario

    tables = Scenario.model_json_schema()
    print(json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema", **tables}, indent=2))
