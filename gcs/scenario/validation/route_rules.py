"""Rules about a route: its legs and times, where its points are and how the leader passes them, and its shapes.

A leg leads from one point to the next; leg 1 from the start to the first point, the last one to the end. Where the
formation may have changed its shape, these rules check the leader alone, and the verification of the plan checks the
others. Zones are in `gcs.scenario.validation.zone_rules`.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from gcs.errors import counted
from gcs.scenario.schema.fields import Place
from gcs.scenario.schema.mistake import Mistake, dotted, plain
from gcs.scenario.schema.places import ROUTE_MAX
from gcs.scenario.schema.scenario import START_SHAPE, RoutePoint, Scenario
from gcs.scenario.schema.toml_lines import Key
from gcs.scenario.validation.boundaries import BOX, Stop, out_of_the_box, stop_at, too_low
from gcs.scenario.validation.rule_set import Mistakes, Rules
from gcs.scenario.validation.spacing import SLACK
from gcs.scenario.values.si import route_points

_WITH_TURNS = 1.25  # of the least time, so that the vehicles also accelerate, brake and turn
_SHORTEST_M = 0.1  # leg
_TIMES = ("at_s", "after_s", "by_s")

RULES = Rules()


@dataclass(frozen=True)
class _Leg:
    """One leg: its number, the table that it leads to, how long it is and the least time that it takes."""

    number: int
    to: Key
    away_m: float  # along the axis
    least_s: float
    axis: int  # that takes longest
    hold_s: float  # before it begins

    def in_words(self, scenario: Scenario) -> str:
        """What it takes, at the limit of its slowest axis."""
        leg = f"leg {self.number}, to {dotted(self.to)}, takes"
        whole = f"{plain(self.away_m)} m {('north', 'east', 'vertical')[self.axis]} take"
        return (
            f"{leg if scenario.route else whole} at least {self.least_s:.1f} s at "
            f"limits.speed_ned_mps[{self.axis}] = {plain(scenario.limits.speed_ned_mps[self.axis])} m/s"
        )


@RULES.needs("route", "loops")
def _rounds_are_few(scenario: Scenario) -> Mistakes:
    count, loops = len(scenario.route), scenario.loops
    if loops > 1 and not count:
        yield Mistake(("loops",), "has no effect without [[route]]", loops, "remove it, or give points")
    if count * loops > ROUTE_MAX:
        text = f"makes {count * loops} points of {count}; all rounds together have at most {ROUTE_MAX}"
        yield Mistake(("loops",), text, loops, remedy=f"set loops to {ROUTE_MAX // count} or less")


@RULES.needs("route", "loops")
def _times_are_in_one_round(scenario: Scenario) -> Mistakes:
    if scenario.loops == 1:
        return
    for row, point in enumerate(scenario.route):
        for key in _TIMES:
            if (time_s := getattr(point, key)) is not None:
                text = f"is one time, and the point is passed {scenario.loops} times"
                yield Mistake(("route", row, key), text, time_s, "remove it, or write all rounds")


@RULES.needs("start", "route", "loops", "end")
def _legs_have_a_length(scenario: Scenario) -> Mistakes:
    reported: set[Key] = set()
    for (before, first), (key, second) in itertools.pairwise(_places(scenario)):
        own = before if key == ("end",) else key
        if np.linalg.norm(np.subtract(second, first)) <= _SHORTEST_M and scenario.route and own not in reported:
            reported.add(own)
            other = dotted(key if own == before else before)
            text = f"is the place of {other} too; a leg is longer than {_SHORTEST_M:g} m"
            yield Mistake((*own, "position_m"), text, scenario.route[int(own[1])].position_m, "remove the point")


@RULES.needs("start", "route", "loops", "end", "time", "limits")
def _times_are_enough(scenario: Scenario) -> Mistakes:
    """From each time that is set to the next one, at the speed limits and without turns."""
    since_s, since, earliest_s, way = 0.0, "the start", 0.0, list[_Leg]()
    for leg, point in zip(_legs(scenario), (*route_points(scenario), None), strict=True):
        way.append(leg)
        earliest_s += leg.hold_s + leg.least_s
        key, due_s = _due(scenario, point)
        if due_s is not None and earliest_s > due_s + SLACK:
            at: Key = ("time", key) if point is None else (*leg.to, key)
            if due_s > since_s:
                needed_s = earliest_s - since_s
                text = f"too {'short' if point is None else 'early'}: {_needs(scenario, way, needed_s)}"
                text += f"; {key} leaves {plain(due_s - since_s)} s from {since}" if scenario.route else ""
                enough_s = since_s + np.ceil(needed_s * _WITH_TURNS)
                yield Mistake(at, text, due_s, remedy=f"set {dotted(at)} to {enough_s:.0f} or more")
            elif point is not None:  # else the rule about times after the flight reports it
                text = f"must be later than {since} at {plain(since_s)} s: the leader passes it before"
                yield Mistake(at, text, due_s, "correct it")
            earliest_s = due_s
        if point is None or scenario.loops > 1:
            continue
        fixed_s = point.at_s if point.at_s is not None else point.after_s  # the leader does not leave it before
        if fixed_s is not None:
            if point.at_s is not None or fixed_s >= earliest_s:
                since_s, since, way = fixed_s, dotted(leg.to), []
            earliest_s = max(earliest_s, fixed_s)


@RULES.needs("route", "time")
def _times_are_in_flight(scenario: Scenario) -> Mistakes:
    key, longest_s = _due(scenario, None)
    for row, point in enumerate(scenario.route):
        for name in _TIMES:
            time_s = getattr(point, name)
            if longest_s is not None and time_s is not None and time_s >= longest_s and name != "by_s":
                text = f"is after the flight, which ends at time.{key} = {longest_s:g}"
                step = f"set route[{row}].{name} to less than {plain(longest_s)}, or time.{key} to more"
                yield Mistake(("route", row, name), text, time_s, remedy=step)


def _needs(scenario: Scenario, way: list[_Leg], needed_s: float) -> str:
    """What some legs and the holds before them take, and which takes longest."""
    longest = max(way, key=lambda leg: leg.least_s).in_words(scenario)
    if len(way) == 1 and not way[0].hold_s:
        return longest
    what = f"{counted(len(way), 'leg')}{' and holds' if any(leg.hold_s for leg in way) else ''}"
    return f"{longest}, and {what} take {needed_s:.1f} s"


def _due(scenario: Scenario, point: RoutePoint | None) -> tuple[str, float | None]:
    """The key of the latest time of a point, or of the end, and that time; None where there is none."""
    if point is None:
        time = scenario.time
        return ("latest_s", time.latest_s) if time.free else ("flight_s", time.flight_s)
    if scenario.loops > 1:
        return "", None  # another rule refuses its times
    return ("at_s", point.at_s) if point.at_s is not None else ("by_s", point.by_s)


def _places(scenario: Scenario) -> list[tuple[Key, Place]]:
    """The start, every point of every round and the end, each with its table."""
    rows = itertools.cycle(range(max(len(scenario.route), 1)))
    points: list[tuple[Key, Place]] = [
        (("route", row), point.position_m) for row, point in zip(rows, route_points(scenario), strict=False)
    ]
    return [(("start",), scenario.start.position_m), *points, (("end",), scenario.end.position_m)]


def _legs(scenario: Scenario) -> list[_Leg]:
    radii = np.array([0.0, *(point.radius_m or 0.0 for point in route_points(scenario)), 0.0])
    holds = [0.0, *(point.hold_s or 0.0 for point in route_points(scenario))]
    found = []
    for number, ((_, first), (key, second)) in enumerate(itertools.pairwise(_places(scenario)), start=1):
        away_m = np.abs(np.subtract(second, first))
        least_s = np.maximum(away_m - radii[number - 1] - radii[number], 0.0) / scenario.limits.speed_ned_mps
        axis = int(least_s.argmax())
        found.append(_Leg(number, key, away_m[axis], float(least_s[axis]), axis, holds[number - 1]))
    return found


@RULES.needs("start", "route", "formation", "limits")
def _points_are_in_the_box(scenario: Scenario) -> Mistakes:
    for stop in _stops(scenario):
        for axis in range(len(BOX)):
            yield from out_of_the_box(scenario, stop, axis)


@RULES.needs("start", "route", "formation", "limits", "terrain")
def _points_clear_the_ground(scenario: Scenario) -> Mistakes:
    for stop in _stops(scenario):
        if not stop.radius_m:  # else the leader may pass where the ground is lower
            yield from too_low(scenario, stop)


@RULES.needs("route", "limits")
def _speeds_are_allowed(scenario: Scenario) -> Mistakes:
    fastest_mps = float(np.linalg.norm(scenario.limits.speed_ned_mps))
    for row, point in enumerate(scenario.route):
        if point.speed_mps is not None and point.speed_mps > fastest_mps + SLACK:
            text = f"faster than any vehicle: limits.speed_ned_mps allows {fastest_mps:.2f} m/s"
            step = f"set route[{row}].speed_mps to {plain(np.floor(100.0 * fastest_mps) / 100.0)} or less"
            yield Mistake(("route", row, "speed_mps"), text, point.speed_mps, remedy=step)


@RULES.needs("route", "limits")
def _headings_are_allowed(scenario: Scenario) -> Mistakes:
    most_deg = scenario.limits.roll_pitch_yaw_deg[2]
    for row, point in enumerate(scenario.route):
        if point.heading_deg is None:
            continue
        yaw_deg = 180.0 - (180.0 - point.heading_deg) % 360.0
        if abs(yaw_deg) > most_deg + SLACK:
            text = f"out of reach; limits.roll_pitch_yaw_deg[2] allows a yaw of {-most_deg:g} to {most_deg:g} degrees"
            yield Mistake(("route", row, "heading_deg"), text, point.heading_deg)


def _stops(scenario: Scenario) -> list[Stop]:
    return [
        stop_at(scenario, ("route", row), point.position_m, point.radius_m or 0.0)
        for row, point in enumerate(scenario.route)
    ]


@RULES.needs("route", "formation")
def _shapes_exist(scenario: Scenario) -> Mistakes:
    names = (START_SHAPE, *(shape.name for shape in scenario.formation.shape))
    for row, point in enumerate(scenario.route):
        if point.shape is not None and point.shape not in names:
            known = ", ".join(f'"{name}"' for name in names)
            yield Mistake(("route", row, "shape"), f"names no shape; there are {known}", point.shape, "correct it")


@RULES.needs("route", "loops", "formation")
def _changes_begin_at_points(scenario: Scenario) -> Mistakes:
    count = len(route_points(scenario))
    for row, change in enumerate(scenario.formation.change):
        if change.at_point is not None and change.at_point > count:
            rounds = f" in {scenario.loops} rounds" if scenario.loops > 1 else ""
            there = f"has {counted(count, 'point')}{rounds}" if count else "does not exist"
            text = f"is no point: [[route]] {there}"
            yield Mistake(("formation", "change", row, "at_point"), text, change.at_point, "correct it")


@RULES.needs("route", "formation")
def _shapes_are_changed_in_one_place(scenario: Scenario) -> Mistakes:
    """In which order changes of both kinds come is known when the leader's track is."""
    timed = [row for row, change in enumerate(scenario.formation.change) if not change.auto]
    shaped = [row for row, point in enumerate(scenario.route) if point.shape is not None]
    if timed and shaped:
        row = shaped[0]
        text = f"stands beside formation.change[{timed[0]}], which changes the shape too"
        step = f"write each shape of [[route]] as [[formation.change]] instead: at_point = {row + 1} for this one"
        yield Mistake(("route", row, "shape"), text, scenario.route[row].shape, remedy=step)
