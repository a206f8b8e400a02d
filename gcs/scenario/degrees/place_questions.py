"""What two numbers are that cannot be the latitude and longitude of a place of this flight: swapped, metres, degE7."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs.frames import Origin, geodetic_to_ned
from gcs.scenario.schema.fields import FARTHEST_M

Pair = tuple[float, float]  # as written: latitude, longitude

LISTED = 4  # places that a message writes out
_DEGE7 = 10_000_000
_TYPED_M = 1_000_000  # larger numbers are no metres
_WRITTEN_MAX = 1e12  # larger numbers were not typed by a person
_WIDEST_DEG = (90.0, 180.0)


@dataclass(frozen=True)
class Question:
    """What to ask about a place, and the numbers that were perhaps meant: degrees, or metres, or neither is known."""

    text: str
    degrees: Pair | None = None
    metres: Pair | None = None


def question(place: Pair, origin: Origin) -> Question | None:
    """What to ask about a place; None for one that may be flown to."""
    if all(isinstance(value, int) and abs(value) <= 180 * _DEGE7 for value in place) and _outside(place):
        divided = (place[0] / _DEGE7, place[1] / _DEGE7)
        if _away_m(divided, origin) <= FARTHEST_M or max(map(abs, place)) > _TYPED_M:
            return Question("are these degrees times 10 million?", degrees=divided)
    away_m = _away_m(place, origin)
    if away_m <= FARTHEST_M:
        return None
    where = f"is {_km(away_m)} from the origin" if np.isfinite(away_m) else "is no place on Earth"
    for meant, text in _slips(place):
        if _away_m(meant, origin) <= FARTHEST_M:
            return Question(f"{where}: {text}?", degrees=meant)
    is_whole = all(value == round(value) for value in place)
    if max(map(abs, place)) <= FARTHEST_M and (is_whole or _outside(place)):
        return Question(f"{where}: are these metres?", metres=place)
    return Question(f"{where}; places are at most {_km(FARTHEST_M)} away" if np.isfinite(away_m) else where)


def numbers(value: Any, count: int | None = None) -> tuple[float, ...] | None:
    """The value as numbers that a person may have written; None for anything else."""
    if not isinstance(value, list | tuple) or (count is not None and len(value) != count):
        return None
    return tuple(value) if all(is_number(one) for one in value) else None


def is_number(value: Any) -> bool:
    """Whether a value is a number that a person may have written."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -_WRITTEN_MAX < value < _WRITTEN_MAX


def degrees(value: float) -> str:
    """Degrees as they are written into a file: to 1e-7, which is a centimetre."""
    text = f"{value:.7f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def shown(place: Sequence[float]) -> str:
    """A place, or a range, in degrees."""
    return f"[{', '.join(degrees(value) for value in place)}]"


def shown_points(places: Sequence[Sequence[float]], write: Callable[[Sequence[float]], str] = shown) -> str:
    """A list of places, of which the first ones are written out."""
    rest = ", ..." if len(places) > LISTED else ""
    return f"[{', '.join(write(place) for place in places[:LISTED])}{rest}]"


def shown_column(values: Sequence[float], write: Callable[[Sequence[float]], str] = shown) -> str:
    """A list of numbers, of which the first ones are written out."""
    return write(values[:LISTED])[:-1] + (", ...]" if len(values) > LISTED else "]")


def _slips(place: Pair) -> Iterator[tuple[Pair, str]]:
    lat, lon = place
    yield (lon, lat), "swapped latitude and longitude"
    if 180.0 < lon <= 360.0:
        yield (lat, lon - 360.0), "longitudes go from -180 to 180; is this one counted to 360"
    for signs in ((-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)):
        yield (signs[0] * lat, signs[1] * lon), "south and west are negative; is a sign wrong"


def _away_m(place: Pair, origin: Origin) -> float:
    """The straight distance from the origin; infinite for what is no place on Earth."""
    if _outside(place):
        return float("inf")
    return float(np.linalg.norm(geodetic_to_ned(place[0], place[1], origin.alt_amsl_m, origin)))


def _outside(place: Pair) -> bool:
    return any(abs(value) > most for value, most in zip(place, _WIDEST_DEG, strict=True))


def _km(metres: float) -> str:
    return f"{metres / 1000.0:,.0f} km"
