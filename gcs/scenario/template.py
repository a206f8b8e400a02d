"""The text of a first scenario: a short one, or one with every table."""

from __future__ import annotations

import re
import tomllib
from importlib.resources import files
from pathlib import Path

from gcs.errors import UsageError
from gcs.scenario.schema.scenario import OriginTable, Scenario


def scenario_text(folder: Path, lat_deg: float, lon_deg: float, alt_amsl_m: float, *, full: bool = False) -> str:
    """The text of a scenario named after its folder, at a place on Earth; `full` has every table, commented.

    Raises UsageError for a folder whose name cannot be a scenario's, and for a place out of range.
    """
    name = folder.resolve().name
    pattern = next(m.pattern for m in Scenario.model_fields["name"].metadata if hasattr(m, "pattern"))
    if not re.match(pattern, name):
        raise UsageError(
            f'"{name}" cannot be the name of a scenario.',
            hint="use small letters, digits, - and _; begin with a letter or a digit",
        )
    try:
        OriginTable(lat_deg=lat_deg, lon_deg=lon_deg, alt_amsl_m=alt_amsl_m)
    except ValueError:
        raise UsageError(
            f"--at {lat_deg:g} {lon_deg:g} {alt_amsl_m:g}: out of range.",
            hint="give latitude (-85 to 85), longitude (-180 to 180) and height above the sea (-500 to 9000 m)",
        ) from None
    template = "template_full.toml" if full else "template.toml"
    text = (files("gcs.scenario") / template).read_text(encoding="utf-8")
    filled = {"NAME": name, "FOLDER": str(folder), "LAT": repr(lat_deg), "LON": repr(lon_deg), "ALT": repr(alt_amsl_m)}
    for key, value in filled.items():
        text = text.replace(f"@{key}@", value)
    tomllib.loads(text)
    return text
