"""What the tables of a scenario must agree on before anyone plans it: places, speeds, distances, thrust.

Knows: rules that need several tables, and the key to change. Does not know: the way between start and end.
Every rule names the tables it needs, so that a mistake in one table does not hide those in others. Only what no
plan could mend is refused; whether there is a plan is for the planner to say.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from gcs.quadrotor import Array
from gcs.scenario.mistakes import Mistake
from gcs.scenario.model import Boundary, Scenario
from gcs.scenario.physical import (
    NED_FROM_UP,
    hover_start_ned_m,
    landing_points_ned_m,
    offsets_ned_m,
    pads_ned_m,
    quadrotor,
    sysids,
)
from gcs.scenario.terrain import ground_envelope_m

# Positions written with two decimals should not fail for the last bit of their sums.
_SLACK = 1e-9
_RUN_UP_SAMPLE_M = 1.0

Mistakes = Iterator[Mistake]


@dataclass(frozen=True)
class _Rule:
    needs: frozenset[str]
    check: Callable[[Scenario], Mistakes]


_RULES: list[_Rule] = []


def check(scenario: Scenario, tables: Collection[str] = tuple(Scenario.model_fields)) -> list[Mistake]:
    """All disagreements between those `tables` of the scenario that are valid in themselves."""
    present = set(tables)
    return [mistake for rule in _RULES if rule.needs <= present for mistake in rule.check(scenario)]


def _needs(*tables: str) -> Callable[[Callable[[Scenario], Mistakes]], Callable[[Scenario], Mistakes]]:
    def register(rule: Callable[[Scenario], Mistakes]) -> Callable[[Scenario], Mistakes]:
        _RULES.append(_Rule(frozenset(tables), rule))
        return rule

    return register


@_needs("start", "formation")
def _leader_starts_where_it_is(scenario: Scenario) -> Mistakes:
    formation, start = scenario.formation, scenario.start.position_m
    place = next(v.position_m for v in formation.vehicle if v.sysid == formation.leader)
    if place != start:
        text = f"differs from {list(place)}, where the formation has its leader, vehicle {formation.leader}"
        yield Mistake(("start", "position_m"), text, start)


@_needs("start", "end", "formation", "limits")
def _ends_are_in_the_box(scenario: Scenario) -> Mistakes:
    limits = scenario.limits
    boxes = (("north_m", limits.north_m), ("east_m", limits.east_m), ("height_m", limits.height_m))
    for table, boundary in _ends(scenario):
        places = _places_up_m(scenario, boundary)
        for axis, (key, (low, high)) in enumerate(boxes):
            beyond = np.maximum(low - places[:, axis], places[:, axis] - high)
            worst = int(beyond.argmax())
            if beyond[worst] > _SLACK:
                text = (
                    f"puts {_vehicles(scenario, beyond > _SLACK)} outside limits.{key}, {low:g} to {high:g}; "
                    f"vehicle {sysids(scenario)[worst]} would be at {places[worst, axis]:g}"
                )
                yield Mistake((table, "position_m", axis), text, boundary.position_m[axis])


@_needs("start", "end", "formation", "limits", "terrain")
def _ends_clear_the_ground(scenario: Scenario) -> Mistakes:
    for table, boundary in _ends(scenario):
        places = _places_up_m(scenario, boundary)
        worst, clearance = _lowest(scenario, places)
        if clearance < scenario.limits.clearance_min_m - _SLACK:
            missing = scenario.limits.clearance_min_m - clearance
            text = (
                f"leaves vehicle {sysids(scenario)[worst]} {clearance:.2f} m above the highest the ground may be "
                f"there; limits.clearance_min_m asks {scenario.limits.clearance_min_m:g} m: {missing:.2f} m more"
            )
            yield Mistake((table, "position_m", 2), text, boundary.position_m[2])


@_needs("start", "formation", "limits", "terrain", "ground_phases")
def _run_up_clears_the_ground(scenario: Scenario) -> Mistakes:
    length = scenario.ground_phases.run_up_m
    begin = hover_start_ned_m(scenario) * NED_FROM_UP
    end = _places_up_m(scenario, scenario.start)
    shares = np.linspace(0.0, 1.0, max(2, int(np.ceil(length / _RUN_UP_SAMPLE_M)) + 1))[:-1]  # end: rule above
    for share in shares:
        worst, clearance = _lowest(scenario, begin + share * (end - begin))
        if clearance < scenario.limits.clearance_min_m - _SLACK:
            text = (
                f"takes vehicle {sysids(scenario)[worst]} within {clearance:.2f} m of the ground {share * length:.0f} "
                f"m into the run-up; limits.clearance_min_m asks {scenario.limits.clearance_min_m:g} m"
            )
            yield Mistake(("ground_phases", "run_up_m"), text, length)
            return


@_needs("start", "end", "formation", "no_fly")
def _ends_are_outside_no_fly_disks(scenario: Scenario) -> Mistakes:
    for index, disk in enumerate(scenario.no_fly):
        for table, boundary in _ends(scenario):
            places = _places_up_m(scenario, boundary)
            distance = np.hypot(places[:, 0] - disk.north_m, places[:, 1] - disk.east_m)
            worst = int(distance.argmin())
            if distance[worst] < disk.radius_m - _SLACK:
                text = (
                    f"holds vehicle {sysids(scenario)[worst]} at its {table}, {distance[worst]:.2f} m from the centre"
                )
                yield Mistake(("no_fly", index, "radius_m"), text, disk.radius_m)


@_needs("formation", "limits")
def _vehicles_are_apart(scenario: Scenario) -> Mistakes:
    places, least = offsets_ned_m(scenario), scenario.limits.separation_min_m
    for first, second, distance in _close_pairs(places, least):
        vehicle = scenario.formation.vehicle
        text = (
            f"vehicles {vehicle[first].sysid} and {vehicle[second].sysid} are {distance:.2f} m apart; "
            f"limits.separation_min_m asks {least:g} m"
        )
        yield Mistake(("formation", "vehicle", second, "position_m"), text, vehicle[second].position_m)


@_needs("start", "end", "formation", "limits", "terrain", "ground_phases")
def _pads_are_apart(scenario: Scenario) -> Mistakes:
    places, least = offsets_ned_m(scenario), scenario.limits.separation_min_m
    told = {(first, second) for first, second, _ in _close_pairs(places, least)}
    for what, points in (("take off", pads_ned_m(scenario)), ("land", landing_points_ned_m(scenario))):
        for first, second, distance in _close_pairs(points, least):
            if (first, second) not in told:
                told.add((first, second))
                vehicle = scenario.formation.vehicle
                text = (
                    f"vehicles {vehicle[first].sysid} and {vehicle[second].sysid} fly above each other and would "
                    f"{what} {distance:.2f} m apart; limits.separation_min_m asks {least:g} m"
                )
                yield Mistake(("formation", "vehicle", second, "position_m"), text, vehicle[second].position_m)


@_needs("limits", "judge")
def _judge_asks_no_more_than_the_plan_holds(scenario: Scenario) -> Mistakes:
    asked, planned = scenario.judge.separation_min_m, scenario.limits.separation_min_m
    if asked > planned:
        text = f"asks more than the plan promises, which is limits.separation_min_m = {planned:g}"
        yield Mistake(("judge", "separation_min_m"), text, asked)


@_needs("start", "end", "limits")
def _ends_are_within_state_limits(scenario: Scenario) -> Mistakes:
    limits = scenario.limits
    axes = ("north", "east", "up")
    angles = ("roll", "pitch", "yaw")
    for table, boundary in _ends(scenario):
        for axis, (value, most) in enumerate(zip(boundary.velocity_mps, limits.speed_ned_mps, strict=True)):
            if abs(value) > most:
                text = f"too fast {axes[axis]}; limits.speed_ned_mps[{axis}] allows {-most:g} to {most:g}"
                yield Mistake((table, "velocity_mps", axis), text, value)
        turns = zip(boundary.roll_pitch_yaw_deg, limits.roll_pitch_yaw_deg, strict=True)
        for axis, (value, most) in enumerate(turns):
            if abs(value) > most:
                text = f"too much {angles[axis]}; limits.roll_pitch_yaw_deg[{axis}] allows {-most:g} to {most:g}"
                yield Mistake((table, "roll_pitch_yaw_deg", axis), text, value)


@_needs("objective", "limits")
def _heading_asked_for_is_allowed(scenario: Scenario) -> Mistakes:
    heading, most = scenario.objective.heading_ref_deg, scenario.limits.roll_pitch_yaw_deg[2]
    if abs(heading) > most:
        text = f"cannot be reached; limits.roll_pitch_yaw_deg[2] allows a yaw of {-most:g} to {most:g} degrees"
        yield Mistake(("objective", "heading_ref_deg"), text, heading)


@_needs("end")
def _flight_ends_in_a_hover(scenario: Scenario) -> Mistakes:
    if any(scenario.end.velocity_mps):
        text = "must be [0, 0, 0]: every flight ends in a hover and lands from it"
        yield Mistake(("end", "velocity_mps"), text, scenario.end.velocity_mps)


@_needs("vehicle", "limits")
def _vehicle_hovers(scenario: Scenario) -> Mistakes:
    model = quadrotor(scenario)
    low, high = scenario.limits.thrust_N
    if not low < model.weight_N < high:
        text = (
            f"cannot hover: the weight is {model.weight_N:.2f} N (vehicle.mass_kg = {model.mass_kg:g}), "
            "and thrust must be free to go below and above it"
        )
        yield Mistake(("limits", "thrust_N"), text, (low, high))
    from_rotors = 4 * model.thrust_coeff_Ns2 * model.rotor_max_radps**2
    if from_rotors < high:
        text = (
            f"too slow: four rotors lift {from_rotors:.2f} N; limits.thrust_N promises {high:g} N "
            f"and needs {np.sqrt(high / (4 * model.thrust_coeff_Ns2)):.0f} rad/s"
        )
        yield Mistake(("vehicle", "rotor_max_radps"), text, model.rotor_max_radps)


@_needs("start", "end", "time", "limits")
def _time_is_enough(scenario: Scenario) -> Mistakes:
    way = np.abs(np.subtract(scenario.end.position_m, scenario.start.position_m))
    needed = way / scenario.limits.speed_ned_mps
    axis = int(needed.argmax())
    if needed[axis] > scenario.time.flight_s:
        name = ("north", "east", "vertical")[axis]
        text = (
            f"too short: {way[axis]:g} m {name} take at least {needed[axis]:.1f} s "
            f"at limits.speed_ned_mps[{axis}] = {scenario.limits.speed_ned_mps[axis]:g} m/s"
        )
        yield Mistake(("time", "flight_s"), text, scenario.time.flight_s)


@_needs("start", "ground_phases")
def _run_up_meets_the_start(scenario: Scenario) -> Mistakes:
    phases = scenario.ground_phases
    speed = float(np.hypot(*scenario.start.velocity_mps[:2]))
    if speed > 0 and not 0 < phases.run_up_m < speed * phases.run_up_s:
        text = (
            f"cannot bring a vehicle from rest to {speed:.2f} m/s in run_up_s = {phases.run_up_s:g} s; "
            f"it must lie between 0 and {speed * phases.run_up_s:.1f}, best near {speed * phases.run_up_s / 2:.1f}"
        )
        yield Mistake(("ground_phases", "run_up_m"), text, phases.run_up_m)


@_needs("start", "end", "formation", "limits", "terrain", "ground_phases", "vehicle")
def _climb_and_descent_are_slow_enough(scenario: Scenario) -> Mistakes:
    """Both are quintics from rest to rest: peak speed 15/8 d / T, peak acceleration 10 / sqrt(3) d / T²."""
    phases, most = scenario.ground_phases, scenario.limits.speed_ned_mps[2]
    vehicle = scenario.vehicle
    spare_mps2 = scenario.limits.thrust_N[1] / vehicle.mass_kg - vehicle.gravity_mps2
    if spare_mps2 <= 0:
        return  # another rule's mistake
    end_ned_m = _places_up_m(scenario, scenario.end) * NED_FROM_UP
    climb = float(np.max(pads_ned_m(scenario)[:, 2] - hover_start_ned_m(scenario)[:, 2]))
    descent = float(np.max(landing_points_ned_m(scenario)[:, 2] - end_ned_m[:, 2]))
    for key, way, time in (("takeoff_s", climb, phases.takeoff_s), ("landing_s", descent, phases.landing_s)):
        needed = max(15 / 8 * way / most, float(np.sqrt(10 / np.sqrt(3) * max(way, 0.0) / spare_mps2)))
        if time < needed:
            text = (
                f"too short for {way:.1f} m from rest to rest; {most:g} m/s (limits.speed_ned_mps[2]) and "
                f"{spare_mps2:.2f} m/s² of spare thrust (limits.thrust_N) take {needed:.1f} s"
            )
            yield Mistake(("ground_phases", key), text, time)


def _ends(scenario: Scenario) -> tuple[tuple[str, Boundary], ...]:
    return (("start", scenario.start), ("end", scenario.end))


def _places_up_m(scenario: Scenario, boundary: Boundary) -> Array:
    """North, east, height (V, 3) of every vehicle at one end."""
    return np.asarray(np.array(boundary.position_m) + offsets_ned_m(scenario) * NED_FROM_UP)


def _vehicles(scenario: Scenario, chosen: NDArray[np.bool_]) -> str:
    ids = [str(sysid) for sysid, is_chosen in zip(sysids(scenario), chosen, strict=True) if is_chosen]
    return f"vehicle {ids[0]}" if len(ids) == 1 else f"vehicles {', '.join(ids)}"


def _lowest(scenario: Scenario, places_up_m: Array) -> tuple[int, float]:
    """Row of the vehicle nearest to the ground, and its clearance in m."""
    ground = ground_envelope_m(scenario.terrain, places_up_m[:, 0], places_up_m[:, 1])
    clearance = places_up_m[:, 2] - ground
    worst = int(clearance.argmin())
    return worst, float(clearance[worst])


def _close_pairs(places: Array, least_m: float) -> Iterator[tuple[int, int, float]]:
    for first, second in combinations(range(len(places)), 2):
        distance = float(np.linalg.norm(places[first] - places[second]))
        if distance < least_m - _SLACK:
            yield first, second, distance
