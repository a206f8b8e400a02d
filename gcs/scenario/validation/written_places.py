"""Places as a file has them, in metres or in degrees: read, written, and asked about where they lie too far away."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gcs.frames import Origin, geodetic_to_ned
from gcs.scenario.schema.degree_keys import CENTRE, DegreeKeys
from gcs.scenario.schema.fields import FARTHEST_M
from gcs.scenario.schema.mistake import degrees, from_e7, plain

Pair = Sequence[float]  # as written: latitude, longitude, or north, east

_LISTED = 4  # places that a message writes out
_WRITTEN_MAX = 1e12  # larger numbers were not typed by a person


class Question(NamedTuple):
    """What to ask about a place, and the place in degrees that was perhaps meant, or whether it is in metres."""

    text: str
    degrees: Pair | None = None
    is_metres: bool = False


def question(place: Pair, origin: Origin) -> Question | None:
    """What to ask about a place; None for one that may be flown to."""
    (lat, lon), away_m, largest = place, _away_m(place, origin), max(map(abs, place))
    if away_m <= FARTHEST_M:
        return None
    if isinstance(lat, int) and isinstance(lon, int) and from_e7(largest) is not None:
        return Question("are these degrees times 10 million?", (lat / 1e7, lon / 1e7))
    where = f"{away_m / 1000.0:,.0f} km from the origin" if math.isfinite(away_m) else "no place on Earth"
    for meant, text in (
        ((lon, lat), "swapped latitude and longitude?"),
        ((lat, lon - 360.0), "longitudes go from -180 to 180; is this one counted to 360?"),
        *(
            ((n * lat, e * lon), "south and west are negative; is a sign wrong?")
            for n, e in ((-1, 1), (1, -1), (-1, -1))
        ),
    ):
        if _away_m(meant, origin) <= FARTHEST_M:
            return Question(f"{where}: {text}", meant)
    if largest <= FARTHEST_M and (not math.isfinite(away_m) or all(value == round(value) for value in place)):
        return Question(f"{where}: are these metres?", is_metres=True)
    return Question(f"{where}; places are at most {FARTHEST_M // 1000} km away")


def numbers(value: Any, *counts: int) -> tuple[float, ...] | None:
    """A list as numbers that a person may have written; None for anything else, and for more or fewer of them."""
    is_list = isinstance(value, list | tuple) and (not counts or len(value) in counts)
    return tuple(value) if is_list and all(map(is_number, value)) else None


def is_number(value: Any) -> bool:
    """Whether a value is a number that a person may have written."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -_WRITTEN_MAX < value < _WRITTEN_MAX


def pairs_of(keys: DegreeKeys, given: Sequence[Any]) -> list[Pair]:
    """The places in the values of the keys of one form; none where something else than places stands there."""
    rows: Sequence[Any] = given
    if keys.form == "position":
        rows = [(numbers(given[0], 2, 3) or ())[:2]]
    elif keys.form == "points":
        rows = given[0] if isinstance(given[0], list | tuple) else []
    elif keys is CENTRE:
        rows = [given]
    elif all(map(numbers, given)):
        rows = list(zip(*given, strict=False))
    found: list[Pair] = [pair for row in rows if (pair := numbers(row, 2))]
    return found if len(found) == len(rows) else []


def written(keys: DegreeKeys, places: Sequence[Pair], height: str = "", *, metres: bool = False) -> str:
    """The keys and values of places in a file; those of a position with its height, of a long list the first ones."""
    names, shown = (keys.metres, plain) if metres else (tuple(keys.degrees), degrees)
    rows, rest = [[shown(value) for value in place] for place in places], ", ..." if len(places) > _LISTED else ""
    if keys.form == "position":
        third, above = ([height or "height"], "") if metres else ([], f", height_m = {height}" if height else "")
        return f"{names[0]} = [{', '.join(rows[0] + third)}]{above}"
    if keys.form == "points":
        listed = [f"[{', '.join(row)}]" for row in rows[:_LISTED]]
        return f"{names[0]} = [{', '.join(listed)}{rest}]"
    columns = [", ".join(column[:_LISTED]) + rest for column in zip(*rows, strict=True)]
    marks = "{} = {}" if keys is CENTRE else "{} = [{}]"
    return " and ".join(map(marks.format, names, columns))


def _away_m(place: Pair, origin: Origin) -> float:
    """The straight distance from the origin; infinite for what is no place on Earth."""
    if abs(place[0]) > 90.0 or abs(place[1]) > 180.0:
        return math.inf
    return float(np.linalg.norm(geodetic_to_ned(place[0], place[1], origin.alt_amsl_m, origin)))
