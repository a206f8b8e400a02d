"""Rules about shapes along a route: the names of its shapes, and the changes of formation that begin at its points."""

from __future__ import annotations

from gcs.errors import counted
from gcs.scenario.mistakes.mistake import Mistake
from gcs.scenario.schema.scenario import START_SHAPE, Scenario
from gcs.scenario.si import route_points
from gcs.scenario.validation.rule_set import Mistakes, Rules

RULES = Rules()


@RULES.needs("route", "formation")
def _shapes_exist(scenario: Scenario) -> Mistakes:
    names = (START_SHAPE, *(shape.name for shape in scenario.formation.shape))
    for row, point in enumerate(scenario.route):
        if point.shape is not None and point.shape not in names:
            known = ", ".join(f'"{name}"' for name in names)
            yield Mistake(("route", row, "shape"), f"names no shape; there are {known}. Correct it", point.shape)


@RULES.needs("route", "loops", "formation")
def _changes_begin_at_points(scenario: Scenario) -> Mistakes:
    count = len(route_points(scenario))
    for row, change in enumerate(scenario.formation.change):
        if change.at_point is not None and change.at_point > count:
            rounds = f" in {scenario.loops} rounds" if scenario.loops > 1 else ""
            there = f"has {counted(count, 'point')}{rounds}" if count else "does not exist"
            text = f"is no point: [[route]] {there}. Correct it"
            yield Mistake(("formation", "change", row, "at_point"), text, change.at_point)


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
