"""The text of a scenario to begin with.

Knows: what is filled in, and that what comes out is a scenario. Does not know: where it is written.
"""

from __future__ import annotations

import re
import tomllib
from importlib.resources import files
from pathlib import Path

from gcs.errors import UsageError
from gcs.scenario.schema.scenario import OriginTable, Scenario


def scenario_text(folder: Path, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> str:
    """A scenario named after its folder, at a place on Earth. Raises UsageError for a name or place that cannot be."""
    name = folder.resolve().name
    pattern = next(m.pattern for m in Scenario.model_fields["name"].metadata if hasattr(m, "pattern"))
    if not re.match(pattern, name):
        raise UsageError(
            f'"{name}" cannot be the name of a scenario.', hint="use small letters, digits, - and _, a letter first"
        )
    try:
        OriginTable(lat_deg=lat_deg, lon_deg=lon_deg, alt_amsl_m=alt_amsl_m)
    except ValueError:
        raise UsageError(
            f"there is no place at {lat_deg:g}, {lon_deg:g}, {alt_amsl_m:g} m.",
            hint="--at takes latitude (-85 to 85), longitude (-180 to 180) and height above the sea (-500 to 9000 m)",
        ) from None
    text = (files("gcs.scenario") / "template.toml").read_text(encoding="utf-8")
    filled = {"NAME": name, "FOLDER": str(folder), "LAT": repr(lat_deg), "LON": repr(lon_deg), "ALT": repr(alt_amsl_m)}
    for key, value in filled.items():
        text = text.replace(f"@{key}@", value)
    tomllib.loads(text)
    return text
