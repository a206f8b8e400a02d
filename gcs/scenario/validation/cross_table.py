"""Rules between tables about speeds, times, attitudes and accelerations, and the check of all rules.

A rule refuses only what no plan can satisfy. The planner decides whether there is a plan.
"""

import itertools
from collections.abc import Collection

import numpy as np

from gcs.scenario.schema.mistake import Mistake, dotted, plain
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.schema.toml_lines import Key
from gcs.scenario.validation import (
    boundaries,
    event_rules,
    formation_rules,
    route_rules,
    unit_guesses,
    vehicle_rules,
    zone_rules,
)
from gcs.scenario.validation.rule_set import Mistakes, Rules
from gcs.types import Array

RULES = Rules()


def check(
    scenario: Scenario, tables: Collection[str] = tuple(Scenario.model_fields), certain: Collection[Key] = ()
) -> list[Mistake]:
    """All mistakes between those `tables` of the scenario that are valid in themselves.

    Where numbers look like degrees, or like heights of another kind, no rule is applied to their tables. `certain` are
    keys whose numbers are metres, whatever they look like.
    """
    asked = [mistake for mistake in unit_guesses.RULES.violated(scenario, tables) if mistake.key not in certain]
    alike = {dotted(mistake.key): mistake for mistake in asked}
    sound = set(tables) - {mistake.key[0] for mistake in alike.values()}
    sets = (
        RULES,
        *(one.RULES for one in (vehicle_rules, boundaries, zone_rules, route_rules, formation_rules, event_rules)),
    )
    return [*alike.values(), *(mistake for rules in sets for mistake in rules.violated(scenario, sound))]


@RULES.needs("limits", "judge")
def _judged_separation_is_planned(scenario: Scenario) -> Mistakes:
    judged, planned = scenario.judge.separation_min_m, scenario.limits.separation_min_m
    if judged is not None and judged > planned:
        text = f"more than the plan keeps, limits.separation_min_m = {planned:g}"
        step = f"set judge.separation_min_m to {plain(planned)} or less"
        yield Mistake(("judge", "separation_min_m"), text, judged, remedy=step)


@RULES.needs("start", "end", "limits")
def _ends_are_within_state_limits(scenario: Scenario) -> Mistakes:
    limited = (
        ("velocity_mps", "speed_ned_mps", ("fast north", "fast east", "fast up"), "m/s"),
        ("roll_pitch_yaw_deg", "roll_pitch_yaw_deg", ("much roll", "much pitch", "much yaw"), "degrees"),
    )
    for table, (key, limit, words, unit) in itertools.product(("start", "end"), limited):
        values, limits = getattr(getattr(scenario, table), key), getattr(scenario.limits, limit)
        for axis, (value, most) in enumerate(zip(values, limits, strict=True)):
            if abs(value) > most:
                text = f"too {words[axis]}; limits.{limit}[{axis}] allows {-most:g} to {most:g} {unit}"
                yield Mistake((table, key, axis), text, value)


@RULES.needs("objective", "limits")
def _desired_heading_is_allowed(scenario: Scenario) -> Mistakes:
    heading, most = scenario.objective.heading_ref_deg, scenario.limits.roll_pitch_yaw_deg[2]
    if heading is not None and abs(heading) > most:
        text = f"out of reach; limits.roll_pitch_yaw_deg[2] allows a yaw of {-most:g} to {most:g} degrees"
        yield Mistake(("objective", "heading_ref_deg"), text, heading)


@RULES.needs("end")
def _flight_ends_in_a_hover(scenario: Scenario) -> Mistakes:
    if any(scenario.end.velocity_mps):
        text = "must be [0, 0, 0]: every flight ends in a hover, from which it lands"
        step = "remove end.velocity_mps"
        yield Mistake(("end", "velocity_mps"), text, scenario.end.velocity_mps, remedy=step)


@RULES.needs("time", "objective", "formation")
def _a_free_time_can_be_chosen(scenario: Scenario) -> Mistakes:
    cannot = "the planner cannot choose the time while"
    is_costless = scenario.time.latest_s is None and not scenario.objective.time_weight
    is_fixed = any(not change.auto and change.at_point is None for change in scenario.formation.change)
    is_moved, costless = any(zone.moves for zone in scenario.no_fly), "needs a cost of time, or the slowest flight is"
    for is_wrong, text, step in (
        (is_costless, f"{costless} the best", "give [objective] time_weight, or a latest_s here"),
        (is_fixed, f"{cannot} changes have fixed times", "set auto = true in each"),
        (is_moved, f"{cannot} no-fly zones move", "remove their moves"),
    ):
        if scenario.time.free and is_wrong:
            yield Mistake(("time", "free"), text, True, step)


@RULES.needs("start", "ground_phases")
def _run_up_meets_the_start(scenario: Scenario) -> Mistakes:
    phases = scenario.ground_phases
    speed = float(np.hypot(*scenario.start.velocity_mps[:2]))
    if speed > 0 and not 0 < phases.run_up_m < speed * phases.run_up_s:
        text = f"cannot bring a vehicle from rest to {speed:.2f} m/s in run_up_s = {phases.run_up_s:g} s"
        text += f"; it must lie between 0 and {speed * phases.run_up_s:.1f}"
        step = f"set ground_phases.run_up_m to {speed * phases.run_up_s / 2:.1f}"
        yield Mistake(("ground_phases", "run_up_m"), text, phases.run_up_m, remedy=step)


@RULES.needs("start", "end", "time", "limits")
def _acceleration_is_enough_for_the_flight(scenario: Scenario) -> Mistakes:
    way = np.subtract(scenario.end.position_m, scenario.start.position_m)
    if np.any(np.abs(way) > np.multiply(scenario.limits.speed_ned_mps, scenario.time.flight_s)):
        return  # the rule about the time reports it
    needed = least_acceleration_mps2(way, np.array(scenario.start.velocity_mps), scenario.time.flight_s)
    yield from _too_little_acceleration(scenario, needed, f"to cover {np.linalg.norm(way):.0f} m in time.flight_s")


@RULES.needs("start", "limits", "ground_phases")
def _acceleration_is_enough_for_the_run_up(scenario: Scenario) -> Mistakes:
    phases, velocity = scenario.ground_phases, np.array([*scenario.start.velocity_mps[:2], 0.0])
    speed = float(np.linalg.norm(velocity))
    if speed > 0 and 0 < phases.run_up_m < speed * phases.run_up_s:  # else the rule about the run-up reports it
        way = velocity / speed * phases.run_up_m
        needed = least_acceleration_mps2(way, velocity, phases.run_up_s)
        what_for = f"for a run-up of {phases.run_up_m:g} m in {phases.run_up_s:g} s"
        yield from _too_little_acceleration(scenario, needed, what_for)


def least_acceleration_mps2(distance_m: Array, velocity_mps: Array, time_s: float) -> float:
    """The least acceleration for a displacement (3,) in a time, from a velocity (3,) to rest or the reverse, m/s².

    Along any direction, full acceleration followed by full braking gives the largest displacement, and the reverse
    order the smallest; both are solved for the acceleration. Two directions are checked: that of the initial velocity,
    and the one in which the displacement differs most from that of uniform braking.
    """
    needed = 0.0
    for direction in (velocity_mps, 4.0 * distance_m - 2.0 * velocity_mps * time_s):
        length = np.linalg.norm(direction)
        if length > 0:
            ahead_mps = float(velocity_mps @ direction / length)
            off_m = abs(4.0 * float(distance_m @ direction / length) - 2.0 * ahead_mps * time_s)
            needed = max(needed, (off_m + float(np.hypot(off_m, 2.0 * ahead_mps * time_s))) / (2.0 * time_s**2))
    return needed


def _too_little_acceleration(scenario: Scenario, needed_mps2: float, what_for: str) -> Mistakes:
    most = scenario.limits.accel_max_mps2
    if most is not None and needed_mps2 > most:
        least = f"{np.ceil(needed_mps2 * 1000.0) / 1000.0:g}"
        text = f"too little {what_for}, which takes at least {least} m/s²"
        yield Mistake(("limits", "accel_max_mps2"), text, most, remedy=f"set limits.accel_max_mps2 to {least} or more")
