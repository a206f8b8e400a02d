"""One picture of a recorded flight: map, heights, speeds, separation and deviation, flown and planned."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt

from gcs.flight.assessment.flight_plot import colours, draw_ground_on, draw_tracks_on, save
from gcs.flight.progress import Event
from gcs.flight.recording.recording import Recording, nearest_m
from gcs.physics.quadrotor import Array
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.navigation_error import judged_separation_m

_INSTANTS = 1500  # at most
_STEP_S = 0.1
_LISTED = 18  # events in the list at most
_ONE_COLUMN = 6  # events at most with long lines
_LINE_IN = 0.17  # inches of such a line
_WIDTH = 190  # characters of it
_TOGETHER = 0.05  # of the time axis: closer events share a mark
_ROOM, _LEAST_ROOM_M = 0.15, 3.0  # around the tracks: share of their extent, and metres
_FAR_M = 5.0  # a vehicle further off has left the plan
_PLANNED: dict[str, Any] = {"color": "0.75", "lw": 3.5, "zorder": 1}


def save_picture(recording: Recording, from_s: float, to_s: float, path: Path) -> None:
    """Draw a section of a flight, in the format of the file's ending. Raises UsageError."""
    t_s = np.linspace(from_s, to_s, int(np.clip((to_s - from_s) / _STEP_S, 2, _INSTANTS)))
    places, rates = recording.at(t_s)
    planned = recording.planned(t_s)
    events = _worth_marking(recording.events, from_s, to_s)
    lines = _listed(events)
    heights = (7.0, _LINE_IN * lines.count("\n") + 2 * _LINE_IN)[: 1 + bool(events)]
    figure = plt.figure(figsize=(13.0, sum(heights)), layout="constrained")
    grid = figure.add_gridspec(len(heights), 2, width_ratios=(1.1, 1), height_ratios=heights)
    several = len(recording.tracks) > 1
    count = 2 + several + bool(planned)
    beside = grid[0, 1].subgridspec(count, 1)
    first = figure.add_subplot(beside[0])
    panels = [first, *(figure.add_subplot(beside[n], sharex=first) for n in range(1, count))]
    _from_above(figure.add_subplot(grid[0, 0]), recording, places, planned, events)
    _heights(panels[0], recording, t_s, places, planned)
    _speeds(panels[1], recording, t_s, rates, planned)
    if several:
        _distances(panels[2], recording, t_s, places, planned)
    if planned:
        _errors(panels[-1], recording, t_s, places - planned[0])
    for axes in panels:
        axes.grid(alpha=0.3)
        axes.tick_params(labelbottom=axes is panels[-1])
    _mark(panels, events, to_s - from_s)
    if events:
        below = figure.add_subplot(grid[1, :])
        below.axis("off")
        below.text(0.0, 1.0, lines, transform=below.transAxes, va="top", fontsize=7, family="monospace")
    panels[-1].set(xlim=(from_s, to_s), xlabel="plan time, s" if recording.plan else "time since the log began, s")
    figure.suptitle(f"{recording.name}: flown (coloured){' and planned (grey)' if planned else ''}")
    save(figure, path)


def _from_above(
    axes: Any, recording: Recording, places: Array, planned: tuple[Array, Array] | None, events: list[Event]
) -> None:
    low, high = np.nanmin(places, axis=(0, 1)), np.nanmax(places, axis=(0, 1))
    room_m = max(_ROOM * float(np.max((high - low)[:2])), _LEAST_ROOM_M)
    if recording.plan is not None:
        draw_ground_on(axes, recording.plan.scenario, np.stack([low - room_m, high + room_m])[None])
    if planned is not None:
        for track in planned[0]:
            axes.plot(track[:, 1], track[:, 0], **_PLANNED)
    draw_tracks_on(axes, recording.sysids, places, ends=("begin", "end"))
    axes.set(xlim=(low[1] - room_m, high[1] + room_m), ylim=(low[0] - room_m, high[0] + room_m))
    for number, event in enumerate(events, start=1):
        if event.sysid in recording.sysids:
            place = recording.tracks[recording.sysids.index(event.sysid)].at(np.array([event.t_s]))[0][0]
            if np.isfinite(place).all() and event.sysid not in {e.sysid for e in events[: number - 1]}:
                axes.plot(place[1], place[0], "x", color="black", ms=8, zorder=6)
                label = f"{number}: vehicle {event.sysid}"
                axes.annotate(label, (place[1], place[0]), xytext=(8, -10), textcoords="offset points", fontsize=8)


def _heights(axes: Any, recording: Recording, t_s: Array, places: Array, planned: tuple[Array, Array] | None) -> None:
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
        axes.plot(t_s, -track[:, 2], **_PLANNED)
    axes.set(ylabel="height, m" if recording.plan else "height above\nthe start, m")
    if recording.plan is not None:
        axes.set_ylim(top=axes.get_ylim()[1] + 0.3 * np.ptp(axes.get_ylim()))
        axes.legend(fontsize=8, loc="upper right")


def _speeds(axes: Any, recording: Recording, t_s: Array, rates: Array, planned: tuple[Array, Array] | None) -> None:
    for colour, sysid, rate in zip(colours(recording.sysids), recording.sysids, rates, strict=True):
        axes.plot(t_s, np.linalg.norm(rate, axis=1), color=colour, lw=1.2, label=f"vehicle {sysid}")
    for rate in planned[1] if planned else ():
        axes.plot(t_s, np.linalg.norm(rate, axis=1), **_PLANNED)
    axes.set(ylabel="speed, m/s", ylim=(0.0, None))


def _distances(axes: Any, recording: Recording, t_s: Array, places: Array, planned: tuple[Array, Array] | None) -> None:
    axes.set(ylabel="least\nseparation, m")
    flown = nearest_m(places)
    usual_m = (
        float(np.nanquantile(flown, 0.9)) if np.isfinite(flown).any() else 1.0
    )  # after landings the rest is far apart
    axes.plot(t_s, flown, lw=1.2, label="flown")
    if recording.plan is not None and planned is not None:
        expected = nearest_m(planned[0])
        usual_m = max(usual_m, float(np.nanmax(expected, initial=0.0)))
        axes.plot(t_s, expected, **_PLANNED, label="planned")
        axes.axhline(judged_separation_m(recording.plan.scenario), color="red", lw=0.8, label="required")
    axes.set(ylim=(0.0, 1.3 * usual_m))
    axes.legend(fontsize=8, loc="lower right", ncols=3)


def _errors(axes: Any, recording: Recording, t_s: Array, off_m: Array) -> None:
    for colour, off in zip(colours(recording.sysids), off_m, strict=True):
        axes.plot(t_s, np.linalg.norm(off, axis=1), color=colour, lw=1.0)
    axes.set(ylabel="position error, m")
    if np.nanmax(off_m, initial=0.0) > _FAR_M:
        axes.set(yscale="log", ylim=(0.01, None))
    else:
        axes.set(ylim=(0.0, None))


def _worth_marking(events: tuple[Event, ...], from_s: float, to_s: float) -> list[Event]:
    """The events within the section; repeated ones of a vehicle once."""
    seen: dict[tuple[int, str], Event] = {}
    for event in events:
        if from_s <= event.t_s <= to_s:
            seen.setdefault((event.sysid, event.what), event)
    return list(seen.values())


def _mark(panels: list[Any], events: list[Event], span_s: float) -> None:
    """Draw a dotted line for each event in every panel, and their numbers above the first."""
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
    """The first events, one or two to a line."""
    shown = events if len(events) <= _LISTED else events[: _LISTED - 1]
    columns = 1 if len(shown) <= _ONE_COLUMN else 2
    width = _WIDTH // columns
    lines = [textwrap.shorten(f"{n}: {event}", width, placeholder=" ...") for n, event in enumerate(shown, start=1)]
    if len(shown) < len(events):
        lines.append(f"and {len(events) - len(shown)} more: see `gcs replay`")
    rows = -(-len(lines) // columns)
    beside = [*lines[rows:], ""] if columns == 2 else [""] * rows
    return "\n".join(f"{a:<{width + 2}}{b}".rstrip() for a, b in zip(lines[:rows], beside, strict=False))
