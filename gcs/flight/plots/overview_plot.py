"""One picture of a scenario or a plan: the map, and over time speed, clearance, separation and distance to zones."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from gcs.flight.plots import map_layers
from gcs.flight.plots.curves import draw_clearance, draw_separation, draw_speeds, draw_zone_margin
from gcs.flight.plots.figure_file import BESIDE, NAMED, Labels, Look, colours, head, head_figure, save, settle
from gcs.flight.plots.flight_map import FlightMap, dart, vehicle_entries
from gcs.flight.plots.shape_view import ShapeView, dot_pt, view_of
from gcs.flight.scene.ground_area import area_of
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.formation.timeline import AUTO
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import NED_FROM_UP, leader_index, offsets_ned_m, sysids
from gcs.types import Array

_STEP_S = 0.5
_ARROW_PT = 34.0
_CURVES_IN = 5.4  # width of the curves
_LEAST_IN = 6.0  # height of them
_BESIDE_IN, _AROUND_IN, _TALLEST_IN = 0.7, 1.05, 3.4  # axis beside a panel; axis and title below and above it
_PANELS = 6  # at most
_ROOM, _LEAST_ROOM_M = 1.16, 2.0
_LARGE_PT = 8.0


def save_overview(scenario: Scenario, plan: Plan | None, path: Path) -> None:
    """Draw a scenario, and its plan if given, in the format of the file's ending. Raises UsageError."""
    save(draw_scenario(scenario) if plan is None else draw_plan(plan), path)


def draw_scenario(scenario: Scenario) -> Figure:
    """Return the map of what is not planned: start and end, and no tracks."""
    start, end = (np.array(b.position_m) * NED_FROM_UP for b in (scenario.start, scenario.end))
    offsets, ids = offsets_ned_m(scenario), sysids(scenario)
    drawn = np.array([point.position_m for point in scenario.route]).reshape(-1, 3) * NED_FROM_UP
    low, high = area = area_of(scenario, np.stack([offsets + place for place in (start, *drawn, end)]))
    width_in, height_in = map_layers.map_size_in(scenario, area)
    figure, axes = plt.subplots(figsize=(width_in, height_in), layout="constrained")
    span_s = (0.0, scenario.time.flight_s)
    map_layers.draw_ground(axes, scenario, area)
    map_layers.draw_zones(axes, scenario, span_s)
    for place, mark, fill in ((start, "^", True), (end, "s", False)):
        for colour, (north, east, _) in zip(colours(ids), offsets + place, strict=True):
            axes.plot(east, north, marker=mark, ms=6, color=colour, mfc=colour if fill else "white", ls="")
    points = map_layers.draw_route(axes, scenario)
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
    look: Look = {"ls": "", "color": "0.3"}
    handles = [
        *vehicle_entries(ids, marker="^", ls=""),
        Line2D([], [], marker="^", label="start", **look),
        Line2D([], [], marker="s", mfc="white", label="end", **look),
        *course[: bool(way.any())],
        *points,
        *map_layers.layer_entries(axes, scenario),
    ]
    axes.legend(handles=handles, **BESIDE)
    head(axes, f"{scenario.name}: not planned", width_in - map_layers.BESIDE_IN)
    settle(figure)
    labels = Labels(figure)
    labels.avoid_points(axes, np.concatenate([offsets + start, offsets + end])[:, 1::-1])
    labels.avoid_arrows(axes)
    map_layers.label_route(axes, labels, scenario)
    labels.place(axes, "start", tuple((offsets + start)[leader_index(scenario), 1::-1].tolist()))
    labels.place(axes, "end", tuple((offsets + end)[leader_index(scenario), 1::-1].tolist()))
    map_layers.label_zones(axes, labels, scenario, span_s)
    return figure


def draw_plan(plan: Plan) -> Figure:
    """Return the map of a plan, its curves, and its shapes where they change."""
    scenario, mission = plan.scenario, plan.phase(PhaseKind.MISSION)
    several, zones = len(plan.sysids) > 1, bool(scenario.no_fly or scenario.keep_in)
    t_s = np.append(np.arange(plan.t_start_s, plan.t_end_s, _STEP_S), np.nextafter(plan.t_end_s, plan.t_start_s))
    states = plan.states(t_s)
    places = states[..., POSITION]
    chart = FlightMap(scenario, plan.sysids, t_s, places)
    width_in, height_in = map_layers.map_size_in(scenario, chart.area)
    sides = (width_in, _CURVES_IN)
    shapes = shapes_of(plan)
    heights = [max(height_in, _LEAST_IN)] + (
        [min(sum(sides) / len(shapes) - _BESIDE_IN + _AROUND_IN, _TALLEST_IN)] if shapes else []
    )
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
    beneath: list[Axes] = []
    if shapes:
        beneath = rows[1].subgridspec(1, len(shapes)).subplots(squeeze=False)[0].tolist()
        draw_shapes(beneath, plan.sysids, shapes, sum(sides) / len(shapes))
    head_figure(figure, f"{scenario.name}: planned")
    settle(figure)
    labels = Labels(figure)
    chart.label(over, labels)
    label_shapes(beneath, plan.sysids, shapes, labels)
    return figure


@dataclass(frozen=True)
class ShownShape:
    """A shape in the plane in which it is the largest: places (V, 2) from its middle, to the right and up, m."""

    name: str
    t_s: float
    right_up_m: Array
    view: ShapeView


def shapes_of(plan: Plan) -> tuple[ShownShape, ...]:
    """Return the shape at the start and after each change, or amid one that undoes itself; none where it is rigid."""
    ends = [("start", 0.0)]
    for move in plan.moves:
        t_s = 0.5 * (move.start_s + move.end_s) if move.trigger == AUTO else min(move.end_s, plan.flight_s)
        ends.append((move.name.replace('"', ""), t_s))
    if len(ends) == 1 or len(plan.sysids) == 1:
        return ()
    ends = sorted(ends, key=lambda end: end[1])
    shown = ends if len(ends) <= _PANELS else [*ends[: _PANELS - 1], ends[-1]]
    return tuple(seen(name, t_s, plan.offsets(np.array([t_s]))[:, 0]) for name, t_s in shown)


def seen(name: str, t_s: float, offsets_ned_m: Array) -> ShownShape:
    """Return a shape (V, 3) in its plane."""
    view = view_of(offsets_ned_m)
    places = view.flat(offsets_ned_m)
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    return ShownShape(name, t_s, places - middle, view)


def draw_shapes(panels: list[Axes], sysids: tuple[int, ...], shapes: tuple[ShownShape, ...], width_in: float) -> None:
    """Draw each shape in its panel; `width_in` is the width of one, for the titles."""
    reach_m = max(_ROOM * max(float(np.abs(shape.right_up_m).max()) for shape in shapes), _LEAST_ROOM_M)
    size_pt = dot_pt(len(sysids), _LARGE_PT)
    for axes, shape in zip(panels, shapes, strict=True):
        for colour, place in zip(colours(sysids), shape.right_up_m, strict=True):
            axes.plot(*place, "o", ms=size_pt, color=colour, zorder=5)
        right, up = shape.view.labels
        axes.set(xlim=(-reach_m, reach_m), ylim=(-reach_m, reach_m), aspect="equal", xlabel=f"{right}, m")
        axes.set_ylabel(f"{up}, m")
        axes.grid(alpha=0.3)
        head(axes, f"{shape.name}\nt = {shape.t_s:.0f} s, {shape.view.words}", width_in, 9.0)


def label_shapes(panels: list[Axes], sysids: tuple[int, ...], shapes: tuple[ShownShape, ...], labels: Labels) -> None:
    """Write the numbers of vehicles where there is room. The layout is settled by then."""
    for axes, shape in zip(panels, shapes, strict=True):
        labels.avoid_points(axes, shape.right_up_m)
        for sysid, (right_m, up_m) in zip(sysids, shape.right_up_m.tolist(), strict=True):
            if len(sysids) <= NAMED:
                labels.place(axes, str(sysid), (right_m, up_m))
