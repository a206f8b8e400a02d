"""A flight as the paper draws it: tracks over the mountains (Fig. 8), from above (Fig. 9), the formation (Fig. 11).

Knows: matplotlib. Does not know: where tracks come from; planned and flown ones look the same.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from gcs.quadrotor import Array
from gcs.scenario.model import Scenario
from gcs.scenario.terrain import ground_height_m

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.colors import LightSource
from matplotlib.patches import Circle

_COLOURS = ("#d62728", "#1f77b4", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf")
_DPI = 130
_GRID = 301


def draw_all(scenario: Scenario, sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array, folder: Path) -> list[Path]:
    """Write tracks.png, map.png and formation.png of tracks (V, N, 3) at plan times (N,)."""
    pictures = {
        "tracks.png": draw_tracks(scenario, sysids, tracks_ned_m),
        "map.png": draw_map(scenario, sysids, tracks_ned_m),
        "formation.png": draw_formation(scenario, sysids, t_s, tracks_ned_m),
    }
    paths = []
    for name, figure in pictures.items():
        path = folder / name
        figure.savefig(path, dpi=_DPI)
        plt.close(figure)
        paths.append(path)
    return paths


def draw_tracks(scenario: Scenario, sysids: tuple[int, ...], tracks_ned_m: Array) -> Any:
    """3D view over the ground; heights are exaggerated, which the axis says."""
    north, east, height = _ground(scenario, tracks_ned_m)
    figure = plt.figure(figsize=(9.6, 6.0), layout="constrained")
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    shade = LightSource(315, 40).shade(height, plt.get_cmap("gist_earth"), vert_exag=8, vmin=-15, vmax=70)
    axes.plot_surface(east, north, height, facecolors=shade, rstride=2, cstride=2, linewidth=0, antialiased=False)
    for i, (sysid, track) in enumerate(zip(sysids, tracks_ned_m, strict=True)):
        colour = _COLOURS[i % len(_COLOURS)]
        axes.plot(track[:, 1], track[:, 0], -track[:, 2], color=colour, lw=1.4, label=f"vehicle {sysid}", zorder=9)
        axes.plot(track[:, 1], track[:, 0], 0 * track[:, 2], color="black", lw=0.4, alpha=0.4, zorder=8)
    axes.set(xlabel="east, m", ylabel="north, m", zlabel="height, m (exaggerated)", title=scenario.title)
    axes.set_box_aspect((1, 1, 0.28))
    axes.view_init(elev=38, azim=-125)
    axes.legend(loc="upper left", fontsize=8, ncols=2)
    return figure


def draw_map(scenario: Scenario, sysids: tuple[int, ...], tracks_ned_m: Array) -> Any:
    """Plan view, north up, with contour lines, no-fly disks and the box of Eq. 51."""
    north, east, height = _ground(scenario, tracks_ned_m)
    figure, axes = plt.subplots(figsize=(7.2, 6.6), layout="constrained")
    filled = axes.contourf(east, north, height, levels=24, cmap="YlOrBr", alpha=0.8)
    axes.contour(east, north, height, levels=(5, 10, 15, 20, 30, 40, 50), colors="saddlebrown", linewidths=0.5)
    figure.colorbar(filled, label="ground height, m", shrink=0.85)
    for disk in scenario.no_fly:
        axes.add_patch(Circle((disk.east_m, disk.north_m), disk.radius_m, color="red", alpha=0.35))
    for i, (sysid, track) in enumerate(zip(sysids, tracks_ned_m, strict=True)):
        axes.plot(track[:, 1], track[:, 0], color=_COLOURS[i % len(_COLOURS)], lw=1.2, label=f"vehicle {sysid}")
    axes.plot(tracks_ned_m[:, 0, 1], tracks_ned_m[:, 0, 0], "k^", ms=5, label="take-off")
    axes.plot(tracks_ned_m[:, -1, 1], tracks_ned_m[:, -1, 0], "ks", ms=5, label="landing")
    axes.set(xlabel="east, m", ylabel="north, m", title=f"{scenario.name}: from above", aspect="equal")
    axes.legend(fontsize=8, loc="lower right")
    return figure


def draw_formation(scenario: Scenario, sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array) -> Any:
    """The formation from above, relative to its leader, at four instants of the flight."""
    leader = sysids.index(scenario.formation.leader)
    figure, panels = plt.subplots(1, 4, figsize=(11.0, 3.4), sharex=True, sharey=True, layout="constrained")
    for axes, share in zip(panels, (0.0, 1 / 3, 2 / 3, 1.0), strict=True):
        instant = int(np.argmin(np.abs(t_s - share * scenario.time.flight_s)))
        relative = tracks_ned_m[:, instant] - tracks_ned_m[leader, instant]
        for i, (sysid, place) in enumerate(zip(sysids, relative, strict=True)):
            axes.plot(place[1], place[0], "o", ms=9, color=_COLOURS[i % len(_COLOURS)])
            axes.annotate(str(sysid), (place[1], place[0]), xytext=(7, 4), textcoords="offset points", fontsize=8)
        axes.set(title=f"t = {t_s[instant]:.0f} s", xlabel="east of leader, m", aspect="equal")
        axes.grid(alpha=0.3)
        axes.margins(0.25)
    panels[0].set_ylabel("north of leader, m")
    return figure


def _ground(scenario: Scenario, tracks_ned_m: Array) -> tuple[Array, Array, Array]:
    """North, east and height (G, G) of the area of the flight; the ripple, finer than the grid, is left out."""
    limits = scenario.limits
    low = np.minimum([limits.north_m[0], limits.east_m[0]], tracks_ned_m[..., :2].min(axis=(0, 1)))
    high = np.maximum([limits.north_m[1], limits.east_m[1]], tracks_ned_m[..., :2].max(axis=(0, 1)))
    grids = np.meshgrid(np.linspace(low[0], high[0], _GRID), np.linspace(low[1], high[1], _GRID), indexing="ij")
    smooth = scenario.terrain.model_copy(update={"ripple": None})
    return grids[0], grids[1], ground_height_m(smooth, grids[0], grids[1])
