"""Rules about both ends of the flight: box, ground clearance, no-fly zones, pads, run-up, take-off and landing.

The formation at the end is known where it keeps its shape. Where it ends in a named shape, its places are known, but
not which vehicle takes which. Otherwise these rules check the leader alone, and the verification of the plan checks the
others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gcs.errors import counted
from gcs.physics.quadrotor import Array
from gcs.scenario.environment.clearance_floor import clearance_floor_m
from gcs.scenario.environment.no_fly import outside_m
from gcs.scenario.schema.scenario import START_SHAPE, Boundary, Scenario
from gcs.scenario.si import (
    NED_FROM_UP,
    ground_step_jerk_peak,
    ground_step_peaks,
    hover_start_ned_m,
    landing_points_ned_m,
    leader_index,
    offsets_ned_m,
    pads_ned_m,
    quadrotor,
    shape_offsets_ned_m,
    sysids,
)
from gcs.scenario.validation.formation_rules import pairs_in_start_shape
from gcs.scenario.validation.mistakes import Mistake
from gcs.scenario.validation.rule_set import Mistakes, Rules
from gcs.scenario.validation.slips.shown_values import dotted, plain
from gcs.scenario.validation.spacing import SLACK, close_pairs
from gcs.scenario.validation.toml_lines import Key

_RUN_UP_SAMPLE_M = 1.0
_SAME_M = 0.01  # a place in degrees is known to a centimetre
_FOOT_M, _HEIGHT = 0.3048, 2
_BOX = ("north_m", "east_m", "height_m")
_NAMED = 8  # vehicles one sentence names

RULES = Rules()


@dataclass(frozen=True)
class _End:
    """The vehicles at one end whose position there is known, and the table that sets it."""

    table: str
    boundary: Boundary
    sysids: tuple[int, ...]
    places_up_m: Array  # (K, 3) north, east, height


@RULES.needs("start", "formation")
def _leader_starts_where_it_is(scenario: Scenario) -> Mistakes:
    formation, start = scenario.formation, scenario.start.position_m
    if formation.count is not None:
        return  # the leader then stands at [start]
    place = next(v.position_m for v in formation.vehicle if v.sysid == formation.leader)
    if max(abs(a - b) for a, b in zip(place, start, strict=True)) > _SAME_M:
        at = ", ".join(plain(value) for value in place)
        text = f"differs from [{at}], the position of the leader, vehicle {formation.leader}. Make them equal"
        if len(formation.vehicle) > 1:
            way = _way(np.subtract(start, place))
            text += f": move [start] back, or every vehicle by {way}"
        yield Mistake(("start", "position_m"), text, start)


@RULES.needs("start", "end", "formation", "limits")
def _ends_are_in_the_box(scenario: Scenario) -> Mistakes:
    for axis, key in enumerate(_BOX):
        low, high = getattr(scenario.limits, key)
        stray = {sysids(scenario)[row] for row in _strays(scenario, axis)}
        if stray:
            yield _stray_vehicle(scenario, axis)
        for end in _ends(scenario):
            along = end.places_up_m[:, axis]
            beyond = np.maximum(low - along, along - high)
            beyond[[sysid in stray for sysid in end.sysids]] = 0.0
            worst = int(beyond.argmax())
            if beyond[worst] > SLACK:
                text = (
                    f"puts {_vehicles(end, beyond > SLACK)} outside limits.{key}, {plain(low)} to {plain(high)}; "
                    f"vehicle {end.sysids[worst]} would be at {plain(along[worst])}"
                )
                own = end.boundary.position_m[axis]
                moves_with = (lambda _: "") if end.table == "end" else partial(_vehicles_move_with, scenario, axis)
                step = _into_the_box(end.table, axis, key, own, along, (low, high), moves_with)
                yield Mistake((end.table, "position_m", axis), text, own, remedy=step)


@RULES.needs("start", "end", "formation", "limits")
def _last_shape_is_in_the_box(scenario: Scenario) -> Mistakes:
    name, limits, end = _last_shape(scenario), scenario.limits, scenario.end
    if name is None:
        return
    places_m = _last_places_up_m(scenario, name)
    for axis, key in enumerate(_BOX):
        low, high = getattr(limits, key)
        stray = _strays(scenario, axis) if name == START_SHAPE else []
        along, own = np.delete(places_m[:, axis], stray), end.position_m[axis]
        outside = int(np.count_nonzero((along < low - SLACK) | (along > high + SLACK)))
        if outside and low <= own <= high:  # else the rule about the leader reports it
            text = (
                f"puts {counted(outside, 'place')} of the last shape, {name}, outside limits.{key}, {plain(low)} to "
                f"{plain(high)}; the shape would reach from {plain(along.min())} to {plain(along.max())}"
            )
            step = _into_the_box("end", axis, key, own, along, (low, high))
            yield Mistake(("end", "position_m", axis), text, own, remedy=step)


@RULES.needs("end", "formation", "no_fly", "time")
def _last_shape_is_outside_no_fly_zones(scenario: Scenario) -> Mistakes:
    name = _last_shape(scenario)
    if name is None:
        return
    places_m, leader = _last_places_up_m(scenario, name), leader_index(scenario)
    for index, zone in enumerate(scenario.no_fly):
        outside = outside_m(zone, np.array(scenario.time.flight_s), places_m[:, 0], places_m[:, 1])
        if outside.min() < -SLACK <= outside[leader]:  # else the rule about the leader reports it
            key = "radius_m" if zone.polygon_m is None else "polygon_m"
            inside, deep_m = int(np.count_nonzero(outside < -SLACK)), -float(outside.min())
            text = f"contains {counted(inside, 'place')} of the last shape, {name}, at the end, {deep_m:.2f} m inside"
            step = f"move the zone or [end] apart by more than {_up(deep_m, 0.1):.1f} m"
            yield Mistake(("no_fly", index, key), text, zone.radius_m, remedy=step)


@RULES.needs("start", "end", "formation", "limits", "terrain")
def _ends_clear_the_ground(scenario: Scenario) -> Mistakes:
    low: set[int] = set()
    for end in _ends(scenario):
        missing = _missing_m(scenario, end.places_up_m)
        if end.table == "start":
            low = {end.sysids[row] for row in _own_mistakes(scenario, missing > SLACK)}
        elif low:
            missing[[sysid in low for sysid in end.sysids]] = 0.0
        worst = int(missing.argmax())
        if missing[worst] > SLACK:
            text = f"vehicle {end.sysids[worst]} would be {_below(float(missing[worst]), scenario)}"
            key: Key = ("formation", "vehicle", worst) if end.table == "start" and low else (end.table,)
            own = float(end.places_up_m[worst, 2]) if len(key) > 1 else end.boundary.position_m[2]
            step = f"set {dotted(key)}.position_m[2] to {plain(_up(own + float(missing[worst]), 0.1))} or more"
            yield Mistake((*key, "position_m", 2), text, own, remedy=step)


@RULES.needs("start", "formation", "limits", "terrain", "ground_phases")
def _run_up_clears_the_ground(scenario: Scenario) -> Mistakes:
    if not any(scenario.start.velocity_mps[:2]):
        return  # then there is no run-up
    length = scenario.ground_phases.run_up_m
    begin = hover_start_ned_m(scenario) * NED_FROM_UP
    start = _at_start(scenario)
    shares = np.linspace(0.0, 1.0, max(2, int(np.ceil(length / _RUN_UP_SAMPLE_M)) + 1))[:-1]  # end: rule above
    for share in shares:
        worst, missing = _lowest(scenario, begin + share * (start.places_up_m - begin))
        if missing > SLACK:
            text = (
                f"vehicle {start.sysids[worst]} would be {_below(missing, scenario)}, {share * length:.0f} m into the "
                "run-up. Shorten it, or raise [start]"
            )
            yield Mistake(("ground_phases", "run_up_m"), text, length)
            return


@RULES.needs("start", "end", "formation", "no_fly", "time", "limits")
def _ends_are_outside_no_fly_zones(scenario: Scenario) -> Mistakes:
    margin_m = scenario.limits.zone_margin_m or 0.0
    for index, zone in enumerate(scenario.no_fly):
        for end, t_s in zip(_ends(scenario), (0.0, scenario.time.flight_s), strict=True):
            outside = outside_m(zone, np.array(t_s), end.places_up_m[:, 0], end.places_up_m[:, 1])
            worst = int(outside.argmin())
            if -SLACK <= outside[worst] < margin_m - SLACK:
                text = (
                    f"too much: vehicle {end.sysids[worst]} is {plain(float(outside[worst]))} m from no-fly zone "
                    f"{index + 1} at its {end.table}"
                )
                step = f"set limits.zone_margin_m to {plain(np.floor(100.0 * float(outside[worst])) / 100.0)} or less"
                yield Mistake(("limits", "zone_margin_m"), text, margin_m, remedy=step)
            if outside[worst] < -SLACK:
                key = "radius_m" if zone.polygon_m is None else "polygon_m"
                text = f"contains vehicle {end.sysids[worst]} at its {end.table}, {-outside[worst]:.2f} m inside"
                step = f"move the zone or [{end.table}] apart by more than {_up(-float(outside[worst]), 0.1):.1f} m"
                yield Mistake(("no_fly", index, key), text, zone.radius_m, remedy=step)


@RULES.needs("start", "end", "formation", "limits", "terrain", "ground_phases")
def _pads_are_apart(scenario: Scenario) -> Mistakes:
    least, places = scenario.limits.separation_min_m, offsets_ned_m(scenario)
    found: set[tuple[int, int]] = set()
    grounds = [("take off", pads_ned_m(scenario))]
    if scenario.formation.ends_in_start_shape:
        grounds.append(("land", landing_points_ned_m(scenario)))
    for what, points in grounds:
        pairs = [
            pair
            for pair in close_pairs(points, least)
            if (pair.first, pair.second) not in found
            and np.linalg.norm(places[pair.first] - places[pair.second])
            >= least - SLACK  # else the rule about shapes reports it
        ]
        found |= {(pair.first, pair.second) for pair in pairs}
        yield from pairs_in_start_shape(scenario, pairs, f"fly above each other and would {what} {{:.2f}} m apart")


@RULES.needs("start", "end", "formation", "limits", "terrain", "ground_phases", "vehicle", "wind")
def _climb_and_descent_are_slow_enough(scenario: Scenario) -> Mistakes:
    """Both are smooth steps from rest to rest, whose peak speed is above the mean."""
    phases, limits = scenario.ground_phases, scenario.limits
    fastest, hardest = ground_step_peaks(scenario)
    drag = scenario.vehicle.drag_Nspm
    most_mps = limits.speed_ned_mps[2]
    sideways_N = float(np.hypot(*np.multiply(quadrotor(scenario).wind.at(limits.height_m[1]), drag)[:2]))
    upwards_N = max(limits.thrust_N[1] ** 2 - sideways_N**2, 0.0) ** 0.5
    spare_mps2 = upwards_N / scenario.vehicle.mass_kg - scenario.vehicle.gravity_mps2
    if spare_mps2 <= 0:
        return  # another rule reports it
    spare = f"{spare_mps2:.2f} m/s² of spare thrust (limits.thrust_N)"
    if limits.accel_max_mps2 is not None and limits.accel_max_mps2 < spare_mps2:
        spare_mps2 = limits.accel_max_mps2
        spare = f"{spare_mps2:g} m/s² (limits.accel_max_mps2)"
    end_ned_m = np.array(scenario.end.position_m) * NED_FROM_UP + offsets_ned_m(scenario)
    climb_m = np.delete(pads_ned_m(scenario)[:, 2] - hover_start_ned_m(scenario)[:, 2], _strays(scenario, _HEIGHT))
    descent_m = (landing_points_ned_m(scenario)[:, 2] - end_ned_m[:, 2])[_rows_known_at_end(scenario)]
    steps = (
        ("takeoff_s", float(climb_m.max()), phases.takeoff_s),
        ("landing_s", float(descent_m.max()), phases.landing_s),
    )
    for key, step_m, time in steps:
        by_speed = fastest * step_m / most_mps
        needed = max(by_speed, float(np.sqrt(hardest * max(step_m, 0.0) / spare_mps2)))
        if limits.jerk_max_mps3 is not None:
            jerky = ground_step_jerk_peak(scenario) * max(step_m, 0.0) / limits.jerk_max_mps3
            if jerky ** (1 / 3) > needed:
                needed, spare = jerky ** (1 / 3), f"{limits.jerk_max_mps3:g} m/s³ (limits.jerk_max_mps3)"
        if time < needed:
            text = (
                f"too short for {step_m:.1f} m from rest to rest; {plain(most_mps)} m/s (limits.speed_ned_mps[2]) and "
                f"{spare} take {needed:.1f} s"
            )
            if needed == by_speed:
                air = "" if quadrotor(scenario).wind.is_still else " in wind"
                text += f", because a smooth step{air} is {fastest:.2f} times as fast in its middle as on average"
            yield Mistake(
                ("ground_phases", key), text, time, remedy=f"set ground_phases.{key} to {np.ceil(needed):.0f}"
            )


def _own_mistakes(scenario: Scenario, wrong: NDArray[np.bool_]) -> list[int]:
    """The rows of vehicles that are wrong (V,) at the start by their own positions; none where the leader is wrong."""
    formation, start = scenario.formation, scenario.start.position_m
    if formation.count is not None or wrong[row := leader_index(scenario)]:
        return []
    moved_m = np.subtract(formation.vehicle[row].position_m, start)
    return np.flatnonzero(wrong).tolist() if np.abs(moved_m).max() <= _SAME_M else []


def _strays(scenario: Scenario, axis: int) -> list[int]:
    """The rows of vehicles outside the box along an axis at the start, while the leader is inside."""
    low, high = getattr(scenario.limits, _BOX[axis])
    along = _at_start(scenario).places_up_m[:, axis]
    return _own_mistakes(scenario, (along < low - SLACK) | (along > high + SLACK))


def _stray_vehicle(scenario: Scenario, axis: int) -> Mistake:
    """The mistake of vehicles outside the box along an axis, at the key of the one that is the farthest outside."""
    key, rows = _BOX[axis], _strays(scenario, axis)
    low, high = getattr(scenario.limits, key)
    start = _at_start(scenario)
    along = start.places_up_m[:, axis]
    worst = max(rows, key=lambda row: float(max(low - along[row], along[row] - high)))
    own, others = float(along[worst]), np.delete(along, worst)
    table: Key = ("formation", "vehicle", worst, "position_m", axis)
    text = f"puts vehicle {start.sysids[worst]} outside limits.{key}, {plain(low)} to {plain(high)}"
    wider = f"limits.{key} to [{plain(min(low, np.floor(along.min())))}, {plain(max(high, np.ceil(along.max())))}]"
    if len(rows) > 1:
        text += f"; in all, {_vehicles(start, np.isin(np.arange(len(along)), rows))} are outside"
        return Mistake(table, text, own, remedy=f"set {wider}, or move these vehicles")
    if axis == _HEIGHT and np.ptp(others) <= SLACK:
        to = f"{plain(float(others[0]))}, as the others have"
    else:
        to = plain(min(max(own, low), high))
    return Mistake(table, text, own, remedy=f"set {dotted(table)} to {to}, or {wider}")


def _vehicles_move_with(scenario: Scenario, axis: int, moved_m: float) -> str:
    """What has to move with the start, where vehicles have positions of their own."""
    formation = scenario.formation
    if formation.count is not None:
        return ""
    way = np.zeros(3)
    way[axis] = moved_m - formation.vehicle[leader_index(scenario)].position_m[axis]
    every = "every vehicle" if len(formation.vehicle) > 1 else "the vehicle"
    return f" and move {every} by {_way(way)}" if way.any() else ""


def _way(north_east_up_m: Array) -> str:
    """A displacement (3,) in words."""
    along = zip(north_east_up_m, (("north", "south"), ("east", "west"), ("up", "down")), strict=True)
    return ", ".join(f"{plain(abs(size))} m {words[int(size < 0)]}" for size, words in along if abs(size) > _SAME_M)


def _into_the_box(
    table: str,
    axis: int,
    key: str,
    own: float,
    along_m: Array,
    box_m: tuple[float, float],
    moves_with: Callable[[float], str] = lambda _: "",
) -> str:
    """How to bring vehicles into the box along one axis: by another position, and else by a wider box."""
    (low, high), least, most = box_m, float(along_m.min()), float(along_m.max())
    wider = f"set limits.{key} to [{plain(min(low, np.floor(least)))}, {plain(max(high, np.ceil(most)))}]"
    if most - least > high - low:
        return wider
    moved = own + (low - least if least < low else high - most)
    step = f"set {table}.position_m[{axis}] to {plain(moved)}{moves_with(moved)}, or {wider.removeprefix('set ')}"
    feet_m = _FOOT_M * own
    if axis == _HEIGHT and most > high and low <= feet_m <= high:
        step += f"; is it in feet? {plain(own)} ft are {plain(feet_m)} m"
    return step


def _up(value: float, step: float) -> float:
    """The value rounded up to a multiple of a step."""
    return float(np.ceil(value / step - SLACK) * step)


def _ends(scenario: Scenario) -> tuple[_End, _End]:
    rows = _rows_known_at_end(scenario)
    ids = sysids(scenario)
    places = np.array(scenario.end.position_m) + offsets_ned_m(scenario)[rows] * NED_FROM_UP
    return _at_start(scenario), _End("end", scenario.end, tuple(ids[row] for row in rows), places)


def _at_start(scenario: Scenario) -> _End:
    places = np.array(scenario.start.position_m) + offsets_ned_m(scenario) * NED_FROM_UP
    return _End("start", scenario.start, sysids(scenario), places)


def _rows_known_at_end(scenario: Scenario) -> list[int]:
    """Rows of the vehicles whose position at the end is known without a plan."""
    if scenario.formation.ends_in_start_shape:
        return list(range(len(sysids(scenario))))
    return [leader_index(scenario)]


def _last_shape(scenario: Scenario) -> str | None:
    """The name of the shape in which the formation ends, where changes at their times make it so."""
    formation = scenario.formation
    scheduled = [change for change in formation.change if not change.auto]
    if formation.frame != "inertial" or not scheduled:
        return None
    if len(scheduled) > 1 and any(change.at_s is None for change in scheduled):
        return None  # which one is the last is known when the leader's track is
    return scheduled[-1].to


def _last_places_up_m(scenario: Scenario, name: str) -> Array:
    return np.asarray(np.array(scenario.end.position_m) + shape_offsets_ned_m(scenario, name) * NED_FROM_UP)


def _vehicles(end: _End, chosen: NDArray[np.bool_]) -> str:
    ids = [str(sysid) for sysid, is_chosen in zip(end.sysids, chosen, strict=True) if is_chosen]
    if len(ids) > _NAMED:
        ids = [*ids[:_NAMED], f"and {len(ids) - _NAMED} more"]
    return f"vehicle {ids[0]}" if len(ids) == 1 else f"vehicles {', '.join(ids)}"


def _missing_m(scenario: Scenario, places_up_m: Array) -> Array:
    """The height that each vehicle lacks above the ground, negative where it has more than that, m."""
    least_m = clearance_floor_m(scenario.terrain, places_up_m[:, 0], places_up_m[:, 1], scenario.limits.clearance_min_m)
    return np.asarray(least_m - places_up_m[:, 2])


def _lowest(scenario: Scenario, places_up_m: Array) -> tuple[int, float]:
    """The row of the vehicle with the least clearance, and the height in m that it lacks."""
    missing = _missing_m(scenario, places_up_m)
    worst = int(missing.argmax())
    return worst, float(missing[worst])


def _below(missing_m: float, scenario: Scenario) -> str:
    """Where a vehicle would be that is so much too low."""
    return (
        f"{missing_m:.2f} m too low: limits.clearance_min_m requires {scenario.limits.clearance_min_m:g} m "
        "to the highest possible ground around it"
    )
