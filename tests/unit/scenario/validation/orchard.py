"""The example of a route in docs/scenario.md, as data: four vehicles in a line, three points, one keep-in area."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from gcs.scenario.schema.vehicle_types import preset_file, with_vehicle
from gcs.scenario.sources.load import load_vehicle

PAGE = Path(__file__).resolve().parents[4] / "docs" / "scenario.md"


def orchard_text() -> str:
    """The file."""
    return PAGE.read_text(encoding="utf-8").split("<<'END'\n")[2].partition("END\n")[0]


def orchard(**tables: Any) -> dict[str, Any]:
    """Its tables with the preset's, and keys of some replaced; what is not a table is replaced as a whole."""
    written = tomllib.loads(orchard_text())
    data = with_vehicle(written, load_vehicle(preset_file(written["vehicle_type"])))
    for name, value in tables.items():
        data[name] = {**data.get(name, {}), **value} if isinstance(value, dict) and name != "end" else value
    if data["end"] == "start":
        data["end"] = dict(data["start"])
    return data
