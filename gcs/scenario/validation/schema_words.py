"""Describes a key from the JSON Schema, and rewrites pydantic's errors for people."""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from gcs.scenario.schema.fields import Disagreement
from gcs.scenario.schema.mistake import EXACT, Mistake, dotted, from_e7, name_of, nearest, plain, toml, value_at
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.schema.toml_lines import Key, Table


@lru_cache
def json_schema(model: type[BaseModel]) -> Table:
    """The JSON Schema of a model, with what it refers to in place, and without the null of optional values."""
    root = model.model_json_schema()
    return dict(_in_place(root, root.get("$defs", {})))


def from_pydantic(error: ValidationError, model: type[BaseModel] = Scenario, within: Key = ()) -> list[Mistake]:
    """The mistakes of a pydantic error, of the whole model or of one value `within` it."""
    return [mistake for found in error.errors(include_url=False) for mistake in _mistakes(found, model, within)]


def _in_place(node: Any, known: Table) -> Any:
    if isinstance(node, list):
        return [_in_place(one, known) for one in node]
    if not isinstance(node, dict):
        return node
    own = {name: _in_place(one, known) for name, one in node.items() if name not in ("$defs", "$ref", "anyOf")}
    for meant in [known[node["$ref"].rsplit("/", 1)[-1]]] if "$ref" in node else node.get("anyOf", ()):
        if meant.get("type") != "null":
            return _in_place(meant, known) | own
    return own


def inside(node: Table, part: str | int) -> Table:
    """The part of a schema for a key of a table, or for a place in a list; empty without one."""
    if isinstance(part, str):
        return dict(node.get("properties", {}).get(part, {}))
    slots = node.get("prefixItems", ())
    return dict(slots[part] if part < len(slots) else node.get("items", {}))


def _mistakes(found: ErrorDetails, model: type[BaseModel], within: Key) -> Iterator[Mistake]:
    key, value, error = (*within, *found["loc"]), found["input"], found.get("ctx", {}).get("error")
    node = above = json_schema(model)
    for part in key:
        above, node = node, inside(node, part)
    if isinstance(error, Disagreement):
        for inner, text, step in error.found:
            given = value_at(value, inner)
            yield Mistake((*key, *inner), text, None if isinstance(given, dict) else given, step)
    elif found["type"] == "extra_forbidden":
        yield _unknown_key(key, above, json_schema(model))
    elif found["type"] == "missing" and isinstance(key[-1], int):
        yield Mistake(key[:-1], f"has too few values; it must be {_wanted(above)}", value)
    elif found["type"] == "missing":
        forms = [form["required"] for form in above.get("oneOf", ())]
        if [key[-1]] in forms:  # a place, which the file may also give in degrees
            step = f"add {dotted(key)} = [north, east, height], in m, or {forms[-1][0]}"
            yield Mistake(key, f"missing; give {' or '.join(form[0] for form in forms)}", remedy=step)
        else:
            step = f"add a table [{dotted(key)}]" if "properties" in node else f"add {dotted(key)}"
            yield Mistake(key, f"missing; it must be {_wanted(node)}", remedy=step)
    elif isinstance(value, dict) and "properties" in inside(node, 0):
        yield Mistake(key, "must be an array of tables", remedy=f"write [[{dotted(key)}]]")
    elif found["type"] == "value_error":
        yield Mistake(key, str(error), value)
    else:
        text, step = _guess(key, value, node)
        yield Mistake(key, f"must be {_wanted(node)}{text}", value, remedy=step)


def _guess(key: Key, value: object, node: Table) -> tuple[str, str]:
    """What a value outside its range is perhaps, and what to write then; both empty where nothing is likely."""
    write = f"write {key[-1]} = " if isinstance(key[-1], str) else "write "
    if isinstance(value, str):
        near = nearest(value, node.get("enum", ()))
        return "", f'{write}"{near}"' if near else ""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return "", ""
    if value < 0.0 <= node.get("minimum", -1.0) <= -value <= node.get("maximum", 0.0):
        return "", write + plain(-value)
    if (meant := from_e7(value)) is not None:
        step = f"write metres; {value} would be {plain(meant)} degrees"
        step = f"{write}{plain(meant, EXACT)}" if name_of(key).endswith("_deg") else step
        return (": is it degrees times 10 million?", step) if name_of(key).endswith(("_m", "_deg")) else ("", "")
    if key[-1] == "lat_deg" and 90.0 < abs(value) <= 180.0:
        return ": swapped latitude and longitude?", "exchange lat_deg and lon_deg"
    return "", ""


def _unknown_key(key: Key, table: Table, root: Table) -> Mistake:
    """The mistake of a key that its table does not have."""
    name, known = str(key[-1]), table.get("properties", {})
    if homes := [(path, header) for path, header, other in _tables(root) if name in other["properties"]]:
        _, home = max(homes, key=lambda one: sum(a == b for a, b in zip(one[0], key, strict=False)))
        return Mistake(key, f"unknown key here; it belongs to {home}", remedy=f"move it to {home}")
    step = f"remove {dotted(key)}; `gcs schema` prints every key with its unit and range"
    return Mistake(key, f"unknown key; known ones are {', '.join(known)}", remedy=step)


def _tables(node: Table, path: Key = ()) -> Iterator[tuple[Key, str, Table]]:
    """Every table with its key and its header, the outer ones first."""
    for name, part in node.get("properties", {}).items():
        for depth, table in enumerate((part, inside(part, 0)), start=1):
            if "properties" in table:
                yield (*path, name), "[" * depth + dotted((*path, name)) + "]" * depth, table
                yield from _tables(table, (*path, name))


def _wanted(node: Table) -> str:
    """What a value must be, and what the key means."""
    description = node.get("description")
    return _shape(node) + (f" ({description.rstrip('.')})" if description else "")


def _shape(node: Table) -> str:
    kind, slots = node.get("type"), [_shape(slot) for slot in node.get("prefixItems", ())]
    if "const" in node or "enum" in node:
        choices = node.get("enum", [node.get("const")])
        return ("one of " if len(choices) > 1 else "") + ", ".join(map(toml, choices))
    if kind in ("number", "integer"):
        return f"a {'whole ' * (kind == 'integer')}number{_bounds(node)}"
    if kind == "string":
        longest, pattern = node.get("maxLength"), node.get("pattern")
        text = f"text of at most {longest} characters" if longest else "text"
        return f"{text} that matches {pattern}" if pattern else text
    if slots:
        each = f", each {slots[0]}" if len({*slots}) == 1 else f": {'; '.join(slots)}"
        return f"a list of {len(slots)}{each}"
    if kind == "array":
        sizes = ((" of at least ", node.get("minItems")), (" of at most ", node.get("maxItems")))
        size = "".join(f"{words}{number}" for words, number in sizes if number)
        return f"a list{size}, each {_shape(node.get('items', {}))}"
    if kind == "object":
        forms = " or ".join(", ".join(form["required"]) for form in node.get("oneOf", ()))
        needed = [*node.get("required", ()), *([forms] if forms else ())]
        return f"a table with {', '.join(needed or node.get('properties', {}))}"
    return "true or false" if kind == "boolean" else "something else"


def _bounds(node: Table) -> str:
    if "minimum" in node and "maximum" in node:
        return f" from {node['minimum']:g} to {node['maximum']:g}"
    signs = (("exclusiveMinimum", ">"), ("minimum", ">="), ("exclusiveMaximum", "<"), ("maximum", "<="))
    return " and".join(f" {sign} {node[name]:g}" for name, sign in signs if name in node)
