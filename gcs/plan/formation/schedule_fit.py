"""Checks whether scheduled changes fit into the flight, before anything is optimised.

Every value that is proposed was tried: with it, and all else as it is, the changes fit.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from gcs.errors import Infeasible
from gcs.plan.formation.coordinates import budget_of_each
from gcs.plan.formation.time_scaling import least_duration
from gcs.plan.formation.timeline import MadeChange, made_changes, trigger_words
from gcs.scenario.schema.scenario import Scenario

_SLACK_S = 1e-9
_HALVINGS = 40
_FASTEST = 20.0  # times a speed of a change: what would need more does not help
_FEW = 50  # vehicles: larger fleets are not assigned anew to try another spacing


class ScheduleMisfit(Infeasible):
    """Scheduled changes do not fit into the flight; more optimising would not help."""


@dataclass(frozen=True)
class _Late:
    """The first change that does not fit."""

    number: int  # among the scheduled ones
    begin_s: float
    duration_s: float
    ready_s: float  # when the change before it has ended
    over_s: float  # by how much it ends after the flight, or begins before `ready_s`
    overlaps: bool


def check_schedule(scenario: Scenario, end_s: float) -> None:
    """Raises ScheduleMisfit where no flight of this length has room for all scheduled changes.

    A change at a gate is taken to begin as soon as the one before it has ended.
    """
    made = made_changes(scenario)
    late = _first_late(scenario, made, end_s)
    if late is None:
        return
    found = [*_times(scenario, made, late, end_s), *_faster(scenario, made, end_s), *_closer(scenario, end_s)]
    hint = "remove a [[formation.change]], or give the flight more time ([time] flight_s) and begin changes earlier"
    raise ScheduleMisfit.because(
        _what(scenario, made, late, end_s), hint=f"set {', or '.join(found)}" if found else hint
    )


def _first_late(scenario: Scenario, made: tuple[MadeChange, ...], end_s: float) -> _Late | None:
    limit = budget_of_each(scenario)
    now_s = 0.0
    for number, change in enumerate(made):
        duration_s = sum(least_duration(leg, limit)[0] for leg, _ in change.legs)
        given_s = change.change.begin_s(duration_s)
        begin_s = now_s if given_s is None else given_s
        if begin_s < now_s - _SLACK_S:
            return _Late(number, begin_s, duration_s, now_s, now_s - begin_s, overlaps=True)
        if begin_s + duration_s > end_s + _SLACK_S:
            return _Late(number, begin_s, duration_s, now_s, begin_s + duration_s - end_s, overlaps=False)
        now_s = begin_s + duration_s
    return None


def _what(scenario: Scenario, made: tuple[MadeChange, ...], late: _Late, end_s: float) -> str:
    change = made[late.number]
    words = f"the change {change.name} ({trigger_words(change.change)}) "
    if late.overlaps:
        if not late.number:
            return f"{words}takes {late.duration_s:.2f} s and would begin {late.over_s:.2f} s before the flight does"
        before = made[late.number - 1]
        return (
            f"{words}would begin {late.over_s:.2f} s before the change {before.name} has ended, at {late.ready_s:.2f} s"
        )
    begins = "begins at" if change.begins_s is not None else "cannot begin before"
    text = (
        f"{words}{begins} {late.begin_s:.2f} s and takes {late.duration_s:.2f} s, limited by {change.limited_by}: "
        f"it would end {late.over_s:.2f} s after the flight of {end_s:g} s"
    )
    if scenario.formation.frame == "course":
        text += '. With frame = "course", turning with the course takes its part of change_speed_mps'
    return text


def _times(scenario: Scenario, made: tuple[MadeChange, ...], late: _Late, end_s: float) -> Iterator[str]:
    """Another time for the change, or for the flight."""
    change = made[late.number].change
    index = scenario.formation.change.index(change)
    key, given_s = change.timed
    if given_s is not None:
        takes_s = late.duration_s if key == "done_at_s" else 0.0
        earliest_s = math.ceil(100.0 * (late.ready_s + takes_s) - _SLACK_S) / 100.0
        latest_s = math.floor(100.0 * (end_s - late.duration_s + takes_s)) / 100.0
        time_s, more = (earliest_s, "or more") if late.overlaps else (latest_s, "or less")
        moved = replace(made[late.number], change=change.model_copy(update={key: time_s}))
        others = (*made[: late.number], moved, *made[late.number + 1 :])
        if time_s - takes_s >= late.ready_s - _SLACK_S and _first_late(scenario, others, end_s) is None:
            yield f"formation.change[{index}].{key} to {time_s:g} {more}"
    if not late.overlaps and not scenario.time.free:
        longer_s = end_s
        while (miss := _first_late(scenario, made, longer_s)) is not None and not miss.overlaps:
            longer_s = float(math.ceil(longer_s + miss.over_s - _SLACK_S))
        if miss is None:
            yield f"time.flight_s to {longer_s:g} or more"


def _faster(scenario: Scenario, made: tuple[MadeChange, ...], end_s: float) -> Iterator[str]:
    """Faster changes: the first of speed alone, acceleration alone, both, that is enough."""
    formation, limits = scenario.formation, scenario.limits
    fastest_mps = float(np.linalg.norm(limits.speed_ned_mps))
    hardest_mps2 = math.inf if limits.accel_max_mps2 is None else limits.accel_max_mps2

    def update(speed: int, accel: int) -> Callable[[float], dict[str, float]]:
        def of(factor: float) -> dict[str, float]:
            found = {}
            if speed:
                found["change_speed_mps"] = min(_up(formation.change_speed_mps * factor), fastest_mps)
            if accel:
                found["change_accel_mps2"] = min(_up(formation.change_accel_mps2 * factor**accel), hardest_mps2)
            return found

        return of

    for keys in (update(1, 0), update(0, 1), update(1, 2)):

        def fits(factor: float, keys: Callable[[float], dict[str, float]] = keys) -> bool:
            faster = formation.model_copy(update=keys(factor))
            return _first_late(scenario.model_copy(update={"formation": faster}), made, end_s) is None

        if (factor := _least(fits, 1.0, _FASTEST)) is not None:
            yield " and ".join(f"formation.{key} to {value:g}" for key, value in keys(factor).items()) + " or more"
            return
    rates = np.array(limits.rates_degps)

    def turning(factor: float) -> Scenario:
        quick = (_up(rates[0] * factor), _up(rates[1] * factor), limits.rates_degps[2])
        return scenario.model_copy(update={"limits": limits.model_copy(update={"rates_degps": quick})})

    least = _least(lambda factor: _first_late(turning(factor), made, end_s) is None, 1.0, _FASTEST)
    if least is not None:
        roll, pitch, _ = turning(least).limits.rates_degps
        yield f"limits.rates_degps to {roll:g} for roll and {pitch:g} for pitch or more"


def _closer(scenario: Scenario, end_s: float) -> Iterator[str]:
    """Shapes of less spacing: their vehicles have less far to fly."""
    shapes = scenario.formation.shape
    if not shapes or len(scenario.formation.sysids) > _FEW:
        return

    def shrunk(factor: float) -> Scenario:
        smaller = tuple(
            shape.model_copy(update={"spacing_m": _down(shape.spacing_m * factor)})
            if shape.spacing_m is not None
            else shape.model_copy(
                update={"offsets_m": tuple(tuple(part * factor for part in place) for place in shape.offsets_m)}
            )
            for shape in shapes
        )
        return scenario.model_copy(update={"formation": scenario.formation.model_copy(update={"shape": smaller})})

    def fits(divisor: float) -> bool:
        tried = shrunk(1.0 / divisor)
        try:
            made = made_changes(tried)
        except Infeasible:
            return False
        gaps_are_kept = all(change.least_gap_m >= scenario.limits.separation_min_m for change in made)
        return gaps_are_kept and _first_late(tried, made, end_s) is None

    # Too close is wrong as well as too far: candidates are few, and the largest spacing that fits is the answer.
    divisor = next((1.0 + 0.05 * step for step in range(1, 41) if fits(1.0 + 0.05 * step)), None)
    if divisor is None:
        return
    remedies = []
    for index, (shape, smaller) in enumerate(zip(shapes, shrunk(1.0 / divisor).formation.shape, strict=True)):
        if shape.spacing_m is not None:
            remedies.append(f"formation.shape[{index}].spacing_m to {smaller.spacing_m:g}")
        else:
            remedies.append(f"formation.shape[{index}].offsets_m to {1.0 / divisor:.2f} of what they are")
    yield " and ".join(remedies)


def _least(fits: Callable[[float], bool], low: float, high: float) -> float | None:
    """About the least factor that fits, or None where the largest does not."""
    if not fits(high):
        return None
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if fits(middle) else (middle, high)
        if high - low < 1e-3 * low:
            break
    return high


def _up(value: float) -> float:
    """Rounded up to two digits."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return round(math.ceil(value / step - 1e-9) * step, 9)


def _down(value: float) -> float:
    """Rounded down to a tenth."""
    return math.floor(10.0 * value + 1e-9) / 10.0
