"""What the JSON Schema of a model says about a key, in the words of a message: its table, its shape, its range."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Any

from gcs.scenario.validation.slips.shown_values import dotted, toml
from gcs.scenario.validation.toml_lines import Key

Schema = Mapping[str, Any]


def tables(node: Schema, root: Schema, key: Key = ()) -> Iterator[tuple[str, Schema]]:
    """Every table with its header, the outer ones first."""
    for name, part in node.get("properties", {}).items():
        table, header = follow(part, root), f"[{dotted((*key, name))}]"
        if is_array_of_tables(table, root):
            table, header = follow(table["items"], root), f"[{header}]"
        if "properties" in table:
            yield header, table
            yield from tables(table, root, (*key, name))


def in_common(header: str, key: Key) -> int:
    """The number of tables, from the outermost, that a header shares with a key."""
    names = [part for part in key if isinstance(part, str)]
    shared = zip(header.strip("[]").split("."), names, strict=False)
    return sum(1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1], shared))


def is_array_of_tables(schema: Schema, root: Schema) -> bool:
    """Whether a key is written [[key]]."""
    return "properties" in follow(schema.get("items", {}), root)


def schema_at(key: Key, root: Schema) -> Schema:
    """The part of the JSON Schema that describes a key; empty without one."""
    node: Schema = root
    for part in key:
        node = follow(node, root)
        if isinstance(part, str):
            node = node.get("properties", {}).get(part, {})
        else:
            slots = node.get("prefixItems", ())
            node = slots[part] if part < len(slots) else node.get("items", {})
    own = {name: node[name] for name in ("description",) if name in node}
    return {**follow(node, root), **own}


def follow(node: Schema, root: Schema) -> Schema:
    """The schema behind a reference or an optional value."""
    if "anyOf" in node:
        node = next(choice for choice in node["anyOf"] if choice.get("type") != "null")
    if "$ref" in node:
        return dict(root["$defs"][node["$ref"].rsplit("/", 1)[-1]])
    return node


def wanted(schema: Schema, root: Schema) -> str:
    """What a value must be, and what the key means."""
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
            forms = [", ".join(form["required"]) for form in schema.get("oneOf", ())]
            needed = [*schema.get("required", ()), *([" or ".join(forms)] if forms else ())]
            return f"a table with {', '.join(needed or schema.get('properties', {}))}"
    return "something else"


def _list(schema: Schema, root: Schema) -> str:
    slots = [_shape(follow(slot, root), root) for slot in schema.get("prefixItems", ())]
    if not slots:
        sizes = ((" of at least ", schema.get("minItems")), (" of at most ", schema.get("maxItems")))
        size = "".join(f"{words}{number}" for words, number in sizes if number)
        return f"a list{size}, each {_shape(follow(schema.get('items', {}), root), root)}"
    if len(set(slots)) == 1:
        return f"a list of {len(slots)}, each {slots[0]}"
    return f"a list of {len(slots)}: {'; '.join(slots)}"


def _bounds(schema: Schema) -> str:
    if "minimum" in schema and "maximum" in schema:
        return f" from {schema['minimum']:g} to {schema['maximum']:g}"
    signs = (("exclusiveMinimum", ">"), ("minimum", ">="), ("exclusiveMaximum", "<"), ("maximum", "<="))
    parts = [f"{sign} {schema[name]:g}" for name, sign in signs if name in schema]
    return f" {' and '.join(parts)}" if parts else ""
