"""One picture of a scenario or a plan: the map, and over time speed, clearance, separation and distance to zones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.lines import Line2D

from gcs.flight.assessment.pictures.curves import draw_clearance, draw_separation, draw_speeds, draw_zone_margin
from gcs.flight.assessment.pictures.figure_file import BESIDE, colours, head, head_figure, save, settle
from gcs.flight.assessment.pictures.flight_map import FlightMap, dart, vehicle_entries
from gcs.flight.assessment.pictures.label_places import Labels
from gcs.flight.assessment.pictures.map_layers import (
    BESIDE_IN,
    area_of,
    draw_ground,
    draw_route,
    draw_zones,
    label_route,
    label_zones,
    layer_entries,
    map_size_in,
)
from gcs.flight.assessment.pictures.shape_panels import draw_shapes, label_shapes, row_height_in, shapes_of
from gcs.physics.quadrotor import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.si import NED_FROM_UP, leader_index, offsets_ned_m, sysids

_STEP_S = 0.5
_ARROW_PT = 34.0
_CURVES_IN = 5.4  # width of the curves
_LEAST_IN = 6.0  # height of them


def save_overview(scenario: Scenario, plan: Plan | None, path: Path) -> None:
    """Draw a scenario, and its plan if given, in the format of the file's ending. Raises UsageError."""
    save(draw_scenario(scenario) if plan is None else draw_plan(plan), path)


def draw_scenario(scenario: Scenario) -> Any:
    """Return the map of what is not planned: start and end, and no tracks."""
    start, end = (np.array(b.position_m) * NED_FROM_UP for b in (scenario.start, scenario.end))
    offsets, ids = offsets_ned_m(scenario), sysids(scenario)
    drawn = np.array([point.position_m for point in scenario.route]).reshape(-1, 3) * NED_FROM_UP
    low, high = area = area_of(scenario, np.stack([offsets + place for place in (start, *drawn, end)]))
    width_in, height_in = map_size_in(scenario, area)
    figure, axes = plt.subplots(figsize=(width_in, height_in), layout="constrained")
    span_s = (0.0, scenario.time.flight_s)
    draw_ground(axes, scenario, area)
    draw_zones(axes, scenario, span_s)
    for place, mark, fill in ((start, "^", True), (end, "s", False)):
        for colour, (north, east, _) in zip(colours(ids), offsets + place, strict=True):
            axes.plot(east, north, marker=mark, ms=6, color=colour, mfc=colour if fill else "white", ls="")
    points = draw_route(axes, scenario)
    way = ((end if not len(drawn) else drawn[0]) - start)[1::-1]
    course = [
        Line2D([], [], marker=dart(float(np.degrees(np.arctan2(*way)))), label="course", ls="", color="black", ms=9)
    ]
    if way.any():
        tip = _ARROW_PT * way / float(np.linalg.norm(way))
        arrow = {"arrowstyle": "<|-", "color": "black", "lw": 1.2, "shrinkB": 6.0}
        at = (offsets + start)[leader_index(scenario), 1::-1]
        axes.annotate("", at, xytext=tuple(tip), textcoords="offset points", arrowprops=arrow)
    axes.set(xlabel="east, m", ylabel="north, m", aspect="equal", xlim=(low[1], high[1]), ylim=(low[0], high[0]))
    look: dict[str, Any] = {"ls": "", "color": "0.3"}
    handles = [
        *vehicle_entries(ids, marker="^", ls=""),
        Line2D([], [], marker="^", label="start", **look),
        Line2D([], [], marker="s", mfc="white", label="end", **look),
        *course[: bool(way.any())],
        *points,
        *layer_entries(axes, scenario),
    ]
    axes.legend(handles=handles, **BESIDE)
    head(axes, f"{scenario.name}: not planned", width_in - BESIDE_IN)
    settle(figure)
    labels = Labels(figure)
    labels.avoid_points(axes, np.concatenate([offsets + start, offsets + end])[:, 1::-1])
    labels.avoid_arrows(axes)
    label_route(axes, labels, scenario)
    labels.place(axes, "start", tuple((offsets + start)[leader_index(scenario), 1::-1].tolist()))
    labels.place(axes, "end", tuple((offsets + end)[leader_index(scenario), 1::-1].tolist()))
    label_zones(axes, labels, scenario, span_s)
    return figure


def draw_plan(plan: Plan) -> Any:
    """Return the map of a plan, its curves, and its shapes where they change."""
    scenario, mission = plan.scenario, plan.phase("mission")
    several, zones = len(plan.sysids) > 1, bool(scenario.no_fly or scenario.keep_in)
    t_s = np.append(np.arange(plan.t_start_s, plan.t_end_s, _STEP_S), np.nextafter(plan.t_end_s, plan.t_start_s))
    states = plan.states(t_s)
    places = states[..., POSITION]
    chart = FlightMap(scenario, plan.sysids, t_s, places)
    width_in, height_in = map_size_in(scenario, chart.area)
    sides = (width_in, _CURVES_IN)
    shapes = shapes_of(plan)
    heights = [max(height_in, _LEAST_IN)] + ([row_height_in(shapes, sum(sides))] if shapes else [])
    figure = plt.figure(figsize=(sum(sides), sum(heights)), layout="constrained")
    rows = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    grid = rows[0].subgridspec(1, 2, width_ratios=sides)
    over = figure.add_subplot(grid[0])
    panels: Any = grid[1].subgridspec(2 + several + zones, 1).subplots(sharex=True)
    chart.draw(over)
    left = iter(panels)
    draw_speeds(next(left), plan.sysids, t_s, states[..., VELOCITY], None)
    draw_clearance(next(left), scenario, t_s, places)
    if several:
        draw_separation(next(left), t_s, places, None, scenario.limits.separation_min_m)
    if zones:
        draw_zone_margin(next(left), scenario, t_s, places, None)
    for axes in panels:
        axes.axvspan(mission.start_s, mission.end_s, color="grey", alpha=0.12)
        axes.set(xlim=(t_s[0], t_s[-1]))
        axes.grid(alpha=0.3)
    panels[-1].set_xlabel("plan time, s (shaded: the mission)")
    beneath: Any = []
    if shapes:
        beneath = rows[1].subgridspec(1, len(shapes)).subplots(squeeze=False)[0]
        draw_shapes(beneath, plan.sysids, shapes, sum(sides) / len(shapes))
    head_figure(figure, f"{scenario.name}: planned")
    settle(figure)
    labels = Labels(figure)
    chart.label(over, labels)
    label_shapes(beneath, plan.sysids, shapes, labels)
    return figure
