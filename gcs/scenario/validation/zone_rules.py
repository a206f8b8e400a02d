"""Rules about zones at the start, at every point of the route, and at the end: no-fly zones and keep-in areas."""

import numpy as np

from gcs.errors import counted
from gcs.scenario.environment.no_fly import Zone, ZoneName, outside_m, zone_names, zones
from gcs.scenario.schema.mistake import Mistake, dotted, plain
from gcs.scenario.schema.scenario import KeepIn, Scenario
from gcs.scenario.schema.toml_lines import Key
from gcs.scenario.validation.boundaries import Stop, ends, last_places_up_m, last_shape, stop_at, up
from gcs.scenario.validation.rule_set import Mistakes, Rules
from gcs.scenario.validation.spacing import SLACK
from gcs.scenario.values.si import leader_index
from gcs.types import Array

RULES = Rules()


@RULES.needs("end", "formation", "no_fly", "keep_in", "time")
def _last_shape_is_outside_zones(scenario: Scenario) -> Mistakes:
    name = last_shape(scenario)
    if name is None:
        return
    places_m, leader = last_places_up_m(scenario, name), leader_index(scenario)
    for zone_name, zone in _named(scenario):
        outside = _outside_m(zone, scenario.time.flight_s, places_m)
        if outside.min() < -SLACK <= outside[leader]:  # else the rule about the leader reports it
            key, value = _place_of(zone_name, zone)
            inside, deep_m = int(np.count_nonzero(outside < -SLACK)), -float(outside.min())
            verb, where = _verb(zone_name)
            text = f"{verb} {counted(inside, 'place')} of the last shape, {name}, at the end, {deep_m:.2f} m {where}"
            yield Mistake(key, text, value, remedy=_apart(zone_name, ("end",), deep_m))


@RULES.needs("start", "end", "formation", "no_fly", "keep_in", "time", "limits")
def _ends_are_outside_zones(scenario: Scenario) -> Mistakes:
    for name, zone in _named(scenario):
        for end, t_s in zip(ends(scenario), (0.0, scenario.time.flight_s), strict=True):
            yield from _in_a_zone(scenario, name, zone, end, t_s)


@RULES.needs("start", "route", "formation", "no_fly", "keep_in", "limits")
def _points_are_outside_zones(scenario: Scenario) -> Mistakes:
    """Zones that move may be elsewhere when the leader comes."""
    for name, zone in _named(scenario):
        for row, point in enumerate(scenario.route):
            if not zone.moves:
                stop = stop_at(scenario, ("route", row), point.position_m, point.radius_m or 0.0)
                yield from _in_a_zone(scenario, name, zone, stop, 0.0)


def _in_a_zone(scenario: Scenario, name: ZoneName, zone: Zone, stop: Stop, t_s: float) -> Mistakes:
    margin_m = scenario.limits.zone_margin_m or 0.0
    outside = _outside_m(zone, t_s, stop.places_up_m) + stop.radius_m
    worst = int(outside.argmin())
    at = f"its {dotted(stop.key)}" if len(stop.key) == 1 else dotted(stop.key)
    if -SLACK <= outside[worst] < margin_m - SLACK:
        text = f"too much: vehicle {stop.sysids[worst]} is {plain(float(outside[worst]))} m from {name.edge} at {at}"
        step = f"set limits.zone_margin_m to {plain(np.floor(100.0 * float(outside[worst])) / 100.0)} or less"
        yield Mistake(("limits", "zone_margin_m"), text, margin_m, remedy=step)
    if outside[worst] < -SLACK:
        key, value = _place_of(name, zone)
        verb, where = _verb(name)
        text = f"{verb} vehicle {stop.sysids[worst]} at {at}, {-outside[worst]:.2f} m {where}"
        if zone.height_m is not None or zone.in_force_s is not None:
            text += "; plans keep out of it at every height and at all times"
        yield Mistake(key, text, value, remedy=_apart(name, stop.key, -float(outside[worst])))


def _named(scenario: Scenario) -> list[tuple[ZoneName, Zone]]:
    """All zones with their names, no-fly zones first."""
    each = list(zip(zone_names(scenario), zones(scenario), strict=True))
    return sorted(each, key=lambda one: one[0].keep_in)


def _outside_m(zone: Zone, t_s: float, places_up_m: Array) -> Array:
    return outside_m(zone, np.array(t_s), places_up_m[:, 0], places_up_m[:, 1])


def _place_of(name: ZoneName, zone: Zone) -> tuple[Key, float | None]:
    """The key that a message about a zone names, and its value where it is short."""
    if isinstance(zone, KeepIn):
        return ("keep_in", name.number - 1, "polygon_m"), None
    return ("no_fly", name.number - 1, "radius_m" if zone.polygon_m is None else "polygon_m"), zone.radius_m


def _verb(name: ZoneName) -> tuple[str, str]:
    return ("leaves out", "outside") if name.keep_in else ("contains", "inside")


def _apart(name: ZoneName, key: Key, deep_m: float) -> str:
    """What to do about a vehicle so deep in a zone."""
    if name.keep_in:
        return f"extend the area, or move [{dotted(key)}] by {up(deep_m, 0.1):.1f} m or more"
    return f"move the zone or [{dotted(key)}] apart by more than {up(deep_m, 0.1):.1f} m"
