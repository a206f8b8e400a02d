"""Numbers with a unit, a decimal comma or minutes, where a scenario takes a plain number in the unit of its key."""

from __future__ import annotations

import math
import re

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
