"""Writes the reference pages of docs, and the policy's tables in flying.md:  ./tools/run python tools/reference.py"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from gcs.files import atomic_write
from gcs.scenario.schema.json_schema import scenario_schema
from tools.api_reference import api_reference
from tools.commands_reference import commands_reference
from tools.formats_reference import formats_reference
from tools.markdown import table
from tools.policy_table import PAGE, with_policy_tables
from tools.shape_drawings import shape_drawings

DOCS = Path(__file__).resolve().parent.parent / "docs"
HEAD = """# Scenario files

<!-- made by tools/reference.py from the models in gcs/scenario; change those -->

A mission is a folder with a `scenario.toml`. `gcs new FOLDER` writes a short one that plans at once; with `--full`
it has every table. The [missions](../README.md#missions) are further examples, and [howto.md](howto.md) leads from a
plan to aircraft. Positions are metres north, east and up from the origin (height 0 is the origin, not the ground), or
[latitude and longitude](#latitude-and-longitude). Headings are degrees clockwise from north. `gcs` reports every key
that is missing, unknown, out of range or in conflict with another, with its line; then it plans nothing.

Keys in **bold** are required; of a place, one of its two forms. With a `vehicle_type` you may leave out `[vehicle]` and
the limits of the vehicle itself (`speed_ned_mps` to `control_margin`). A value in the scenario overrides that of the
type. A vehicle file has those two tables and may name its `autopilot`: copy one from `gcs/scenario/presets`.
`gcs schema` prints all keys as JSON Schema, for editors. "Eq." and "§" are the paper's ([design.md](design.md)).

## Latitude and longitude

Every place may be given in degrees instead of metres from the origin, by the key of the same name that ends in `_deg`:

| in metres | in degrees (WGS 84) |
| --- | --- |
| `position_m = [north, east, height]` | `position_deg = [latitude, longitude]`, and `height_m` or `alt_amsl_m` |
| `polygon_m`, `gate_m`: `[[north, east], ...]` | `polygon_deg`, `gate_deg`: `[[latitude, longitude], ...]` |
| `north_m`, `east_m` of disks, mountains and limits | `lat_deg`, `lon_deg` |

Latitude comes first; south and west are negative. A place has one of both forms; one file may have places of both.
`height_m` counts from the origin as in `position_m`, `alt_amsl_m` from mean sea level. Displacements (`moves`,
`offsets_m`) stay metres. Skein converts degrees once, when it reads the file: plans and exports hold the same latitude
and longitude to 1e-7 degrees. Limits in degrees become the largest box in metres inside.

```sh
mkdir -p plans/airfield
cat > plans/airfield/scenario.toml <<'END'
schema_version = 1
name = "airfield"
vehicle_type = "quad500"
origin = { lat_deg = 47.4, lon_deg = 8.55, alt_amsl_m = 488.0 }
time = { flight_s = 90.0 }
start = { position_deg = [47.4, 8.55], height_m = 15.0 }
end = { position_deg = [47.4025, 8.5508], alt_amsl_m = 503.0 }

[limits]
lat_deg = [47.3992, 47.4035]
lon_deg = [8.5480, 8.5525]
height_m = [0.0, 40.0]
clearance_min_m = 5.0
separation_min_m = 5.0

[[no_fly]]
polygon_deg = [[47.4010, 8.5508], [47.4015, 8.5508], [47.4015, 8.5516], [47.4010, 8.5516]]

[[no_fly]]
lat_deg = 47.4017
lon_deg = 8.5492
radius_m = 25.0

[formation]
count = 4
start_shape = "line"
shape = [{ name = "line", generator = "line", spacing_m = 10.0 }]
END
./tools/run gcs show plans/airfield
```

`gcs` asks about numbers that look like something else, and says what to write: swapped latitude and longitude (the
order of GeoJSON and KML), degrees under a key in metres, metres under a key in degrees, degrees times 10 million
(MAVLink), and a lost sign. It refuses places more than 100 km from the origin.

## Routes and keep-in areas

`[[route]]` tables are points that the leader passes between start and end, in the order of the file. It flies through a
point, or beside it within `radius_m`; with `hold_s` it hovers there. `speed_mps` and `heading_deg` are those at the
point. Times (`at_s`, `after_s`, `by_s`) count from T0, when the leader is at the start. `gcs` names the leg for which a
time is too short. `shape` names the shape from the point on; beside other scheduled changes, write
`[[formation.change]]` with `at_point` instead.

`loops = 2` flies all points twice; then a point has no times. All rounds together have at most 100 points. With
`end = "start"` the flight ends where it started, at rest. Two points in a row must be more than 0.1 m apart.

`[[keep_in]]` is an area that no vehicle leaves, from take-off to landing and at any height. Planner, verification,
`gcs check` and the assessment of a flight treat its edge as that of a no-fly zone, also with `zone_margin_m`. The
exported fence ends at the edge, or up to 2 m beyond it where the plan comes near. With several areas, vehicles stay
inside each of them.

```sh
mkdir -p plans/orchard
cat > plans/orchard/scenario.toml <<'END'
schema_version = 1
name = "orchard"
vehicle_type = "quad500"
origin = { lat_deg = 47.4, lon_deg = 8.55, alt_amsl_m = 488.0 }
time = { flight_s = 120.0 }
start = { position_m = [0.0, 0.0, 15.0] }
end = "start"

[limits]
north_m = [-40.0, 140.0]
east_m = [-40.0, 120.0]
height_m = [0.0, 40.0]
clearance_min_m = 5.0
separation_min_m = 5.0

[[keep_in]]
polygon_m = [[-30.0, -30.0], [130.0, -30.0], [130.0, 110.0], [60.0, 110.0], [-30.0, 60.0]]

[[route]]
name = "gate"
position_m = [80.0, 0.0, 15.0]
radius_m = 3.0

[[route]]
name = "well"
position_m = [100.0, 70.0, 20.0]
hold_s = 5.0

[[route]]
position_m = [40.0, 50.0, 15.0]
by_s = 90.0

[formation]
count = 4
start_shape = "line"
shape = [{ name = "line", generator = "line", spacing_m = 8.0 }]
END
./tools/run gcs show plans/orchard
```
"""
HIDDEN = {("Terrain", "relief")}  # passed between programs, never written by hand
Schema = dict[str, Any]


def reference() -> str:
    """The page."""
    schema = scenario_schema()
    return "\n".join([HEAD, "## Keys before the first table\n", *_section(schema, schema, "Scenario", "")])


def _section(schema: Schema, definition: Schema, name: str, path: str) -> list[str]:
    """One table and those below it."""
    rows = []
    below: list[str] = []
    for key, value in definition["properties"].items():
        if (name, key) in HIDDEN:
            continue
        forms = [name for form in definition.get("oneOf", ()) for name in form["required"]]
        required = key in (*definition.get("required", ()), *forms)
        what = value.get("description", "")
        target, many = _definition(value)
        if target is not None:
            inner = f"{path}.{key}".lstrip(".")
            heading = f"`[[{inner}]]`" if many else f"`[{inner}]`"
            below += [f"## {heading}\n", f"{schema['$defs'][target].get('description', '')}\n"]
            below += _section(schema, schema["$defs"][target], target, inner)
            if inner == "formation.shape":
                below.append(shape_drawings())
            if not path:
                continue
            what = f"see {heading}"
        shown = f"**`{key}`**" if required else f"`{key}`"
        rows.append((shown, what, _values(value), _default(value, required)))
    return [table(("key", "what", "values", "if left out"), rows), *below]


def _definition(value: Schema) -> tuple[str | None, bool]:
    """Name of the table that a key holds, and whether there may be many of it."""
    if "$ref" in value:
        return value["$ref"].rpartition("/")[2], False
    if "$ref" in value.get("items", {}):
        return value["items"]["$ref"].rpartition("/")[2], True
    for choice in value.get("anyOf", ()):
        if "$ref" in choice:
            return choice["$ref"].rpartition("/")[2], False
    return None, False


def _values(value: Schema) -> str:
    """What may stand there, in a few words."""
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f'`"{one}"`' for one in value["enum"])
    if "anyOf" in value:
        return " or ".join(_values(one) for one in value["anyOf"] if one.get("type") != "null")
    if "$ref" in value or "$ref" in value.get("items", {}):
        return "table" if "$ref" in value else "tables"
    kind = value.get("type")
    if kind == "array":
        parts = value.get("prefixItems")
        if parts is None:
            return "list of " + _plural(_values(value["items"])).removeprefix("of ")
        texts = [_values(part) for part in parts]
        return f"{len(texts)} {_plural(texts[0])}" if len(set(texts)) == 1 else f"[{'; '.join(texts)}]"
    if kind in ("number", "integer"):
        return _range(value, "number" if kind == "number" else "whole number")
    return {"boolean": "`true`, `false`", "string": "text"}.get(str(kind), str(kind))


def _plural(text: str) -> str:
    """Of what `_values` says about one."""
    return text.replace("number", "numbers", 1) if text.startswith("number") else f"of [{text}]"


def _range(value: Schema, noun: str) -> str:
    low, above = value.get("minimum"), value.get("exclusiveMinimum")
    high, below = value.get("maximum"), value.get("exclusiveMaximum")
    words = [f"> {above:g}"] if above is not None else []
    words += [f"< {below:g}"] if below is not None else []
    if low is not None and high is not None:
        words.append(f"{low:g} to {high:g}")
    else:
        words += [f"at least {low:g}"] if low is not None else []
        words += [f"at most {high:g}"] if high is not None else []
    return " ".join([noun, ", ".join(words)]).strip()


def _default(value: Schema, required: bool) -> str:
    if required or "default" not in value or value["default"] is None:
        return ""
    default = value["default"]
    if isinstance(default, bool):
        return "`true`" if default else "`false`"
    if isinstance(default, str):
        return f'`"{default}"`'
    return "none" if default in ([], {}) or isinstance(default, dict) else f"`{default}`"


PAGES: dict[str, Callable[[], str]] = {
    "scenario.md": reference,
    "api.md": api_reference,
    "commands.md": commands_reference,
    "formats.md": formats_reference,
    PAGE.name: with_policy_tables,
}

if __name__ == "__main__":
    for name, page in PAGES.items():
        atomic_write(DOCS / name, page())
        print(DOCS / name)
