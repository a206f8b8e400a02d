"""One picture of a scenario or a plan: map, and the plan's clearance and separation over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt

from gcs.flight.assessment.flight_plot import draw_map_on, save
from gcs.physics.quadrotor import POSITION, Array
from gcs.plan.formation.separation import least_gap
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.si import NED_FROM_UP, offsets_ned_m, sysids

_STEP_S = 0.5


def save_overview(scenario: Scenario, plan: Plan | None, path: Path) -> None:
    """Draw a scenario, and its plan if given, in the format of the file's ending. Raises UsageError."""
    figure = _of_scenario(scenario) if plan is None else _of_plan(plan)
    save(figure, path)


def _of_scenario(scenario: Scenario) -> Any:
    """Without a plan, straight lines from start to end stand for the tracks."""
    figure, axes = plt.subplots(figsize=(7.2, 6.6), layout="constrained")
    ends = np.stack([np.array(b.position_m) * NED_FROM_UP for b in (scenario.start, scenario.end)])
    draw_map_on(axes, scenario, sysids(scenario), offsets_ned_m(scenario)[:, None] + ends, style=":")
    return figure


def _of_plan(plan: Plan) -> Any:
    scenario, mission = plan.scenario, plan.phase("mission")
    figure, (over, below, beside) = plt.subplots(
        3, 1, figsize=(7.2, 9.6), height_ratios=(3, 1, 1), layout="constrained"
    )
    t_s = np.arange(plan.t_start_s, plan.t_end_s, _STEP_S)
    places = plan.states(t_s)[..., POSITION]
    draw_map_on(over, scenario, plan.sysids, places)
    below.plot(t_s, (-places[..., 2] - _ground_m(scenario, places)).min(axis=0))
    below.axhline(scenario.limits.clearance_min_m, color="red", lw=0.8, label="required in flight")
    below.set(ylabel="least clearance\nabove ground, m")
    if len(plan.sysids) > 1:
        beside.plot(t_s, [least_gap(places[:, i])[0] for i in range(len(t_s))])
        beside.axhline(scenario.limits.separation_min_m, color="red", lw=0.8, label="required")
    beside.set(ylabel="least\nseparation, m", xlabel="plan time, s")
    for axes in (below, beside):
        axes.axvspan(mission.start_s, mission.end_s, color="grey", alpha=0.12, label="mission")
        axes.set(xlim=(t_s[0], t_s[-1]), ylim=(0.0, None))
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    return figure


def _ground_m(scenario: Scenario, places_ned_m: Array) -> Array:
    return ground_height_m(scenario.terrain, places_ned_m[..., 0], places_ned_m[..., 1])
