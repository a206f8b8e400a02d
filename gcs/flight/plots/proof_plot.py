"""One picture of proved tracks: the map with the nearest calls, and over time separation, height and speed."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gcs.flight.plots import map_layers
from gcs.flight.plots.curves import LIMIT, draw_separation
from gcs.flight.plots.figure_file import BESIDE, NAMED, Labels, colours, head_figure, save, settle
from gcs.flight.plots.flight_map import vehicle_entries
from gcs.flight.scene.ground_area import area_of
from gcs.mission.proving.track import PolynomialTrack
from gcs.mission.proving.track_report import TrackCheck, TrackReport
from gcs.plan.trajectory.constraint_id import Kind
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array

_INSTANTS = 1200
_CURVES_IN, _LEAST_IN = 5.4, 6.0
_CALL = "#c00000"
_MANY: str = "0.45"  # the colour of tracks too many for a legend


def save_proof(tracks: Sequence[PolynomialTrack], report: TrackReport, scenario: Scenario | None, path: Path) -> None:
    """Draw proved tracks in the format of the file's ending. Raises UsageError."""
    save(draw_proof(tracks, report, scenario), path)


def draw_proof(tracks: Sequence[PolynomialTrack], report: TrackReport, scenario: Scenario | None) -> Figure:
    """Return the map of tracks with the nearest call of their separation and every failed check, and their curves."""
    nearest_s = [check.t_s for check in report.checks]
    t_s = np.union1d(np.linspace(report.t_start_s, report.t_end_s, _INSTANTS), nearest_s)
    places, speeds = (np.stack([_at(track, t_s, order) for track in tracks]) for order in (0, 1))
    area = area_of(scenario, places)
    width_in, height_in = map_layers.map_size_in(scenario, area)
    figure = plt.figure(figsize=(width_in + _CURVES_IN, max(height_in, _LEAST_IN)), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=(width_in, _CURVES_IN))
    chart = figure.add_subplot(grid[0])
    several = len(tracks) > 1
    panels: Any = grid[1].subgridspec(2 + several, 1).subplots(sharex=True)
    _draw_map(chart, tracks, t_s, places, scenario)
    calls = [each for each in report.checks if each.vehicles and (each.kind is Kind.SEPARATION or not each.ok)]
    panel = iter(panels)
    if several:
        limit = next((check.limit for check in report.checks if check.kind is Kind.SEPARATION), None)
        _draw_near(next(panel), t_s, places, limit, calls)
    _draw_heights(next(panel), t_s, places, scenario)
    axes = next(panel)
    axes.plot(t_s, np.linalg.norm(speeds, axis=2).max(axis=0), lw=1.2)
    axes.set(ylabel="largest\nspeed, m/s", ylim=(0.0, None))
    for axes in panels:
        for check in calls:
            axes.axvline(check.t_s, color=_CALL, lw=0.7, ls=":")
        axes.set(xlim=(t_s[0], t_s[-1]))
        axes.grid(alpha=0.3)
    panels[-1].set_xlabel("time, s")
    failed = len(report.failures)
    head_figure(
        figure, "proved at every instant" if report.ok else f"NOT proved: {failed} of {len(report.checks)} checks"
    )
    settle(figure)
    labels = Labels(figure)
    _label_calls(chart, labels, calls, tracks)
    if scenario is not None:
        map_layers.label_zones(chart, labels, scenario, (report.t_start_s, report.t_end_s))
    return figure


def _at(track: PolynomialTrack, t_s: Array, derivative: int) -> Array:
    """Places or velocities (N, 3); a vehicle stands before and after its own track."""
    own = track.position_ned_m
    found = np.asarray(own(np.clip(t_s, own.x[0], own.x[-1]), derivative))
    return found if derivative == 0 else np.where(((t_s >= own.x[0]) & (t_s <= own.x[-1]))[:, None], found, 0.0)


def _draw_map(
    axes: Axes, tracks: Sequence[PolynomialTrack], t_s: Array, places: Array, scenario: Scenario | None
) -> None:
    low, high = area_of(scenario, places)
    if scenario is not None:
        map_layers.draw_ground(axes, scenario, (low, high))
        map_layers.draw_zones(axes, scenario, (float(t_s[0]), float(t_s[-1])))
    few = len(tracks) <= NAMED
    ids = tuple(range(len(tracks)))
    tints = colours(ids) if few else [_MANY] * len(tracks)
    for colour, track in zip(tints, places, strict=True):
        axes.plot(track[:, 1], track[:, 0], color=colour, lw=1.1 if few else 0.5)
        axes.plot(track[0, 1], track[0, 0], "^", color=colour, ms=5)
    axes.set(xlabel="east, m", ylabel="north, m", aspect="equal", xlim=(low[1], high[1]), ylim=(low[0], high[0]))
    handles = vehicle_entries(ids, ls="-") if few else []
    for handle, track in zip(handles, tracks, strict=False):
        handle.set_label(track.name)
    layers = map_layers.layer_entries(axes, scenario) if scenario is not None else []
    if handles or layers:
        axes.legend(handles=[*handles, *layers], **BESIDE)


def _draw_near(axes: Axes, t_s: Array, places: Array, limit_m: float | None, calls: Sequence[TrackCheck]) -> None:
    draw_separation(axes, t_s, places, None, limit_m)
    for check in calls:
        if check.kind is Kind.SEPARATION:
            axes.plot(check.t_s, check.seen, "o", ms=4, color=_CALL)


def _draw_heights(axes: Axes, t_s: Array, places: Array, scenario: Scenario | None) -> None:
    """The least height, above the scenario's ground where there is one."""
    up_m = -places[..., 2]
    if scenario is None:
        axes.plot(t_s, up_m.min(axis=0), lw=1.2)
        axes.set(ylabel="least height\nabove height 0, m")
        return
    axes.plot(t_s, (up_m - ground_height_m(scenario.terrain, places[..., 0], places[..., 1])).min(axis=0), lw=1.2)
    axes.axhline(scenario.limits.clearance_min_m, **LIMIT)
    axes.set(ylabel="least height\nabove ground, m")


def _label_calls(axes: Axes, labels: Labels, calls: Sequence[TrackCheck], tracks: Sequence[PolynomialTrack]) -> None:
    """Mark where the vehicles of each call are at its instant."""
    named = {track.name: track for track in tracks}
    for check in calls:
        spots = np.array([_at(named[name], np.array([check.t_s]), 0)[0, 1::-1] for name in check.vehicles])
        axes.plot(spots[:, 0], spots[:, 1], "o-", ms=5, mfc="none", color=_CALL, lw=1.0, zorder=10)
        text = f"{check.name}: {check.seen:.3g} {check.unit}\nat {check.t_s:.1f} s"
        middle = spots.mean(axis=0)
        labels.place(axes, text, (float(middle[0]), float(middle[1])), needed=True, color=_CALL)
