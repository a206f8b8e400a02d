"""One mistake in a scenario and its sentence: key, value and what is allowed.

The allowed ranges come from the JSON Schema of the model.
"""

from __future__ import annotations

import difflib
import itertools
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from gcs.scenario.schema.fields import Disagreement
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.toml_lines import Key

Schema = Mapping[str, Any]
_SHOWN_INT = 10**100
_SHOWN_DEPTH = 10


@dataclass(frozen=True)
class Mistake:
    """The mistake of one key; `text` follows "key = value: "."""

    key: Key
    text: str
    value: Any = None

    def __str__(self) -> str:
        shown = "" if self.value is None else f" = {toml(self.value)}"
        return f"{dotted(self.key)}{shown}: {self.text}"


def dotted(key: Key) -> str:
    """The key as text: `formation.vehicle[3].position_m[0]`."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in key)
    return "".join(parts).removeprefix(".")


def toml(value: Any, depth: int = 0) -> str:
    """The value in TOML, cut when it is long or nested deeply."""
    if isinstance(value, bool):
        return str(value).lower()
    if depth > _SHOWN_DEPTH:
        text = "..."
    elif isinstance(value, str):
        text = json.dumps(value, ensure_ascii=False)
    elif isinstance(value, list | tuple):
        text = f"[{', '.join(toml(item, depth + 1) for item in value)}]"
    elif isinstance(value, dict):
        text = f"{{{', '.join(f'{name} = {toml(item, depth + 1)}' for name, item in value.items())}}}"
    elif isinstance(value, int) and abs(value) >= _SHOWN_INT:
        text = hex(value)  # Python refuses thousands of decimal digits
    else:
        text = str(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def from_pydantic(error: ValidationError, model: type[BaseModel] = Scenario) -> list[Mistake]:
    """The mistakes of a pydantic error."""
    schema = _json_schema(model)
    return [mistake for found in error.errors(include_url=False) for mistake in _mistakes(found, schema)]


@lru_cache
def _json_schema(model: type[BaseModel]) -> Schema:
    return model.model_json_schema()


def _mistakes(found: ErrorDetails, root: Schema) -> list[Mistake]:
    error = found.get("ctx", {}).get("error")
    if isinstance(error, Disagreement):
        return [Mistake((*found["loc"], *key), text, _value_at(found["input"], key)) for key, text in error.found]
    return [_mistake(found, root)]


def _value_at(table: Any, key: Key) -> Any:
    """The value at a key inside a table; None without one, and for tables, which are too long to show."""
    for part in key:
        if isinstance(part, str):
            table = table.get(part) if isinstance(table, Mapping) else None
        else:
            table = table[part] if isinstance(table, list | tuple) and part < len(table) else None
    return None if isinstance(table, Mapping) else table


def _mistake(found: ErrorDetails, root: Schema) -> Mistake:
    key, kind = found["loc"], found["type"]
    if kind == "extra_forbidden":
        return Mistake(key, _unknown_key(key, root))
    wanted = _wanted(_schema_at(key, root), root)
    if kind == "missing":
        return Mistake(key, f"missing; it must be {wanted}")
    if isinstance(found["input"], dict) and _is_array_of_tables(_schema_at(key, root), root):
        return Mistake(key, f"must be an array of tables. Write [[{dotted(key)}]]")
    if kind == "value_error":
        value = found["input"] if not isinstance(found["input"], dict) else None
        return Mistake(key, str(found["ctx"]["error"]), value)
    return Mistake(key, f"must be {wanted}", found["input"])


def _unknown_key(key: Key, root: Schema) -> str:
    name = str(key[-1])
    known = list(_schema_at(key[:-1], root).get("properties", {}))
    without_unit = [key for key in known if key.startswith(f"{name}_")]
    if near := without_unit or difflib.get_close_matches(name, known, n=1):
        return f"unknown key; the nearest known one is {near[0]}"
    if homes := [home for home, table in _tables(root, root) if name in table.get("properties", {})]:
        return f"unknown key here; it belongs to {max(homes, key=lambda home: _in_common(home, key))}"
    return f"unknown key; known ones are {', '.join(known)}"


def _tables(node: Schema, root: Schema, key: Key = ()) -> Iterator[tuple[str, Schema]]:
    """Every table with its header, the outer ones first."""
    for name, part in node.get("properties", {}).items():
        table, header = _follow(part, root), f"[{dotted((*key, name))}]"
        if _is_array_of_tables(table, root):
            table, header = _follow(table["items"], root), f"[{header}]"
        if "properties" in table:
            yield header, table
            yield from _tables(table, root, (*key, name))


def _in_common(header: str, key: Key) -> int:
    """The number of tables, from the outermost, that a header shares with a key."""
    names = [part for part in key if isinstance(part, str)]
    shared = zip(header.strip("[]").split("."), names, strict=False)
    return sum(1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1], shared))


def _is_array_of_tables(schema: Schema, root: Schema) -> bool:
    return "properties" in _follow(schema.get("items", {}), root)


def _schema_at(key: Key, root: Schema) -> Schema:
    """The part of the JSON Schema that describes a key; empty without one."""
    node: Schema = root
    for part in key:
        node = _follow(node, root)
        if isinstance(part, str):
            node = node.get("properties", {}).get(part, {})
        else:
            slots = node.get("prefixItems", ())
            node = slots[part] if part < len(slots) else node.get("items", {})
    own = {name: node[name] for name in ("description",) if name in node}
    return {**_follow(node, root), **own}


def _follow(node: Schema, root: Schema) -> Schema:
    """The schema behind a reference or an optional value."""
    if "anyOf" in node:
        node = next(choice for choice in node["anyOf"] if choice.get("type") != "null")
    if "$ref" in node:
        return dict(root["$defs"][node["$ref"].rsplit("/", 1)[-1]])
    return node


def _wanted(schema: Schema, root: Schema) -> str:
    text = _shape(schema, root)
    return f"{text} ({schema['description'].rstrip('.')})" if "description" in schema else text


def _shape(schema: Schema, root: Schema) -> str:
    if "const" in schema:
        return toml(schema["const"])
    if "enum" in schema:
        return f"one of {', '.join(toml(choice) for choice in schema['enum'])}"
    match schema.get("type"):
        case "number":
            return f"a number{_bounds(schema)}"
        case "integer":
            return f"a whole number{_bounds(schema)}"
        case "string":
            pattern, longest = schema.get("pattern"), schema.get("maxLength")
            text = f"text of at most {longest} characters" if longest else "text"
            return f"{text} that matches {pattern}" if pattern else text
        case "boolean":
            return "true or false"
        case "array":
            return _list(schema, root)
        case "object":
            return f"a table with {', '.join(schema.get('required', schema.get('properties', {})))}"
    return "something else"


def _list(schema: Schema, root: Schema) -> str:
    slots = [_shape(_follow(slot, root), root) for slot in schema.get("prefixItems", ())]
    if not slots:
        sizes = ((" of at least ", schema.get("minItems")), (" of at most ", schema.get("maxItems")))
        size = "".join(f"{words}{number}" for words, number in sizes if number)
        return f"a list{size}, each {_shape(_follow(schema.get('items', {}), root), root)}"
    if len(set(slots)) == 1:
        return f"a list of {len(slots)}, each {slots[0]}"
    return f"a list of {len(slots)}: {'; '.join(slots)}"


def _bounds(schema: Schema) -> str:
    if "minimum" in schema and "maximum" in schema:
        return f" from {schema['minimum']:g} to {schema['maximum']:g}"
    signs = (("exclusiveMinimum", ">"), ("minimum", ">="), ("exclusiveMaximum", "<"), ("maximum", "<="))
    parts = [f"{sign} {schema[name]:g}" for name, sign in signs if name in schema]
    return f" {' and '.join(parts)}" if parts else ""
