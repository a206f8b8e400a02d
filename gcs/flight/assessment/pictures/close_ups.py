"""The stretches of a flight worth a closer look.

They are changes of shape, the nearest call, the least distance to a zone, and the lowest flight above the ground.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.distance import pdist

from gcs.flight.assessment.pictures.figure_file import NAMED, colours, head
from gcs.flight.assessment.pictures.label_places import Labels
from gcs.flight.assessment.pictures.map_layers import draw_ground, draw_zones
from gcs.flight.recording.recording import nearest_m
from gcs.physics.quadrotor import Array
from gcs.plan.formation.changes.timeline import Move
from gcs.plan.trajectory.distances import zone_distances_m
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario

MOST = 3
_LEVEL_M = 1.0  # a lower relief is level ground
_AROUND_S = 3.0  # to either side of an instant
_ROOM, _LEAST_ROOM_M = 0.15, 1.0


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
    during = np.flatnonzero((t_s >= 0.0) & (t_s <= scenario.time.flight_s))
    found = [_nearest_call(sysids, t_s, tracks_ned_m, during)] if len(sysids) > 1 and len(during) else []
    if (scenario.no_fly or scenario.keep_in) and len(during):
        away_m = zone_distances_m(scenario, t_s[during], tracks_ned_m[:, during])
        row, n = np.unravel_index(int(np.nanargmin(away_m)), away_m.shape)
        inside = "inside" if away_m[row, n] < 0.0 else "from"
        zone = "the edge of a zone" if scenario.keep_in else "a no-fly zone"
        title = f"vehicle {sysids[row]}, {abs(away_m[row, n]):.2f} m {inside} {zone}"
        found.append(CloseUp.around(title, float(t_s[during[n]])))
    if len(found) < MOST - len(moves) and len(during):
        found += _lowest(scenario, sysids, t_s, tracks_ned_m, during)
    changes = [
        CloseUp(f"{move.name}, t = {move.start_s:.0f} to {move.end_s:.0f} s", move.start_s, move.end_s)
        for move in moves
        if move.end_s > move.start_s
    ]
    found = changes[: MOST - len(found)] + found
    return found or [CloseUp.around("the middle of the flight", 0.5 * scenario.time.flight_s)]


def _lowest(scenario: Scenario, sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array, during: Any) -> list[CloseUp]:
    """Where a vehicle passes lowest above ground that is not level."""
    north, east, down = np.moveaxis(tracks_ned_m[:, during], -1, 0)
    ground_m = ground_height_m(scenario.terrain, north, east)
    if not np.ptp(ground_m[np.isfinite(ground_m)]) > _LEVEL_M:
        return []
    above_m = -down - ground_m
    row, n = np.unravel_index(int(np.nanargmin(above_m)), above_m.shape)
    title = f"vehicle {sysids[row]}, {above_m[row, n]:.2f} m above the ground"
    return [CloseUp.around(title, float(t_s[during[n]]))]


def _nearest_call(sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array, during: Any) -> CloseUp:
    n = int(np.nanargmin(nearest_m(tracks_ned_m[:, during])))
    gaps = pdist(tracks_ned_m[:, during[n]])
    pair = int(np.nanargmin(gaps))
    first, second = np.triu_indices(len(sysids), 1)
    rows = int(first[pair]), int(second[pair])
    title = f"nearest call: vehicles {sysids[rows[0]]} and {sysids[rows[1]]}, {gaps[pair]:.2f} m"
    return CloseUp.around(title, float(t_s[during[n]]), rows)


def draw_close_up(
    axes: Any,
    scenario: Scenario,
    sysids: tuple[int, ...],
    t_s: Array,
    tracks_ned_m: Array,
    what: CloseUp,
    size_in: tuple[float, float],
) -> None:
    """Draw a stretch as a map: hollow where vehicles begin it, filled where they end it, or at its instant.

    `size_in` is the width and the height of the axes.
    """
    during = np.flatnonzero((t_s >= what.begin_s) & (t_s <= what.end_s))
    tracks = tracks_ned_m[:, during, 1::-1]
    at = int(np.argmin(np.abs(t_s - what.at_s))) if what.at_s is not None else int(during[-1])
    low, high = _frame(tracks, size_in)
    draw_ground(axes, scenario, (low[::-1], high[::-1]), scale=False)
    draw_zones(axes, scenario, (float(t_s[at]), float(t_s[at])))
    for colour, track, place in zip(colours(sysids), tracks, tracks_ned_m[:, at, 1::-1], strict=True):
        axes.plot(*track.T, color=colour, lw=1.2)
        axes.plot(*track[0], "o", color=colour, mfc="white", ms=4.5)
        axes.plot(*place, "o", color=colour, ms=5.5, zorder=5)
    if what.pair is not None:
        axes.plot(*tracks_ned_m[list(what.pair), at, 1::-1].T, color="black", lw=1.0, zorder=4)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="east, m", ylabel="north, m")
    axes.locator_params(nbins=5)
    axes.grid(alpha=0.3)
    when = "" if what.at_s is None else f"\nat t = {what.at_s:.1f} s"
    head(axes, what.title + when, size_in[0], 9.0)


def _frame(tracks: Array, size_in: tuple[float, float]) -> tuple[Array, Array]:
    """The least and the greatest east and north (2,) around tracks (V, N, 2), with room, that fill axes of a size."""
    low, high = np.nanmin(tracks, axis=(0, 1)), np.nanmax(tracks, axis=(0, 1))
    room_m = max(_ROOM * float(np.max(high - low)), _LEAST_ROOM_M)
    scale = float(np.max((high - low + 2.0 * room_m) / np.array(size_in)))
    half, middle = 0.5 * scale * np.array(size_in), 0.5 * (low + high)
    return middle - half, middle + half


def label_close_up(
    axes: Any, labels: Labels, sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array, what: CloseUp
) -> None:
    """Write the number of every vehicle beside it."""
    instant_s = what.end_s if what.at_s is None else what.at_s
    places = tracks_ned_m[:, int(np.argmin(np.abs(t_s - instant_s))), 1::-1]
    labels.avoid_points(axes, places)
    for sysid, place in zip(sysids, places, strict=True):
        labels.place(axes, str(sysid), (float(place[0]), float(place[1])), needed=len(sysids) <= NAMED)
