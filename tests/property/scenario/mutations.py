"""Bundled scenarios with seeded mistakes: in their values, their keys, their tables and their text.

Most mistakes are gross, and are refused. Some stay inside the ranges of the schema, so that they come as far as the
planner: small factors, the bounds themselves, and keys that a file leaves out.
"""

from __future__ import annotations

import copy
import datetime
import json
import math
import random
import tomllib
from pathlib import Path
from typing import Any

from gcs.frames import Origin
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.schema.vehicle_types import preset_file, presets
from gcs.scenario.sources.template import scenario_text
from tests.property.scenario.in_degrees import in_degrees

Data = dict[str, Any]
Slot = tuple[Any, Any]  # a dict and its key, or a list and its index

ROOT = Path(__file__).resolve().parents[3]
PRESETS = [preset_file(name) for name in presets()]
HEX_DIGITS = 5000  # more than Python converts to decimals
NUMBERS: tuple[Any, ...] = (
    *(0, 0.0, -0.0, -1, 1, -1.5, 0.5, 2.0, 3, 7.25, 100, 254, 255, 10_000, 10_001),
    *(1e-3, 1e-9, -1e-9, 5e-324, 1e-300, -1e-300, 1e-154, 1e6, -1e6, 1e15, 1e100, 1e154, -1e200, 1e308, -1e308),
    *(1.7976931348623157e308, float("nan"), float("inf"), float("-inf")),
    *(2**31, -(2**31), 2**53 + 1, 2**63 - 1, 2**64, 10**30, -(10**30), 10**308, 10**400, -(10**400), 16**HEX_DIGITS),
)
STRINGS = (
    *(
        "",
        "5",
        "nan",
        "x",
        "start",
        "f150",
        "quad500",
        "../../etc/passwd",
        "a b",
        "Ä",
        "\u202eabc",
        "\x1b[2J",
        "a\x00b",
    ),
    *("\r\n\t", "\x7f\x85", "\U0001f681", "[red]", "%s%n{0}", "x" * 300, "y" * 20_000),
)
OTHERS: tuple[Any, ...] = (
    *(True, False, [], {}, [[]], [{}], [None, 1], {"a": 1}, {"": {}}, [1.0], [1.0, 2.0], [0.0, 0.0, 0.0], [[0.0, 0.0]]),
    *(datetime.date(1979, 5, 27), datetime.time(7, 32), datetime.datetime(1979, 5, 27, 7, 32, tzinfo=datetime.UTC)),
)
FACTORS = (-1.0, 0.5, 0.9, 0.99, 1.01, 1.1, 1.5, 2.0, 4.0, 10.0, 0.1, 1e3, 1e-3, 1e9, 1e-9, 1e300, 1e-300)
_SCHEMA = Scenario.model_json_schema()


def bundled() -> dict[str, str]:
    """The texts of all scenarios that come with the program, by name; `dem` files lie in missions/ridge."""
    texts = {
        str(f.relative_to(ROOT / "missions")): f.read_text()
        for f in sorted(ROOT.glob("missions/*/*.toml"))
        if f.parent.name != "campaigns"
    }
    for full in (False, True):
        texts["template_full" if full else "template"] = scenario_text(
            Path("first"), Origin(47.4, 8.55, 440.0), full=full
        )
    changes = tomllib.loads(texts["changes/scenario.toml"])
    changes["no_fly"].append({"polygon_m": [[390.0, -90.0], [400.0, -80.0], [390.0, -70.0]]})
    texts["in degrees"] = toml_text(in_degrees(changes))
    return texts


def mutated(data: Data, chance: random.Random) -> Data:
    """A copy with one to four mistakes, most often one."""
    changed = copy.deepcopy(data)
    for _ in range(chance.choice((1, 1, 1, 1, 2, 2, 3, 4))):
        chance.choice(_MISTAKES)(changed, chance)
    return changed


def mutated_text(text: str, chance: random.Random) -> bytes:
    """The text with some bytes changed, lost or doubled, or cut off."""
    content = bytearray(text.encode())
    for _ in range(chance.choice((1, 1, 2, 5, 20))):
        at, length = chance.randrange(len(content) + 1), chance.randrange(1, 40)
        match chance.randrange(6):
            case 0 if at < len(content):
                content[at] ^= 1 << chance.randrange(8)
            case 1 if at < len(content):
                content[at] = chance.choice(b"\x00\x0b\x1b\"'[]{}=#\\.\n\r,-+e9\xff\xc3")
            case 2:
                del content[at : at + length]
            case 3:
                content[at:at] = content[at : at + length]
            case 4:
                content[at:at] = bytes(chance.choices(range(256), k=chance.randrange(1, 8)))
            case _ if chance.random() < 0.3:
                del content[at:]
    return bytes(content)


def toml_text(data: Data) -> str:
    """Tables as a TOML text. What TOML does not have (None) becomes the text "none"."""
    lines: list[str] = []
    _write_table(lines, data, ())
    return "\n".join(lines) + "\n"


def _write_table(lines: list[str], table: Data, path: tuple[str, ...]) -> None:
    later = []
    for key, value in table.items():
        if len(path) < 20 and (isinstance(value, dict) or _is_array_of_tables(value)):
            later.append((key, value))
        else:
            lines.append(f"{_text(str(key))} = {_inline(value)}")
    for key, value in later:
        place = (*path, str(key))
        header = ".".join(map(_text, place))
        for item in value if isinstance(value, list) else [value]:
            lines.append(f"[[{header}]]" if isinstance(value, list) else f"[{header}]")
            _write_table(lines, item, place)


def _is_array_of_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(item, dict) for item in value)


def _text(value: str) -> str:
    bare = value.replace("_", "").replace("-", "")
    return value if bare.isascii() and bare.isalnum() else json.dumps(value).replace("\x7f", "\\u007f")


def _inline(value: Any) -> str:
    match value:
        case bool():
            return str(value).lower()
        case int() if abs(value) >= 10**300:
            return hex(value) if value > 0 else str(value)
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case list() | tuple():
            return f"[{', '.join(map(_inline, value))}]"
        case dict():
            return f"{{{', '.join(f'{json.dumps(str(k))} = {_inline(v)}' for k, v in value.items())}}}"
        case None:
            return '"none"'
    return value.isoformat() if hasattr(value, "isoformat") else str(value)


def _slots(node: Any) -> list[Slot]:
    """Every place of a value: all keys and all indices."""
    found: list[Slot] = []
    if isinstance(node, dict | list):
        for key in node if isinstance(node, dict) else range(len(node)):
            found.append((node, key))
            found += _slots(node[key])
    return found


def numbers_of(data: Data) -> list[Slot]:
    """The places of all numbers."""
    return [
        (node, key)
        for node, key in _slots(data)
        if isinstance(node[key], int | float) and node[key] not in (True, False)
    ]


def _another_number(data: Data, chance: random.Random) -> None:
    if found := numbers_of(data):
        node, key = chance.choice(found)
        node[key] = chance.choice(NUMBERS)


def _another_size(data: Data, chance: random.Random) -> None:
    if found := numbers_of(data):
        node, key = chance.choice(found)
        if abs(node[key]) < 1e300:
            node[key] = node[key] * chance.choice(FACTORS)


def _another_type(data: Data, chance: random.Random) -> None:
    if found := _slots(data):
        node, key = chance.choice(found)
        # A copy: the next mistake may change it, and each seed must give one file.
        node[key] = copy.deepcopy(chance.choice((*NUMBERS, *STRINGS, *OTHERS, *OTHERS)))


def _another_string(data: Data, chance: random.Random) -> None:
    if found := [(node, key) for node, key in _slots(data) if isinstance(node[key], str)]:
        node, key = chance.choice(found)
        node[key] = chance.choice((*STRINGS, node[key] * chance.choice((2, 3, 1000))))


def _lost_key(data: Data, chance: random.Random) -> None:
    if found := _slots(data):
        node, key = chance.choice(found)
        del node[key]


def _renamed_key(data: Data, chance: random.Random) -> None:
    if found := [(node, key) for node, key in _slots(data) if isinstance(node, dict)]:
        node, key = chance.choice(found)
        names = (key[:-1], f"{key}_m", key.upper(), "x" * 200, "\x1b[2J", "", "name", chance.choice(found)[1])
        node[chance.choice(names)] = node.pop(key)


def _copied_value(data: Data, chance: random.Random) -> None:
    if found := _slots(data):
        (node, key), (other, place) = chance.choice(found), chance.choice(found)
        value = copy.deepcopy(other[place])
        if chance.random() < 0.5:
            other[place] = copy.deepcopy(node[key])  # swapped; a copy cannot contain itself
        node[key] = copy.deepcopy(value)
        if isinstance(node, dict) and chance.random() < 0.2:
            node[str(place)] = value


def _another_list(data: Data, chance: random.Random) -> None:
    if found := [(node, key) for node, key in _slots(data) if isinstance(node[key], list)]:
        node, key = chance.choice(found)
        items = node[key]
        last = items[-1:] or [0.0]
        node[key] = chance.choice(
            (
                *([], items[::-1], items[:-1], items + last, items * 2, items + items[:1], last * len(items)),
                *(last * 300, last * 3000, [items], items[1:], chance.sample(items, len(items))),
            )
        )


def _many_corners(data: Data, chance: random.Random) -> None:
    """A no-fly zone with a jagged outline, or one that moves often."""
    zones = data.get("no_fly")
    corners = chance.choice((3, 4, 7, 60, 500, 501))
    reach = chance.choice((1e-3, 1.0, 50.0, 1e4))
    outline = []
    for number in range(corners):
        angle, radius = 2.0 * math.pi * number / corners, reach * chance.choice((0.5, 1.0, chance.random()))
        outline.append([200.0 + radius * math.cos(angle), 150.0 + radius * math.sin(angle)])
    times = sorted(
        chance.choice((0.0, 1e-9, 1.0, 20_000.0)) * chance.random() for _ in range(chance.choice((0, 2, 900)))
    )
    zone = {"polygon_m": outline, "moves": [[t, chance.uniform(-9.0, 9.0), 0.0] for t in times]}
    data["no_fly"] = [*(zones if isinstance(zones, list) else ()), zone]


def _nested(data: Data, chance: random.Random) -> None:
    if found := _slots(data):
        node, key = chance.choice(found)
        value = node[key]
        is_table = chance.random() < 0.5
        for _ in range(chance.choice((1, 5, 60, 120))):
            value = {"a": value} if is_table else [value]
        node[key] = value


def _from_the_schema(data: Data, chance: random.Random) -> None:
    """A key at a bound of its range, or one that the file leaves out."""
    node: Any = data
    schema = _SCHEMA
    for _ in range(6):
        schema = _followed(schema, chance)
        if isinstance(node, dict) and (keys := schema.get("properties")):
            key: Any = chance.choice([k for k in keys if k != "relief"])
            schema = keys[key]
        elif isinstance(node, list) and node:
            key = chance.randrange(len(node))
            slots = schema.get("prefixItems", ())
            schema = slots[key] if key < len(slots) else schema.get("items", {})
        else:
            return
        is_there = isinstance(node, list) or key in node
        if not is_there or not isinstance(node[key], dict | list):
            node[key] = _valid(schema, chance, data)
            return
        node = node[key]


def _followed(schema: Data, chance: random.Random) -> Data:
    if "anyOf" in schema:
        schema = chance.choice([choice for choice in schema["anyOf"] if choice.get("type") != "null"])
    if "$ref" in schema:
        schema = _SCHEMA["$defs"][schema["$ref"].rsplit("/", 1)[-1]]
    return schema


def _valid(schema: Data, chance: random.Random, data: Data) -> Any:
    """A value that a part of the schema allows, at a bound of its range as often as within it."""
    schema = _followed(schema, chance)
    if "const" in schema or "enum" in schema:
        return chance.choice(schema.get("enum", [schema.get("const")]))
    match schema.get("type"):
        case "number" | "integer":
            low = schema.get("minimum", schema.get("exclusiveMinimum", -1e3))
            high = schema.get("maximum", schema.get("exclusiveMaximum", 1e3))
            value = chance.choice((low, high, 1.01 * low, 0.99 * high, chance.uniform(low, high), 1.0, 0.1, 10.0))
            return value if schema["type"] == "number" else int(value)
        case "boolean":
            return chance.random() < 0.5
        case "string":
            names = [shape["name"] for shape in _listed(data, "formation", "shape") if "name" in shape]
            return chance.choice(("start", "x", "first", *map(str, names)))
        case "array":
            slots = schema.get("prefixItems")
            if slots is None:
                slots = [schema.get("items", {})] * chance.choice((0, 1, 2, 3, 5))
            return [_valid(slot, chance, data) for slot in slots]
        case "object":
            given = schema.get("required", ())
            return {
                key: _valid(part, chance, data)
                for key, part in schema.get("properties", {}).items()
                if key != "relief" and (key in given or chance.random() < 0.3)
            }
    return 1.0


def _listed(data: Data, *path: str) -> list[Data]:
    node: Any = data
    for part in path:
        node = node.get(part, []) if isinstance(node, dict) else []
    return [item for item in node if isinstance(item, dict)] if isinstance(node, list) else []


_MISTAKES = (
    *(_another_number, _another_number, _another_number, _another_size, _another_size, _another_size),
    *(_another_type, _many_corners, _another_string, _lost_key, _renamed_key, _copied_value, _another_list, _nested),
    *(_from_the_schema, _from_the_schema, _from_the_schema),
)
assert tomllib.loads(toml_text({"a": {"b": [{"c": float("inf")}]}})) == {"a": {"b": [{"c": float("inf")}]}}
