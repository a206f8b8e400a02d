"""Rules about events and the orders that answer them: shapes that exist, times within the flight, names once."""

from gcs.scenario.schema.event_table import CHANGES_SHAPE
from gcs.scenario.schema.formation_table import START_SHAPE
from gcs.scenario.schema.mistake import Mistake
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.rule_set import Mistakes, Rules

RULES = Rules()


@RULES.needs("on", "formation")
def _shapes_exist(scenario: Scenario) -> Mistakes:
    known = [START_SHAPE, *(shape.name for shape in scenario.formation.shape)]
    for row, each in enumerate(scenario.on):
        if each.shape is not None and each.shape not in known:
            yield Mistake(("on", row, "shape"), f"is no shape of the formation; it has {', '.join(known)}", each.shape)


@RULES.needs("on", "formation")
def _shape_may_be_ordered(scenario: Scenario) -> Mistakes:
    formation = scenario.formation
    if formation.frame != "course" and not any(change.auto for change in formation.change):
        return
    for row, each in enumerate(scenario.on):
        if each.order in CHANGES_SHAPE:
            text = "cannot be planned: the shape of this formation changes by itself all the time"
            yield Mistake(
                ("on", row, "order"), text, each.order, remedy='give "home", "hold", "slower", "land" or "return"'
            )


@RULES.needs("on", "limits")
def _places_are_within_the_limits(scenario: Scenario) -> Mistakes:
    for row, each in enumerate(scenario.on):
        for axis, key in enumerate(("north_m", "east_m", "height_m") if each.position_m is not None else ()):
            assert each.position_m is not None
            wanted_m, (low_m, high_m) = each.position_m[axis], getattr(scenario.limits, key)
            if not low_m <= wanted_m <= high_m:
                text = f"outside of limits.{key}, {low_m:g} to {high_m:g} m: the leader may not be there"
                yield Mistake(("on", row, "position_m", axis), text, wanted_m)


@RULES.needs("on", "time")
def _times_are_within_the_flight(scenario: Scenario) -> Mistakes:
    for row, each in enumerate(scenario.on):
        if each.at_s is not None and not scenario.time.free and each.at_s >= scenario.time.flight_s:
            text = f"after the flight, which ends at time.flight_s = {scenario.time.flight_s:g}"
            yield Mistake(("on", row, "at_s"), text, each.at_s)


@RULES.needs("on")
def _names_are_given_once(scenario: Scenario) -> Mistakes:
    names = [each.event for each in scenario.on]
    for row, name in enumerate(names):
        if name is not None and name in names[:row]:
            yield Mistake(("on", row, "event"), f"the event of row {names.index(name) + 1} too", name)
