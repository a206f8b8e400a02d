"""Warnings about zones and ground that a plan passes nearer than the navigation error."""

import math

from gcs.plan.trajectory.constraint_id import Kind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof.verdict import Report
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.navigation_error import navigation_error

_SLACK_M = 0.01  # a margin that is thinner by so little is what was asked for
_ON_ZERO_M = 0.005


def navigation_in_words(scenario: Scenario) -> str:
    """The navigation error of one vehicle, for a table."""
    error = navigation_error(scenario)
    return (
        f"up to {error.horizontal_m:g} m horizontally, {error.vertical_m:g} m in height "
        f"({scenario.sensors.grade} sensors, 3 sigma)"
    )


def thin_margins(plan: Plan, report: Report) -> tuple[str, ...]:
    """One sentence each for the zone and the ground that vehicles pass nearer than the navigation error."""
    scenario, error = plan.scenario, navigation_error(plan.scenario)
    grade = scenario.sensors.grade
    better = "" if grade == "rtk" else ', or sensors.grade = "rtk"'
    found = []
    nearest = report.nearest_zone
    if nearest is not None and nearest.distance_m < error.horizontal_m - _SLACK_M:
        found.append(
            f"vehicle {nearest.sysid} passes {nearest.name.edge} at {_metres(nearest.distance_m)} m "
            f"(t = {nearest.t_s:.0f} s); the navigation error of {grade} sensors is up to {error.horizontal_m:g} m "
            f"(3 sigma). Set limits.zone_margin_m = {error.horizontal_m:g}{better}"
        )
    if report.clearance_min_m < error.vertical_m - _SLACK_M:
        lowest = min((c for c in report.checks if c.constraint.kind is Kind.CLEARANCE), key=lambda check: check.worst)
        found.append(
            f"vehicle {lowest.sysid} passes the ground at {_metres(report.clearance_min_m)} m "
            f"(t = {lowest.t_s:.0f} s); the navigation error of {grade} sensors is up to {error.vertical_m:g} m "
            f"in height (3 sigma). "
            f"Set limits.clearance_min_m = {error.vertical_m:g}{better}"
        )
    return tuple(found)


def _metres(distance_m: float) -> str:
    """A distance rounded down, without the sign of rounding alone."""
    return f"{max(math.floor(100.0 * distance_m) / 100.0, 0.0) if distance_m > -_ON_ZERO_M else distance_m:.2f}"
