"""Vehicle types: `vehicle_type = "quad500"` in a scenario names a preset, or the path of a vehicle file.

A vehicle file has the tables [vehicle] and [limits] of a scenario, the latter with what the type can do, and may name
its autopilot. The scenario's own keys override it. Its mistakes are reported with its own lines.
"""

from importlib.resources import files
from pathlib import Path

from pydantic import Field

from gcs.autopilots.traits import AutopilotKey
from gcs.scenario.schema.fields import Part
from gcs.scenario.schema.scenario import ROLL_PITCH_KEYS, Performance, Scenario, VehicleTable
from gcs.scenario.schema.toml_lines import Table

KEY = "vehicle_type"
DIALECT = "https://json-schema.org/draft/2020-12/schema"
_PRESETS = files("gcs.scenario.schema") / "presets"


class VehicleFile(Part):
    """One type of vehicle: its body, its limits and its autopilot."""

    vehicle: VehicleTable
    limits: Performance
    autopilot: AutopilotKey | None = Field(default=None, description="its autopilot")


def presets() -> tuple[str, ...]:
    """The names of the types that come with the program."""
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in _PRESETS.iterdir() if entry.name[0] != "_"))


def preset_file(name: str) -> Path:
    """The file of a preset."""
    return Path(str(_PRESETS / f"{name}.toml"))


def vehicle_file(wanted: str, folder: Path) -> Path:
    """The preset of this name, else the file of this path, from the scenario's folder."""
    return preset_file(wanted) if wanted in presets() else folder / wanted


def _beside(given: Table, own: object) -> Table:
    """A type's limits without those of U_2..U_4 that the scenario's own replace, which may have another unit."""
    kept = dict(given)
    if old := kept.pop("torque", None):
        kept |= {"roll_pitch_force_N": old[:2], "yaw_moment_Nm": old[2]}
    own_keys = set(own) if isinstance(own, dict) else set()
    if own_keys & set(ROLL_PITCH_KEYS):
        kept = {key: value for key, value in kept.items() if key not in ROLL_PITCH_KEYS}
    if "torque" in own_keys:
        kept.pop("yaw_moment_Nm", None)
    return kept


def with_vehicle(data: Table, kind: VehicleFile) -> Table:
    """A scenario's tables, completed by those of its vehicle type."""
    found = {name: value for name, value in data.items() if name != KEY}
    given = kind.model_dump(mode="json", exclude_none=True)
    given["limits"] = _beside(given["limits"], found.get("limits"))
    for table in ("vehicle", "limits"):
        if isinstance(found.get(table, {}), dict):
            found[table] = {**given[table], **found.get(table, {})}
    mission = found.get("mission", {})
    if kind.autopilot is not None and isinstance(mission, dict):
        found["mission"] = {"autopilot": kind.autopilot, **mission}
    return found


def scenario_schema() -> Table:
    """The JSON Schema of every table and key. It does not require those that a vehicle type may give; loading does."""
    tables = Scenario.model_json_schema()
    kinds = f"type of vehicle: {', '.join(presets())}, or the path of a vehicle file"
    tables["properties"][KEY] = {"type": "string", "description": kinds}
    tables["required"].remove("vehicle")
    for name in ("VehicleTable", "LimitsTable"):
        tables["$defs"][name].pop("required")
    return {"$schema": DIALECT, **tables}
