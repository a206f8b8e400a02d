"""A scenario's tables with metres in the place of latitude and longitude, and mistakes in the file's own degrees.

All later layers know metres only.
"""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from pydantic import ValidationError

from gcs.frames import Origin, geodetic_to_ned
from gcs.scenario.schema.degree_keys import ABOVE_GROUND, DegreeKeys, Pair, adapter, is_number, numbers
from gcs.scenario.schema.fields import FARTHEST_M, tables
from gcs.scenario.schema.mistake import KeyChange, Mistake, from_e7, plain, value_at
from gcs.scenario.schema.scenario import OriginTable, Scenario
from gcs.scenario.schema.toml_lines import Key, Table
from gcs.scenario.validation.schema_words import from_pydantic

_SPOILT = ""  # no number: it makes a table invalid, and keeps rules about other tables away from it


@dataclass(frozen=True)
class InDegrees:
    """A place that a table gives in degrees: its keys and values there, and where it is."""

    table: Key
    keys: DegreeKeys
    values: Table
    origin: Origin
    metres: Table

    def in_file(self, key: Key) -> Key:
        """The key inside this table in the file for one in metres; empty for any other key."""
        path = key[len(self.table) :]
        is_ours = key[: len(self.table)] == self.table and path and path[0] in self.keys.metres
        return self.keys.in_file(path, self.values) if is_ours else ()

    def changed(self, given: KeyChange) -> KeyChange:
        """The change of the key in the file for that of one in metres."""
        if not (path := self.in_file(given.key)):
            return given
        metres = given.key[len(self.table) :]
        value = self.keys.changed(str(path[0]), metres, given.value, self.metres, self.origin)
        return KeyChange((*self.table, *path), value)


@dataclass
class InMetres:
    """The tables in metres, the mistakes in their degrees, the places that were converted, and those with mistakes."""

    data: Table
    origin: Origin | None  # None where it has mistakes of its own
    mistakes: list[Mistake] = field(default_factory=list)
    places: list[InDegrees] = field(default_factory=list)
    spoilt: set[Key] = field(default_factory=set)

    @property
    def certain(self) -> set[Key]:
        """The keys in metres whose places were in degrees: nothing needs to be asked about their numbers."""
        return {(*place.table, name) for place in self.places for name in place.keys.metres}

    def replace(self, keys: DegreeKeys, table: Table, key: Key) -> None:
        """Replace one place of a table."""
        values = {name: table.pop(name) for name in keys.every if name in table}
        values = {name: value for name, value in values.items() if value is not None}  # as JSON has what is left out
        if not values:
            return
        in_metres = [name for name in keys.metres if table.get(name) is not None]
        is_above = table.get(ABOVE_GROUND) is not None
        mistakes = list(_place_mistakes(keys, values, in_metres, self.origin, key, is_above=is_above))
        self.mistakes += mistakes
        if not mistakes and self.origin is not None:
            metres = keys.converted(values, self.origin)
            table |= metres
            self.places.append(InDegrees(key, keys, values, self.origin, metres))
        elif len(in_metres) < len(keys.metres):
            table |= dict.fromkeys(keys.metres, _SPOILT)
            self.spoilt |= {(*key, name) for name in keys.metres}


def in_metres(data: Table) -> InMetres:
    """The tables of a scenario with known keys, each place in metres from [origin]."""
    try:
        origin = Origin(**OriginTable.model_validate(data.get("origin")).model_dump())
    except ValidationError:
        origin = None
    found = InMetres(dict(data), origin)
    for key, model, table in tables(Scenario, found.data):
        for keys in model.degree_keys:
            found.replace(keys, table, key)
    return found


def _place_mistakes(
    keys: DegreeKeys, values: Table, in_metres: list[str], origin: Origin | None, key: Key, *, is_above: bool
) -> Iterator[Mistake]:
    """The mistakes of one place in degrees: of its keys, of where it is, and of each number.

    With `is_above` its height is that above the ground, in a key that tables in metres have too.
    """
    names, heights = list(keys.degrees), [name for name in keys.heights if name in values]
    lacking, first = [name for name in names if name not in values], next(iter(values))
    third = numbers(values.get(names[0]), 3) if keys.heights else None
    if in_metres:
        text = f"stands beside {' and '.join(in_metres)}; a place is in metres or in degrees"
        text += ", with its height" if keys.heights else ""
        yield Mistake((*key, first), text, values[first], remedy="keep one of the two")
    elif lacking:
        step = f"add {lacking[0]}" + (" = [latitude, longitude]" if keys.heights else ", in degrees")
        yield Mistake((*key, lacking[0]), f"missing; {first} needs it", remedy=step)
    if in_metres or lacking:
        return
    if keys.heights and not heights and not third and not is_above:
        text = f"missing; {first} needs a height: height_m above the origin, alt_amsl_m above the sea"
        text += ", or height_above_ground_m"
        yield Mistake((*key, "height_m"), text, remedy="add height_m, in m")
    if beside := [*[ABOVE_GROUND] * is_above, *heights][1:]:
        text = f"stands beside {ABOVE_GROUND if is_above else heights[0]}; both are the height"
        yield Mistake((*key, beside[0]), text, values[beside[0]], "keep one of the two")
    found = list(_misplaced(keys, values, third, origin, key))
    yield from found
    for name in heights if found else values:
        try:
            adapter(keys.every[name]).validate_python(values[name])
        except ValidationError as error:
            yield from from_pydantic(error, Scenario, (*key, name))


def _misplaced(
    keys: DegreeKeys, values: Table, third: Pair | None, origin: Origin | None, key: Key
) -> Iterator[Mistake]:
    """Places that are not near the origin, and lists that are none of places."""
    name, *_ = keys.degrees
    value, height = values[name], plain(third[2]) if third and len(values) == 1 else ""
    places, where = keys.pairs([values[one] for one in keys.degrees]), (*key, name)
    asked = [question(place, origin) if origin else None for place in places]
    wrong = [one for one in asked if one]
    if wrong and all(one.degrees for one in wrong):
        meant = [one.degrees if one and one.degrees else place for one, place in zip(asked, places, strict=True)]
        yield Mistake(where, wrong[0].text, value, remedy=f"write {keys.written(meant, height)}")
    elif wrong and all(one and one.is_metres for one in asked):
        height = plain(values["height_m"]) if is_number(values.get("height_m")) else height
        yield Mistake(where, wrong[0].text, value, remedy=f"write {keys.written(places, height, metres=True)}")
    elif wrong:
        for row, (one, place) in enumerate(zip(asked, places, strict=True)):
            at, shown = (where, value) if is_number(value) or numbers(value) else ((*where, row), place)
            if one:
                yield Mistake(at, one.text, shown, remedy="correct the place, or [origin]")
    elif third:
        text = "has three numbers; it is latitude and longitude, and the height has its own key"
        yield Mistake(where, text, value, remedy=f"write {keys.written(places, height)}")


def in_degree_keys(mistake: Mistake, found: InMetres) -> Mistake:
    """The mistake with the keys, the value and the next step that fit the file."""
    for place in found.places:
        mistake = dataclasses.replace(mistake, changes=tuple(map(place.changed, mistake.changes)))
        if path := place.in_file(mistake.key):
            mistake = dataclasses.replace(mistake, key=(*place.table, *path), value=value_at(place.values, path))
    return mistake


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


def _away_m(place: Pair, origin: Origin) -> float:
    """The distance from the origin along the Earth; infinite for what is no place on it."""
    if abs(place[0]) > 90.0 or abs(place[1]) > 180.0:
        return math.inf
    return float(np.linalg.norm(geodetic_to_ned(place[0], place[1], origin.alt_amsl_m, origin)))
