"""One picture of a recorded flight: map, heights, speeds, separation and deviation, flown and planned."""

import textwrap
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gcs.flight.monitoring.progress import Event
from gcs.flight.plots.curves import draw_separation, draw_speeds, draw_zone_margin
from gcs.flight.plots.figure_file import Labels, colours, head_figure, save, settle
from gcs.flight.plots.flight_map import PLANNED, FlightMap
from gcs.flight.plots.map_layers import map_size_in
from gcs.flight.recording.recording import Recording
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.values.navigation_error import judged_separation_m
from gcs.types import Array

_INSTANTS = 1500  # at most
_STEP_S = 0.1
_LISTED = 18  # events in the list at most
_ONE_COLUMN = 6  # events at most with long lines
_LINE_IN = 0.17  # inches of such a line
_WIDTH = 190  # characters of it
_CURVES_IN, _PANEL_IN = 5.6, 1.5  # width of the curves, least height of each
_TOGETHER = 0.08  # of the time axis: closer events share a mark
_FAR_M = 5.0  # a vehicle further off has left the plan


def save_picture(recording: Recording, from_s: float, to_s: float, path: Path) -> None:
    """Draw a section of a flight, in the format of the file's ending. Raises UsageError."""
    save(draw_recording(recording, from_s, to_s), path)


def draw_recording(recording: Recording, from_s: float, to_s: float) -> Figure:
    """Return the map of a section of a flight, its curves and its events."""
    t_s = np.linspace(from_s, to_s, int(np.clip((to_s - from_s) / _STEP_S, 2, _INSTANTS)))
    places, rates = recording.at(t_s)
    planned = recording.planned(t_s)
    first: dict[tuple[int, str], Event] = {}  # what a vehicle repeats is marked once
    for event in recording.events:
        if from_s <= event.t_s <= to_s:
            first.setdefault((event.sysid, event.what), event)
    events = list(first.values())
    lines = _listed(events)
    scenario = recording.plan.scenario if recording.plan is not None else None
    flown, rates_planned = planned if planned is not None else (None, None)
    chart = FlightMap(scenario, recording.sysids, t_s, places, flown, ("begin", "end"))
    width_in, height_in = map_size_in(scenario, chart.area)
    several, zones = len(recording.tracks) > 1, scenario is not None and bool(scenario.no_fly or scenario.keep_in)
    count = 2 + several + zones + bool(planned)
    heights: tuple[float, ...] = (max(height_in, _PANEL_IN * count), _LINE_IN * lines.count("\n") + 2 * _LINE_IN)
    heights = heights[: 1 + bool(events)]
    sides = (width_in, _CURVES_IN)
    figure = plt.figure(figsize=(sum(sides), sum(heights)), layout="constrained")
    grid = figure.add_gridspec(len(heights), 2, width_ratios=sides, height_ratios=heights)
    panels: list[Axes] = list(grid[0, 1].subgridspec(count, 1).subplots(sharex=True, squeeze=False)[:, 0])
    above = figure.add_subplot(grid[0, 0])
    chart.draw(above)
    left = iter(panels)
    _heights(next(left), recording, t_s, places, planned)
    draw_speeds(next(left), recording.sysids, t_s, rates, rates_planned)
    if several:
        required_m = judged_separation_m(scenario) if scenario is not None else None
        draw_separation(next(left), t_s, places, flown, required_m)
    if zones and scenario is not None:
        draw_zone_margin(next(left), scenario, t_s, places, flown)
    if flown is not None:
        _errors(next(left), recording, t_s, places - flown)
    for axes in panels:
        axes.grid(alpha=0.3)
        axes.tick_params(labelbottom=axes is panels[-1])
    _mark(panels, events, to_s - from_s)
    if events:
        below = figure.add_subplot(grid[1, :])
        below.axis("off")
        below.text(0.0, 1.0, lines, transform=below.transAxes, va="top", fontsize=7, family="monospace")
    panels[-1].set(xlim=(from_s, to_s), xlabel="plan time, s" if recording.plan else "time since the log began, s")
    head_figure(figure, f"{recording.name}: flown (coloured){' and planned (grey)' if planned else ''}")
    settle(figure)
    labels = Labels(figure)
    seen: set[int] = set()
    for number, event in enumerate(events, start=1):
        if event.sysid in seen or event.sysid not in recording.sysids:
            continue
        place = recording.tracks[recording.sysids.index(event.sysid)].at(np.array([event.t_s]))[0][0]
        if np.isfinite(place).all():
            seen.add(event.sysid)
            above.plot(place[1], place[0], "x", color="black", ms=8, zorder=6)
            labels.place(above, f"{number}: vehicle {event.sysid}", (float(place[1]), float(place[0])))
    chart.label(above, labels)
    return figure


def _heights(axes: Axes, recording: Recording, t_s: Array, places: Array, planned: tuple[Array, Array] | None) -> None:
    if recording.plan is not None:
        terrain = recording.plan.scenario.terrain
        under = ground_height_m(terrain, places[..., 0], places[..., 1])  # (V, N)
        ground = np.max(np.where(np.isnan(under), -np.inf, under), axis=0)
        ground = np.where(np.isfinite(ground), ground, np.nan)
        least = min(0.0, float(np.nanmin(ground)))
        axes.fill_between(t_s, least, ground, color="saddlebrown", alpha=0.3, lw=0, label="highest ground below")
    for colour, track in zip(colours(recording.sysids), places, strict=True):
        axes.plot(t_s, -track[:, 2], color=colour, lw=1.2)
    for track in planned[0] if planned else ():
        axes.plot(t_s, -track[:, 2], **PLANNED)
    axes.set(ylabel="height, m" if recording.plan else "height above\nthe start, m")
    if recording.plan is not None:
        axes.set_ylim(top=axes.get_ylim()[1] + 0.3 * np.ptp(axes.get_ylim()))
        axes.legend(fontsize=8, loc="upper right")


def _errors(axes: Axes, recording: Recording, t_s: Array, off_m: Array) -> None:
    for colour, off in zip(colours(recording.sysids), off_m, strict=True):
        axes.plot(t_s, np.linalg.norm(off, axis=1), color=colour, lw=1.0)
    axes.set(ylabel="position error, m")
    if np.nanmax(off_m, initial=0.0) > _FAR_M:
        axes.set(yscale="log", ylim=(0.01, None))
    else:
        axes.set(ylim=(0.0, None))


def _mark(panels: list[Axes], events: list[Event], span_s: float) -> None:
    groups: list[list[int]] = []
    for n, event in enumerate(events):
        for axes in panels:
            axes.axvline(event.t_s, color="black", lw=0.6, ls=":")
        if groups and event.t_s - events[groups[-1][0]].t_s <= _TOGETHER * span_s:
            groups[-1].append(n)
        else:
            groups.append([n])
    for group in groups:
        label = str(group[0] + 1) + (f"–{group[-1] + 1}" if len(group) > 1 else "")
        where = (events[group[0]].t_s, 1.0)
        panels[0].annotate(label, where, xycoords=("data", "axes fraction"), ha="center", va="bottom", fontsize=7)


def _listed(events: list[Event]) -> str:
    shown = events if len(events) <= _LISTED else events[: _LISTED - 1]
    columns = 1 if len(shown) <= _ONE_COLUMN else 2
    width = _WIDTH // columns
    lines = [textwrap.shorten(f"{n}: {event}", width, placeholder=" ...") for n, event in enumerate(shown, start=1)]
    if len(shown) < len(events):
        lines.append(f"and {len(events) - len(shown)} more: see `gcs replay`")
    rows = -(-len(lines) // columns)
    beside = [*lines[rows:], ""] if columns == 2 else [""] * rows
    return "\n".join(f"{a:<{width + 2}}{b}".rstrip() for a, b in zip(lines[:rows], beside, strict=False))
