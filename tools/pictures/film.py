"""A flight as a film: the formation on the map, the same seen from behind, its size and clearance so far."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.terrain import ground_height_m
from gcs.types import Array
from tools.pictures.measures import clearance_m, places_ned_m, size
from tools.pictures.scenery import LIMIT, chain_lines, colour, draw_ground

_FPS = 10
_DPI = 80
_STEP_S = 0.2
_ASIDE_M = 95.0  # on the map: so far to either side of the start
_BEHIND_M, _RISE_M = 55.0, 42.0  # seen from behind: so far to either side of the leader, and so high


def write_film(plan: Plan, path: Path, frame_s: float = 1.0) -> Path:
    """A GIF with a frame for every `frame_s` of the flight, ten a second."""
    film = _Film(plan)
    writer = PillowWriter(fps=_FPS)
    with writer.saving(film.figure, path, dpi=_DPI):
        for t in np.arange(0.0, plan.flight_s, frame_s):
            film.show(float(t))
            writer.grab_frame()
    return path


class _Film:
    """The figure, drawn once, and what moves in it."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.t_s = np.arange(0.0, plan.flight_s, _STEP_S)
        self.places = places_ned_m(plan, self.t_s)
        self.figure = Figure(figsize=(9.0, 6.8), layout="constrained")
        grid = self.figure.add_gridspec(3, 2, height_ratios=(3.3, 1.0, 1.0), width_ratios=(1.2, 1.0))
        self._map(self.figure.add_subplot(grid[0, :]))
        self._from_behind(self.figure.add_subplot(grid[1:, 0]))
        limits = plan.scenario.limits
        curves = (("size, of that at t = 0", size, None), ("clearance, m", clearance_m, limits.clearance_min_m))
        self.curves = [
            self._curve(self.figure.add_subplot(grid[row + 1, 1]), name, measure(plan, self.t_s), required)
            for row, (name, measure, required) in enumerate(curves)
        ]
        self.show(0.0)
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")  # what moves must not move the axes

    def show(self, t_s: float) -> None:
        """Everything as it is at an instant."""
        until = int(np.searchsorted(self.t_s, t_s, side="right"))
        now = self.places[:, until - 1]
        for tail, track in zip(self.tails, self.places, strict=True):
            tail.set_data(track[:until, 0], track[:until, 1])
        self.chain.set_data(*chain_lines(now))
        self.dots.set_offsets(now[:, :2])
        (_, sizes), (_, clearances) = self.curves
        self.title.set_text(f"t = {t_s:.0f} s, size {sizes[until - 1]:.2f}, clearance {clearances[until - 1]:.1f} m")
        self.seen.set_offsets(np.column_stack([now[:, 1], -now[:, 2]]))
        self._look_at(now)
        for curve, values in self.curves:
            curve.set_data(self.t_s[:until], values[:until])

    def _map(self, axes: Any) -> None:
        draw_ground(axes, self.plan.scenario)
        paints = [colour(row) for row in range(len(self.plan.sysids))]
        self.tails = [axes.plot([], [], color=paint, lw=1.0)[0] for paint in paints]
        (self.chain,) = axes.plot([], [], color="black", lw=0.8)
        self.dots = axes.scatter(*self.places[:, 0, :2].T, c=paints, s=18, zorder=5)
        middle = self.plan.scenario.start.position_m[1]
        axes.set_ylim(middle + _ASIDE_M, middle - _ASIDE_M)
        axes.legend(fontsize=8, loc="upper right")
        self.title = axes.set_title("t")

    def _from_behind(self, axes: Any) -> None:
        scenario = self.plan.scenario
        paints = [colour(row) for row in range(len(self.plan.sysids))]
        self.ground = axes.add_patch(Polygon([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], fc="#d9b38c", ec="saddlebrown"))
        self.seen = axes.scatter(*self.places[:, 0, 1:].T, c=paints, s=24, zorder=5)
        axes.axhline(scenario.limits.height_m[1], color=LIMIT, lw=1.0, ls=":", label="ceiling")
        axes.set(ylim=(0.0, _RISE_M), aspect="equal", xlabel="east, m", ylabel="height, m")
        axes.set_title("from behind, over the ground below each vehicle", fontsize=9)
        axes.legend(fontsize=8, loc="upper center")
        self.behind = axes

    def _look_at(self, places: Array) -> None:
        """The ground along a line through all vehicles from west to east: under each of them it is its own."""
        middle = places[self.plan.leader, 1]
        order = np.argsort(places[:, 1])
        east = np.union1d(np.linspace(middle - _BEHIND_M, middle + _BEHIND_M, 111), places[:, 1])
        north = np.interp(east, places[order, 1], places[order, 0])
        height = ground_height_m(self.plan.scenario.terrain, north, east)
        rim = np.column_stack([east, np.minimum(height, 2.0 * _RISE_M)])
        self.ground.set_xy(np.concatenate([[(east[0], -1.0)], rim, [(east[-1], -1.0)]]))
        self.behind.set_xlim(middle - _BEHIND_M, middle + _BEHIND_M)

    def _curve(self, axes: Any, name: str, values: Array, required: float | None) -> tuple[Any, Array]:
        if required is not None:
            axes.axhline(required, color=LIMIT, lw=1.0, ls=":", label=f"required: {required:g} m")
            axes.legend(fontsize=8, loc="lower right")
            axes.set_xlabel("time, s")
        else:
            axes.tick_params(labelbottom=False)
        (curve,) = axes.plot([], [], color="black", lw=1.4)
        axes.set(xlim=(0.0, self.plan.flight_s), ylim=(0.0, 1.15 * values.max()))
        axes.set_title(name, fontsize=9)
        axes.grid(alpha=0.25)
        return curve, values
