"""Drawn lines that zones or ground are in the way of: default limits give way, those of the scenario do not."""

from dataclasses import replace

import numpy as np

from gcs.errors import Infeasible
from gcs.physics.states import POSITION
from gcs.plan.ocp.active_vehicles import offsets_at
from gcs.plan.ocp.margins import Margin, box, clearance, height, no_fly
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.leg_lines import LegLine
from gcs.plan.trajectory.trajectory import Trajectory

_EVERY_M = 1.0
_SHARE = 0.5  # of a limit: so far beside the line, or above it, the optimiser can be expected to pass


def open_where_blocked(problem: Problem, guess: Trajectory) -> Problem:
    """The problem with free legs where a vehicle cannot follow the line. Its shape there is that of the guess.

    Raises Infeasible where the scenario itself gives the limit, and names the leg.
    """
    lines = tuple(_opened(problem, line, leg, guess) for leg, line in enumerate(problem.lines))
    return replace(problem, lines=lines)


def _opened(problem: Problem, line: LegLine, leg: int, guess: Trajectory) -> LegLine:
    if line.limits.is_free:
        return line
    if line.is_too_rough:
        raise Infeasible.because(
            f"{problem.leg_words(leg)}: the ground below varies by {line.envelope_gap_m:.1f} m within metres, too much "
            f"to be followed within {line.limits.height_m:g} m",
            hint="give the leg a larger height_tolerance_m, or its points heights that do not follow the ground",
        )
    start_s, end_s = problem.legs_s[leg]
    count = max(int(np.linalg.norm(line.to_ned_m - line.from_ned_m) / _EVERY_M), 1) + 1
    times, share = np.linspace(start_s, end_s, count), np.linspace(0.0, 1.0, count)
    states = guess.state(times)
    states[:, POSITION] = line.places(share)
    places = states[:, POSITION] + offsets_at(problem, problem.shape.offsets(times), states)
    scenario, limits = problem.scenario, line.limits
    beside = [*no_fly(scenario, places, times), *(box(scenario, places) if problem.has_box else [])]
    above = [clearance(scenario, places), height(scenario, places)]
    blocked = [
        _first_below(margins, -_SHARE * m) for margins, m in ((beside, limits.corridor_m), (above, limits.height_m))
    ]
    for hit, set_by_scenario in zip(blocked, line.set_by_scenario, strict=True):
        if hit is not None and set_by_scenario:
            raise Infeasible.because(
                f"{problem.leg_words(leg)}: on the drawn line {hit.name} is missed by {-hit.value.min():.1f} m, more "
                "than the leg's limits give way",
                hint='move a point of [[route]], or give the leg a larger corridor_m, height_tolerance_m, or "free"',
            )
    return line.opened(beside=blocked[0] is not None, above=blocked[1] is not None)


def _first_below(margins: list[Margin], least_m: float) -> Margin | None:
    return next((margin for margin in margins if margin.value.min() < least_m), None)
