"""Orders in flight in the words of `gcs tell`: `avoid 560,480,30`, `go 200,0,30`, `scale 0.6`, `shape vee`, `hold`.

A row of `_READ` has the word, what it needs, and how that is read.
"""

import math
from collections.abc import Callable, Sequence

import shapely

from gcs.errors import UsageError
from gcs.flight.monitoring.progress import AskedOrder
from gcs.frames import geodetic_to_ned
from gcs.plan.event_plans import other_order, planned_order
from gcs.plan.formation_orders import Avoid, FlyHome, GoOn, GoTo, Hold, PlanOrder, Reshape, Scale, Slower
from gcs.scenario.schema.scenario import EventTable, Scenario
from gcs.scenario.values.si import local_origin

_FARTHEST_M = 1e5
_SCALES, _PACES = (0.001, 10.0), (0.1, 0.99)
_SIMPLE: dict[str, PlanOrder] = {"home": FlyHome(), "hold": Hold(), "resume": GoOn()}


def order_of(words: Sequence[str], scenario: Scenario, *, in_degrees: bool = False) -> AskedOrder | PlanOrder:
    """The order of these words. Raises UsageError, with what is expected.

    `in_degrees`: places are latitude and longitude. A polygon is avoided with the smallest disk around it.
    """
    name, rest = (words[0], list(words[1:])) if words else ("", [])
    if (row := _READ.get(name)) is not None:
        form, several, read = row
        if not rest:
            raise UsageError(f"{name} of what?", hint=f"give {form}")
        if len(rest) == 1 or several:
            return read(rest, scenario, in_degrees)
    elif not rest and name in _SIMPLE:
        return _SIMPLE[name]
    elif not rest and name in set(AskedOrder):
        return AskedOrder(name)
    raise UsageError(f"{' '.join(words)!r} is no order", hint=f"orders are {', '.join(WORDS)}")


def order_of_event(row: EventTable) -> AskedOrder | PlanOrder:
    """The order that answers an event."""
    return planned_order(row) or AskedOrder(row.order)


def order_instead(words: Sequence[str], scenario: Scenario) -> AskedOrder | None:
    """The order, to each vehicle by itself, where that of these words has no plan; None: the old plan is flown on."""
    if words and words[0] == "event":
        row = next(row for row in scenario.on if row.event == words[1])
        return None if (other := other_order(row)) is None else AskedOrder(other)
    return AskedOrder.HOLD if tuple(words) == ("hold",) else None


def _answer_to(rest: list[str], scenario: Scenario, in_degrees: bool) -> AskedOrder | PlanOrder:
    (name,) = rest
    rows = {row.event: row for row in scenario.on if row.event is not None}
    if name not in rows:
        known = f"it has {', '.join(rows)}" if rows else "write [[on]] with event and order into it before the flight"
        raise UsageError(f'the scenario has no event "{name}"', hint=known)
    return order_of_event(rows[name])


def _scale(rest: list[str], scenario: Scenario, in_degrees: bool) -> Scale:
    return Scale(_factor(rest[0], "scale", _SCALES, "a formation is not scaled by"))


def _slower(rest: list[str], scenario: Scenario, in_degrees: bool) -> Slower:
    return Slower(_factor(rest[0], "slower", _PACES, "a formation is not slowed down to"))


def _factor(text: str, name: str, within: tuple[float, float], refused: str) -> float:
    (factor,) = _numbers(text, 1, name)
    if not within[0] <= factor <= within[1]:
        raise UsageError(f"{refused} {factor:g}", hint=f"give {FORMS[name]}")
    return factor


def _shape(rest: list[str], scenario: Scenario, in_degrees: bool) -> Reshape:
    known = ["start", *(shape.name for shape in scenario.formation.shape)]
    if rest[0] not in known:
        raise UsageError(f'the scenario has no shape "{rest[0]}"', hint=f"it has {', '.join(known)}")
    return Reshape(rest[0])


def _go(rest: list[str], scenario: Scenario, in_degrees: bool) -> GoTo:
    first, second, height_m = _numbers(rest[0], 3, "go")
    north_m, east_m = _place(first, second, scenario, in_degrees=in_degrees)
    if max(abs(north_m), abs(east_m), abs(height_m)) > _FARTHEST_M:
        raise UsageError(
            f"({north_m:.0f}, {east_m:.0f}) at {height_m:g} m is no place of this flight", hint=f"give {FORMS['go']}"
        )
    return GoTo(round(north_m, 3), round(east_m, 3), round(height_m, 3))


def _avoid(rest: list[str], scenario: Scenario, in_degrees: bool) -> Avoid:
    if len(rest) == 1:
        first, second, radius_m = _numbers(rest[0], 3, "avoid")
        north_m, east_m = _place(first, second, scenario, in_degrees=in_degrees)
    elif len(rest) >= 3:
        corners = [_numbers(text, 2, "avoid") for text in rest]
        area = shapely.MultiPoint([_place(a, b, scenario, in_degrees=in_degrees) for a, b in corners])
        centre = shapely.minimum_bounding_circle(area).centroid
        north_m, east_m, radius_m = centre.x, centre.y, float(shapely.minimum_bounding_radius(area))
    else:
        raise UsageError(f"{' '.join(rest)!r} is no zone", hint=f"give {FORMS['avoid']}")
    if not 0.0 < radius_m <= _FARTHEST_M or max(abs(north_m), abs(east_m)) > _FARTHEST_M:
        raise UsageError(
            f"a zone of {radius_m:g} m around ({north_m:.0f}, {east_m:.0f}) is not one of this flight",
            hint=f"give {FORMS['avoid']}",
        )
    return Avoid(round(north_m, 3), round(east_m, 3), round(radius_m, 3))


def _place(first: float, second: float, scenario: Scenario, *, in_degrees: bool) -> tuple[float, float]:
    if not in_degrees:
        return first, second
    if not (abs(first) <= 90.0 and abs(second) <= 180.0):
        raise UsageError(f"({first:g}, {second:g}) is no latitude and longitude", hint="give degrees")
    place_ned_m = geodetic_to_ned(first, second, scenario.origin.alt_amsl_m, local_origin(scenario))
    north_m, east_m, _ = place_ned_m.tolist()
    return float(north_m), float(east_m)


def _numbers(text: str, count: int, name: str) -> list[float]:
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if len(found) != count or not all(map(math.isfinite, found)):
        raise UsageError(f"{text!r} is not what {name} needs", hint=f"give {FORMS[name]}")
    return found


_Reading = Callable[[list[str], Scenario, bool], AskedOrder | PlanOrder]
_READ: dict[str, tuple[str, bool, _Reading]] = {  # what it needs, whether that may be several words
    "avoid": ("NORTH,EAST,RADIUS in m, or three corners NORTH,EAST or more", True, _avoid),
    "go": ("NORTH,EAST,HEIGHT of the leader in m", False, _go),
    "slower": ("the new speed over the present one, as 0.7", False, _slower),
    "scale": ("the new size over the present one, as 0.6", False, _scale),
    "shape": ("the name of a shape of the scenario", False, _shape),
    "event": ("the name of an event of the scenario", False, _answer_to),
}
FORMS = {name: form for name, (form, _, _) in _READ.items()}
PLACES = frozenset({"avoid", "go"})  # that `--degrees` is for
WORDS = tuple(dict.fromkeys((*FORMS, *_SIMPLE, *AskedOrder)))
