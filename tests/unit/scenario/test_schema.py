"""`gcs schema`: the printed JSON Schema accepts the bundled mission and says what each key means."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gcs.cli.main import run
from gcs.scenario.schema.scenario import Scenario
from tests.property.scenario.mutations import bundled

Schema = dict[str, Any]


@pytest.fixture
def schema(capsys: pytest.CaptureFixture[str]) -> Schema:
    assert run(["schema"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert isinstance(printed, dict)
    return printed


def violations(value: Any, schema: Schema, root: Schema, at: str = "") -> Iterator[str]:
    """The rules of JSON Schema 2020-12 that the printed schema uses; any other makes the test fail."""
    known = {
        "$defs", "$schema", "$ref", "anyOf", "type", "properties", "required", "additionalProperties", "items",
        "prefixItems", "minItems", "maxItems", "minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "enum",
        "const", "pattern", "maxLength", "title", "description", "default", "oneOf",
    }  # fmt: skip
    assert set(schema) <= known
    if "$ref" in schema:
        yield from violations(value, root["$defs"][schema["$ref"].rsplit("/", 1)[1]], root, at)
        return
    if "anyOf" in schema:
        if all(any(violations(value, choice, root, at)) for choice in schema["anyOf"]):
            yield f"{at}: none of anyOf"
        return
    types = {"object": dict, "array": list, "string": str, "integer": int, "number": (int, float), "null": type(None)}
    types["boolean"] = bool
    kind = schema.get("type")
    if kind and (not isinstance(value, types[kind]) or isinstance(value, bool) != (kind == "boolean")):
        yield f"{at}: not {schema['type']}"
        return
    if "const" in schema and value != schema["const"]:
        yield f"{at}: not {schema['const']}"
    if "enum" in schema and value not in schema["enum"]:
        yield f"{at}: not in {schema['enum']}"
    if isinstance(value, dict):
        yield from (f"{at}.{key}: missing" for key in schema.get("required", []) if key not in value)
        forms = [form["required"] for form in schema.get("oneOf", ())]
        if forms and [all(key in value for key in form) for form in forms].count(True) != 1:
            yield f"{at}: not one of {forms}"
        for key, inner in value.items():
            if key in schema["properties"]:
                yield from violations(inner, schema["properties"][key], root, f"{at}.{key}")
            else:
                yield f"{at}.{key}: unknown"
    elif isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            yield f"{at}: {len(value)} items"
        slots = schema.get("prefixItems", [])
        for index, inner in enumerate(value):
            rule = slots[index] if index < len(slots) else schema.get("items", {})
            yield from violations(inner, rule, root, f"{at}[{index}]")
    elif isinstance(value, str):
        if len(value) > schema.get("maxLength", len(value)):
            yield f"{at}: too long"
    elif isinstance(value, int | float):
        low, high = schema.get("minimum", value), schema.get("maximum", value)
        above, below = schema.get("exclusiveMinimum", value - 1), schema.get("exclusiveMaximum", value + 1)
        if not (low <= value <= high and above < value < below):
            yield f"{at}: {value} out of range"


def test_the_bundled_mission_is_valid(schema: Schema, repo_root: Path) -> None:
    for file in (repo_root / "missions").glob("*/scenario.toml"):
        assert list(violations(tomllib.loads(file.read_text(encoding="utf-8")), schema, schema)) == []


def test_places_in_degrees_are_valid_and_each_place_has_one_form(schema: Schema) -> None:
    data = tomllib.loads(bundled()["in degrees"])
    assert list(violations(data, schema, schema)) == []
    data["start"]["position_m"] = [0.0, 0.0, 15.0]
    data["no_fly"][0]["lat_deg"] = 474012000
    assert sorted(violations(data, schema, schema)) == [
        ".no_fly[0].lat_deg: 474012000 out of range",
        ".start: not one of [['position_m'], ['position_deg']]",
    ]


def test_formations_of_every_kind_are_valid(schema: Schema, repo_root: Path) -> None:
    data = tomllib.loads((repo_root / "missions" / "simulation1" / "scenario.toml").read_text(encoding="utf-8"))
    data["formation"] = {
        "leader": 300,
        "count": 1000,
        "start_shape": "grid",
        "frame": "course",
        "topology": "leader",
        "shape": [
            {"name": "grid", "generator": "grid", "spacing_m": 2.0},
            {"name": "table", "offsets_m": [[0.0, 2.0 * row, 0.0] for row in range(1000)]},
        ],
        "change": [
            {"kind": "rotate", "at_s": 0, "angle_deg": -90.0, "axis": [0, 1, 0]},
            {"kind": "shrink", "gate_m": [[1.0, 2.0], [3, 4]], "scale": 2},
            {"kind": "reshape", "auto": True, "to": "table", "assignment": "fixed", "weight": 0.1},
        ],
    }
    assert list(violations(data, schema, schema)) == []
    # What programs hand on says every key, with null and empty lists for those left out.
    scenario = Scenario.model_validate(data)
    written = json.loads(scenario.model_dump_json())
    assert list(violations(written, schema, schema)) == []
    assert Scenario.model_validate(written) == scenario
    data["formation"]["change"][0]["auto"] = 1
    data["formation"]["change"][1] |= {"gate_m": [[1.0, 2.0]], "scale": 0.0}
    data["formation"]["shape"][0]["generator"] = "square"
    data["formation"]["count"] = 0
    assert [text.partition(":")[0] for text in sorted(violations(data, schema, schema))] == [
        ".formation.change[0].auto",
        ".formation.change[1].gate_m",
        ".formation.change[1].scale",
        ".formation.count",
        ".formation.shape[0].generator",
    ]


def test_the_schema_refuses_what_the_loader_refuses(schema: Schema, repo_root: Path) -> None:
    data = tomllib.loads((repo_root / "missions" / "simulation1" / "scenario.toml").read_text(encoding="utf-8"))
    data["origin"]["lat_deg"] = 95.0
    data["limits"]["hieght_m"] = [0.0, 1.0]
    data["time"]["flight_s"] = "275"
    del data["start"]["position_m"]
    data["sensors"]["grade"] = "rtx"
    data["start"]["velocity_mps"] = [0.0, 0.0]
    assert sorted(violations(data, schema, schema)) == [
        ".limits.hieght_m: unknown",
        ".origin.lat_deg: 95.0 out of range",
        ".sensors.grade: not in ['rtk', 'gnss']",
        ".start.velocity_mps: 2 items",
        ".start: not one of [['position_m'], ['position_deg']]",
        ".time.flight_s: not number",
    ]


def test_every_key_says_what_it_means(schema: Schema) -> None:
    parts = {"Scenario": schema, **schema["$defs"]}
    silent = [
        f"{name}.{key}"
        for name, part in parts.items()
        for key, node in part["properties"].items()
        if name != "Ripple" and "description" not in node and "$ref" not in json.dumps(node)
    ]
    assert silent == []
    assert all(part["description"] for part in parts.values())
