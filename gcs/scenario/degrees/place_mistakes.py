"""The mistakes of places in degrees: two forms at once, a height that lacks, and numbers that are something else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gcs.frames import Origin
from gcs.scenario.degrees.place_questions import (
    Pair,
    Question,
    is_number,
    numbers,
    question,
    shown,
    shown_column,
    shown_points,
)
from gcs.scenario.schema.degree_keys import DegreeKeys
from gcs.scenario.validation.mistakes import Mistake
from gcs.scenario.validation.slips.shown_values import AsShown, plain
from gcs.scenario.validation.toml_lines import Key

_THREE = 3


def in_other_form(keys: DegreeKeys, values: dict[str, Any], in_metres: list[str], key: Key) -> list[Mistake]:
    """The mistake of a place that is given twice, or not whole."""
    given = [name for name in keys.degrees if name in values]
    heights = [name for name in keys.heights or () if name in values]
    if in_metres and given:
        text = f"stands beside {' and '.join(in_metres)}; a place is in metres or in degrees. Keep one of the two"
        return [Mistake((*key, given[0]), text, as_shown(values[given[0]]))]
    if in_metres:
        text = f"stands beside {in_metres[0]}, whose third number is the height"
        return [Mistake((*key, heights[0]), text, values[heights[0]], remedy=f"remove {heights[0]}")]
    lacking = [name for name in keys.degrees if name not in values]
    if lacking and given:
        text = f"missing; {given[0]} needs it"
        return [Mistake((*key, lacking[0]), text, remedy=f"add {lacking[0]}, in degrees")]
    if lacking:
        text = f"missing; {heights[0]} belongs to it"
        return [Mistake((*key, lacking[0]), text, remedy=f"add {lacking[0]} = [latitude, longitude]")]
    if len(heights) > 1:
        text = f"stands beside {heights[0]}; both are the height. Keep one of the two"
        return [Mistake((*key, heights[1]), text, values[heights[1]])]
    return []


def missing_height(keys: DegreeKeys, values: dict[str, Any], key: Key) -> list[Mistake]:
    """The mistake of a position without its height, or with its height as a third number."""
    if keys.heights is None:
        return []
    (name,), low_high = keys.degrees, list(keys.heights)
    height = next((one for one in low_high if one in values), None)
    if is_three(keys, name, values[name]):
        place, last = values[name][:2], plain(values[name][2])
        text = "has three numbers; it is latitude and longitude, and the height has its own key"
        step = f"write {name} = {shown(place)}" + ("" if height else f", height_m = {last}")
        return [Mistake((*key, name), text, as_shown(values[name]), remedy=step)]
    if height is None:
        text = f"missing; {name} needs a height: height_m above the origin, or alt_amsl_m above the sea"
        return [Mistake((*key, "height_m"), text, remedy="add height_m, in m")]
    return []


def is_three(keys: DegreeKeys, name: str, value: Any) -> bool:
    """Whether a position has its height as a third number."""
    return keys.form == "position" and name in keys.degrees and numbers(value, _THREE) is not None


def misplaced(keys: DegreeKeys, values: dict[str, Any], origin: Origin | None, key: Key) -> list[Mistake]:
    """Questions about numbers that are not near the origin, and ranges or lists that do not fit together."""
    names = list(keys.degrees)
    if keys.form == "axes" and len(lengths := _lengths(values)) == 2 and lengths[0] != lengths[1]:
        plural = "s" if lengths[1] != 1 else ""
        text = f"has {lengths[1]} number{plural}, and {names[0]} has {lengths[0]}. Give one of both for each place"
        return [Mistake((*key, names[1]), text)]
    if keys.form == "points" and (found := _other_lists(names[0], values[names[0]], key)):
        return found
    places = _places(keys, values)
    if origin is None or places is None:
        return []
    asked = [question(place, origin) for place in places]
    wrong = [(row, place, one) for row, (place, one) in enumerate(zip(places, asked, strict=True)) if one]
    if not wrong:
        return _out_of_order(keys, values, key)
    first = wrong[0][2]
    alike = all(one.degrees for _, _, one in wrong) or all(one and one.metres for one in asked)
    if alike or keys.form != "points":
        meant = [place if one is None else _meant(one, place) for place, one in zip(places, asked, strict=True)]
        step = _step(keys, values, meant, first)
        return [Mistake((*key, names[0]), _joint(first.text, len(wrong), keys), _whole(keys, values), remedy=step)]
    return [
        Mistake((*key, names[0], row), one.text, as_shown(place), remedy=_step_of_one(one)) for row, place, one in wrong
    ]


def as_shown(value: Any) -> Any:
    """Degrees with all their digits, where a message shows a value."""
    if is_number(value):
        return AsShown(shown([value])[1:-1])
    if numbers(value):
        return AsShown(shown(value))
    if isinstance(value, list | tuple) and value and all(numbers(one) for one in value):
        return AsShown(shown_points(value))
    return value


def _other_lists(name: str, value: Any, key: Key) -> list[Mistake]:
    """The mistake of corners with heights, or of coordinates in one list."""
    if not isinstance(value, list | tuple) or not value:
        return []
    rows, flat = [numbers(row, _THREE) for row in value], numbers(value)
    if all(rows):
        text = "has three numbers for each place; heights do not belong to it"
        places = [row[:2] for row in rows if row]
    elif flat is not None and len(flat) % 2 == 0:
        text = "is one list of numbers; each place is a list of its own"
        places = [flat[n : n + 2] for n in range(0, len(flat), 2)]
    else:
        return []
    return [Mistake((*key, name), text, as_shown(value), remedy=f"write {name} = {shown_points(places)}")]


def _lengths(values: dict[str, Any]) -> list[int]:
    return [len(value) for value in values.values() if isinstance(value, list | tuple)]


def _places(keys: DegreeKeys, values: dict[str, Any]) -> list[Pair] | None:
    """The places of a key, or of two keys; None where a value is no number."""
    given = [values[name] for name in keys.degrees]
    rows: Sequence[Any]
    if keys.form == "position":
        rows = [given[0][:2]] if numbers(given[0], _THREE) else given
    elif keys.form == "points":
        rows = given[0] if isinstance(given[0], list | tuple) else [None]
    elif keys.form != "box" and all(is_number(one) for one in given):
        rows = [given]
    elif all(numbers(one, 2 if keys.form == "box" else None) for one in given):
        rows = list(zip(*given, strict=False))
    else:
        return None
    found = [numbers(row, 2) for row in rows]
    return [(one[0], one[1]) for one in found if one] if all(found) and found else None


def _out_of_order(keys: DegreeKeys, values: dict[str, Any], key: Key) -> list[Mistake]:
    """Ranges that are not [south, north] and [west, east]."""
    if keys.form != "box":
        return []
    (south, north), (west, east) = values["lat_deg"], values["lon_deg"]
    found = []
    if south >= north:
        found.append(("lat_deg", "must be [south, north]", [north, south]))
    if not 0.0 < (east - west) % 360.0 < 180.0:
        found.append(("lon_deg", "must be [west, east]", [east, west]))
    return [
        Mistake((*key, name), text, as_shown(values[name]), remedy=f"write {name} = {shown(meant)}")
        for name, text, meant in found
    ]


def _meant(one: Question, place: Pair) -> Pair:
    return one.degrees or one.metres or place


def _whole(keys: DegreeKeys, values: dict[str, Any]) -> Any:
    return as_shown(values[next(iter(keys.degrees))])


def _joint(text: str, count: int, keys: DegreeKeys) -> str:
    if count == 1 or keys.form == "box":
        return text
    return text.replace("is no place", "has places that are none", 1).replace("is ", "has places ", 1)


def _step(keys: DegreeKeys, values: dict[str, Any], meant: list[Pair], asked: Question) -> str:
    """What to write for all places of a key."""
    if asked.degrees is None and asked.metres is None:
        return "correct the place, or [origin]"
    names = list(keys.degrees if asked.degrees else keys.metres)
    write = shown if asked.degrees else _metres
    if keys.form == "position":
        if asked.degrees:
            third = values[names[0]][2:]  # a height that has a key of its own
            added = f", height_m = {plain(third[0])}" if third and len(values) == 1 else ""
            return f"write {names[0]} = {write(meant[0])}{added}"
        height = values.get("height_m")
        last = plain(height) if height is not None and is_number(height) else "height"
        return f"write {names[0]} = {_metres(meant[0])[:-1]}, {last}]"
    if keys.form == "points":
        return f"write {names[0]} = {shown_points(meant, write)}"
    columns = list(zip(*meant, strict=True))
    if is_number(values["lat_deg"]):
        texts = [write(column)[1:-1] for column in columns]
    else:
        texts = [shown_column(column, write) for column in columns]
    return "write " + " and ".join(f"{name} = {text}" for name, text in zip(names, texts, strict=True))


def _step_of_one(asked: Question) -> str:
    return f"write {shown(asked.degrees)}" if asked.degrees else "correct the place, or [origin]"


def _metres(place: Sequence[float]) -> str:
    return f"[{', '.join(plain(value) for value in place)}]"
