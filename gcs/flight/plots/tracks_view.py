"""Tracks in 3D over the ground in bands of height, with no-fly zones, and close-ups of changes and narrow places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import LightSource, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from mpl_toolkits.mplot3d.proj3d import proj_transform
from scipy.spatial.distance import pdist

from gcs.flight.plots import map_layers
from gcs.flight.plots.figure_file import NAMED, Labels, Look, colours, head, settle
from gcs.flight.plots.flight_map import FlightMap, vehicle_entries
from gcs.flight.plots.shape_view import dot_pt, view_of
from gcs.flight.recording.recording import nearest_m
from gcs.flight.scene.ground_area import Area, ground_grid, outlines
from gcs.plan.formation.timeline import Move
from gcs.plan.trajectory.distances import zone_distances_m
from gcs.scenario.environment.no_fly import zones
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import KeepIn, Scenario
from gcs.types import Array

_HIGH = 0.25  # height of the box over its longer side; more where that would make heights smaller than they are
_TICKS = 4
_PANEL_IN, _BETWEEN_IN = (4.3, 2.2), 0.95  # a close-up, and the room of its titles
_CELLS = 101  # of the ground along a side
_BAND = 0.84  # how dark every other band of heights is
_LEVEL = (0.93, 0.92, 0.88)  # the colour of level ground
_WIND = 0.18  # length of the arrow over the shorter side
_CORNERS = 49  # of a zone in 3D, at most
MOST = 3
_LEVEL_M = 1.0  # a lower relief is level ground
_AROUND_S = 3.0  # to either side of an instant
_ROOM, _LEAST_ROOM_M = 0.15, 1.0


def draw_tracks(
    scenario: Scenario, sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array, moves: tuple[Move, ...] = ()
) -> Figure:
    """Return a 3D view of tracks (V, N, 3) at plan times (N,), heights exaggerated, with close-ups beside it."""
    stretches = close_ups(scenario, sysids, t_s, tracks_ned_m, moves)
    rows = max(len(stretches), 2)
    figure = plt.figure(figsize=(13.0, rows * (_PANEL_IN[1] + _BETWEEN_IN)), layout="constrained")
    grid = figure.add_gridspec(rows, 2, width_ratios=(1.7, 1))
    axes: Axes3D = figure.add_subplot(grid[:, 0], projection="3d", computed_zorder=False)
    chart = FlightMap(scenario, sysids, t_s, tracks_ned_m)
    _draw_in_space(axes, chart, scenario)
    panels = [figure.add_subplot(grid[row, 1]) for row in range(len(stretches))]
    for panel, stretch in zip(panels, stretches, strict=True):
        draw_close_up(panel, scenario, chart, stretch)
    settle(figure)
    labels = Labels(figure)
    for mark_s, (north, east, down) in zip(*chart.marks(), strict=True):
        right, up, _ = proj_transform(east, north, -down, axes.get_proj())
        labels.place(axes, f"{mark_s:.0f} s", (float(right), float(up)))
    for panel, stretch in zip(panels, stretches, strict=True):
        label_close_up(panel, labels, chart, stretch)
    return figure


def _draw_in_space(axes: Axes3D, chart: FlightMap, scenario: Scenario) -> None:
    sysids, tracks_ned_m, span_s = chart.sysids, chart.tracks_ned_m, (float(chart.t_s[0]), float(chart.t_s[-1]))
    low, high = area = chart.area
    lowest_m, top_m = _draw_ground(axes, scenario, area), float(np.nanmax(-tracks_ned_m[..., 2]))
    for zone in zones(scenario):
        colour = map_layers.KEEP_IN if isinstance(zone, KeepIn) else map_layers.ZONE
        for corners in outlines(zone, span_s):
            _draw_zone(axes, scenario, np.clip(corners, low, high), top_m, colour)
    for colour, track in zip(colours(sysids), tracks_ned_m, strict=True):
        under_m = ground_height_m(scenario.terrain, track[:, 0], track[:, 1])
        axes.plot(track[:, 1], track[:, 0], under_m, color="black", lw=0.5, alpha=0.35, zorder=8)
        axes.plot(track[:, 1], track[:, 0], -track[:, 2], color=colour, lw=1.4, zorder=9)
    _, places = chart.marks()
    look: Look = {"ls": "", "marker": "o", "ms": 4.5, "mfc": "white", "mec": "black", "mew": 0.6, "zorder": 10}
    axes.plot(places[:, 1], places[:, 0], -places[:, 2], **look)
    _draw_wind(axes, scenario, area, tracks_ned_m[..., :2], top_m)
    sides_m = (high - low)[::-1] / float(np.max(high - low))
    height_m = max(top_m, axes.get_zlim()[1]) - lowest_m
    times = max(_HIGH * float(np.max(high - low)) / height_m, 1.0)
    high_box = times * height_m / float(np.max(high - low))
    axes.set(xlim=(low[1], high[1]), ylim=(low[0], high[0]), zlim=(lowest_m, lowest_m + height_m))
    axes.set_xlabel("east, m", labelpad=16.0)
    axes.set_ylabel("north, m", labelpad=16.0)
    axes.set_zlabel("height, m", labelpad=2.0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(_TICKS))
    axes.set_box_aspect((*sides_m, high_box), zoom=1.1)
    axes.view_init(elev=35, azim=-60)
    entries = [
        *vehicle_entries(sysids),
        *map_layers.zone_entry(scenario),
        *map_layers.wind_entry(scenario, in_space=True),
    ]
    axes.legend(handles=entries, fontsize=8, loc="upper left", ncols=2)
    scale = f"heights are drawn {times:.1f} times as large" if times > 1.0 else "true to scale"
    head(axes, f"{scenario.title or scenario.name}\n({scale})", 7.0)


def _draw_wind(axes: Axes3D, scenario: Scenario, area: Area, flat_ned_m: Array, top_m: float) -> None:
    """Draw an arrow along the wind, as high as the highest track, over the corner that is farthest from all tracks."""
    if scenario.wind is None or scenario.wind.speed_mps == 0.0:
        return
    low, high = area
    length_m = _WIND * float(np.min(high - low))
    corners = [np.array([north, east]) for north in (low[0], high[0]) for east in (low[1], high[1])]
    corners = [corner + np.where(corner == low, 1.0, -1.0) * 0.7 * length_m for corner in corners]
    away_m = [np.nanmin(np.linalg.norm(flat_ned_m.reshape(-1, 2) - corner, axis=1)) for corner in corners]
    place = corners[int(np.argmax(away_m))]
    turned = np.asarray(map_layers.ARROW.transformed(Affine2D().rotate_deg(180.0 - scenario.wind.from_deg)).vertices)
    east, north = (place[::-1] + 0.5 * length_m * turned).T
    outline = list(zip(east, north, np.full(len(east), top_m), strict=True))
    axes.add_collection3d(Poly3DCollection([outline], facecolor=map_layers.WIND, edgecolor="none", zorder=11))


def _draw_ground(axes: Axes3D, scenario: Scenario, area: Area) -> float:
    """Draw the ground as it is, in bands of height; return its lowest height."""
    north, east, height = ground_grid(scenario, area, _CELLS)
    levels = map_layers.levels_m(height)
    if len(levels):
        range_m = Normalize(float(height.min()), float(height.max()))
        shade = LightSource(315, 45).shade(height, plt.get_cmap("YlOrBr"), norm=range_m, vert_exag=4, blend_mode="soft")
        band = np.searchsorted(levels, height)
        shade[..., :3] *= np.where((band - band.min()) % 2, _BAND, 1.0)[..., None]
        axes.plot_surface(east, north, height, facecolors=shade, rstride=1, cstride=1, linewidth=0, antialiased=False)
    else:
        axes.plot_surface(
            east[::20, ::20], north[::20, ::20], height[::20, ::20], color=_LEVEL, linewidth=0, shade=False
        )
    return float(height.min())


def _draw_zone(axes: Axes3D, scenario: Scenario, corners: Array, top_m: float, colour: str) -> None:
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


@dataclass(frozen=True)
class CloseUp:
    """Some seconds of a flight."""

    title: str
    begin_s: float
    end_s: float
    at_s: float | None = None  # the instant that it is about; None: the whole of it
    pair: tuple[int, int] | None = None  # rows of the nearest two vehicles

    @classmethod
    def around(cls, title: str, at_s: float, pair: tuple[int, int] | None = None) -> CloseUp:
        """Some seconds before and after an instant."""
        return cls(title, at_s - _AROUND_S, at_s + _AROUND_S, at_s, pair)


def close_ups(
    scenario: Scenario, sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array, moves: tuple[Move, ...]
) -> list[CloseUp]:
    """Return at most three stretches of the mission where something happens; its middle where nothing does."""
    during = (t_s >= 0.0) & (t_s <= scenario.time.flight_s)
    at_s, flown = t_s[during], tracks_ned_m[:, during]
    found = []
    if len(sysids) > 1 and len(at_s):
        least = int(np.nanargmin(nearest_m(flown)))
        gaps = pdist(flown[:, least])
        pair = int(np.nanargmin(gaps))
        first, second = (int(rows[pair]) for rows in np.triu_indices(len(sysids), 1))
        title = f"nearest call: vehicles {sysids[first]} and {sysids[second]}, {gaps[pair]:.2f} m"
        found.append(CloseUp.around(title, float(at_s[least]), (first, second)))
    if (scenario.no_fly or scenario.keep_in) and len(at_s):
        away_m = zone_distances_m(scenario, at_s, flown)
        row, n = np.unravel_index(int(np.nanargmin(away_m)), away_m.shape)
        inside = "inside" if away_m[row, n] < 0.0 else "from"
        zone = "the edge of a zone" if scenario.keep_in else "a no-fly zone"
        title = f"vehicle {sysids[row]}, {abs(away_m[row, n]):.2f} m {inside} {zone}"
        found.append(CloseUp.around(title, float(at_s[n])))
    if len(found) < MOST - len(moves) and len(at_s):
        north, east, down = np.moveaxis(flown, -1, 0)
        ground_m = ground_height_m(scenario.terrain, north, east)
        if np.ptp(ground_m[np.isfinite(ground_m)]) > _LEVEL_M:
            above_m = -down - ground_m
            row, n = np.unravel_index(int(np.nanargmin(above_m)), above_m.shape)
            title = f"vehicle {sysids[row]}, {above_m[row, n]:.2f} m above the ground"
            found.append(CloseUp.around(title, float(at_s[n])))
    changes = [
        CloseUp(f"{move.name}, t = {move.start_s:.0f} to {move.end_s:.0f} s", move.start_s, move.end_s)
        for move in moves
        if move.end_s > move.start_s
    ]
    found = changes[: MOST - len(found)] + found
    return found or [CloseUp.around("the middle of the flight", 0.5 * scenario.time.flight_s)]


def draw_close_up(axes: Axes, scenario: Scenario, chart: FlightMap, what: CloseUp) -> None:
    """Draw a part of the flight: vehicles are hollow where it begins, and filled where it ends.

    It is a map, or a view from the side where the formation stands upright at the end, or at the instant shown.
    """
    t_s, tracks_ned_m = chart.t_s, chart.tracks_ned_m
    during = np.flatnonzero((t_s >= what.begin_s) & (t_s <= what.end_s))
    view = view_of(_places_at(chart, what))
    tracks = view.flat(tracks_ned_m[:, during])
    at = int(np.argmin(np.abs(t_s - what.at_s))) if what.at_s is not None else int(during[-1])
    low, high = np.nanmin(tracks, axis=(0, 1)), np.nanmax(tracks, axis=(0, 1))
    room_m = max(_ROOM * float(np.max(high - low)), _LEAST_ROOM_M)
    scale = float(np.max((high - low + 2.0 * room_m) / np.array(_PANEL_IN)))
    half, middle = 0.5 * scale * np.array(_PANEL_IN), 0.5 * (low + high)
    low, high = middle - half, middle + half
    if not view.is_side:
        map_layers.draw_ground(axes, scenario, (low[::-1], high[::-1]), scale=False)
        map_layers.draw_zones(axes, scenario, (float(t_s[at]), float(t_s[at])))
    dot = dot_pt(len(chart.sysids), 5.5)
    for colour, track, place in zip(colours(chart.sysids), tracks, view.flat(tracks_ned_m[:, at]), strict=True):
        axes.plot(*track.T, color=colour, lw=1.2)
        axes.plot(*track[0], "o", color=colour, mfc="white", ms=0.8 * dot)
        axes.plot(*place, "o", color=colour, ms=dot, zorder=5)
    if what.pair is not None:
        axes.plot(*view.flat(tracks_ned_m[list(what.pair), at]).T, color="black", lw=1.0, zorder=4)
    right, up = view.labels
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel=f"{right}, m")
    axes.set_ylabel("height, m" if view.is_side else f"{up}, m")
    axes.locator_params(nbins=5)
    axes.grid(alpha=0.3)
    when = "" if what.at_s is None else f"\nat t = {what.at_s:.1f} s"
    head(axes, what.title + when + (f", {view.words}" if view.is_side else ""), _PANEL_IN[0], 9.0)


def label_close_up(axes: Axes, labels: Labels, chart: FlightMap, what: CloseUp) -> None:
    """Write the number of every vehicle beside it; of many vehicles those of the nearest two."""
    at_ned_m = _places_at(chart, what)
    places = view_of(at_ned_m).flat(at_ned_m)
    labels.avoid_points(axes, places)
    few = len(chart.sysids) <= NAMED
    rows = range(len(chart.sysids)) if few else what.pair or ()
    for row in rows:
        labels.place(axes, str(chart.sysids[row]), (float(places[row, 0]), float(places[row, 1])), needed=True)


def _places_at(chart: FlightMap, what: CloseUp) -> Array:
    """Where the vehicles are (V, 3) at the instant of a close-up, else at its end."""
    instant_s = what.end_s if what.at_s is None else what.at_s
    return np.asarray(chart.tracks_ned_m[:, int(np.argmin(np.abs(chart.t_s - instant_s)))])
