"""`gcs schema`: print the JSON Schema of scenario files."""

from __future__ import annotations

import json

from gcs.cli.shared_options import DebugOption


def schema(debug: DebugOption = False) -> None:
    """Print the JSON Schema of scenario.toml, for editors that complete TOML.

    Example: gcs schema > scenario.schema.json
    """
    from gcs.scenario.schema.json_schema import scenario_schema

    print(json.dumps(scenario_schema(), indent=2))
