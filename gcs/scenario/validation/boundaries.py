"""Rules about both ends of the flight: box, ground clearance, pads, run-up, take-off and landing.

The formation at the end is known where it keeps its shape. Where it ends in a named shape, its places are known, but
not which vehicle takes which. Otherwise these rules check the leader alone, and the verification of the plan checks the
others.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.errors import counted
from gcs.scenario.environment.clearance_floor import clearance_floor_m
from gcs.scenario.schema.fields import Place
from gcs.scenario.schema.mistake import KeyChange, Mistake, plain
from gcs.scenario.schema.scenario import START_SHAPE, Scenario
from gcs.scenario.schema.toml_lines import Key
from gcs.scenario.validation.formation_rules import pairs_in_start_shape
from gcs.scenario.validation.rule_set import Mistakes, Rules
from gcs.scenario.validation.spacing import SLACK, close_pairs
from gcs.scenario.values import si
from gcs.types import Array

_RUN_UP_SAMPLE_M = 1.0
_SAME_M = 0.01  # a place in degrees is known to a centimetre
_FOOT_M, _HEIGHT = 0.3048, 2
BOX = ("north_m", "east_m", "height_m")
_NAMED = 8  # vehicles one sentence names

_START: Key = ("start",)

RULES = Rules()


@dataclass(frozen=True)
class Stop:
    """A place of the leader that a table sets, and the vehicles whose position is then known."""

    key: Key  # of the table
    position_m: Place
    sysids: tuple[int, ...]
    places_up_m: Array  # (K, 3) north, east, height
    radius_m: float = 0.0  # the leader may be so far from the place


@RULES.needs("start", "formation")
def _leader_starts_where_it_is(scenario: Scenario) -> Mistakes:
    formation, start = scenario.formation, scenario.start.position_m
    if formation.count is not None:
        return  # the leader then stands at [start]
    place = next(v.position_m for v in formation.vehicle if v.sysid == formation.leader)
    if max(abs(a - b) for a, b in zip(place, start, strict=True)) > _SAME_M:
        at = ", ".join(plain(value) for value in place)
        text = f"differs from [{at}], the position of the leader, vehicle {formation.leader}"
        step = "make them equal"
        if len(formation.vehicle) > 1:
            step += f": move [start] back, or every vehicle by {_way(np.subtract(start, place))}"
        yield Mistake(("start", "position_m"), text, start, step)


@RULES.needs("start", "end", "formation", "limits")
def _ends_are_in_the_box(scenario: Scenario) -> Mistakes:
    for axis in range(len(BOX)):
        if _strays(scenario, axis):
            yield _stray_vehicle(scenario, axis)
        for end in ends(scenario):
            yield from out_of_the_box(scenario, end, axis)


@RULES.needs("start", "end", "formation", "limits")
def _last_shape_is_in_the_box(scenario: Scenario) -> Mistakes:
    name, limits, end = last_shape(scenario), scenario.limits, scenario.end
    if name is None:
        return
    places_m = last_places_up_m(scenario, name)
    for axis, key in enumerate(BOX):
        low, high = getattr(limits, key)
        stray = _strays(scenario, axis) if name == START_SHAPE else []
        along, own = np.delete(places_m[:, axis], stray), end.position_m[axis]
        outside = int(np.count_nonzero((along < low - SLACK) | (along > high + SLACK)))
        if outside and low <= own <= high:  # else the rule about the leader reports it
            text = f"puts {counted(outside, 'place')} of the last shape, {name}, {_outside(scenario, axis)}"
            text += f"; the shape would reach from {plain(along.min())} to {plain(along.max())}"
            yield _into_the_box(scenario, ("end",), axis, own, along, text)


@RULES.needs("start", "end", "formation", "limits", "terrain")
def _ends_clear_the_ground(scenario: Scenario) -> Mistakes:
    for end in ends(scenario):
        yield from too_low(scenario, end)


@RULES.needs("start", "formation", "limits", "terrain", "ground_phases")
def _run_up_clears_the_ground(scenario: Scenario) -> Mistakes:
    if not any(scenario.start.velocity_mps[:2]):
        return  # then there is no run-up
    length = scenario.ground_phases.run_up_m
    begin = si.hover_start_ned_m(scenario) * si.NED_FROM_UP
    start = _at_start(scenario)
    shares = np.linspace(0.0, 1.0, int(np.ceil(length / _RUN_UP_SAMPLE_M)) + 1)[:-1]  # end: rule above
    missing_m = _missing_m(scenario, begin + shares[:, None, None] * (start.places_up_m - begin))
    for share, missing in zip(shares.tolist(), missing_m, strict=True):
        if missing.max() > SLACK:
            sysid, below = start.sysids[int(missing.argmax())], _below(float(missing.max()), scenario)
            text = f"vehicle {sysid} would be {below}, {share * length:.0f} m into the run-up"
            yield Mistake(("ground_phases", "run_up_m"), text, length, "shorten it, or raise [start]")
            return


@RULES.needs("start", "end", "formation", "limits", "terrain", "ground_phases")
def _pads_are_apart(scenario: Scenario) -> Mistakes:
    least, places = scenario.limits.separation_min_m, si.offsets_ned_m(scenario)
    found: set[tuple[int, int]] = set()
    grounds = [("take off", si.pads_ned_m(scenario))]
    if scenario.formation.ends_in_start_shape:
        grounds.append(("land", si.landing_points_ned_m(scenario)))
    for what, points in grounds:
        new = [pair for pair in close_pairs(points, least) if (pair.first, pair.second) not in found]
        flown_m = [float(np.linalg.norm(places[pair.first] - places[pair.second])) for pair in new]
        # Where they are too near in flight, the rule about shapes reports it.
        pairs = [pair for pair, apart_m in zip(new, flown_m, strict=True) if apart_m >= least - SLACK]
        found |= {(pair.first, pair.second) for pair in pairs}
        yield from pairs_in_start_shape(scenario, pairs, f"fly above each other and would {what} {{:.2f}} m apart")


@RULES.needs("start", "end", "formation", "limits", "terrain", "ground_phases", "vehicle", "wind")
def _climb_and_descent_are_slow_enough(scenario: Scenario) -> Mistakes:
    """Both are smooth steps from rest to rest, whose peak speed is above the mean."""
    phases, limits = scenario.ground_phases, scenario.limits
    fastest, hardest = si.ground_step_peaks(scenario)
    drag = scenario.vehicle.drag_Nspm
    most_mps = limits.speed_ned_mps[2]
    sideways_N = float(np.hypot(*np.multiply(si.quadrotor(scenario).wind.at(limits.height_m[1]), drag)[:2]))
    upwards_N = max(limits.thrust_N[1] ** 2 - sideways_N**2, 0.0) ** 0.5
    spare_mps2 = upwards_N / scenario.vehicle.mass_kg - scenario.vehicle.gravity_mps2
    if spare_mps2 <= 0:
        return  # another rule reports it
    spare = f"{spare_mps2:.2f} m/s² of spare thrust (limits.thrust_N)"
    if limits.accel_max_mps2 is not None and limits.accel_max_mps2 < spare_mps2:
        spare_mps2 = limits.accel_max_mps2
        spare = f"{spare_mps2:g} m/s² (limits.accel_max_mps2)"
    end_ned_m = np.array(scenario.end.position_m) * si.NED_FROM_UP + si.offsets_ned_m(scenario)
    climb_m = (si.pads_ned_m(scenario) - si.hover_start_ned_m(scenario))[:, 2]
    climb_m = np.delete(climb_m, _strays(scenario, _HEIGHT))
    descent_m = (si.landing_points_ned_m(scenario)[:, 2] - end_ned_m[:, 2])[_rows_known_later(scenario)]
    for key, step_m in (("takeoff_s", float(climb_m.max())), ("landing_s", float(descent_m.max()))):
        time = getattr(phases, key)
        if time is None:
            continue
        by_speed = fastest * step_m / most_mps
        needed = max(by_speed, float(np.sqrt(hardest * max(step_m, 0.0) / spare_mps2)))
        if limits.jerk_max_mps3 is not None:
            jerky = si.ground_step_jerk_peak(scenario) * max(step_m, 0.0) / limits.jerk_max_mps3
            if jerky ** (1 / 3) > needed:
                needed, spare = jerky ** (1 / 3), f"{limits.jerk_max_mps3:g} m/s³ (limits.jerk_max_mps3)"
        if time < needed:
            by = f"{plain(most_mps)} m/s (limits.speed_ned_mps[2]) and {spare}"
            text = f"too short for {step_m:.1f} m from rest to rest; {by} take {needed:.1f} s"
            if needed == by_speed:
                air = "" if si.quadrotor(scenario).wind.is_still else " in wind"
                text += f", because a smooth step{air} is {fastest:.2f} times as fast in its middle as on average"
            step = f"set ground_phases.{key} to {np.ceil(needed):.0f}"
            yield Mistake(("ground_phases", key), text, time, remedy=step)


def out_of_the_box(scenario: Scenario, stop: Stop, axis: int) -> Mistakes:
    """The mistake of vehicles outside the box along an axis, but for those outside by their own positions."""
    (low, high), stray = getattr(scenario.limits, BOX[axis]), _strays(scenario, axis)
    along = stop.places_up_m[:, axis]
    beyond = np.maximum(low - along, along - high) - stop.radius_m
    beyond[np.isin(stop.sysids, [si.sysids(scenario)[row] for row in stray])] = 0.0
    worst = int(beyond.argmax())
    if beyond[worst] > SLACK:
        text = f"puts {_vehicles(stop, beyond > SLACK)} {_outside(scenario, axis)}"
        text += f"; vehicle {stop.sysids[worst]} would be at {plain(along[worst])}"
        yield _into_the_box(scenario, stop.key, axis, stop.position_m[axis], along, text)


def too_low(scenario: Scenario, stop: Stop) -> Mistakes:
    """The mistake of the lowest vehicle above the ground; what is already wrong at the start counts there alone."""
    missing = _missing_m(scenario, stop.places_up_m)
    if missing.max() <= SLACK:
        return
    rows = _own_mistakes(scenario, _missing_m(scenario, _at_start(scenario).places_up_m) > SLACK)
    if stop.key != _START:
        missing[np.isin(stop.sysids, [si.sysids(scenario)[row] for row in rows])] = 0.0
    worst = int(missing.argmax())
    if missing[worst] > SLACK:
        text = f"vehicle {stop.sysids[worst]} would be {_below(float(missing[worst]), scenario)}"
        key: Key = ("formation", "vehicle", worst) if stop.key == _START and rows else stop.key
        own = stop.position_m[2] if key == stop.key else float(stop.places_up_m[worst, 2])
        key = (*key, "position_m", _HEIGHT)
        yield Mistake(key, text, own, "set {} or more", (KeyChange(key, up(own + float(missing[worst]), 0.1)),))


def _own_mistakes(scenario: Scenario, wrong: NDArray[np.bool_]) -> list[int]:
    """The rows of vehicles that are wrong (V,) at the start by their own positions; none where the leader is wrong."""
    formation, start = scenario.formation, scenario.start.position_m
    if formation.count is not None or wrong[row := si.leader_index(scenario)]:
        return []
    moved_m = np.subtract(formation.vehicle[row].position_m, start)
    return np.flatnonzero(wrong).tolist() if np.abs(moved_m).max() <= _SAME_M else []


def _strays(scenario: Scenario, axis: int) -> list[int]:
    """The rows of vehicles outside the box along an axis at the start, while the leader is inside."""
    low, high = getattr(scenario.limits, BOX[axis])
    along = _at_start(scenario).places_up_m[:, axis]
    return _own_mistakes(scenario, (along < low - SLACK) | (along > high + SLACK))


def _stray_vehicle(scenario: Scenario, axis: int) -> Mistake:
    """The mistake of vehicles outside the box along an axis, at the key of the one that is the farthest outside."""
    (low, high), rows = getattr(scenario.limits, BOX[axis]), _strays(scenario, axis)
    start = _at_start(scenario)
    along = start.places_up_m[:, axis]
    worst = max(rows, key=lambda row: float(max(low - along[row], along[row] - high)))
    own, others = float(along[worst]), np.delete(along, worst)
    table: Key = ("formation", "vehicle", worst, "position_m", axis)
    text = f"puts vehicle {start.sysids[worst]} {_outside(scenario, axis)}"
    wider = _wider(scenario, axis, along)
    if len(rows) > 1:
        text += f"; in all, {_vehicles(start, np.isin(np.arange(len(along)), rows))} are outside"
        return Mistake(table, text, own, "set {}, or move these vehicles", (wider,))
    if axis == _HEIGHT and np.ptp(others) <= SLACK:
        changes = KeyChange(table, float(others[0])), wider
        return Mistake(table, text, own, "set {}, as the others have, or {}", changes)
    return Mistake(table, text, own, "set {}, or {}", (KeyChange(table, min(max(own, low), high)), wider))


def _vehicles_move_with(scenario: Scenario, axis: int, moved_m: float) -> str:
    """What has to move with the start, where vehicles have positions of their own."""
    formation = scenario.formation
    if formation.count is not None:
        return ""
    way = np.zeros(3)
    way[axis] = moved_m - formation.vehicle[si.leader_index(scenario)].position_m[axis]
    every = "every vehicle" if len(formation.vehicle) > 1 else "the vehicle"
    return f" and move {every} by {_way(way)}" if way.any() else ""


def _way(north_east_up_m: Array) -> str:
    """A displacement (3,) in words."""
    along = zip(north_east_up_m, (("north", "south"), ("east", "west"), ("up", "down")), strict=True)
    return ", ".join(f"{plain(abs(size))} m {words[int(size < 0)]}" for size, words in along if abs(size) > _SAME_M)


def _outside(scenario: Scenario, axis: int) -> str:
    low, high = getattr(scenario.limits, BOX[axis])
    return f"outside the box, {BOX[axis].removesuffix('_m')} {plain(low)} to {plain(high)} m"


def _into_the_box(scenario: Scenario, table: Key, axis: int, own: float, along_m: Array, text: str) -> Mistake:
    """The mistake of a position, with how to bring vehicles into the box: by another position, else by a wider box."""
    key, wider = (*table, "position_m", axis), _wider(scenario, axis, along_m)
    (low, high), least, most = getattr(scenario.limits, BOX[axis]), float(along_m.min()), float(along_m.max())
    if most - least > high - low:
        return Mistake(key, text, own, "set {}", (wider,))
    moved = own + (low - least if least < low else high - most)
    step = f"set {{}}{_vehicles_move_with(scenario, axis, moved) if table == _START else ''}, or {{}}"
    feet_m = _FOOT_M * own
    if axis == _HEIGHT and most > high and low <= feet_m <= high:
        step += f"; is it in feet? {plain(own)} ft are {plain(feet_m)} m"
    return Mistake(key, text, own, step, (KeyChange(key, moved), wider))


def _wider(scenario: Scenario, axis: int, along_m: Array) -> KeyChange:
    """The box along an axis that holds these places too."""
    low, high = getattr(scenario.limits, BOX[axis])
    return KeyChange(("limits", BOX[axis]), [min(low, np.floor(along_m.min())), max(high, np.ceil(along_m.max()))])


def up(value: float, step: float) -> float:
    """The value rounded up to a multiple of a step."""
    return float(np.ceil(value / step - SLACK) * step)


def ends(scenario: Scenario) -> tuple[Stop, Stop]:
    """The start and the end."""
    return _at_start(scenario), stop_at(scenario, ("end",), scenario.end.position_m)


def stop_at(scenario: Scenario, key: Key, position_m: Place, radius_m: float = 0.0) -> Stop:
    """A place of the leader after the start, with the vehicles whose position is then known without a plan."""
    rows, ids = _rows_known_later(scenario), si.sysids(scenario)
    places = np.array(position_m) + si.offsets_ned_m(scenario)[rows] * si.NED_FROM_UP
    return Stop(key, position_m, tuple(ids[row] for row in rows), places, radius_m)


def _at_start(scenario: Scenario) -> Stop:
    places = np.array(scenario.start.position_m) + si.offsets_ned_m(scenario) * si.NED_FROM_UP
    return Stop(_START, scenario.start.position_m, si.sysids(scenario), places)


def _rows_known_later(scenario: Scenario) -> list[int]:
    """Rows of the vehicles whose position after the start is known: of all where the formation keeps its shape."""
    if scenario.formation.ends_in_start_shape and not any(point.shape for point in scenario.route):
        return list(range(len(si.sysids(scenario))))
    return [si.leader_index(scenario)]


def last_shape(scenario: Scenario) -> str | None:
    """The name of the shape in which the formation ends, where changes at their times make it so."""
    formation = scenario.formation
    scheduled = [change for change in formation.change if not change.auto]
    if any(point.shape for point in scenario.route) or formation.frame != "inertial" or not scheduled:
        return None
    if len(scheduled) > 1 and any(change.timed[1] is None for change in scheduled):
        return None  # which one is the last is known when the leader's track is
    return scheduled[-1].to


def last_places_up_m(scenario: Scenario, name: str) -> Array:
    """The places (V, 3) of a named shape at the end: north, east, height."""
    return np.asarray(np.array(scenario.end.position_m) + si.shape_offsets_ned_m(scenario, name) * si.NED_FROM_UP)


def _vehicles(end: Stop, chosen: NDArray[np.bool_]) -> str:
    ids = [str(sysid) for sysid, is_chosen in zip(end.sysids, chosen, strict=True) if is_chosen]
    if len(ids) > _NAMED:
        ids = [*ids[:_NAMED], f"and {len(ids) - _NAMED} more"]
    return f"vehicle {ids[0]}" if len(ids) == 1 else f"vehicles {', '.join(ids)}"


def _missing_m(scenario: Scenario, places_up_m: Array) -> Array:
    """The height (...) that places (..., 3) lack above the ground, negative where they have more than that, m."""
    north_m, east_m, up_m = np.moveaxis(places_up_m, -1, 0)
    return np.asarray(clearance_floor_m(scenario.terrain, north_m, east_m, scenario.limits.clearance_min_m) - up_m)


def _below(missing_m: float, scenario: Scenario) -> str:
    """Where a vehicle would be that is so much too low."""
    required = f"limits.clearance_min_m requires {scenario.limits.clearance_min_m:g} m"
    return f"{missing_m:.2f} m too low: {required} to the highest possible ground around it"
