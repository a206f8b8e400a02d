"""Figs. 6 to 22: tracks over their ground, and time histories of all vehicles with their limits."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from gcs.flight.plots.flight_plot import draw_formation, draw_map
from gcs.flight.plots.tracks_view import draw_tracks
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tools.paper.track import ENDS_S, Track
from tools.pictures.scenery import LIMIT, colour

_DPI, _ASPECTS = 85, ("equal", "auto", "equal")
_THICK, _THINNER = 4.5, 0.7  # vehicles that do the same are seen as rims of each other
CAPTIONS = {
    6: "one vehicle from above, by the weight Q",
    7: "the same in 3D, and its height before the arrival",
    8: "Simulation 1 in 3D over its ground",
    9: "Simulation 1 from above",
    10: "pitch and roll in Simulation 1",
    11: "the formation of Simulation 1 close up, seen from its leader",
    12: "U1 in Simulation 1",
    13: "U2, U3 and U4 in Simulation 1",
    14: "v_x, v_y and v_z in Simulation 1",
    15: "Simulation 2 in 3D over its ground",
    16: "Simulation 2 from above",
    17: "pitch and roll in Simulation 2",
    18: "v_x, v_y and v_z in Simulation 2",
    19: "U1 in Simulation 2",
    20: "U2, U3 and U4 in Simulation 2",
    21: "the tracks of PSO in 3D",
    22: "the tracks of PSO from above, our leader dashed",
}


def save(figure: Any, folder: Path, number: int) -> None:
    """Write figure `number` of the page; the same numbers give the same file."""
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / f"fig{number:02d}.png", dpi=_DPI, metadata={"Software": None})
    plt.close(figure)


def weights(tracks: dict[str, Track], bent: Sequence[Track], bent_deg: float, folder: Path) -> None:
    """Figs. 6 and 7: the flights by Q, and the same with a smaller heading scale."""
    figure = Figure(figsize=(12.0, 4.4), layout="constrained")
    titles = ("whole flight", "last 60 s", f"whole flight, heading scale {bent_deg:g}°")
    panels, flights = figure.subplots(1, 3), (tracks.values(), tracks.values(), bent)
    for axes, title, drawn, last_s, aspect in zip(panels, titles, flights, (1e3, 60.0, 1e3), _ASPECTS, strict=True):
        for row, (q, track) in enumerate(zip(tracks, drawn, strict=True)):
            north, east = track.states[track.last(last_s), :2].T
            axes.plot(east, north, color=colour(row), lw=1.5, label=f"Q = {q}")
        axes.set(xlabel="east, m", ylabel="north, m", title=title, aspect=aspect)
        axes.grid(alpha=0.3)
    panels[0].legend(fontsize=8)
    save(figure, folder, 6)
    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    above: Any = figure.add_subplot(1, 2, 1, projection="3d")
    profile = figure.add_subplot(1, 2, 2)
    for row, (q, track) in enumerate(tracks.items()):
        above.plot(track.states[::20, 1], track.states[::20, 0], track.height_m[::20], color=colour(row))
        part = track.last(60.0)
        profile.plot(track.end_s - track.t_s[part], track.height_m[part], color=colour(row), label=f"Q = {q}")
    above.set(xlabel="east, m", ylabel="north, m", zlabel="height, m")
    above.set_box_aspect((1, 1, 0.6), zoom=0.85)
    profile.set(xlabel="time before the arrival, s", ylabel="height, m", xlim=(60.0, 0.0))
    profile.grid(alpha=0.3)
    profile.legend(fontsize=8)
    save(figure, folder, 7)


def simulation(track: Track, numbers: dict[str, int], folder: Path) -> None:
    """A simulation's figures, whose numbers go by: tracks, formation, attitude, thrust, moments, velocity."""
    plan, part = track.plan, np.append(np.arange(0, len(track.t_s) - 1, 5), len(track.t_s) - 1)
    places = track.places_ned_m[:, part]
    over_ground(plan.scenario, track.t_s[part], places, numbers["tracks"], folder)
    if "formation" in numbers:
        save(draw_formation(plan.scenario, plan.sysids, track.t_s[part], places), folder, numbers["formation"])
    degrees, u, (u2, u3, u4) = np.degrees(track.all_states[..., 6:9]), track.all_controls, track.torque
    roll, pitch, _ = track.limits.roll_pitch_yaw_deg
    curves: dict[str, list[tuple[str, Array, float, float]]] = {
        "attitude": [("pitch, deg", degrees[..., 1], -pitch, pitch), ("roll, deg", degrees[..., 0], -roll, roll)],
        "thrust": [("U1, N", u[..., 0], *track.limits.thrust_N)],
        "moments": [("U2, N", u[..., 1], -u2, u2), ("U3, N", u[..., 2], -u3, u3), ("U4, N m", u[..., 3], -u4, u4)],
        "velocity": [
            (f"v_{axis}, m/s", track.all_states[..., 3 + i], -track.limits.speed_ned_mps[i], top)
            for i, (axis, top) in enumerate(zip("xyz", track.limits.speed_ned_mps, strict=True))
        ],
    }
    for what, drawn in curves.items():
        save(_histories(track, drawn), folder, numbers[what])


def over_ground(
    scenario: Scenario, t_s: Array, tracks: Array, number: int, folder: Path, beside: Array | None = None
) -> None:
    """Figure `number` in 3D and the next from above; `beside` is one more track (N, 3), dashed."""
    save(draw_tracks(scenario, scenario.formation.sysids, t_s, tracks), folder, number)
    figure = draw_map(scenario, scenario.formation.sysids, t_s, tracks)
    if beside is not None:
        axes = figure.axes[0]
        axes.plot(beside[:, 1], beside[:, 0], "k--", lw=1.2, label="our leader")
        if (legend := axes.get_legend()) is not None:
            axes.add_artist(legend)
        axes.legend(handles=axes.lines[-1:], fontsize=8, loc="lower right")
    save(figure, folder, number + 1)


def _histories(track: Track, curves: list[tuple[str, Array, float, float]]) -> Figure:
    """Values (V, N) of every vehicle between their limits, and close up."""
    figure = Figure(figsize=(9.0, 1.2 + 1.7 * len(curves)), layout="constrained")
    panels = figure.subplots(len(curves), 2, sharex=True, squeeze=False)
    for (whole, near), (name, values, low, high) in zip(panels, curves, strict=True):
        for axes in (whole, near):
            for row, sysid in enumerate(track.plan.sysids):
                width = _THICK - _THINNER * row
                axes.plot(track.t_s[::2], values[row, ::2], color=colour(row), lw=width, label=f"vehicle {sysid}")
            axes.grid(alpha=0.3)
        between, room = values[:, track.cruise], 0.08 * (high - low)
        whole.set(ylabel=name, ylim=(low - room, high + room))
        near.set_ylim(between.min() - 0.2 * np.ptp(between), between.max() + 0.2 * np.ptp(between))
        for axes in (whole, near):
            inside = [bound for bound in (low, high) if axes.get_ylim()[0] <= bound <= axes.get_ylim()[1]]
            for bound in inside:
                axes.axhline(bound, color=LIMIT, lw=1.2, ls="--")
    panels[0, 0].set_title("with its limits (dashed)", fontsize=9)
    panels[0, 1].set_title(f"close up, as between the first and the last {ENDS_S:g} s", fontsize=9)
    panels[0, 0].plot([], [], color=LIMIT, lw=1.2, ls="--", label="limit, Eq. 51")
    for axes in panels[-1]:
        axes.set_xlabel("time, s")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, ncols=len(labels), loc="outside lower center", frameon=False)
    return figure
