"""Centres a drawn route between two no-fly zones: the optimum first, then room beside the nearer zone at a small cost.

The shortest way through a gate touches the zone on the inner side of the turn, however much room is left beyond. The
flight is solved once more, from the optimum, with that zone wider by half of the difference.
"""

from collections.abc import Callable
from dataclasses import replace

from gcs.errors import PlanningError
from gcs.plan.nlp.mesh_refinement import Optimum, with_end, with_times
from gcs.plan.ocp.problem import Problem
from gcs.plan.search.shape_schedule import optimise_on_schedule
from gcs.plan.trajectory.gates import OneSidedGate, one_sided_gates
from gcs.plan.trajectory.plan import MeshRound
from gcs.scenario.environment.no_fly import widened

DEFAULT_PERCENT = 0.1  # of the optimum that room may cost, where the scenario gives no gate_cost_percent
_ROUNDED = 0.98  # of what the cost allows: solutions are exact to less than that
_WORTH = 40  # iterations by default: from the optimum, solves that cost next to nothing take 5 to 20


def centred(problem: Problem, best: Optimum, on_round: Callable[[MeshRound], None]) -> Optimum:
    """The flight with room on both sides in the gates of its route, where that is worth its cost; else `best`."""
    gates = one_sided_gates(problem.scenario, best.trajectory, best.shape, best.lines, best.point_s)
    if not gates or best.last is None:
        return best
    asked = problem.scenario.objective.gate_cost_percent
    percent, worth = (DEFAULT_PERCENT, _WORTH) if asked is None else (asked, None)
    most, share = best.objective + 0.01 * percent * abs(best.objective), 1.0
    while share > 0.0:
        try:
            found = _aside(problem, best, gates, share, on_round, worth)
        except PlanningError:
            return best
        if found.objective <= most:
            return replace(found, history=(*best.history, *found.history))
        # Near an optimum the cost is convex: a share of the way costs no more than that share of its price.
        allowed = (most - best.objective) / (found.objective - best.objective)
        share = _ROUNDED * allowed if share == 1.0 else 0.0
    return best


def _aside(
    problem: Problem,
    best: Optimum,
    gates: list[OneSidedGate],
    share: float,
    on_round: Callable[[MeshRound], None],
    worth: int | None,
) -> Optimum:
    """The best flight near the optimum, farther from the zones that it touches."""
    zones = list(problem.scenario.no_fly)
    for gate in gates:
        zones[gate.zone] = widened(problem.scenario.no_fly[gate.zone], share * gate.aside_m)
    scenario = problem.scenario.model_copy(update={"no_fly": tuple(zones)})
    end_s, time = best.trajectory.end_s, problem.free_time
    same = replace(problem, scenario=scenario, lines=best.lines)
    if time is not None:
        same = replace(with_end(same, end_s), free_time=replace(time, earliest_s=end_s, latest_s=end_s))
    same = with_times(same, end_s, best.point_s)
    return optimise_on_schedule(same, best.trajectory, on_round, warm=best.last, most=worth)
