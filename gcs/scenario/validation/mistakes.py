"""One mistake in a scenario and its sentence: key, value and what is allowed.

The allowed ranges come from the JSON Schema of the model.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from gcs.scenario.schema.fields import Disagreement
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.slips.schema_words import (
    Schema,
    follow,
    in_common,
    is_array_of_tables,
    schema_at,
    tables,
    wanted,
)
from gcs.scenario.validation.slips.shown_values import dotted, exact, plain, toml
from gcs.scenario.validation.toml_lines import Key

_STEPS = "Choose|Complete|Correct|Give|Keep|Make|Move|Raise|Remove|Set|Shorten|Widen|Write"
_LAST_STEP = re.compile(rf"\.\s+((?:{_STEPS})\b[^;]*)$")  # a sentence at the end that says what to do
_DEGE7 = 10_000_000
_FARTHEST_M = 1_000_000
_WRITTEN_MAX = 1e12  # larger numbers were not typed by a person
EVERY_KEY = "`gcs schema` prints every key with its unit and range"


@dataclass(frozen=True)
class Mistake:
    """The mistake of one key; `text` follows "key = value: ". `remedy` says what to do, as a `next:` line has it."""

    key: Key
    text: str
    value: Any = None
    remedy: str = ""
    line: int | None = None  # where the text of the file itself is wrong
    is_unknown: bool = False  # no key of the schema

    @property
    def place(self) -> str:
        """The key and its value."""
        shown = "" if self.value is None else f" = {toml(self.value)}"
        return f"{dotted(self.key)}{shown}"

    @property
    def problem(self) -> str:
        """What is wrong, without what to do."""
        return self.text if self.remedy else _LAST_STEP.sub("", self.text)

    @property
    def next_step(self) -> str:
        """What to do; empty where nothing is known but the problem."""
        if self.remedy:
            return self.remedy
        found = _LAST_STEP.search(self.text)
        return found[1][0].lower() + found[1][1:] if found else ""

    @property
    def whole(self) -> str:
        """What is wrong and what to do."""
        stop = "" if self.text.endswith("?") else "."
        return f"{self.text}{stop} {self.remedy[0].upper()}{self.remedy[1:]}" if self.remedy else self.text

    def __str__(self) -> str:
        return f"{self.place}: {self.whole}"


def from_pydantic(error: ValidationError, model: type[BaseModel] = Scenario, within: Key = ()) -> list[Mistake]:
    """The mistakes of a pydantic error, of the whole model or of one value `within` it."""
    schema = json_schema(model)
    errors = error.errors(include_url=False)
    for found in errors:
        found["loc"] = (*within, *found["loc"])
    return [mistake for found in errors for mistake in _mistakes(found, schema)]


@lru_cache
def json_schema(model: type[BaseModel]) -> Schema:
    """The JSON Schema of a model."""
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
    key, kind, value = found["loc"], found["type"], found["input"]
    if kind == "extra_forbidden":
        return Mistake(key, _unknown_key(key, root), is_unknown=True)
    node = schema_at(key, root)
    if kind == "missing":
        given = wanted(node, root)
        if isinstance(key[-1], int):
            return Mistake(
                key[:-1],
                f"has too few values; it must be {wanted(schema_at(key[:-1], root), root)}",
                value,
            )
        forms = [form["required"] for form in schema_at(key[:-1], root).get("oneOf", ())]
        if [key[-1]] in forms:  # a place, which the file may also give in degrees
            text = f"missing; give {' or '.join(form[0] for form in forms)}"
            return Mistake(key, text, remedy=f"add {dotted(key)} = [north, east, height], in m, or {forms[-1][0]}")
        step = f"add {dotted(key)}" if "properties" not in follow(node, root) else f"add a table [{dotted(key)}]"
        return Mistake(key, f"missing; it must be {given}", remedy=step)
    if isinstance(value, dict) and is_array_of_tables(node, root):
        return Mistake(key, f"must be an array of tables. Write [[{dotted(key)}]]")
    if kind == "value_error":
        return Mistake(key, str(found["ctx"]["error"]), None if isinstance(value, dict) else value)
    text = f"must be {wanted(node, root)}"
    if _is_negative(value) and follow(node, root).get("minimum", -1) >= 0:
        step = f"write {key[-1]} = {plain(-value)}" if isinstance(key[-1], str) else f"write {plain(-value)}"
        return Mistake(key, f"must not be negative; it must be {wanted(node, root)}", value, remedy=step)
    if isinstance(value, str) and (near := nearest(value, follow(node, root).get("enum", ()))):
        return Mistake(key, text, value, remedy=f'write {key[-1]} = "{near}"')
    if isinstance(value, int | float) and (asked := _question(key, value)):
        return Mistake(key, f"{text}: {asked[0]}", value, remedy=asked[1])
    return Mistake(key, text, value)


def _question(key: Key, value: float) -> tuple[str, str] | None:
    """What a number out of range is perhaps, and what to write then."""
    name = next((part for part in reversed(key) if isinstance(part, str)), "")
    if name in ("lat_deg", "lon_deg") and isinstance(value, int) and _FARTHEST_M < abs(value) <= 180 * _DEGE7:
        return "is it degrees times 10 million?", f"write {name} = {exact(value / _DEGE7)}"
    if name == "lat_deg" and 90 < abs(value) <= 180:
        return "swapped latitude and longitude?", "exchange lat_deg and lon_deg"
    if name.endswith("_m") and isinstance(value, int) and _FARTHEST_M < abs(value) <= 180 * _DEGE7:
        return "is it degrees times 10 million?", f"write metres; {value} would be {plain(value / _DEGE7)} degrees"
    return None


def _is_negative(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and -_WRITTEN_MAX < value < 0


def nearest(name: str, known: Collection[str]) -> str | None:
    """The known name that a person most likely meant: the same but for its unit, or similar."""
    same = name.lower().replace("-", "_")
    with_unit = [one for one in known if one.startswith(f"{same}_")]
    near = difflib.get_close_matches(same, list(known), n=1)
    return next(iter(with_unit or near), None)


def _unknown_key(key: Key, root: Schema) -> str:
    name = str(key[-1])
    known = list(schema_at(key[:-1], root).get("properties", {}))
    if near := nearest(name, known):
        return f"unknown key; the nearest known one is {near}"
    if homes := [home for home, table in tables(root, root) if name in table.get("properties", {})]:
        return f"unknown key here; it belongs to {max(homes, key=lambda home: in_common(home, key))}"
    return f"unknown key; known ones are {', '.join(known)}"
