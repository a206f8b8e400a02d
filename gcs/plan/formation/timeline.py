"""The timeline: a scenario's scheduled changes one after another, and the shape at every instant of the flight.

Changes must neither overlap nor violate the separation. The instants at which gates are crossed are an input.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from gcs.errors import Infeasible
from gcs.plan.formation.coordinates import budget_of_each
from gcs.plan.formation.reshape import SLACK_M, reshape
from gcs.plan.formation.separation import least_gap
from gcs.plan.formation.shape import Shape, joined, rigid, stretched
from gcs.plan.formation.time_scaling import NOTHING, least_duration
from gcs.plan.formation.transforms import (
    paper_reshape_time_s,
    paper_rotation_time_s,
    paper_shrink_time_s,
    rotated,
    rotation,
    shrinking,
)
from gcs.scenario.schema.scenario import ChangeTable, Scenario
from gcs.scenario.values.si import NED_FROM_UP, leader_index, offsets_ned_m, shape_offsets_ned_m, sysids
from gcs.types import Array

AUTO = "auto"  # the trigger of a change that the optimiser chose; others are words of `trigger_words`
_SLACK_S = 1e-9
_KEYS = "change_speed_mps or change_accel_mps2"
_DOWN = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Move:
    """One planned change of shape: when, what limits its duration, and the least distance of two vehicles in it."""

    kind: str
    name: str
    trigger: str
    start_s: float
    end_s: float
    paper_time_s: float  # Eqs. 8, 12, 14: a lower bound
    limited_by: str
    way: str
    least_gap_m: float  # between any two vehicles, from start to end


@dataclass(frozen=True)
class Timeline:
    """The shape over the flight, and its moves."""

    shape: Shape
    moves: tuple[Move, ...]


@dataclass(frozen=True)
class MadeChange:
    """One change without its start time: from one rigid shape to the next."""

    change: ChangeTable
    before_ned_m: Array  # (V, 3)
    after_ned_m: Array  # (V, 3)
    legs: tuple[tuple[Shape, float], ...]  # on [0, 1], and the seconds each takes
    limited_by: str
    name: str
    paper_time_s: float
    way: str
    least_gap_m: float

    @property
    def duration_s(self) -> float:
        """How long it takes within its budget."""
        return sum(seconds for _, seconds in self.legs)

    @property
    def begins_s(self) -> float | None:
        """When it begins, where the scenario gives its time."""
        return self.change.begin_s(self.duration_s)


def scheduled(scenario: Scenario) -> tuple[ChangeTable, ...]:
    """The changes that begin at a time or a gate, in order."""
    return tuple(change for change in scenario.formation.change if not change.auto)


def starts_at_points(scenario: Scenario, point_s: tuple[float, ...]) -> tuple[float, ...] | None:
    """When each scheduled change begins, by the leader's times at the points of the route; None with gates.

    None too where no change begins at a point.
    """
    changes = scheduled(scenario)
    if all(change.at_point is None for change in changes) or any(change.gate_m is not None for change in changes):
        return None
    return tuple(
        made.begins_s or 0.0 if made.change.at_point is None else point_s[made.change.at_point - 1]
        for made in made_changes(scenario)
    )


def stops_ned_m(scenario: Scenario) -> tuple[Array, ...]:
    """The rigid shapes (V, 3) of the schedule: the first, and the result of each change. Raises as `lay`."""
    return (offsets_ned_m(scenario), *(made.after_ned_m for made in made_changes(scenario)))


def in_turn(scenario: Scenario, starts_s: tuple[float, ...], end_s: float) -> tuple[float, ...]:
    """Start times nearest to `starts_s` at which changes at gates and points neither overlap nor outlast the flight.

    For estimated times; times given by `at_s` and `done_at_s` stay.
    """
    made = made_changes(scenario)
    starts = list(starts_s)
    for i in reversed(range(len(starts))):
        if made[i].begins_s is None:
            next_s = starts[i + 1] if i + 1 < len(starts) else end_s
            starts[i] = min(starts[i], next_s - made[i].duration_s)
    for i in range(len(starts)):
        if made[i].begins_s is None:
            ready_s = starts[i - 1] + made[i - 1].duration_s if i > 0 else 0.0
            starts[i] = max(starts[i], ready_s)
    return tuple(starts)


def lay(scenario: Scenario, starts_s: tuple[float, ...], start_s: float, end_s: float) -> Timeline:
    """The timeline from start to end of the flight, every scheduled change beginning at its time in `starts_s`.

    Raises `Infeasible` for a change that begins before the previous one has ended, ends after the flight, or violates
    the separation (naming two vehicles).
    """
    offsets = offsets_ned_m(scenario)
    parts: list[Shape] = []
    moves: list[Move] = []
    now_s = start_s
    for made, wanted_s in zip(made_changes(scenario), starts_s, strict=True):
        begin_s = _begin(made, wanted_s, now_s, moves[-1].name if moves else "")
        if (over_s := begin_s + made.duration_s - end_s) > _SLACK_S:
            latest_s = math.floor(100.0 * (end_s - made.duration_s)) / 100.0
            raise Infeasible(
                f'the change "{made.name}" ({trigger_words(made.change)}) begins at {begin_s:.2f} s and takes '
                f"{made.duration_s:.2f} s: it would end {over_s:.2f} s after the flight does",
                hint=f"start it at {latest_s:.2f} s or earlier, or increase [time] flight_s, or {_KEYS}",
            )
        if begin_s > now_s:
            parts.append(rigid(made.before_ned_m, now_s, begin_s))
        now_s = begin_s
        for leg, seconds in made.legs:
            finish_s = now_s + seconds
            # Equal to the flight's end to the last bit: the next phase begins there.
            parts.append(stretched(leg, now_s, end_s if abs(finish_s - end_s) <= _SLACK_S else finish_s))
            now_s = parts[-1].end_s
        offsets = made.after_ned_m
        moves.append(
            Move(
                kind=made.change.kind,
                name=made.name,
                trigger=trigger_words(made.change),
                start_s=begin_s,
                end_s=now_s,
                paper_time_s=made.paper_time_s,
                limited_by=made.limited_by,
                way=made.way,
                least_gap_m=made.least_gap_m,
            )
        )
    if now_s < end_s:
        parts.append(rigid(offsets, now_s, end_s))
    return Timeline(joined(parts), tuple(moves))


def gate_crossing_s(gate_m: tuple[tuple[float, float], ...], times_s: Array, positions_ned_m: Array) -> float | None:
    """The instant at which a track (N, 3) at times (N,) first crosses a gate (two points north, east), or None.

    The track is straight between instants; its ends and the gate's ends count.
    """
    a, b = np.array(gate_m)
    along = b - a
    seen = positions_ned_m[:, :2] - a
    across = along[0] * seen[:, 1] - along[1] * seen[:, 0]
    before, after = across[:-1], across[1:]
    crossing = (before * after <= 0.0) & ((before != 0.0) | (after != 0.0))
    share = np.divide(before, before - after, out=np.zeros_like(before), where=crossing)
    places = seen[:-1] + share[:, None] * np.diff(seen, axis=0)
    where = places @ along / (along @ along)
    hits = np.flatnonzero(crossing & (where >= 0.0) & (where <= 1.0))
    if len(hits) == 0:
        return None
    first = hits[0]
    return float(times_s[first] + share[first] * (times_s[first + 1] - times_s[first]))


@lru_cache(maxsize=8)  # the planner iterates over gate times; the changes themselves stay
def made_changes(scenario: Scenario) -> tuple[MadeChange, ...]:
    """The scheduled changes, one after another, without their start times. Raises as `lay` where one is impossible."""
    offsets = offsets_ned_m(scenario)
    found: list[MadeChange] = []
    for change in scheduled(scenario):
        made = {"rotate": _rotated, "shrink": _shrunk, "reshape": _reshaped}[change.kind](scenario, change, offsets)
        found.append(made)
        offsets = made.after_ned_m
    return tuple(found)


def _rotated(scenario: Scenario, change: ChangeTable, offsets: Array) -> MadeChange:
    assert change.angle_deg is not None
    angle_rad = math.radians(change.angle_deg)
    # NEU and NED name the same axis; a right-handed rotation about it is the same.
    axis = _DOWN if change.axis is None else np.array(change.axis) * NED_FROM_UP
    about = "" if change.axis is None else " about ({:g}, {:g}, {:g})".format(*change.axis)
    return _made(
        scenario,
        change,
        (rotation(offsets, axis, angle_rad),),
        (offsets, rotated(offsets, axis, angle_rad)),
        name=f"rotate {change.angle_deg:g} deg{about}",
        paper_time_s=paper_rotation_time_s(offsets, axis, angle_rad, scenario.formation.change_speed_mps),
        way="as one rigid body",
        least_gap_m=least_gap(offsets)[0],
    )


def _shrunk(scenario: Scenario, change: ChangeTable, offsets: Array) -> MadeChange:
    assert change.scale is not None
    name = f"shrink to {change.scale:g}" if change.scale <= 1.0 else f"grow to {change.scale:g}"
    gap_m, i, j = least_gap(offsets)
    least_m = scenario.limits.separation_min_m
    if gap_m * change.scale < least_m - SLACK_M:
        ids = sysids(scenario)
        smallest = math.ceil(1000.0 * least_m / gap_m) / 1000.0
        raise Infeasible(
            f"{name}: vehicles {ids[i]} and {ids[j]} would be {gap_m * change.scale:.2f} m apart; "
            f"separation_min_m is {least_m:g} m",
            hint=f"set scale to {smallest:g} or more, or start with a larger spacing",
        )
    return _made(
        scenario,
        change,
        (shrinking(offsets, change.scale),),
        (offsets, change.scale * offsets),
        name=name,
        paper_time_s=paper_shrink_time_s(offsets, change.scale, scenario.formation.change_speed_mps),
        way="in proportion",
        least_gap_m=gap_m * min(1.0, change.scale),
    )


def _reshaped(scenario: Scenario, change: ChangeTable, offsets: Array) -> MadeChange:
    assert change.to is not None
    name = f'reshape to "{change.to}"'
    try:
        made = reshape(
            offsets,
            shape_offsets_ned_m(scenario, change.to),
            leader_index(scenario),
            scenario.limits.separation_min_m,
            fixed=change.assignment == "fixed",
            sysids=sysids(scenario),
        )
    except Infeasible as error:
        raise Infeasible(f"{name}: {error.message}", hint=error.hint) from error
    after = made.offsets_after_ned_m
    return _made(
        scenario,
        change,
        made.legs,
        (offsets, after),
        name=name,
        paper_time_s=paper_reshape_time_s(offsets, after, scenario.formation.change_speed_mps),
        way=made.way,
        least_gap_m=made.least_distance_m,
    )


def _made(
    scenario: Scenario, change: ChangeTable, legs: tuple[Shape, ...], ends_ned_m: tuple[Array, Array], **found: Any
) -> MadeChange:
    """The change with the shortest durations of its legs, without those of no length; what limits the longest."""
    limit = budget_of_each(scenario)
    durations = [least_duration(leg, limit) for leg in legs]
    _, limited_by = max(durations, default=(0.0, NOTHING))
    timed = tuple((leg, seconds) for leg, (seconds, _) in zip(legs, durations, strict=True) if seconds > 0.0)
    return MadeChange(change, *ends_ned_m, timed, limited_by, **found)


def trigger_words(change: ChangeTable) -> str:
    """When a scheduled change begins, in words."""
    if change.gate_m is not None:
        (n1, e1), (n2, e2) = change.gate_m
        return f"gate ({n1:g}, {e1:g})-({n2:g}, {e2:g})"
    if change.at_point is not None:
        return f"at point {change.at_point}"
    return f"at {change.at_s:g} s" if change.done_at_s is None else f"complete at {change.done_at_s:g} s"


def _begin(made: MadeChange, wanted_s: float, now_s: float, before: str) -> float:
    """The start of the change; raises Infeasible where the previous change has not ended."""
    if wanted_s >= now_s - _SLACK_S:
        return max(wanted_s, now_s)
    earliest_s = math.ceil(100.0 * now_s - _SLACK_S) / 100.0
    then = f'"{before}" has ended' if before else "the flight"
    raise Infeasible(
        f'the change "{made.name}" ({trigger_words(made.change)}) would begin at {wanted_s:.2f} s, '
        f"{now_s - wanted_s:.2f} s before {then}",
        hint=f"start it at {earliest_s:.2f} s or later; a larger {_KEYS} makes changes shorter",
    )
