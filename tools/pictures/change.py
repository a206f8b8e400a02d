"""One change of shape in the formation's own frame, as the paper's Figs. 3 and 4 draw it.

Places before and after, the paths of all vehicles between them, the information graph, and the paper's speeds beside
the flown ones.
"""

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib import patheffects
from matplotlib.figure import Figure

from gcs.plan.formation.graph import information_graph
from gcs.plan.formation.timeline import Move
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array
from tools.pictures.scenery import ASIDE, LIMIT, colour

_INSTANTS = 301
_TICKS = 12  # marks on a track, at equal times
_LEVEL_M = 0.01  # less than this is not a change of height
_AWAY = 0.045  # of the picture: an id from its place
_SIDES = np.array([(np.cos(a), np.sin(a)) for a in np.radians(np.arange(22.5, 360.0, 45.0))])  # north, east
_EQUATION = {"rotate": "Eq. 8", "shrink": "Eq. 12", "reshape": "Eq. 14"}
_HALO = [patheffects.withStroke(linewidth=2.5, foreground="white")]


def draw_change(plan: Plan, move: Move) -> Figure:
    """Tracks from above; over time: distance to the leader, height above it where it changes, speed in the shape."""
    t_s = np.linspace(move.start_s, np.nextafter(move.end_s, move.start_s), _INSTANTS)
    offsets = plan.offsets(t_s)
    climbs = bool(np.ptp(offsets[..., 2], axis=1).max() > _LEVEL_M)
    figure = Figure(figsize=(11.0, 6.4 if climbs else 5.6), layout="constrained")
    grid = figure.add_gridspec(3 if climbs else 2, 2, width_ratios=(1.15, 1.0))
    _draw_tracks(figure.add_subplot(grid[:, 0]), plan, offsets)
    panels = [figure.add_subplot(grid[i, 1]) for i in range(3 if climbs else 2)]
    for before, after in pairwise(panels):
        before.sharex(after)
        before.tick_params(labelbottom=False)
    _draw_curves(panels[0], t_s, np.linalg.norm(offsets, axis=2), "distance to the leader, m")
    if climbs:
        _draw_curves(panels[1], t_s, -offsets[..., 2], "height above the leader, m")
    _draw_speeds(panels[-1], plan, move, t_s)
    figure.suptitle(_title(move), fontsize=11)
    return figure


def _title(move: Move) -> str:
    return (
        f"{move.name} ({move.trigger}): {move.start_s:.1f} s … {move.end_s:.1f} s, {move.way}\n"
        f"flown in {move.end_s - move.start_s:.1f} s (limited by {move.limited_by}); t_min of {_EQUATION[move.kind]}: "
        f"{move.paper_time_s:.1f} s; nearest two vehicles {move.least_gap_m:.2f} m"
    )


def _draw_tracks(axes: Any, plan: Plan, offsets: Array) -> None:
    """From above: hollow where a vehicle was, full where it goes, a mark every twelfth of the time."""
    listening = []
    for instant, style, name in ((0, ":", "before"), (-1, "-", "after")):
        places = offsets[:, instant]
        edges = information_graph(plan.scenario.formation.topology, places, plan.leader).edges
        lines = np.linspace(places[edges[:, 0], :2], places[edges[:, 1], :2], _TICKS, axis=1)  # (E, ticks, 2)
        listening.append(lines.reshape(-1, 2))
        for number, line in enumerate(lines):
            label = f"information graph, {name}" if number == 0 else None
            axes.plot(line[:, 1], line[:, 0], style, color=ASIDE, lw=0.8, zorder=1, label=label)
    for row, way in enumerate(offsets):
        paint = colour(row)
        axes.plot(way[:, 1], way[:, 0], color=paint, lw=1.6, zorder=2)
        axes.plot(way[:: _INSTANTS // _TICKS, 1], way[:: _INSTANTS // _TICKS, 0], ".", color=paint, ms=5, zorder=2)
        axes.plot(way[0, 1], way[0, 0], "o", mfc="white", mec=paint, ms=8, mew=1.6, zorder=3)
        axes.plot(way[-1, 1], way[-1, 0], "o", color=paint, ms=8, zorder=4)
    for style, name in (("white", "place before"), ("black", "place after")):
        axes.plot([], [], "o", mfc=style, mec="black", ms=8, label=name)
    _write_ids(axes, plan, offsets, np.concatenate(listening))
    axes.set(xlabel="east of the leader, m", ylabel="north of the leader, m", aspect="equal", adjustable="datalim")
    axes.margins(0.15)
    axes.grid(alpha=0.25)
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, frameon=False)


def _write_ids(axes: Any, plan: Plan, offsets: Array, lines: Array) -> None:
    """Beside every place, on the side where most room is left by lines (L, 2), tracks, places and other ids."""
    taken = [*lines, *offsets[:, :: _INSTANTS // _TICKS, :2].reshape(-1, 2)]
    away_m = _AWAY * float(np.ptp(offsets[..., :2], axis=(0, 1)).max())
    for places, how in ((offsets[:, -1], {"weight": "bold"}), (offsets[:, 0], {"style": "italic"})):
        for row, (sysid, place) in enumerate(zip(plan.sysids, places[:, :2], strict=True)):
            if how.get("style") and np.allclose(place, offsets[row, -1, :2]):
                continue  # it has not moved, and has its id
            room = [np.linalg.norm(np.array(taken) - place - away_m * side, axis=1).min() for side in _SIDES]
            spot = place + away_m * _SIDES[int(np.argmax(room))]
            taken.append(spot)
            axes.text(
                *spot[::-1],
                str(sysid),
                color=colour(row),
                ha="center",
                va="center",
                path_effects=_HALO,
                zorder=5,
                **how,
            )


def _draw_curves(axes: Any, t_s: Array, values: Array, name: str) -> None:
    for row, value in enumerate(values):
        axes.plot(t_s, value, color=colour(row), lw=1.4)
    axes.set_title(name, fontsize=9)
    axes.grid(alpha=0.25)
    axes.margins(x=0.02)


def _draw_speeds(axes: Any, plan: Plan, move: Move, t_s: Array) -> None:
    """Speeds of all vehicles beside the paper's: the longest path at v_max from the first instant on."""
    speeds = np.linalg.norm(plan.offsets(t_s, 1), axis=2)
    _draw_curves(axes, t_s, speeds, "speed in the shape, m/s")
    v_max = plan.scenario.formation.change_speed_mps
    end_s = move.start_s + move.paper_time_s
    step = ([move.start_s, move.start_s, end_s, end_s], [0.0, v_max, v_max, 0.0])
    axes.plot(*step, "--", color=LIMIT, lw=1.2, label="longest distance, by the paper")
    axes.set(xlabel="time, s", ylim=(0.0, 1.3 * v_max))
    axes.legend(fontsize=8, loc="upper right")
