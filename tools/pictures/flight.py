"""A flight whose shape changes: tracks on the map with the formation drawn every ten seconds, and what changed when.

Maps, size, clearance and separation over time, with a second plan beside.
"""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gcs.plan.trajectory.plan import Plan
from gcs.types import Array
from tools.pictures.measures import clearance_m, nearest_m, places_ned_m, size
from tools.pictures.scenery import ASIDE, LIMIT, chain_lines, colour, draw_ground

_STEP_S = 0.2
_EVERY_S = 10.0


def draw_flight(plan: Plan, beside: Plan | None = None) -> Figure:
    """Map above; size, clearance and nearest vehicles over time below; `beside` is another plan of the same flight."""
    limits = plan.scenario.limits
    t_s = np.arange(0.0, plan.flight_s, _STEP_S)
    shape = np.ptp(limits.east_m) / np.ptp(limits.north_m)
    heights = (9.0 * shape, 1.3, 1.3, 1.3)
    figure = Figure(figsize=(10.5, sum(heights) + 2.0), layout="constrained")
    panels = figure.subplots(4, 1, gridspec_kw={"height_ratios": heights})
    _draw_map(panels[0], figure, plan, beside, t_s)
    for axes, (name, measure, required) in zip(
        panels[1:],
        (
            ("size, of that\nat t = 0", size, None),
            ("clearance, m", clearance_m, limits.clearance_min_m),
            ("nearest two\nvehicles, m", nearest_m, limits.separation_min_m),
        ),
        strict=True,
    ):
        if beside is not None:
            axes.plot(t_s, measure(beside, t_s), "--", color=ASIDE, lw=1.2, label="rigid")
        axes.plot(t_s, measure(plan, t_s), color="black", lw=1.6, label="planned")
        if required is not None:
            axes.axhline(required, color=LIMIT, lw=1.0, ls=":", label=f"required: {required:g} m")
        for move in plan.moves:
            axes.axvspan(move.start_s, move.end_s, color="steelblue", alpha=0.15)
        axes.set(ylabel=name, xlim=(0.0, plan.flight_s))
        axes.set_ylim(bottom=0.0)
        axes.grid(alpha=0.25)
        axes.legend(fontsize=8, loc="lower right", ncols=3)
    for axes in panels[1:3]:
        axes.tick_params(labelbottom=False)
    for move in plan.moves:
        panels[1].annotate(
            move.name,
            (0.5 * (move.start_s + move.end_s), 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            fontsize=8,
        )
    panels[-1].set_xlabel("time, s (shaded: the shape changes)")
    return figure


def _draw_map(axes: Any, figure: Any, plan: Plan, beside: Plan | None, t_s: Array) -> None:
    bands = draw_ground(axes, plan.scenario)
    figure.colorbar(bands, ax=axes, label="ground height, m", shrink=0.85, pad=0.01)
    if beside is not None:
        track = places_ned_m(beside, t_s)[beside.leader]
        label = f"leader of the rigid formation: cost {beside.objective:.3f}"
        axes.plot(track[:, 0], track[:, 1], "--", color="black", lw=1.3, label=label)
        _draw_formations(axes, beside, ASIDE)
    for row, (sysid, track) in enumerate(zip(plan.sysids, places_ned_m(plan, t_s), strict=True)):
        axes.plot(track[:, 0], track[:, 1], color=colour(row), lw=1.0, label=f"vehicle {sysid}")
    _draw_formations(axes, plan, "black")
    axes.set_title(f"{plan.scenario.title or plan.scenario.name}\ncost {plan.objective:.3f}", fontsize=11)
    axes.legend(fontsize=8, loc="upper left", ncols=2)


def _draw_formations(axes: Any, plan: Plan, paint: str) -> None:
    """The positions of all vehicles every ten seconds."""
    for t in np.arange(0.0, plan.flight_s + 1e-6, _EVERY_S):
        places = places_ned_m(plan, np.array([t]))[:, 0]
        axes.plot(*chain_lines(places), color=paint, lw=0.7, zorder=4)
        axes.plot(places[:, 0], places[:, 1], "o", color=paint, ms=2.0, zorder=4)
