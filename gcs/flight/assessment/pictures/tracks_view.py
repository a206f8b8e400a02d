"""Tracks in 3D over the ground in bands of height, with no-fly zones, and close-ups of where something happens."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.colors import LightSource, Normalize
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from mpl_toolkits.mplot3d.proj3d import proj_transform

from gcs.flight.assessment.pictures.close_ups import close_ups, draw_close_up, label_close_up
from gcs.flight.assessment.pictures.figure_file import colours, head, settle
from gcs.flight.assessment.pictures.flight_map import FlightMap, vehicle_entries
from gcs.flight.assessment.pictures.label_places import Labels
from gcs.flight.assessment.pictures.map_layers import (
    ARROW,
    KEEP_IN,
    WIND,
    ZONE,
    Area,
    ground_grid,
    levels_m,
    outlines,
    wind_entry,
    zone_entry,
)
from gcs.physics.quadrotor import Array
from gcs.plan.formation.changes.timeline import Move
from gcs.scenario.environment.no_fly import zones
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import KeepIn, Scenario

_HIGH = 0.25  # height of the box over its longer side
_TICKS = 4
_PANEL_IN, _BETWEEN_IN = (4.3, 2.2), 0.95  # a close-up, and the room of its titles
_CELLS = 101  # of the ground along a side
_BAND = 0.84  # how dark every other band of heights is
_LEVEL = (0.93, 0.92, 0.88)  # the colour of level ground
_WIND = 0.18  # length of the arrow over the shorter side
_CORNERS = 49  # of a zone in 3D, at most


def draw_tracks(
    scenario: Scenario, sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array, moves: tuple[Move, ...] = ()
) -> Any:
    """Return a 3D view of tracks (V, N, 3) at plan times (N,), heights exaggerated, with close-ups beside it."""
    stretches = close_ups(scenario, sysids, t_s, tracks_ned_m, moves)
    rows = max(len(stretches), 2)
    figure = plt.figure(figsize=(13.0, rows * (_PANEL_IN[1] + _BETWEEN_IN)), layout="constrained")
    grid = figure.add_gridspec(rows, 2, width_ratios=(1.7, 1))
    axes: Any = figure.add_subplot(grid[:, 0], projection="3d", computed_zorder=False)
    chart = FlightMap(scenario, sysids, t_s, tracks_ned_m)
    _draw_in_space(axes, chart, scenario)
    panels = [figure.add_subplot(grid[row, 1]) for row in range(len(stretches))]
    for panel, stretch in zip(panels, stretches, strict=True):
        draw_close_up(panel, scenario, sysids, t_s, tracks_ned_m, stretch, _PANEL_IN)
    settle(figure)
    labels = Labels(figure)
    for mark_s, (north, east, down) in zip(*chart.marks(), strict=True):
        right, up, _ = proj_transform(east, north, -down, axes.get_proj())
        labels.place(axes, f"{mark_s:.0f} s", (float(right), float(up)))
    for panel, stretch in zip(panels, stretches, strict=True):
        label_close_up(panel, labels, sysids, t_s, tracks_ned_m, stretch)
    return figure


def _draw_in_space(axes: Any, chart: FlightMap, scenario: Scenario) -> None:
    sysids, tracks_ned_m, span_s = chart.sysids, chart.tracks_ned_m, (float(chart.t_s[0]), float(chart.t_s[-1]))
    low, high = area = chart.area
    lowest_m, top_m = _draw_ground(axes, scenario, area), float(np.nanmax(-tracks_ned_m[..., 2]))
    for zone in zones(scenario):
        colour = KEEP_IN if isinstance(zone, KeepIn) else ZONE
        for corners in outlines(zone, span_s):
            _draw_zone(axes, scenario, np.clip(corners, low, high), top_m, colour)
    for colour, track in zip(colours(sysids), tracks_ned_m, strict=True):
        under_m = ground_height_m(scenario.terrain, track[:, 0], track[:, 1])
        axes.plot(track[:, 1], track[:, 0], under_m, color="black", lw=0.5, alpha=0.35, zorder=8)
        axes.plot(track[:, 1], track[:, 0], -track[:, 2], color=colour, lw=1.4, zorder=9)
    _, places = chart.marks()
    look = {"ls": "", "marker": "o", "ms": 4.5, "mfc": "white", "mec": "black", "mew": 0.6, "zorder": 10}
    axes.plot(places[:, 1], places[:, 0], -places[:, 2], **look)
    _draw_wind(axes, scenario, area, tracks_ned_m[..., :2], top_m)
    sides_m = (high - low)[::-1] / float(np.max(high - low))
    height_m = max(top_m, axes.get_zlim()[1]) - lowest_m
    times = _HIGH * float(np.max(high - low)) / height_m
    axes.set(xlim=(low[1], high[1]), ylim=(low[0], high[0]), zlim=(lowest_m, lowest_m + height_m))
    axes.set_xlabel("east, m", labelpad=16.0)
    axes.set_ylabel("north, m", labelpad=16.0)
    axes.set_zlabel("height, m", labelpad=2.0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(_TICKS))
    axes.set_box_aspect((*sides_m, _HIGH), zoom=1.1)
    axes.view_init(elev=35, azim=-60)
    entries = [*vehicle_entries(sysids), *zone_entry(scenario), wind_entry(scenario, in_space=True)]
    axes.legend(handles=entries, fontsize=8, loc="upper left", ncols=2)
    head(axes, f"{scenario.title or scenario.name}\n(heights are drawn {times:.1f} times as large)", 7.0)


def _draw_wind(axes: Any, scenario: Scenario, area: Area, flat_ned_m: Array, top_m: float) -> None:
    """Draw an arrow along the wind, as high as the highest track, over the corner that is farthest from all tracks."""
    if scenario.wind is None or scenario.wind.speed_mps == 0.0:
        return
    low, high = area
    length_m = _WIND * float(np.min(high - low))
    corners = [np.array([north, east]) for north in (low[0], high[0]) for east in (low[1], high[1])]
    corners = [corner + np.where(corner == low, 1.0, -1.0) * 0.7 * length_m for corner in corners]
    away_m = [np.nanmin(np.linalg.norm(flat_ned_m.reshape(-1, 2) - corner, axis=1)) for corner in corners]
    place = corners[int(np.argmax(away_m))]
    turned = np.asarray(ARROW.transformed(Affine2D().rotate_deg(180.0 - scenario.wind.from_deg)).vertices)
    east, north = (place[::-1] + 0.5 * length_m * turned).T
    outline = list(zip(east, north, np.full(len(east), top_m), strict=True))
    axes.add_collection3d(Poly3DCollection([outline], facecolor=WIND, edgecolor="none", zorder=11))


def _draw_ground(axes: Any, scenario: Scenario, area: Area) -> float:
    """Draw the ground as it is, in bands of height; return its lowest height."""
    north, east, height = ground_grid(scenario, area, _CELLS)
    levels = levels_m(height)
    if len(levels):
        range_m = Normalize(float(height.min()), float(height.max()))
        shade: Any = LightSource(315, 45).shade(
            height, plt.get_cmap("YlOrBr"), norm=range_m, vert_exag=4, blend_mode="soft"
        )
        band = np.searchsorted(levels, height)
        shade[..., :3] *= np.where((band - band.min()) % 2, _BAND, 1.0)[..., None]
        axes.plot_surface(east, north, height, facecolors=shade, rstride=1, cstride=1, linewidth=0, antialiased=False)
    else:
        axes.plot_surface(
            east[::20, ::20], north[::20, ::20], height[::20, ::20], color=_LEVEL, linewidth=0, shade=False
        )
    return float(height.min())


def _draw_zone(axes: Any, scenario: Scenario, corners: Array, top_m: float, colour: str) -> None:
    """Draw a wall around a zone, from the ground to the highest track."""
    corners = corners[np.linspace(0, len(corners) - 1, min(len(corners), _CORNERS)).astype(int)]
    north, east = corners.T
    foot_m = ground_height_m(scenario.terrain, north, east)
    top = np.full_like(foot_m, top_m)
    wall = [
        [
            (east[n], north[n], foot_m[n]),
            (east[n + 1], north[n + 1], foot_m[n + 1]),
            (east[n + 1], north[n + 1], top_m),
            (east[n], north[n], top_m),
        ]
        for n in range(len(north) - 1)
    ]
    faces = Poly3DCollection(wall, facecolor=colour, edgecolor="none", alpha=0.13, zorder=7.5)
    axes.add_collection3d(faces)
    for edge in (foot_m, top):
        axes.plot(east, north, edge, color=colour, lw=1.0, zorder=7.6)
