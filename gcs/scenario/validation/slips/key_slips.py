"""Mistyped keys and numbers with units, read as they were meant: one slip is one mistake, and hides no other."""

from __future__ import annotations

import difflib
from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel

from gcs.scenario.validation.mistakes import Mistake, json_schema, nearest
from gcs.scenario.validation.slips.number_units import converted, reading, unit_of
from gcs.scenario.validation.slips.place_slips import has_degrees, place_slip
from gcs.scenario.validation.slips.schema_words import Schema, follow, schema_at
from gcs.scenario.validation.slips.shown_values import dotted, exact, toml
from gcs.scenario.validation.toml_lines import Key

_ALIKE = 0.75  # below, the key may mean something else, whose value fits nothing
_KEPT_MAX = 20  # slips that one error lists


@dataclass
class Meant:
    """The tables as they were meant, the slips in them, and the keys of the file behind those that were renamed."""

    data: dict[str, Any]
    text: str = ""  # of the file, without the slips that TOML refuses
    mistakes: list[Mistake] = field(default_factory=list)
    written: dict[Key, Key] = field(default_factory=dict)
    guessed: set[Key] = field(default_factory=set)  # whose values may be meant for something else

    def in_file(self, key: Key) -> Key:
        """The key as the file has it."""
        for length in range(len(key), 0, -1):
            if key[:length] in self.written:
                return self.in_file(self.written[key[:length]]) + key[length:]
        return key

    def follows(self, mistake: Mistake) -> bool:
        """Whether a mistake only follows from a guess."""
        return any(mistake.key[: len(key)] == key for key in self.guessed)


def as_meant(data: dict[str, Any], model: type[BaseModel], also: tuple[str, ...] = ()) -> Meant:
    """The tables of a file with known keys and plain numbers, and the slips that were corrected in them.

    `also` are keys of the outermost table that the model does not have.
    """
    meant = Meant({})
    meant.data = _Reader(json_schema(model), meant).table(data, json_schema(model), (), also)
    if len(meant.mistakes) > _KEPT_MAX:  # no slips, but something else than a scenario
        return Meant(data)
    return meant


@dataclass
class _Reader:
    root: Schema
    meant: Meant

    def table(self, table: dict[str, Any], node: Schema, key: Key, also: tuple[str, ...] = ()) -> dict[str, Any]:
        known = (*node.get("properties", {}), *also)
        read: dict[str, Any] = {}
        if slip := place_slip(table, known, key):
            self.meant.mistakes.append(slip.mistake)
            self.meant.guessed |= {(*key, name) for name in slip.guessed}
            table = slip.table
        for name, value in table.items():
            target = name if name in known else self._known(name, value, [k for k in known if k not in table], key)
            if target in read:  # two slips that mean one key
                target = name
            part = schema_at((*key, target), self.root)
            own = value if target == name else self._renamed(name, value, target, key)
            read[target] = self._value(own, part, (*key, target))
        return read

    def _known(self, name: str, value: Any, free: list[str], key: Key) -> str:
        in_degrees = f"{name.lower().removesuffix('_m')}_deg"
        if in_degrees in free and has_degrees(value):
            return in_degrees
        if isinstance(value, int | float):
            same = [known for known in free if converted(value, name, known) is not None]
            if same:
                return same[0]
        return nearest(name, free) or name

    def _renamed(self, name: str, value: Any, target: str, key: Key) -> Any:
        path = (*key, target)
        self.meant.written[path] = (*key, name)
        text, step = f"unknown key; the nearest known one is {target}", f"write {target} instead of {name}"
        if isinstance(value, int | float) and (other := converted(value, name, target)) is not None:
            text, value = f"unknown key; Skein has it in {unit_of(target)}, as {target}", other
            step = f"write {target} = {exact(other)}"
        elif not (target.startswith(f"{name}_") or _ratio(name, target) >= _ALIKE):
            self.meant.guessed.add(path)
        self.meant.mistakes.append(Mistake((*key, name), text, remedy=step))
        return value

    def _value(self, value: Any, node: Schema, key: Key) -> Any:
        node = follow(node, self.root)
        if isinstance(value, dict) and "properties" in node:
            return self.table(value, node, key)
        if isinstance(value, list) and node.get("type") == "array":
            return self._list(value, node, key)
        if isinstance(value, str) and node.get("type") in ("number", "integer"):
            return self._number(value, key)
        return value

    def _list(self, values: list[Any], node: Schema, key: Key) -> list[Any]:
        name = _name(key)
        found = [reading(value, name) if isinstance(value, str) else None for value in values]
        slots = node.get("prefixItems", ())
        kinds = [follow(slots[n] if n < len(slots) else node.get("items", {}), self.root) for n in range(len(values))]
        if any(kind.get("type") == "number" and one for kind, one in zip(kinds, found, strict=True)):
            read = [value if one is None else one.value for value, one in zip(values, found, strict=True)]
            why = next(one.why for one in found if one is not None)
            step = f"write [{', '.join(exact(v) if isinstance(v, int | float) else toml(v) for v in read)}]"
            self.meant.mistakes.append(Mistake(key, why, values, remedy=step))
            return read
        return [self._value(value, kind, (*key, n)) for n, (value, kind) in enumerate(zip(values, kinds, strict=True))]

    def _number(self, text: str, key: Key) -> Any:
        found = reading(text, _name(key))
        if found is None:
            return text
        value = int(found.value) if found.value == int(found.value) else found.value
        step = f"write {dotted(key[-1:])} = {exact(value)}"
        self.meant.mistakes.append(Mistake(key, found.why, text, remedy=step))
        return value


def type_mistake(value: Any, presets: tuple[str, ...], why: str) -> Mistake:
    """The mistake of a vehicle type that is neither a preset nor a file."""
    near = nearest(value, presets) if isinstance(value, str) else None
    step = f'write vehicle_type = "{near}"' if near else f"name a preset ({', '.join(presets)}), or a file"
    return Mistake(("vehicle_type",), why, value, remedy=f"{step}; a path is relative to the scenario's folder")


def _name(key: Key) -> str:
    return next((part for part in reversed(key) if isinstance(part, str)), "")


def _ratio(name: str, target: str) -> float:
    return difflib.SequenceMatcher(None, name.lower(), target).ratio()
