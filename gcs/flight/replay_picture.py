"""One picture of a recorded flight: ways from above, heights, speeds and distances over time, what was planned beside.

Knows: matplotlib, a recording. Does not know: files of flights, verdicts.
"""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt

from gcs.flight.events import Event
from gcs.flight.pictures import colours, draw_ground_on, draw_ways_on, save
from gcs.flight.recording import Recording, nearest_m
from gcs.quadrotor import Array
from gcs.scenario.terrain import ground_height_m

_INSTANTS = 1500  # at most
_STEP_S = 0.1
_LISTED = 9  # events there is room for
_WIDTH = 92  # letters of a line of them
_PLANNED: dict[str, Any] = {"color": "black", "lw": 0.8, "ls": "--"}


def save_picture(recording: Recording, from_s: float, to_s: float, path: Path) -> None:
    """Draw a stretch of a flight; the file's name says which kind of picture. Raises UsageError."""
    t_s = np.linspace(from_s, to_s, int(np.clip((to_s - from_s) / _STEP_S, 2, _INSTANTS)))
    places, rates = recording.at(t_s)
    planned = recording.planned(t_s)
    events = _worth_marking(recording.events, from_s, to_s)
    figure = plt.figure(figsize=(13.0, 8.2 if events else 7.0), layout="constrained")
    grid = figure.add_gridspec(1 + bool(events), 2, width_ratios=(1.1, 1), height_ratios=(5, 1)[: 1 + bool(events)])
    beside = grid[0, 1].subgridspec(3 + bool(planned), 1)
    first = figure.add_subplot(beside[0])
    panels = [first, *(figure.add_subplot(one, sharex=first) for one in list(beside)[1:])]
    _from_above(figure.add_subplot(grid[0, 0]), recording, places, planned, events)
    _heights(panels[0], recording, t_s, places, planned)
    _speeds(panels[1], recording, t_s, rates, planned)
    _distances(panels[2], recording, t_s, places, planned)
    if planned:
        _errors(panels[3], recording, t_s, places - planned[0])
    for axes in panels:
        axes.grid(alpha=0.3)
        axes.tick_params(labelbottom=axes is panels[-1])
    if events:
        _mark(panels, figure.add_subplot(grid[1, :]), events)
    panels[-1].set(xlim=(from_s, to_s), xlabel="plan time, s" if recording.plan else "time since the log began, s")
    figure.suptitle(f"{recording.name}: flown (lines){' and planned (dashed)' if planned else ''}")
    save(figure, path)


def _from_above(
    axes: Any, recording: Recording, places: Array, planned: tuple[Array, Array] | None, events: list[Event]
) -> None:
    if recording.plan is not None:
        draw_ground_on(axes, recording.plan.scenario, places)
    if planned is not None:
        for track in planned[0]:
            axes.plot(track[:, 1], track[:, 0], **_PLANNED)
    draw_ways_on(axes, recording.sysids, places)
    axes.margins(0.06)
    for number, event in enumerate(events, start=1):
        if event.sysid in recording.sysids:
            place = recording.tracks[recording.sysids.index(event.sysid)].at(np.array([event.t_s]))[0][0]
            if np.isfinite(place).all():
                axes.plot(place[1], place[0], "x", color="black", ms=7)
                axes.annotate(str(number), (place[1], place[0]), xytext=(5, 5), textcoords="offset points", fontsize=8)


def _heights(axes: Any, recording: Recording, t_s: Array, places: Array, planned: tuple[Array, Array] | None) -> None:
    if recording.plan is not None:
        terrain = recording.plan.scenario.terrain
        under = ground_height_m(terrain, places[..., 0], places[..., 1])  # (V, N)
        ground = np.max(np.where(np.isnan(under), -np.inf, under), axis=0)
        ground = np.where(np.isfinite(ground), ground, np.nan)
        least = min(0.0, float(np.nanmin(ground)))
        axes.fill_between(t_s, least, ground, color="saddlebrown", alpha=0.3, lw=0, label="highest ground under them")
        axes.legend(fontsize=8, loc="upper right")
    for colour, track in zip(colours(recording.sysids), places, strict=True):
        axes.plot(t_s, -track[:, 2], color=colour, lw=1.2)
    for track in planned[0] if planned else ():
        axes.plot(t_s, -track[:, 2], **_PLANNED)
    axes.set(ylabel="height, m" if recording.plan else "height above\nthe first place, m")


def _speeds(axes: Any, recording: Recording, t_s: Array, rates: Array, planned: tuple[Array, Array] | None) -> None:
    for colour, sysid, rate in zip(colours(recording.sysids), recording.sysids, rates, strict=True):
        axes.plot(t_s, np.linalg.norm(rate, axis=1), color=colour, lw=1.2, label=f"vehicle {sysid}")
    for rate in planned[1] if planned else ():
        axes.plot(t_s, np.linalg.norm(rate, axis=1), **_PLANNED)
    axes.set(ylabel="speed, m/s", ylim=(0.0, None))


def _distances(axes: Any, recording: Recording, t_s: Array, places: Array, planned: tuple[Array, Array] | None) -> None:
    axes.set(ylabel="nearest two\nvehicles, m")
    if len(recording.tracks) < 2:
        axes.text(0.5, 0.5, "one vehicle", transform=axes.transAxes, ha="center", va="center")
        return
    axes.plot(t_s, nearest_m(places), lw=1.2, label="flown")
    if recording.plan is not None and planned is not None:
        axes.plot(t_s, nearest_m(planned[0]), **_PLANNED, label="planned")
        axes.axhline(recording.plan.scenario.judge.separation_min_m, color="red", lw=0.8, label="asked of the flight")
    axes.set(ylim=(0.0, None))
    axes.legend(fontsize=8, loc="lower right", ncols=3)


def _errors(axes: Any, recording: Recording, t_s: Array, off_m: Array) -> None:
    for colour, off in zip(colours(recording.sysids), off_m, strict=True):
        axes.plot(t_s, np.linalg.norm(off, axis=1), color=colour, lw=1.0)
    axes.set(ylabel="off the plan, m", ylim=(0.0, None))


def _worth_marking(events: tuple[Event, ...], from_s: float, to_s: float) -> list[Event]:
    """Within the stretch; what a vehicle says again and again once."""
    seen: dict[tuple[int, str], Event] = {}
    for event in events:
        if from_s <= event.t_s <= to_s:
            seen.setdefault((event.sysid, event.what), event)
    return list(seen.values())


def _mark(panels: list[Any], below: Any, events: list[Event]) -> None:
    """A dotted line for each event in every panel, and a list of the first of them."""
    for number, event in enumerate(events, start=1):
        for axes in panels:
            axes.axvline(event.t_s, color="black", lw=0.6, ls=":")
        panels[0].annotate(
            str(number), (event.t_s, 1.0), xycoords=("data", "axes fraction"), ha="center", va="bottom", fontsize=7
        )
    below.axis("off")
    lines = [textwrap.shorten(f"{n}  {event}", _WIDTH, placeholder=" ...") for n, event in enumerate(events, start=1)]
    if len(lines) > 2 * _LISTED:
        lines = [*lines[: 2 * _LISTED - 1], f"and {len(lines) - 2 * _LISTED + 1} more: see `gcs replay`"]
    for column in range(2):
        text = "\n".join(lines[column * _LISTED : (column + 1) * _LISTED])
        below.text(0.5 * column, 1.0, text, transform=below.transAxes, va="top", fontsize=8)
