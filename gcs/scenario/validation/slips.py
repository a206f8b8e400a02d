"""Corrects slips in a file's tables, so that each is reported once and hides no other mistake."""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from typing import Any

from gcs.scenario.schema.degree_keys import CENTRE, POSITION, is_number, numbers
from gcs.scenario.schema.fields import Part, tables
from gcs.scenario.schema.mistake import EXACT, Mistake, name_of, nearest, plain, toml
from gcs.scenario.schema.toml_lines import Key, Table
from gcs.scenario.validation.schema_words import inside, json_schema

_ALIKE = 0.75  # below, the key may mean something else, whose value fits nothing
_KEPT_MAX = 20  # slips that one error lists
_METRES_DIGITS = 3  # people write metres with no more of them after the point, and degrees with more
_ROLES = {  # what people call a place and its numbers
    **dict.fromkeys(("lat", "latitude"), "lat"),
    **dict.fromkeys(("lon", "lng", "longitude"), "lon"),
    **dict.fromkeys(("alt", "altitude", "height", "alt_amsl"), "height"),
    **dict.fromkeys(("position", "place", "at", "center", "centre", "location", "coordinates", "coords"), "place"),
    **dict.fromkeys(("gps", "lat_lon", "latlon", "latlng", "point", "position_lat_lon"), "place"),
}

_UNITS: dict[str, tuple[str, dict[str, float]]] = {  # suffix of a key: its unit, and the size of others in it
    "m": ("m", {"m metre metres meter meters": 1.0, "km": 1000.0, "cm": 0.01, "mm": 0.001, "ft feet foot": 0.3048}
          | {"mi": 1609.344, "nmi": 1852.0}),
    "mps": ("m/s", {"m/s mps": 1.0, "km/h kmh kph": 1.0 / 3.6, "kn kt kts knots": 1852.0 / 3600.0, "mph": 0.44704}
            | {"ft/s ftps": 0.3048, "cm/s": 0.01}),
    "mps2": ("m/s²", {"m/s2 m/s^2 m/s² mps2": 1.0}),
    "s": ("s", {"s sec second seconds": 1.0, "ms": 0.001, "min minutes": 60.0, "h": 3600.0}),
    "deg": ("degrees", {"deg degrees °": 1.0, "rad": math.degrees(1.0)}),
    "degps": ("degrees/s", {"deg/s °/s": 1.0}),
    "kg": ("kg", {"kg": 1.0, "g": 0.001, "lb": 0.45359237}),
    **{unit: (unit, {unit: 1.0}) for unit in ("N", "Nm", "V", "Wh")},
    "hz": ("Hz", {"Hz": 1.0}),
}  # fmt: skip
_SIZES = {
    key: {unit: size for names, size in others.items() for unit in names.split()} for key, (_, others) in _UNITS.items()
}
UNIT = "|".join(map(re.escape, sorted({unit for sizes in _SIZES.values() for unit in sizes}, key=len, reverse=True)))
_LONGEST = 40
_WITH_UNIT = re.compile(rf"([-+]?[0-9]{{1,12}}(?:[.,][0-9]{{1,12}})?)\s*({UNIT})?")
_IN_SIXTIETHS = re.compile(
    r"([-+]?)([0-9]{1,3})\s*[°:]\s*([0-9]{1,2})\s*(?:['′:]\s*([0-9]{1,2}(?:\.[0-9]{1,6})?)?)?\s*[\"″]?\s*([NSEW]?)"
)


@dataclass
class Meant:
    """The tables as they were meant, the slips in them, and the keys of the file behind those that were renamed."""

    data: Table
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

    def mend(self, table: Table, node: Table, key: Key, also: tuple[str, ...] = ()) -> None:
        """Make one table of the file what was meant, and tell its slips."""
        known, given = (*node["properties"], *also), dict(table)
        table.clear()
        for name, value in self._with_place(given, known, key).items():
            free = [one for one in known if one not in given and one not in table]
            target, own = (name, value) if name in known else self._renamed(name, value, node, free, key)
            table[target] = self._value(own, inside(node, target), (*key, target))

    def _renamed(self, name: str, value: Any, node: Table, free: list[str], key: Key) -> tuple[str, Any]:
        """The known key that an unknown one means, or the unknown one, and the value in the unit of that key."""
        stem, own = _stem(name), value
        target = f"{stem}_deg" if f"{stem}_deg" in free and _has_degrees(value) else None
        (same, _, unit), is_converted = name.rpartition("_"), False
        for known in free if unit and is_number(value) else ():
            if known.rpartition("_")[0] == same and (found := reading(f"{value} {unit}", known)):
                target, own, is_converted = known, found[0], True
        target = target or nearest(name, free) or nearest(_ROLES.get(stem, name), free)
        if not target:
            return name, value
        text, step = f"unknown key; the nearest known one is {target}", f"write {target} instead of {name}"
        if is_converted:
            text, step = f"unknown key; Skein has it as {target}", f"write {target} = {plain(own, EXACT)}"
        elif not target.startswith(f"{name}_") and SequenceMatcher(None, name.lower(), target).ratio() < _ALIKE:
            self.guessed.add((*key, target))
            text += f" ({inside(node, target).get('description')})"
        self.written[(*key, target)] = (*key, name)
        self.mistakes.append(Mistake((*key, name), text, remedy=step))
        return target, own

    def _with_place(self, table: Table, known: Iterable[str], key: Key) -> Table:
        """The table with its place under the keys that it has for one, where people expect others."""
        keys = POSITION if "position_deg" in known else CENTRE if {"radius_m", "lat_deg"} <= {*known} else None
        names = {role: name for name in table if name not in known and (role := _ROLES.get(_stem(name)))}
        found = {role: table[name] for role, name in names.items()}
        pair = numbers([found.get("lat"), found.get("lon")]) or numbers(found.get("place"), 2, 3)
        if keys is None or pair is None or "position_m" in table:
            return table
        is_in_degrees = "lat" in found or names["place"].endswith("_deg") or _has_degrees([*pair])
        forms = f"{' and '.join(keys.metres)}, or {' and '.join(keys.degrees)}"
        text = f"unknown key; a place is {forms}{' with height_m or alt_amsl_m' if keys.heights else ''}"
        height = toml(found["height"]) if "height" in found else "".join(map(plain, pair[2:]))
        step = f"write {keys.written([pair[:2]], height, metres=not is_in_degrees)}"
        self.mistakes.append(Mistake((*key, next(iter(names.values()))), text, remedy=step))
        rest = {name: value for name, value in table.items() if name not in names.values()}
        if keys is CENTRE:
            return rest | dict(zip(keys.degrees if is_in_degrees else keys.metres, pair, strict=False))
        self.guessed |= {(*key, name) for name in (*keys.metres, *keys.every)}
        return rest

    def _value(self, value: Any, node: Table, key: Key) -> Any:
        is_list = isinstance(value, list) and node.get("type") == "array"
        given = value if is_list else [value]
        parts = [inside(node, row) for row in range(len(value))] if is_list else [node]
        found = [
            reading(one, name_of(key)) if isinstance(one, str) and part.get("type") in ("number", "integer") else None
            for one, part in zip(given, parts, strict=True)
        ]
        if any(found):
            read = [one[0] if one else old for one, old in zip(found, given, strict=True)]
            shown = ", ".join(plain(one, EXACT) if is_number(one) else toml(one) for one in read)
            step = f"write [{shown}]" if is_list else f"write {key[-1]} = {shown}"
            self.mistakes.append(Mistake(key, next(one[1] for one in found if one), value, step))
            return read if is_list else read[0]
        if is_list:
            return [
                self._value(one, part, (*key, row)) for row, (one, part) in enumerate(zip(given, parts, strict=True))
            ]
        return value


def as_meant(data: Table, model: type[Part], also: tuple[str, ...] = ()) -> Meant:
    """The tables of a file as they were meant, and the slips in them.

    `also` are keys of the outermost table that the model does not have.
    """
    meant = Meant(dict(data))
    for key, part, table in tables(model, meant.data):
        meant.mend(table, json_schema(part), key, () if key else also)
    return meant if len(meant.mistakes) <= _KEPT_MAX else Meant(data)  # no slips, but something else than a scenario


def _stem(name: str) -> str:
    return name.lower().removesuffix("_deg").removesuffix("_m")


def _has_degrees(value: object) -> bool:
    """Whether a place, or a list of them, has as many digits as degrees need."""
    if found := numbers(value):
        return any(round(one, _METRES_DIGITS) != one for one in found[:2])
    return isinstance(value, list) and any(numbers(one) and _has_degrees(one) for one in value)


def reading(text: str, key: str) -> tuple[float, str] | None:
    """The number that a text means for a key, and what is wrong with the text; None where that is not plain."""
    text, suffix = text.strip()[: _LONGEST + 1], key.rpartition("_")[2]
    shown, _ = _UNITS.get(suffix, ("", {}))
    if suffix in ("deg", "s") and (found := _IN_SIXTIETHS.fullmatch(text)):
        parts = [float(part or 0.0) for part in found.group(2, 3, 4)]
        value = parts[0] + parts[1] / 60.0 + parts[2] / 3600.0
        size = 1.0 if suffix == "deg" else 3600.0 if found[4] else 60.0
        sign = -1.0 if found[1] == "-" or found[5] in ("S", "W") else 1.0
        return round(sign * size * value, 7), f"must be one number, in {shown}"
    found = _WITH_UNIT.fullmatch(text)
    if not found or len(text) > _LONGEST or (found[2] and found[2] not in _SIZES.get(suffix, ())):
        return None
    value, unit = float(found[1].replace(",", ".")), found[2]
    if unit and (size := _SIZES[suffix][unit]) != 1.0:
        return round(value * size, 3), f"is in {unit}; this key is in {shown}, and its numbers stand alone"
    if unit:
        return value, "has a unit; numbers stand alone, and the key's name ends in the unit"
    is_comma = "," in found[1]
    why = "has a decimal comma; numbers have a point" if is_comma else "must be a number, without quotes"
    return int(value) if value == int(value) else value, why
