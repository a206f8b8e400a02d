"""The adversary: it bends a valid plan until exactly one constraint is violated, shortly and between all samples.

A hump in a state, a control or an offset grows until the oracle sees the wanted violation. `near` first moves the
limit towards the plan, so that a small hump is enough; else the limit stays, and the hump is as large as it takes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import ValidationError
from scipy.interpolate import PPoly

from gcs.plan.trajectory.plan import Plan
from gcs.types import Array
from tests.property.plan.adversary import humps
from tests.property.plan.adversary.oracle import (
    AIRBORNE,
    CLEARANCE,
    GROUND,
    HEADING,
    HEIGHT,
    PAD,
    Oracle,
    turning_limits,
    window,
)
from tests.unit.plan.problems import changed

SAMPLE_S = 0.05
DEPTH_M = (1e-3, 0.1)
DEPTH_SHARE = (2e-3, 5e-2)  # of a limit
DEPTH_HEADING = (1.2e-2, 0.1)  # of its tolerance, of which 1 % more is accepted
LASTS_S = (1e-3, 40e-3)
_WIDEST_S = 0.4
_LENGTHS = (*GROUND, "height", "north position", "east position", "separation")
STATE_ROWS = {
    "north position": 0,
    "east position": 1,
    "north speed": 3,
    "east speed": 4,
    "vertical speed": 5,
    "roll": 6,
    "pitch": 7,
    "yaw": 8,
    "roll rate": 9,
    "pitch rate": 10,
    "yaw rate": 11,
}
CONTROL_ROWS = {"thrust U1": 0, "control U2": 1, "control U3": 2, "control U4": 3}
Bend = Callable[[float, PPoly], Plan]  # how much, and the hump


@dataclass(frozen=True)
class Wish:
    """What is to be done to a plan; `when` and `depth` are shares of what is possible."""

    constraint: str
    near: bool
    when: float
    place_in_gap: float
    depth: float
    lasts_s: float
    vehicle: int
    by_shape: bool
    smooth: int  # derivatives that the hump leaves continuous at its ends


@dataclass(frozen=True)
class Bent:
    """A bent plan, and what the oracle sees of it."""

    plan: Plan
    depth: float  # of the violation, in the unit of the check
    start_s: float
    lasts_s: float


def is_length(name: str) -> bool:
    """Whether a constraint is judged in metres, not as a share of its limit."""
    return name in (*_LENGTHS, "place in formation") or name.startswith("no-fly zone")


def limit_of(plan: Plan, name: str) -> float:
    """The size of a limit, which shares refer to."""
    limits, formation = plan.scenario.limits, plan.scenario.formation
    sizes = {
        "thrust U1": limits.thrust_N[1],
        "rotor speed": 1.0,
        "turning load factor": limits.load_factor_max,
        "acceleration": limits.accel_max_mps2,
        HEADING: formation.course_tolerance_deg,
        "speed in the shape": formation.change_speed_mps,
        "acceleration in the shape": formation.change_accel_mps2,
    }
    for table, names in (
        (limits.speed_ned_mps, ("north speed", "east speed", "vertical speed")),
        (limits.roll_pitch_yaw_deg, ("roll", "pitch", "yaw")),
        (limits.rates_degps, ("roll rate", "pitch rate", "yaw rate")),
        (turning_limits(plan.scenario), ("control U2", "control U3", "control U4")),
    ):
        sizes |= dict(zip(names, table, strict=True))
    found = 1.0 if is_length(name) else sizes[name]
    assert found is not None
    return found


def samples_s(plan: Plan) -> Array:
    """Where a verifier that samples every 0.05 s in each phase looks, and all joints."""
    found = [np.linspace(p.start_s, p.end_s, int(np.ceil((p.end_s - p.start_s) / SAMPLE_S)) + 1) for p in plan.phases]
    return np.union1d(np.concatenate(found), plan.joints_s)


def spans_s(plan: Plan, name: str) -> list[tuple[float, float]]:
    """Where a constraint holds."""
    wanted = {
        CLEARANCE: AIRBORNE,
        HEIGHT: ("takeoff", "landing"),
        PAD: ("takeoff", "landing"),
        "place in formation": AIRBORNE,
        "height": AIRBORNE,
        "north position": ("mission",),
        "east position": ("mission",),
        HEADING: ("mission",),
        "speed in the shape": ("mission",),
        "acceleration in the shape": ("mission",),
    }.get(name)
    return [(p.start_s, p.end_s) for p in plan.phases if wanted is None or p.name in wanted]


def bent(plan: Plan, wish: Wish) -> Bent | None:
    """The plan as wished for, or None where that cannot be had there."""
    gap = _gap(plan, wish)
    if gap is None:
        return None
    low_s, high_s = gap
    at_s = low_s + (0.2 + 0.6 * wish.place_in_gap) * (high_s - low_s)
    name, scale = wish.constraint, limit_of(plan, wish.constraint)
    shares = DEPTH_HEADING if name == HEADING else DEPTH_SHARE
    least, most = DEPTH_M if is_length(name) else (shares[0] * scale, shares[1] * scale)
    depth = least * 1.05 * (0.95 * most / least / 1.05) ** wish.depth
    if wish.near:
        nearer = moved_limit(plan, name, at_s, reserve=0.5 * depth)
        if nearer is None:
            return None
        plan = nearer
    bend = _bend(plan, wish, at_s)
    if bend is None:
        return None
    width_s = 1.5 * wish.lasts_s
    for _ in range(12):
        found = _grown(bend, wish, at_s, width_s, depth)
        if found is None:
            return None
        if found.start_s <= low_s or found.start_s + found.lasts_s >= high_s or found.lasts_s > LASTS_S[1]:
            width_s *= 0.6
        elif found.lasts_s < max(LASTS_S[0], 0.4 * wish.lasts_s) and width_s < _WIDEST_S:
            width_s *= 1.8
        else:
            within = least <= found.depth <= most and found.lasts_s >= LASTS_S[0]
            return found if within else None
    return None


def moved_limit(plan: Plan, name: str, at_s: float, reserve: float) -> Plan | None:
    """The plan in a scenario whose limit leaves it `reserve` where it has least; None where that cannot be."""
    by = min(_least(plan, name), float(Oracle(plan).margin(name, np.array([at_s])).min())) - reserve
    if by <= 0.0:
        return None
    scenario = plan.scenario
    limits: dict[str, Any] = scenario.limits.model_dump()
    tables: dict[str, Any] = {"limits": limits}
    rows = {"north position": "north_m", "east position": "east_m", "height": "height_m", "thrust U1": "thrust_N"}
    vectors = {
        "speed_ned_mps": ("north speed", "east speed", "vertical speed"),
        "roll_pitch_yaw_deg": ("roll", "pitch", "yaw"),
        "rates_degps": ("roll rate", "pitch rate", "yaw rate"),
    }
    single = {"turning load factor": "load_factor_max", "acceleration": "accel_max_mps2"}
    lowest = {CLEARANCE: "clearance_min_m", "separation": "separation_min_m"}
    if name in rows:
        low, high = limits[rows[name]]
        limits[rows[name]] = [low + by, high - by]
    elif name in lowest:
        limits[lowest[name]] += by
    elif name in single:
        limits[single[name]] -= by
    elif name in ("speed in the shape", "acceleration in the shape"):
        key = "change_speed_mps" if name.startswith("speed") else "change_accel_mps2"
        tables = {"formation": {key: getattr(scenario.formation, key) - by}}
    elif name in CONTROL_ROWS:
        bounds = list(turning_limits(scenario))
        bounds[CONTROL_ROWS[name] - 1] -= by
        for key in ("torque", "roll_pitch_moment_Nm"):
            limits.pop(key, None)
        limits |= {"roll_pitch_force_N": bounds[:2], "yaw_moment_Nm": bounds[2]}
    else:
        found = next((key for key, names in vectors.items() if name in names), None)
        if found is None:
            return None
        bounds = list(limits[found])
        bounds[vectors[found].index(name)] -= by
        limits[found] = bounds
    try:
        return replace(plan, scenario=changed(scenario, **tables))
    except ValidationError:
        return None


_LEAST: dict[tuple[str, str], float] = {}
_ORDER: dict[tuple[str, str], Array] = {}


def _least(plan: Plan, name: str) -> float:
    """The least margin of a whole flight, every 10 ms; each is worked out once."""
    if (plan.hash, name) not in _LEAST:
        step_s = 0.05 if name in GROUND else 0.01
        times = np.concatenate([np.arange(a + 1e-6, b - 1e-6, step_s) for a, b in spans_s(plan, name)])
        _LEAST[plan.hash, name] = float(np.min(Oracle(plan).margin(name, times)))
    return _LEAST[plan.hash, name]


def _gap(plan: Plan, wish: Wish) -> tuple[float, float] | None:
    """Two neighbouring samples; with `near`, those around the least margin of the flight."""
    samples = samples_s(plan)
    spans = spans_s(plan, wish.constraint)
    middles = 0.5 * (samples[1:] + samples[:-1])
    fit = np.any([(middles > a) & (middles < b) for a, b in spans], axis=0) & (np.diff(samples) > 0.02)
    fitting = np.flatnonzero(fit)
    if not len(fitting):
        return None
    if wish.near:
        key = (plan.hash, wish.constraint)
        if key not in _ORDER:
            _ORDER[key] = np.argsort(Oracle(plan).margin(wish.constraint, middles[fitting]).min(axis=0))
        order = _ORDER[key]
        gap = fitting[order[int(wish.when * 0.999 * min(10, len(order)))]]
    else:
        gap = fitting[int(wish.when * 0.999 * len(fitting))]
    return float(samples[gap]), float(samples[gap + 1])


def _bend(plan: Plan, wish: Wish, at_s: float) -> Bend | None:
    """What to bend, and which way: the way that takes from the margin."""
    name, oracle, now = wish.constraint, Oracle(plan), np.array([at_s])
    vehicle = wish.vehicle % len(plan.sysids)
    place = name in (*_LENGTHS, "place in formation") or name.startswith("no-fly zone")
    if name in ("separation", "place in formation", "speed in the shape", "acceleration in the shape"):
        if len(plan.sysids) < 2:
            return None
        if name == "place in formation" and wish.by_shape and turns_or_changes(plan):
            return _whole(plan)
        vehicle = next(v for v in (vehicle, vehicle + 1) if v % len(plan.sysids) != plan.leader) % len(plan.sysids)
        toward = oracle.places_ned_m(now)[plan.leader, 0] - oracle.places_ned_m(now)[vehicle, 0]
        return _along(plan, vehicle, toward / np.linalg.norm(toward))
    if place:
        row = int(np.argmin(oracle.margin(name, now)[:, 0]))
        toward = _downhill(plan, name, at_s, row)
        if toward is None:
            return None
        if wish.by_shape:
            return _along(plan, row, toward)
        axis = int(np.argmax(np.abs(toward)))
        return lambda size, top: humps.leader_state(plan, axis, size * float(np.sign(toward[axis])), top)
    if name in STATE_ROWS:
        row = STATE_ROWS[name]
        sign = float(np.sign(plan.states(now)[plan.leader, 0, row])) or 1.0
        unit = np.pi / 180.0 if row >= 6 else 1.0
        return lambda size, top: humps.leader_state(plan, row, sign * unit * size, top)
    if name in CONTROL_ROWS:
        row = CONTROL_ROWS[name]
        low, high = plan.scenario.limits.thrust_N
        value = plan.controls(now)[plan.leader, 0, row] - (0.5 * (low + high) if row == 0 else 0.0)
        sign = float(np.sign(value)) or 1.0
        return lambda size, top: humps.leader_control(plan, row, sign * size, top)
    if name == "rotor speed":
        sign = 1.0 if wish.vehicle % 2 else -1.0
        v, row = plan.scenario.vehicle, 3 if wish.by_shape else 0
        unit = 4.0 * (v.moment_coeff_Nms2 if row else v.thrust_coeff_Ns2) * v.rotor_max_radps**2
        return lambda size, top: humps.leader_control(plan, row, sign * unit * size, top)
    if name == "acceleration":
        return lambda size, top: humps.leader_control(plan, 0, size * plan.quadrotor.mass_kg, top)
    if name == "turning load factor":
        if np.hypot(*plan.states(now)[plan.leader, 0, 3:5]) < 0.5:
            return None
        sign = 1.0 if wish.vehicle % 2 else -1.0
        return lambda size, top: humps.leader_state(plan, 6, sign * size, top)
    if name == HEADING:
        north, east = plan.states(now)[plan.leader, 0, 3:5]
        if np.hypot(north, east) < 1.5:
            return None
        row = 3 if abs(north) < abs(east) else 4
        unit = np.radians(1.0) * float(np.hypot(north, east)) * (1.0 if wish.vehicle % 2 else -1.0)
        return lambda size, top: humps.leader_state(plan, row, unit * size, top)
    raise ValueError(f"nobody has told how to bend {name}")


def _along(plan: Plan, vehicle: int, toward: Array) -> Bend:
    return lambda size, top: humps.offset(plan, vehicle, size * toward, top)


def turns_or_changes(plan: Plan) -> bool:
    """Whether the shape may differ from the scheduled one: by automatic changes, or because it follows the course."""
    formation = plan.scenario.formation
    return formation.frame == "course" or any(change.auto for change in formation.change)


def _whole(plan: Plan) -> Bend:
    """All vehicles at once, as the formation may not move: a turn where it may only shrink, else to another size."""
    start = plan.offsets(np.array([0.0]))[:, 0]
    start = start / np.linalg.norm(start, axis=1).max()
    if any(change.auto and change.kind == "shrink" for change in plan.scenario.formation.change):
        start = start @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    return lambda size, top: humps.offsets(plan, size * start, top)


def _downhill(plan: Plan, name: str, at_s: float, row: int) -> Array | None:
    """The direction (3,), along one axis for the leader, in which a vehicle loses most of a margin of place."""
    now, top = np.array([at_s]), humps.hump(at_s - 1e-3, 2e-3, 2)
    here = Oracle(plan).margin(name, now)[row, 0]
    moved = [humps.offset(plan, row, 1e-3 * axis, top) for axis in np.eye(3)]
    steps = np.array([Oracle(other).margin(name, now)[row, 0] for other in moved]) - here
    size = float(np.linalg.norm(steps))
    return -steps / size if size > 1e-5 else None


def _grown(bend: Bend, wish: Wish, at_s: float, width_s: float, depth: float) -> Bent | None:
    """The hump as large as makes the violation `depth` deep: regula falsi, then a look every 0.1 ms."""
    top = humps.hump(at_s - 0.5 * width_s, width_s, wish.smooth)
    times = np.unique(np.concatenate([[at_s], np.linspace(*top.x, 43)[1:-1]]))

    worst = int(np.argmin(Oracle(bend(0.0, top)).margin(wish.constraint, np.array([at_s]))[:, 0]))
    row = worst if wish.constraint in GROUND else None

    def seen(size: float) -> float:
        return float(np.min(Oracle(bend(size, top)).margin(wish.constraint, times, row))) + depth

    low, at_low = 0.0, seen(0.0)
    if at_low <= 0.0:
        return None
    high, at_high = at_low, seen(at_low)
    for _ in range(25):
        if at_high <= 0.0:
            break
        low, at_low, high = high, at_high, high * 1.7
        at_high = seen(high)
    else:
        return None
    for _ in range(40):
        middle = low + (high - low) * float(np.clip(at_low / (at_low - at_high), 0.05, 0.95))
        at_middle = seen(middle)
        if abs(at_middle) < 0.02 * depth:
            break
        if at_middle > 0.0:
            low, at_low = middle, at_middle
        else:
            high, at_high = middle, at_middle
    plan = bend(middle, top)
    return measured(plan, wish.constraint, float(top.x[0]), float(top.x[-1]))


def measured(plan: Plan, name: str, start_s: float, end_s: float, row: int | None = None) -> Bent | None:
    """What the oracle sees of a violation in a span of time, every 0.1 ms; of one vehicle, or of the worst one."""
    times = window(start_s, end_s)
    if row is None and name in GROUND:
        row = int(np.argmin(Oracle(plan).margin(name, times[:: max(len(times) // 20, 1)]).min(axis=1)))
    margin = Oracle(plan).margin(name, times, row).min(axis=0)
    under = np.flatnonzero(margin < 0.0)
    if not len(under):
        return None
    return Bent(plan, float(-margin.min()), float(times[under[0]]), float(times[under[-1]] - times[under[0]]))
