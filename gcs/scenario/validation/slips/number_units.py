"""Numbers with a unit, a decimal comma or degrees and minutes, where a scenario takes a plain number."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

_UNITS = {  # unit: its quantity, and its size in the unit that keys have
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), ("m", 1.0)),
    **{"km": ("m", 1000.0), "cm": ("m", 0.01), "mm": ("m", 0.001), "mi": ("m", 1609.344), "nmi": ("m", 1852.0)},
    **dict.fromkeys(("ft", "feet", "foot"), ("m", 0.3048)),
    **dict.fromkeys(("m/s", "mps"), ("mps", 1.0)),
    **dict.fromkeys(("km/h", "kmh", "kph"), ("mps", 1.0 / 3.6)),
    **dict.fromkeys(("kn", "kt", "kts", "knots"), ("mps", 1852.0 / 3600.0)),
    **{"mph": ("mps", 0.44704), "ft/s": ("mps", 0.3048), "cm/s": ("mps", 0.01)},
    **{"m/s2": ("mps2", 1.0), "m/s^2": ("mps2", 1.0), "m/s²": ("mps2", 1.0), "mps2": ("mps2", 1.0)},
    **dict.fromkeys(("s", "sec", "second", "seconds"), ("s", 1.0)),
    **{"ms": ("s", 0.001), "min": ("s", 60.0), "minutes": ("s", 60.0), "h": ("s", 3600.0)},
    **dict.fromkeys(("deg", "degrees", "°"), ("deg", 1.0)),
    **{"rad": ("deg", math.degrees(1.0)), "deg/s": ("degps", 1.0), "°/s": ("degps", 1.0)},
    **{"kg": ("kg", 1.0), "g": ("kg", 0.001), "lb": ("kg", 0.45359237)},
    **{"N": ("N", 1.0), "Nm": ("Nm", 1.0), "V": ("V", 1.0), "Wh": ("Wh", 1.0), "Hz": ("hz", 1.0)},
}
_KEY_UNITS = {  # what a key's name says, and how messages write it
    **{"m": "m", "mps": "m/s", "mps2": "m/s²", "s": "s", "deg": "degrees", "degps": "degrees/s", "kg": "kg"},
    **{"N": "N", "Nm": "N m", "V": "V", "Wh": "Wh", "hz": "Hz"},
}
_IN_KEYS = {"kmh": "km/h", "kph": "km/h", "ftps": "ft/s"}  # units as the names of keys have to write them
ANY_UNIT = "|".join(re.escape(unit) for unit in sorted(_UNITS, key=len, reverse=True))
_LONGEST = 40
_MEANT_MAX = 1e12  # larger numbers were not typed by a person
_NUMBER = r"[-+]?[0-9]{1,12}(?:[.,][0-9]{1,12})?"
_WITH_UNIT = re.compile(rf"({_NUMBER})\s*({ANY_UNIT})?")
_DEGREES = re.compile(
    r"([-+]?[0-9]{1,3})\s*[°:]\s*([0-9]{1,2})\s*['′:]\s*([0-9]{1,2}(?:\.[0-9]{1,6})?)\s*[\"″]?\s*([NSEW]?)"
)
_MINUTES = re.compile(r"([0-9]{1,3}):([0-9]{2})")


@dataclass(frozen=True)
class Reading:
    """The number that a text means for a key, and what is wrong with the text."""

    value: float
    why: str


def is_number_with_unit(text: str) -> bool:
    """Whether a text is a number and a unit, which a person may have written without quotes."""
    found = _WITH_UNIT.fullmatch(text.strip()) if len(text) <= _LONGEST else None
    return bool(found and found[2])


def reading(text: str, key: str) -> Reading | None:
    """What a text means as the number of a key, whose name ends in its unit; None where that is not plain."""
    text, unit = text.strip(), key.rpartition("_")[2]
    if len(text) > _LONGEST:
        return None
    if unit == "deg" and (found := _DEGREES.fullmatch(text)):
        whole, minutes, seconds = float(found[1]), float(found[2]), float(found[3])
        size = abs(whole) + minutes / 60.0 + seconds / 3600.0
        sign = -1.0 if found[1].startswith("-") or found[4] in ("S", "W") else 1.0
        return Reading(round(sign * size, 7), "must be a number of degrees, with decimals, without quotes")
    if unit == "s" and (found := _MINUTES.fullmatch(text)):
        return Reading(60.0 * float(found[1]) + float(found[2]), "must be a number of seconds, without quotes")
    if not (found := _WITH_UNIT.fullmatch(text)):
        return None
    value = float(found[1].replace(",", "."))
    if found[2]:
        return _in_unit(value, found[2], unit)
    why = "has a decimal comma; numbers have a point" if "," in found[1] else "must be a number, without quotes"
    return Reading(value, why)


def converted(value: float, key: str, known: str) -> float | None:
    """The value of the known key for one of another key that is the same but for its unit (`flight_min`)."""
    (stem, _, unit), (known_stem, _, known_unit) = key.rpartition("_"), known.rpartition("_")
    found = _UNITS.get(_IN_KEYS.get(unit, unit))
    if stem != known_stem or found is None or found[0] != known_unit or abs(value) >= _MEANT_MAX:
        return None
    return round(value * found[1], 3)


def unit_of(key: str) -> str:
    """The unit that the name of a key ends in, as messages write it; empty without one."""
    return _KEY_UNITS.get(key.rpartition("_")[2], "")


def _in_unit(value: float, written: str, unit: str) -> Reading | None:
    quantity, size = _UNITS[written]
    if quantity != unit:
        return None
    if size == 1.0:
        return Reading(value, "has a unit; numbers stand alone, and the key's name ends in the unit")
    return Reading(
        round(value * size, 3), f"is in {written}; this key is in {_KEY_UNITS[unit]}, and its numbers stand alone"
    )
