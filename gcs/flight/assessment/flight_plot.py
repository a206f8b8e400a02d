"""Figures of tracks, as in the paper: in 3D over terrain (Fig. 8), as a map (Fig. 9), the formation (Fig. 11)."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from gcs.errors import UsageError
from gcs.files import atomic_write
from gcs.physics.quadrotor import Array
from gcs.scenario.environment.no_fly import displacement_m, outline
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.colors import LightSource
from matplotlib.patches import Polygon

_COLOURS = ("#d62728", "#1f77b4", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf")
DPI = 110
_KINDS = (".png", ".svg", ".pdf")
_GRID = 141
_LEVEL_M = 0.1
NAMED = 12  # vehicles at most in a legend
_CLOSE_UP_S = 6.0


def draw_all(scenario: Scenario, sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array, folder: Path) -> list[Path]:
    """Write tracks.png, map.png and formation.png of tracks (V, N, 3) at plan times (N,); return their paths."""
    pictures = {
        "tracks.png": draw_tracks(scenario, sysids, t_s, tracks_ned_m),
        "map.png": draw_map(scenario, sysids, tracks_ned_m),
        "formation.png": draw_formation(scenario, sysids, t_s, tracks_ned_m),
    }
    for name, figure in pictures.items():
        save(figure, folder / name)
    return [folder / name for name in pictures]


def refuse_kind(path: Path) -> None:
    """Raises UsageError for a file name without the ending of a picture."""
    if path.suffix.lower() not in _KINDS:
        raise UsageError(f"{path} is not the name of a picture.", hint="use a name ending in .png, .svg or .pdf")


def save(figure: Any, path: Path) -> None:
    """Write and close a figure, in the format of the file's ending, whole or not at all. Raises UsageError."""
    drawn = io.BytesIO()
    try:
        refuse_kind(path)
        figure.savefig(drawn, dpi=DPI, format=path.suffix[1:].lower())
    finally:
        plt.close(figure)
    try:
        atomic_write(path, drawn.getvalue())
    except OSError as problem:
        raise UsageError(f"{path} cannot be written: {problem.strerror or problem}.") from None


def draw_tracks(scenario: Scenario, sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array) -> Any:
    """Return a 3D view over the terrain, heights exaggerated, and a close-up of a section of the same tracks."""
    north, east, height = _ground(scenario, tracks_ned_m)
    figure = plt.figure(figsize=(12.0, 5.6), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=(2.3, 1))
    axes: Any = figure.add_subplot(grid[0], projection="3d", computed_zorder=False)
    shade = LightSource(315, 50).shade(height, plt.get_cmap("terrain"), vert_exag=4, vmin=-22, vmax=62)
    axes.plot_surface(east, north, height, facecolors=shade, rstride=1, cstride=1, linewidth=0, antialiased=False)
    for colour, track in zip(colours(sysids), tracks_ned_m, strict=True):
        axes.plot(track[:, 1], track[:, 0], 0 * track[:, 2], color="black", lw=0.4, alpha=0.3, zorder=8)
        axes.plot(track[:, 1], track[:, 0], -track[:, 2], color=colour, lw=1.4, zorder=9)
    axes.set(xlabel="east, m", ylabel="north, m", title=scenario.title)
    axes.set_zlabel("height, m", labelpad=-2.0)
    axes.set_box_aspect((1, 1, 0.25), zoom=1.15)
    axes.view_init(elev=35, azim=-60)
    _draw_close_up(figure.add_subplot(grid[1]), sysids, t_s, tracks_ned_m, 0.5 * scenario.time.flight_s)
    return figure


def _draw_close_up(axes: Any, sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array, middle_s: float) -> None:
    """Draw some seconds of the tracks as a map: from afar they look like one line."""
    during = np.flatnonzero(np.abs(t_s - middle_s) <= _CLOSE_UP_S / 2)
    for colour, sysid, track in zip(colours(sysids), sysids, tracks_ned_m, strict=True):
        axes.plot(track[during, 1], track[during, 0], color=colour, lw=1.3, label=f"vehicle {sysid}")
        axes.plot(track[during[-1], 1], track[during[-1], 0], "o", color=colour, ms=5)
    axes.set(
        xlabel="east, m",
        ylabel="north, m",
        aspect="equal",
        title=f"close up: {_CLOSE_UP_S:g} s at t = {middle_s:.0f} s",
    )
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.02, 1.0), borderaxespad=0.0)


def colours(sysids: tuple[int, ...]) -> list[str]:
    """Return a colour for each vehicle."""
    return [_COLOURS[i % len(_COLOURS)] for i in range(len(sysids))]


def draw_map(scenario: Scenario, sysids: tuple[int, ...], tracks_ned_m: Array) -> Any:
    """Return a map, north up: contour lines, no-fly zones (moving ones at start and end), the box of Eq. 51."""
    figure, axes = plt.subplots(figsize=(7.2, 6.6), layout="constrained")
    draw_map_on(axes, scenario, sysids, tracks_ned_m)
    return figure


def draw_map_on(axes: Any, scenario: Scenario, sysids: tuple[int, ...], tracks_ned_m: Array, style: str = "-") -> None:
    """Draw the same on given axes."""
    draw_ground_on(axes, scenario, tracks_ned_m)
    draw_tracks_on(axes, sysids, tracks_ned_m, style)
    axes.set(title=f"{scenario.name}: map")


def draw_ground_on(axes: Any, scenario: Scenario, tracks_ned_m: Array) -> None:
    """Draw terrain and no-fly zones around tracks (V, N, 3), within the box of Eq. 51, as a map."""
    north, east, height = _ground(scenario, tracks_ned_m)
    if np.ptp(height) > _LEVEL_M:
        filled = axes.contourf(east, north, height, levels=24, cmap="YlOrBr", alpha=0.8)
        axes.contour(east, north, height, levels=(5, 10, 15, 20, 30, 40, 50), colors="saddlebrown", linewidths=0.5)
        axes.figure.colorbar(filled, ax=axes, label="ground height, m", shrink=0.85)
    for zone in scenario.no_fly:
        for moved in displacement_m(zone, np.array([0.0, scenario.time.flight_s])[: 1 + bool(zone.moves)]):
            corners = np.array(outline(zone).exterior.coords) + moved
            axes.add_patch(Polygon(corners[:, ::-1], color="red", alpha=0.35))


def draw_tracks_on(
    axes: Any,
    sysids: tuple[int, ...],
    tracks_ned_m: Array,
    style: str = "-",
    ends: tuple[str, str] = ("take-off", "landing"),
) -> None:
    """Draw tracks (V, N, 3; NaN where unknown) with their ends as a map; the legend is beside it."""
    places = []
    for colour, sysid, track in zip(colours(sysids), sysids, tracks_ned_m, strict=True):
        axes.plot(track[:, 1], track[:, 0], color=colour, lw=1.2, ls=style, label=f"vehicle {sysid}")
        known = track[~np.isnan(track[:, 0])]
        places += [known[[0, -1]]] if len(known) else []
    first, last = np.stack(places, axis=1)
    axes.plot(first[:, 1], first[:, 0], "k^", ms=5, label=ends[0], clip_on=False, zorder=5)
    axes.plot(last[:, 1], last[:, 0], "ks", ms=5, label=ends[1], clip_on=False, zorder=5)
    axes.set(xlabel="east, m", ylabel="north, m", aspect="equal")
    if len(sysids) <= NAMED:
        axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)


def draw_formation(scenario: Scenario, sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array) -> Any:
    """Return the formation relative to its leader, horizontally, at four times of the flight."""
    leader = sysids.index(scenario.formation.leader)
    figure, panels = plt.subplots(1, 4, figsize=(11.0, 3.4), sharex=True, sharey=True, layout="constrained")
    for axes, share in zip(panels, (0.0, 1 / 3, 2 / 3, 1.0), strict=True):
        instant = int(np.argmin(np.abs(t_s - share * scenario.time.flight_s)))
        relative = tracks_ned_m[:, instant] - tracks_ned_m[leader, instant]
        for colour, sysid, place in zip(colours(sysids), sysids, relative, strict=True):
            axes.plot(place[1], place[0], "o", ms=9, color=colour)
            axes.annotate(str(sysid), (place[1], place[0]), xytext=(7, 4), textcoords="offset points", fontsize=8)
        axes.set(title=f"t = {t_s[instant]:.0f} s", xlabel="east of leader, m", aspect="equal")
        axes.grid(alpha=0.3)
        axes.margins(0.25)
    panels[0].set_ylabel("north of leader, m")
    return figure


def _ground(scenario: Scenario, tracks_ned_m: Array) -> tuple[Array, Array, Array]:
    """North, east and height (G, G) of the flight area, without the ripple, which is finer than the grid."""
    limits = scenario.limits
    low = np.minimum([limits.north_m[0], limits.east_m[0]], np.nanmin(tracks_ned_m[..., :2], axis=(0, 1)))
    high = np.maximum([limits.north_m[1], limits.east_m[1]], np.nanmax(tracks_ned_m[..., :2], axis=(0, 1)))
    grids = np.meshgrid(np.linspace(low[0], high[0], _GRID), np.linspace(low[1], high[1], _GRID), indexing="ij")
    smooth = scenario.terrain.model_copy(update={"ripple": None})
    return grids[0], grids[1], ground_height_m(smooth, grids[0], grids[1])
