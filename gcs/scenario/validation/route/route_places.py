"""Rules about where the points of a route are, and how the leader passes them: box, ground, speed and yaw.

Zones are in `gcs.scenario.validation.zone_rules`. Where the formation may have changed its shape, these rules check the
leader alone, and the verification of the plan checks the others.
"""

from __future__ import annotations

import numpy as np

from gcs.scenario.mistakes.mistake import Mistake, plain
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.boundaries import BOX, Stop, out_of_the_box, stop_at, too_low
from gcs.scenario.validation.rule_set import Mistakes, Rules
from gcs.scenario.validation.spacing import SLACK

RULES = Rules()


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
